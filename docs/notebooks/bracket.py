# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Which part of the bracket's pattern around the hole is mere kinematics?
#
# J Figs 11 and 12 show, around the moulded-in hole of a flange, high A_θθ below the hole (θ = 0) and low A_θθ above
# it (θ = 180°), where the two fronts meet again. How much of this would any flow around a round pin give? Potential
# flow around a circle knows nothing of fibres, viscosity or fronts; here it carries planar random fibres past the
# pin.
#
# With a solver run at hand, its flow file stands beside the closed form on the same path:
#
# ```sh
# ppmc run configs/bracket_coarse.yaml
# PPMC_BRACKET_FLOW=runs/bracket_coarse/flow.vtkhdf jupyter lab docs/notebooks/bracket.py
# ```

# %%
import os

import numpy as np

import ppmc
from ppmc.analysis.averages.paths import circle_path
from ppmc.analysis.averages.regions import box
from ppmc.analysis.explore import path_averages, path_figure, region_frame, relabelled, scene_paths
from ppmc.orientation import push_affine
from ppmc.particles import Particles

radius, thickness = 6.35, 5.0  # of the pin and the flange, mm (model: 12.7 mm hole, 5 mm flange)
flow_file = os.environ.get("PPMC_BRACKET_FLOW")
if flow_file:
    print(f"Solver run: {flow_file}, beside the closed form.")
else:
    print("No solver run: PPMC_BRACKET_FLOW names no flow file, so what follows is the closed form alone.")

# %% [markdown]
# ## Material of the flange below the pin, pushed upwards
#
# Complex velocity w = 1 − a²/ζ² with ζ along x3 + i x2; its derivative gives the velocity gradient. Fibres start
# random in the flange's plane, normals along x1. Fourth-order Runge-Kutta carries positions and F.

# %%
rng = np.random.default_rng(1)
count = 24_000
start = np.column_stack([rng.uniform(0, thickness, count), rng.uniform(-17, 17, count), rng.uniform(-48, 20, count)])
start = start[np.hypot(start[:, 1], start[:, 2]) > 1.02 * radius]


def motion(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and velocity gradient at x."""
    zeta = x[:, 2] + 1j * x[:, 1]
    w, dw = 1 - (radius / zeta) ** 2, 2 * radius**2 / zeta**3
    v = np.column_stack([0 * w.real, -w.imag, w.real])
    L = np.zeros((len(x), 3, 3))
    L[:, 1, 1], L[:, 2, 2] = -dw.real, dw.real
    L[:, 1, 2] = L[:, 2, 1] = -dw.imag
    return v, L


x, F = start.copy(), np.broadcast_to(np.eye(3), (len(start), 3, 3)).copy()
h = 0.2
for _ in range(150):
    slopes: list[tuple[np.ndarray, np.ndarray]] = []
    for weight in (0.0, 0.5, 0.5, 1.0):
        xs = x + weight * h * slopes[-1][0] if slopes else x
        Fs = F + weight * h * slopes[-1][1] if slopes else F
        v, L = motion(xs)
        slopes.append((v, L @ Fs))
    x = x + h / 6 * (slopes[0][0] + 2 * slopes[1][0] + 2 * slopes[2][0] + slopes[3][0])
    F = F + h / 6 * (slopes[0][1] + 2 * slopes[1][1] + 2 * slopes[2][1] + slopes[3][1])
print(f"det F: {np.linalg.det(F).min():.4f} to {np.linalg.det(F).max():.4f}")

# %%
angle = rng.uniform(0, np.pi, len(x))
p0 = np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
normal = np.tile([1.0, 0, 0], (len(x), 1))
before = Particles("random", start, np.ones(len(x)), p0, normal)
after = Particles("after potential flow", x, np.ones(len(x)), push_affine(p0, F), normal)

# %% [markdown]
# ## The path around the hole, in cylindrical components

# %%
hole = circle_path(
    "hole", centre=[thickness / 2, 0, 0], axis=[1, 0, 0], zero=[0, 0, -1], inner_radius=radius, outer_radius=11.0,
    height=thickness, points=36, width=10.0,
)  # fmt: skip
path_figure(hole, before, after)

# %%
hoop = path_averages(hole, after).fibre_tensor[:, 1, 1]
print(f"A_θθ below the hole {hoop[0]:.2f}, above it {hoop[18]:.2f}; random fibres: 0.50")
region_frame(after, [box("below", [0, -3, -11], [5, 3, -7]), box("above", [0, -3, 7], [5, 3, 11])])[
    ["region", "particle_count", "A22", "A33", "sd_A22"]
]

# %% [markdown]
# The pattern of A is there already: fibres turn across the flow where it is stopped, and along it where it leaves.
# What potential flow cannot give is the knit line's own signature, normals across the line (high N_θθ at 180°): it
# has no fronts.
#
# ## The same path in the solver run
#
# The paths are those of the scene that the flow file carries; `ppmc analyze` draws them too. J's Figs 13 and 14 are
# the path `base`.

# %%
if flow_file:
    run = ppmc.read(flow_file)
    first, last = relabelled(run[0], "run"), relabelled(run[-1], "run")
    paths = scene_paths(flow_file)
    rings = [path for path in paths.values() if path.components[1] == "θ"]
    for ring in rings:
        averages = path_averages(ring, last)
        A, N = averages.fibre_tensor[:, 1, 1], averages.normal_tensor[:, 1, 1]
        above = len(ring) // 2
        print(
            f"{ring.name}: below the hole A_θθ {A[0]:.2f}, N_θθ {N[0]:.2f}; above it {A[above]:.2f}, {N[above]:.2f}; "
            f"{int((averages.particle_count == 0).sum())} of {len(ring)} regions empty"
        )
else:
    print("Closed form only.")

# %%
path_figure(rings[0], first, last) if flow_file else path_figure(hole, after)

# %%
path_figure(paths["base"], first, last) if flow_file and "base" in paths else None

# %%
assert hoop[0] > 0.8
assert hoop[18] < 0.35

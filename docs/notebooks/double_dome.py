# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Why does the transverse charge of the double dome end at A_aa ≈ 0.7?
#
# D finds that the charge laid across the dome meets the side walls early, then flows along the axis alone, and ends
# at an axial alignment of about 0.7 (D Fig 10). If flow along the axis is all there is, planar random fibres
# stretched by λ have
#
# $$ A_{aa} = \frac{\lambda}{1 + \lambda}, $$
#
# so 0.7 says λ = 7/3: the charge covered about 43 % of the length. This notebook checks the formula on particles that
# lie on a dome-like section, and shows why D6's local axes are needed to see it.
#
# With a solver run at hand, its flow file is set beside the formula at the end:
#
# ```sh
# ppmc part double_dome --spacing 4 --output dome.yaml && ppmc run dome.yaml
# PPMC_DOME_FLOW=runs/double_dome/flow.vtkhdf jupyter lab docs/notebooks/double_dome.py
# ```

# %%
import os

import numpy as np

import ppmc
from ppmc.analysis.averages.local import local_frames, localise, material_normals, turned_to
from ppmc.analysis.averages.paths import swept_path
from ppmc.analysis.explore import path_averages, path_figure, relabelled, scene_paths
from ppmc.orientation import push_affine
from ppmc.particles import Particles

flow_file = os.environ.get("PPMC_DOME_FLOW")
if flow_file:
    print(f"Solver run: {flow_file}, after the closed form.")
else:
    print("No solver run: PPMC_DOME_FLOW names no flow file, so what follows is the closed form alone.")

# %% [markdown]
# ## A prismatic section with slanted walls, covered with planar random fibres
#
# Axis x3, across x1, up x2: a flat top, two walls of 50°, two flanges. One random direction a particle, in the plane
# of the surface at its place.

# %%
rng = np.random.default_rng(2)
count = 24_000
s = rng.uniform(-120, 120, count)
slope = np.where((np.abs(s) > 40) & (np.abs(s) < 90), -np.sign(s) * np.radians(50), 0.0)
across = np.interp(
    s,
    *(
        lambda g: (
            g,
            np.cumsum(np.cos(np.where((np.abs(g) > 40) & (np.abs(g) < 90), np.radians(50), 0))) * (g[1] - g[0]),
        )
    )(np.linspace(-120, 120, 4001)),
)
across -= 0.5 * (across.min() + across.max())
normal = np.column_stack([-np.sin(slope), np.cos(slope), 0 * s])
frames = local_frames(normal, [0, 0, 1])
angle = rng.uniform(0, np.pi, count)
p0 = np.cos(angle)[:, None] * frames[:, 0] + np.sin(angle)[:, None] * frames[:, 1]

# %% [markdown]
# ## Stretch along the axis
#
# The walls stop all motion across; thickness gives way: F = λ a⊗a + t⊗t + λ⁻¹ n⊗n in local axes.

# %%
stretch = 7 / 3
F = np.einsum("nai,a,naj->nij", frames, np.array([stretch, 1.0, 1 / stretch]), frames)
position = np.column_stack([across, 0 * s, rng.uniform(-75, 75, count)])
charge = Particles("charge", position, np.ones(count), p0, normal)
moulded = Particles("stretched by 7/3", position, np.ones(count), push_affine(p0, F), normal)

# %% [markdown]
# ## Global components (D Fig 9): the walls look strange

# %%
path = swept_path(
    "across", along=2, sweep=0, length=150, width=4, centre=0, start=across.min(), stop=across.max(), points=48
)
path_figure(path, charge, moulded)

# %% [markdown]
# ## Local components (D Fig 10): they are as plain as the top
#
# The normal of each region is the platelets' own mean normal here; `ppmc analyze` takes that of the nearest tool.

# %%
normals = turned_to(material_normals(path_averages(path, moulded).normal_tensor), up=[0, 1, 0])
local = localise(path, normals, [0, 0, 1], "the platelets")
path_figure(local, charge, moulded)

# %%
a = path_averages(local, moulded)
share = a.fibre_tensor[:, 0, 0]
print(f"A_aa along the path: mean {np.nanmean(share):.3f}, formula {stretch / (1 + stretch):.3f}")
assert abs(np.nanmean(share) - 0.7) < 0.01
assert np.nanmax(a.fibre_tensor[:, 2, 2]) < 0.05

# %% [markdown]
# ## The solver run
#
# The swept path of the scene that the flow file carries, in local axes from the tools' own normals. λ is how much
# longer the charge has become along x3.

# %%
if flow_file:
    run = ppmc.read(flow_file)
    first, last = relabelled(run[0], "run"), relabelled(run[-1], "run")
    local_run = next(path for name, path in scene_paths(flow_file).items() if name.endswith("_local"))
    found = path_averages(local_run, last)
    grown = np.ptp(last.positions[:, 2]) / np.ptp(first.positions[:, 2])
    print(
        f"λ = {grown:.2f}: formula A_aa = {grown / (1 + grown):.3f}; run, mean over "
        f"{int((found.particle_count > 0).sum())} of {len(local_run)} regions with material: "
        f"{np.nanmean(found.fibre_tensor[:, 0, 0]):.3f}"
    )
else:
    print("Closed form only.")

# %%
path_figure(local_run, first, last) if flow_file else path_figure(local, moulded)

# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # A squeeze in ten lines
#
# A Newtonian block between slip plates spreads evenly: its height falls by $\lambda = h/h_0$ and both other sides grow
# by $\lambda^{-1/2}$. Fibres drawn at random in the plane of $x_1$ and $x_3$ lean over as that plane is stretched by
# $s = \lambda^{-3/2}$ along $x_1$; of planar random fibres $A_{11} = s/(1+s)$ then (J, section II.A, integrated over
# the angle).

# %%
import ppmc

charge = ppmc.Charge.box((10, 10, "8 mm"), spacing=1, orientation=ppmc.PlanarRandom(seed=1, normal=(0, 1, 0)))
lower = ppmc.tools.plane((0, 0, 0), (0, 0, 1), name="lower")
ram = ppmc.tools.plane((0, 0, 8), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, "-4 mm/s"), travel=4), name="ram")
material = ppmc.materials.Newtonian(shear_viscosity="1 Pa*s")
flow = ppmc.solve(charge, [lower, ram], material, end_time="1 s", output_interval="0.25 s")
s = ((8 - 4 * flow.times) / 8) ** -1.5
table = flow.to_pandas()[["time", "press_force", "A11", "A33"]].assign(exact_A11=s / (1 + s))
table

# %%
flow.plot("fibre_direction")

# %% [markdown]
# What is left of the difference is that 800 fibres are not all fibres: the same deformation of just these,
# $p' = Fp/|Fp|$, leaves next to nothing of it. The ram's force is that of the exact flow, $3\eta\dot\varepsilon$ on the
# area of the block:

# %%
import numpy as np

from ppmc.orientation import orientation_tensor, push_affine

stretch = np.diag([0.5**-0.5, 0.5**-0.5, 0.5])
exact = orientation_tensor(push_affine(charge.fibre_direction, np.broadcast_to(stretch, (len(charge), 3, 3))))
force = 3.0 * (4.0 / 4.0) * 100.0 * 2.0  # viscosity, rate at half height, area: Pa mm^2
print(f"A11 {flow[-1].A[0, 0]:.4f}, of these fibres {exact[0, 0]:.4f}, of all {s[-1] / (1 + s[-1]):.4f}")
print(f"force {flow.press_force[-1] / force:.3f} of the exact one; verdict {flow.verdict.headline}")

# %%
assert abs(table["A11"] - table["exact_A11"]).max() < 0.03
assert abs(flow[-1].A - exact).max() < 5e-3
assert abs(flow.press_force[-1] / force - 1) < 0.03

# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # How far can the directions from a CT scan be trusted?
#
# A phantom has known fibre directions and platelet normals. Scan it, analyse it as if it were a specimen, and set the
# orientation tensors beside the truth.

# %%
import tempfile
from pathlib import Path

import numpy as np

import ppmc
from ppmc.analysis.averages.paths import straight_path
from ppmc.analysis.explore import path_figure
from ppmc.analysis.flow.compare import compare_with_truth
from ppmc.analysis.report.tables import truth_table
from ppmc.ct import stage as ct
from ppmc.files import read_voxels
from ppmc.scene import parse_scene

scene = parse_scene("""
name: validation
seed: 3
phantom:
  cavity: [14 mm, 9 mm, 3 mm]
  voxel_size: 0.1 mm
  platelet: {length: 6 mm, width: 3 mm, thickness: 0.6 mm}
  noise: 0.2
ct: {stride: 2}
""")
folder = Path(tempfile.mkdtemp())
volume = ct.make_phantom(scene, folder / "volume.vtkhdf")
measured = ct.run(scene, input=volume, output=folder / "orientations.vtkhdf")

# %% [markdown]
# ## The tensors, away from the faces
#
# Columns `d_` are differences to the truth.

# %%
with read_voxels(volume, "volume") as true_file, read_voxels(measured, "orientations") as ct_file:
    comparison = compare_with_truth(true_file, ct_file, None, [], notes := [])
table = truth_table(comparison.rows)
table[
    ["source", "particle_count", "A11", "A22", "A33", "N33", "d_A11", "d_A22", "d_A33", "d_N33", "largest_difference"]
]

# %% [markdown]
# ## Voxel by voxel

# %%
for name, errors in (("fibre direction", comparison.fibre_errors), ("platelet normal", comparison.normal_errors)):
    print(
        f"{name}: median {errors.percentile(50):.1f}°, 90 % below {errors.percentile(90):.1f}°, "
        f"mean {errors.mean:.1f}°, {errors.count:,} voxels"
    )

# %% [markdown]
# The long tail of single voxels sits at platelet edges, where two directions share one window; averages hardly feel
# it.
#
# ## Along the specimen

# %%
true, found = ppmc.read(volume).particles, ppmc.read(measured).particles
path = straight_path("length", 0, 14, [0, -np.inf, -np.inf], [14, np.inf, np.inf])
path_figure(path, true, found)

# %%
assert comparison.rows[1].largest_difference < 0.05
assert comparison.fibre_errors.percentile(50) < 8

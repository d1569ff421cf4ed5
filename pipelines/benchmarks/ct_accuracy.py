"""Angular errors of ppmc and of peers on plies with known fibre direction and normal, side by side.

    python pipelines/benchmarks/ct_accuracy.py [--voxels 72] [--tilt 16]

Plies at 0/45/90/-45/30/-60/15/75 degrees, streaks of wavelength about 7 voxels in the plane and half of that through
the thickness, resin films one voxel thick; the stack tilted about x and then y. Errors in degrees, median/95 %:
"in" is p well inside plies, "near" p within two voxels of an interface, "wrong" the share of all voxels off by more
than 20 degrees. Peers run with one round window of two voxels, as they offer no other: structure-tensor
(pip install structure-tensor) and scikit-image (Sobel) with NumPy's eigh.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ppmc.ct.noise import noise_level, noise_tensor
from ppmc.ct.orientations import Job, grey_reference, orientations
from ppmc.ct.phantom import Phantom
from ppmc.ct.settings import settings
from ppmc.ct.signal import signal_of
from ppmc.ct.source import Volume
from ppmc.ct.tiles import Tiling
from ppmc.orientation import angle_between_axes
from ppmc.scene.sections.ct import CtSection
from ppmc.scene.sections.phantom import PhantomSection

Array = NDArray[np.float32]
Solver = Callable[[Array, float], tuple[Array, Array]]
ANGLES = [0, 45, 90, -45, 30, -60, 15, 75]
WELL_INSIDE = {16: 4.0, 8: 2.5, 5: 1.5}
MARGIN = 12


def plies(voxels: int, thickness: int, noise: float, tilt: float) -> tuple[dict[str, Array], Array]:
    """Return the fields of the phantom and each voxel's distance from the nearest interface."""
    section = PhantomSection(
        cavity=(voxels, voxels, voxels), voxel_size=1.0, layup="plies", angles=ANGLES, tilt=(tilt, tilt), noise=noise,
        platelet={"length": 4 * thickness, "width": 2 * thickness, "thickness": thickness}, void_fraction=0.0,
        platelet_contrast=0.0, streak_wavelength=7.0, streak_flatness=2.0, resin_thickness=1.0, blur=0.3,
        grey_type="float32",
    )  # fmt: skip
    phantom = Phantom(section, 0)
    slabs = [slab.fields for slab in phantom.slabs()]
    fields = {name: np.concatenate([s[name] for s in slabs]) for name in slabs[0]}
    return fields, distance_from_interface(fields["platelet_id"])


def distance_from_interface(ids: Array) -> Array:
    """Return each voxel's distance from the nearest voxel of another ply, less half a voxel."""
    from scipy.ndimage import distance_transform_edt

    least = np.full(ids.shape, np.inf)
    for ply in np.unique(ids):
        inside = ids == ply
        least = np.where(inside, distance_transform_edt(inside) - 0.5, least)
    return least


def ppmc_plain(grey: Array, thickness: float) -> tuple[Array, Array]:
    """ppmc with the peers' single round window."""
    return solve(grey, CtSection(sigma=1.0, fibre_window=2.0, normal_window=2.0, side_steps=0), None)


def ppmc(grey: Array, thickness: float) -> tuple[Array, Array]:
    """ppmc as it is when only the platelet thickness is known."""
    return solve(grey, CtSection(), thickness)


def ppmc_alone(grey: Array, thickness: float) -> tuple[Array, Array]:
    """ppmc as it is when nothing is known."""
    return solve(grey, CtSection(), None)


def solve(grey: Array, section: CtSection, thickness: float | None) -> tuple[Array, Array]:
    volume = Volume(Path("memory"), grey.shape, grey.dtype, lambda box: grey[box])
    spacing = (1.0, 1.0, 1.0)
    level = noise_level(volume)
    chosen = settings(section, spacing, grey.shape, thickness, signal_of(volume, spacing, level))
    reference = grey_reference(volume)
    noise = noise_tensor(chosen, level / reference.unit)
    job = Job(volume, spacing, chosen, reference, noise=noise)
    p, r = (np.empty((*grey.shape, 3), np.float32) for _ in range(2))
    for block in orientations(job, 2, Tiling(job.shape, job.shape)):
        place = tuple(slice(a, b) for a, b in block.box)
        p[place], r[place] = block.fields["fibre_direction"], block.fields["platelet_normal"]
    return p, r


def structure_tensor(grey: Array, thickness: float) -> tuple[Array, Array]:
    from structure_tensor import eig_special_3d, structure_tensor_3d

    tensor = structure_tensor_3d(grey.astype(np.float32), 1.0, 2.0)
    _, vectors = eig_special_3d(tensor, full=True, eigenvalue_order="desc")
    # vectors[i] are the components (x, y, z) of the i-th eigenvector
    return np.moveaxis(vectors[2], 0, -1), np.moveaxis(vectors[0], 0, -1)


def scikit_image(grey: Array, thickness: float) -> tuple[Array, Array]:
    from skimage.feature import structure_tensor as tensor

    zz, yz, xz, yy, xy, xx = tensor(grey, sigma=2.0)
    full = np.stack([np.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], axis=-1)
    _, vectors = np.linalg.eigh(full)
    return vectors[..., :, 0].astype(np.float32), vectors[..., :, 2].astype(np.float32)


SOLVERS: dict[str, Solver] = {
    "ppmc": ppmc,
    "ppmc, thickness not known": ppmc_alone,
    "ppmc, one round window": ppmc_plain,
    "structure-tensor": structure_tensor,
    "scikit-image + eigh": scikit_image,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--voxels", type=int, default=72)
    parser.add_argument("--tilt", type=float, default=16.0)
    arguments = parser.parse_args()
    print("| plies | noise | method | p in | p near | p all | wrong | r |")
    print("|---|---|---|---|---|---|---|---|")
    inner = (slice(MARGIN, -MARGIN),) * 3
    for thickness in (16, 8, 5):
        for noise in (0.0, 0.3, 1.0):
            fields, distance = plies(arguments.voxels, thickness, noise, arguments.tilt)
            for name, method in SOLVERS.items():
                try:
                    p, r = method(fields["grey"], float(thickness))
                except ImportError as missing:
                    print(f"| {thickness} | {noise} | {name} | not installed: {missing.name} | | | | |")
                    continue
                error = angle_between_axes(p[inner], fields["fibre_direction"][inner])
                tilt = angle_between_axes(r[inner], fields["platelet_normal"][inner])
                away = distance[inner]
                columns = [summary(e) for e in (error[away > WELL_INSIDE[thickness]], error[away <= 2.0], error)]
                wrong = f"{100 * np.mean(error > 20):.1f} %"
                print(
                    f"| {thickness} | {noise} | {name} | {' | '.join(columns)} | {wrong} | {summary(tilt)} |",
                    flush=True,
                )


def summary(error: Array) -> str:
    return f"{np.nanmedian(error):.2f}/{np.nanpercentile(error, 95):.1f}"


if __name__ == "__main__":
    main()

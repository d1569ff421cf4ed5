"""Statistics of random platelets beside an independent code and the measured charge; one list of figures a question.

python pipelines/benchmarks/charge_statistics.py five_step    A11 of single layers for five sizes
python pipelines/benchmarks/charge_statistics.py seeds        A and N of ten seeds at 12.7 x 12.7 mm
python pipelines/benchmarks/charge_statistics.py measured     configs/bracket*.yaml beside J13
python pipelines/benchmarks/charge_statistics.py tiles        gaps, double claims and incomplete platelets
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import ppmc
from ppmc.charge.domains.domain import lattice_of
from ppmc.charge.domains.lattice import Lattice, box_lattice
from ppmc.charge.orient import frames_of
from ppmc.charge.orientations.frames import Frames
from ppmc.charge.platelets.five_step import COMPLETE, CUT_BY_WALL, FREE, INCOMPLETE, fill_layer
from ppmc.charge.platelets.platelets import distance_beyond
from ppmc.charge.stage import STAGE_NUMBER
from ppmc.orientation import orientation_tensor
from ppmc.scene import load_scene
from ppmc.scene.sections.charge import OrientationSource, PlateletsOrientation

CONFIGS = Path(__file__).parents[2] / "configs"
SIZE = (93.5, 34.0, 6.0)
# Length, width, mean A11 of ten runs of one layer of 187 x 68 cells of an independent code, and its stated spread.
REFERENCE = [
    (12.7, 12.7, 0.482, 0.017),
    (12.7, 6.35, 0.609, 0.007),
    (6.35, 6.35, 0.488, 0.009),
    (12.7, 3.175, 0.599, 0.010),
    (25.4, 12.7, 0.748, 0.018),
]
J13_A = [[0.503, -0.015, 0.027], [-0.015, 0.469, -0.003], [0.027, -0.003, 0.028]]
J13_N = [[0.071, 0.001, -0.045], [0.001, 0.088, 0.001], [-0.045, 0.001, 0.841]]
LAYERS = 400


def frames(section: OrientationSource, lattice: Lattice, seed: int) -> Frames:
    """Return the frames that the stage makes of a scene with this seed."""
    return frames_of(section, lattice, np.random.default_rng([seed, STAGE_NUMBER]))


def five_step() -> None:
    """Compare means of many layers with the reference, in standard errors of the difference."""
    lattice = box_lattice((0, 0, 0), (SIZE[0], SIZE[1], 0.5 * LAYERS), (0.5, 0.5, 0.5), LAYERS)
    print("size, mm       reference      mean ± its error   one layer: spread   ten layers: error   apart   platelets")
    for length, width, expected, error in REFERENCE:
        made = frames(PlateletsOrientation(length=length, width=width), lattice, 1)
        layers = np.mean(made.fibre_direction[:, 0].reshape(LAYERS, -1) ** 2, axis=1)
        spread = float(layers.std(ddof=1))
        own = spread / np.sqrt(LAYERS)
        apart = (layers.mean() - expected) / np.hypot(error, own)
        print(
            f"{length:5.2f} x {width:5.2f}  {expected:.3f} ± {error:.3f}  {layers.mean():.4f} ± {own:.4f}"
            f"     {spread:.3f}               {spread / np.sqrt(10):.3f}          {apart:+.1f}"
            f"    {made.notes['platelets'] / LAYERS:.0f}"
        )


def tensors(section: OrientationSource, lattice: Lattice, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Return A and N of each seed, shape (seeds, 3, 3)."""
    made = [frames(section, lattice, seed) for seed in seeds]
    return (
        np.array([orientation_tensor(f.fibre_direction, lattice.volumes) for f in made]),
        np.array([orientation_tensor(f.platelet_normal, lattice.volumes) for f in made]),
    )


def show(name: str, tensor: np.ndarray, measured: list[list[float]] | None = None) -> None:
    """Print the six components of the mean and their spread over seeds."""
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)):
        of_seeds = tensor[:, i, j]
        text = f"  {name}{i + 1}{j + 1}  {of_seeds.mean():+.3f} ± {of_seeds.std(ddof=1):.3f}"
        if measured is not None:
            off = of_seeds - measured[i][j]
            text += f"   measured {measured[i][j]:+.3f}, mean {off.mean():+.3f} off, seed 1 {off[0]:+.3f}"
        print(text)


def seeds() -> None:
    """Print A and N of ten seeds of the bracket's charge with 12.7 mm squares between hard walls."""
    made = [
        ppmc.Charge.box(SIZE, spacing=0.5, orientation=ppmc.Platelets(length=12.7, width=12.7, seed=seed))
        for seed in range(1, 11)
    ]
    A, N = np.array([charge.A for charge in made]), np.array([charge.N for charge in made])
    show("A", A)
    show("N", N)


def measured() -> None:
    """Print ten seeds of the shipped scenes beside J13."""
    for name in ("bracket", "bracket_coarse"):
        charge = load_scene(CONFIGS / f"{name}.yaml").require("charge")
        A, N = tensors(charge.orientation, lattice_of(charge), range(1, 11))
        print(name)
        show("A", A, J13_A)
        show("N", N, J13_N)


def tiles() -> None:
    """Check every cell of 100 layers: held by one platelet, inside that platelet's rectangle, complete ones whole."""
    ny, nx, step, pad = 68, 187, 0.5, 40
    j, i = np.indices((ny, nx))
    for length, width, softness in ((12.7, 12.7, 0.0), (12.7, 6.35, 0.38), (6.35, 1.59, 0.0)):
        gaps, strays, short, counts = 0, 0, 0, np.zeros(3, dtype=int)
        for seed in range(100):
            owner = np.full((ny, nx), FREE, dtype=np.int64)
            beyond = distance_beyond(owner == FREE, pad, step, step)
            sizes = np.full(owner.size, length), np.full(owner.size, width)
            state = np.array([seed], dtype=np.uint64)
            angles, kinds = fill_layer(owner, beyond, pad, step, step, *sizes, softness, 1000, 0, state)
            gaps += int(np.sum(owner < 0))
            held = np.bincount(owner.ravel(), minlength=len(angles))
            counts += np.bincount(kinds, minlength=3)
            for k in np.flatnonzero(kinds == COMPLETE):
                y, x = j[owner == k], i[owner == k]
                u, v = (i - x.mean()) * step, (j - y.mean()) * step
                along = u * np.cos(angles[k]) + v * np.sin(angles[k])
                across = v * np.cos(angles[k]) - u * np.sin(angles[k])
                inside = (np.abs(along) <= length / 2 + 1e-9) & (np.abs(across) <= width / 2 + 1e-9)
                strays += int(np.sum(~inside[owner == k]))
                short += int(np.sum(inside) != held[k])
            # An owner is one number a cell, so that claims can only be double if a platelet lost cells it was given.
            short += int(np.sum(held == 0))
        print(
            f"{length} x {width} mm, softness {softness}: {gaps} gaps, {strays} cells outside their platelet, "
            f"{short} platelets that lack cells; complete {counts[COMPLETE]}, cut by walls {counts[CUT_BY_WALL]}, "
            f"incomplete {counts[INCOMPLETE]}"
        )


if __name__ == "__main__":
    questions = {"five_step": five_step, "seeds": seeds, "measured": measured, "tiles": tiles}
    for question in sys.argv[1:] or questions:
        questions[question]()

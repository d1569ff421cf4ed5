"""A charge of randomly placed platelets: sizes, layers, walls, tilt, and the statistics of the result."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppmc.charge.domains.lattice import Lattice
from ppmc.charge.orientations.frames import RANDOM, Frames
from ppmc.charge.platelets.five_step import COMPLETE, CUT_BY_WALL, FREE, INCOMPLETE, ON_EDGE, OUTSIDE, fill_layer
from ppmc.charge.platelets.on_edge import stand_on_edge
from ppmc.errors import SceneError
from ppmc.scene.sections.charge import ListedSizes, NormalSizes, PlateletsOrientation, Sizes

Array = NDArray[np.floating]
# Kind of a platelet that stands on edge, beside those of `five_step`.
STANDING = 3
KIND_NAMES = {COMPLETE: "complete", CUT_BY_WALL: "cut_by_wall", INCOMPLETE: "incomplete", STANDING: "on_edge"}


def draw_sizes(sizes: Sizes, n: int, generator: np.random.Generator) -> Array:
    """Return n sizes, mm, drawn as the scene says."""
    if isinstance(sizes, NormalSizes):
        drawn = generator.normal(sizes.mean, sizes.deviation, n)
        while len(bad := np.flatnonzero((drawn < 0.1 * sizes.mean) | (drawn > 2.0 * sizes.mean))):
            drawn[bad] = generator.normal(sizes.mean, sizes.deviation, len(bad))
        return drawn
    if isinstance(sizes, ListedSizes):
        shares = np.asarray(sizes.shares or [1.0] * len(sizes.values))
        return generator.choice(np.asarray(sizes.values), size=n, p=shares / shares.sum())
    return np.full(n, float(sizes))


def largest_sizes(section: PlateletsOrientation) -> tuple[float, float]:
    """Return the largest length and width, mm, that are named; the mean of a distribution."""

    def named(sizes: Sizes) -> float:
        if isinstance(sizes, NormalSizes):
            return sizes.mean
        return max(sizes.values) if isinstance(sizes, ListedSizes) else float(sizes)

    return named(section.length), named(section.width)


def tilted(directions: Array, faces: Array, pitch: Array, roll: Array) -> tuple[Array, Array]:
    """Return p and r after a pitch about q and then a roll about p.

    Parameters
    ----------
    directions, faces : ndarray, shape (k, 3)
        p and r.
    pitch, roll : ndarray, shape (k,)
        Angles, radians; pitch takes p towards r, roll takes q towards r.
    """
    q = np.cross(faces, directions)
    a, b = pitch[:, None], roll[:, None]
    p = np.cos(a) * directions + np.sin(a) * faces
    r = np.cos(a) * faces - np.sin(a) * directions
    return p, np.cos(b) * r - np.sin(b) * q


def random_platelets(section: PlateletsOrientation, lattice: Lattice, generator: np.random.Generator) -> Frames:
    """Return the frames of a charge of random platelets, one platelet for every particle.

    Parameters
    ----------
    section : PlateletsOrientation
        Sizes, walls and tilt.
    lattice : Lattice
        The particles; each layer is filled on its own, or as many layers together as a platelet is thick.
    generator : numpy.random.Generator
        Source of all random numbers.

    Raises
    ------
    SceneError
        If platelets are far smaller than particles.
    """
    dx, dy, dz = lattice.spacing
    n3, ny, nx = lattice.shape
    span = max(1, round(section.thickness / dz)) if section.thickness else 1
    domain = np.zeros(n3 * ny * nx, dtype=bool)
    domain[lattice.cells] = True
    domain = domain.reshape(lattice.shape)
    # Layers of one band share platelets; a cell of the band is filled if any of its layers is.
    bands = [np.asarray(domain[k : k + span].any(axis=0)) for k in range(0, n3, span)]
    cells = max(int(band.sum()) for band in bands)
    lengths, widths = (draw_sizes(s, cells, generator) for s in (section.length, section.width))
    if max(lengths.max(), widths.max()) < 0.5 * max(dx, dy):
        raise SceneError(
            f"charge.orientation: platelets of {lengths.max():g} x {widths.max():g} mm are smaller than the particle "
            f"spacing {max(dx, dy):g} mm; give a smaller charge.spacing, or source: planar_random"
        )
    state = np.array([generator.integers(0, 2**64, dtype=np.uint64)])
    standing, p, r, kinds = _standing(section, bands, lattice.spacing, span, lengths, widths, state)
    owner = np.empty((len(bands), ny, nx), dtype=np.int64)
    pad = int(0.5 * np.hypot(lengths.max(), widths.max()) / min(dx, dy)) + 3
    for k, band in enumerate(bands):
        layer = np.where(band, np.where(standing[k] >= 0, ON_EDGE, FREE), OUTSIDE).astype(np.int64)
        order = generator.permutation(cells)
        angles, layer_kinds = fill_layer(
            layer, distance_beyond(band, pad, dx, dy), pad, dx, dy, lengths[order], widths[order],
            section.wall_softness, section.attempts, len(kinds), state,
        )  # fmt: skip
        flat = np.zeros((len(angles), 3))
        flat[:, 0], flat[:, 1] = np.cos(angles), np.sin(angles)
        p = np.concatenate([p, flat])
        r = np.concatenate([r, np.tile([0.0, 0.0, 1.0], (len(angles), 1))])
        kinds = np.concatenate([kinds, layer_kinds])
        owner[k] = np.where(standing[k] >= 0, standing[k], layer)
    pitch, roll = (np.radians(s) * generator.standard_normal(len(p)) for s in (section.pitch, section.roll))
    p, r = tilted(p, r, pitch, roll)
    ids = owner[lattice.layer // span, *np.divmod(lattice.cells % (ny * nx), nx)]
    frames = Frames.of(p[ids], r[ids], RANDOM)
    frames.notes.update(statistics(ids, kinds, lattice))
    return replace(frames, platelet_id=ids)


def statistics(ids: NDArray[np.int64], kinds: NDArray[np.int8], lattice: Lattice) -> dict[str, Any]:
    """Return how many platelets of each kind there are, and their volume fraction in every layer."""
    notes: dict[str, Any] = {"platelets": len(kinds)}
    per_layer = np.bincount(lattice.layer, weights=lattice.volumes, minlength=lattice.shape[0])
    for kind, name in KIND_NAMES.items():
        chosen = kinds[ids] == kind
        volume = np.bincount(lattice.layer[chosen], weights=lattice.volumes[chosen], minlength=lattice.shape[0])
        notes[f"platelets_{name}"] = int(np.count_nonzero(kinds == kind))
        notes[f"volume_fraction_{name}_per_layer"] = [
            round(float(v), 6) for v in volume / np.maximum(per_layer, 1e-300)
        ]
    return notes


def distance_beyond(band: NDArray[np.bool_], pad: int, dx: float, dy: float) -> Array:
    """Return the signed distance from a layer, positive outside, shape (ny + 2 pad, nx + 2 pad), mm; pad at least 1.

    Straight walls along the axes are met exactly; others within a cell.
    """
    from scipy.ndimage import distance_transform_edt

    wide = np.pad(band, pad)
    out = np.empty(wide.shape)
    j, i = np.indices(wide.shape)
    for inside, sign in ((wide, -1.0), (~wide, 1.0)):
        distance, (to_j, to_i) = distance_transform_edt(inside, sampling=(dy, dx), return_indices=True)
        # Between centres of cells; the wall is half a cell before the other centre.
        across = (np.abs(to_i - i) * dx**2 + np.abs(to_j - j) * dy**2) / np.maximum(distance, 1e-300)
        out[inside] = sign * (distance - 0.5 * across)[inside]
    return out


def _standing(
    section: PlateletsOrientation,
    bands: list[NDArray[np.bool_]],
    spacing: tuple[float, float, float],
    span: int,
    lengths: Array,
    widths: Array,
    state: NDArray[np.uint64],
) -> tuple[NDArray[np.int64], Array, Array, NDArray[np.int8]]:
    """Return the owners (-1 for none), p, r and kinds of the platelets that stand on edge."""
    owner = np.full((len(bands), *bands[0].shape), -1, dtype=np.int64)
    none = np.zeros((0, 3))
    if section.on_edge is None:
        return owner, none, none, np.zeros(0, dtype=np.int8)
    from scipy.ndimage import distance_transform_edt

    dx, dy, dz = spacing
    depth = section.on_edge.depth or max(dx, dy)
    where, normals, filled = [], [], []
    for k, band in enumerate(bands):
        distance, (to_j, to_i) = distance_transform_edt(np.pad(band, 1), sampling=(dy, dx), return_indices=True)
        j, i = np.arange(band.shape[0])[:, None], np.arange(band.shape[1])
        towards = np.stack([(to_i[1:-1, 1:-1] - i - 1) * dx, (to_j[1:-1, 1:-1] - j - 1) * dy], axis=-1)
        away = np.maximum(distance[1:-1, 1:-1], 1e-300)
        towards /= away[..., None]
        thick = np.abs(towards) @ np.array([dx, dy])
        # Share of each cell that lies in the wall layer, for cells need not fit its depth.
        part = np.where(band, np.clip((depth - (away - thick)) / np.maximum(thick, 1e-300), 0.0, 1.0), 0.0)
        inside = (part > 0.5 - 1e-9) | ((part > 0.0) & (away - thick < 1e-9))
        at_j, at_i = np.nonzero(inside)
        where.append(np.stack([np.full(len(at_j), k), at_j, at_i], axis=1))
        normals.append(towards[inside])
        filled.append(float(part.sum()))
    at = np.concatenate(where)
    places = at[:, ::-1] * np.array([dx, dy, dz * span])
    claimed = np.full(len(at), FREE, dtype=np.int64)
    wanted = min(round(section.on_edge.share * sum(filled)), len(at))
    thickness = max(section.thickness or 0.0, dx, dy) * (1.0 + 1e-9)
    fill = -(-len(at) // len(lengths))
    p, r = stand_on_edge(
        claimed, places, np.concatenate(normals), wanted, np.tile(lengths, fill)[: len(at)],
        np.tile(widths, fill)[: len(at)], thickness, len(bands) * dz * span, state,
    )  # fmt: skip
    owner[tuple(at.T)] = claimed
    return owner, p, r, np.full(len(p), STANDING, dtype=np.int8)

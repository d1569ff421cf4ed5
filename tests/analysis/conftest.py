"""A small chain of files made from closed forms: phantom, CT with known noise, charge, affine squeeze."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ppmc.analysis.figures.rendering import Rendered
from ppmc.files import Provenance, SeriesWriter, VoxelGrid, write_particles, write_voxels
from ppmc.orientation import normalise, push_affine, push_normal


def blank_pictures(jobs: list[object]) -> Rendered:
    """Stand in for VTK: rendering has its own test."""
    stream = io.BytesIO()
    Image.new("RGB", (8, 6), "white").save(stream, "PNG")
    return Rendered([stream.getvalue()] * len(jobs))


SPACING = 0.5
SQUEEZE = 0.5
ORIGIN = Provenance(creator="test")


@dataclass(frozen=True)
class Chain:
    """Files of a chain and what they were made from."""

    volume: Path
    orientations: Path
    charge: Path
    flow: Path
    deformation_gradient: np.ndarray
    particles: int


@pytest.fixture(scope="session")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Chain:
    folder = tmp_path_factory.mktemp("chain")
    return write_chain(folder)


def write_chain(folder: Path) -> Chain:
    """Write a 12 x 8 x 3 mm block of square tiles, each a platelet, squeezed to half its height."""
    rng = np.random.default_rng(5)
    nz, ny, nx = 12, 32, 48
    h = 0.25
    grid = VoxelGrid((nz, ny, nx), (h, h, h), (h / 2, h / 2, h / 2))
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    names, tile = np.unique((z // 3) * 100 + (y // 8) * 10 + x // 12, return_inverse=True)
    tile = tile.reshape(z.shape)
    angle, tilt = rng.uniform(0, np.pi, len(names)), rng.normal(0, 0.15, len(names))
    p = np.column_stack([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)])
    q = np.column_stack([-np.sin(angle), np.cos(angle), 0 * angle])
    r = np.cross(p, q)
    resin = rng.random(z.shape) < 0.1
    true_p, true_r = p[tile].astype("f4"), r[tile].astype("f4")
    true_p[resin] = 0
    true_r[resin] = 0
    write_voxels(
        folder / "volume.vtkhdf",
        "volume",
        {
            "grey": np.full(z.shape, 100, "u1"),
            "mask": np.ones(z.shape, "u1"),
            "fibre_direction": true_p,
            "platelet_normal": true_r,
            "platelet_id": np.where(resin, -1, tile).astype("i4"),
        },
        grid=grid,
        provenance=ORIGIN,
    )
    ct_p = normalise(p[tile] + rng.normal(0, 0.03, (*z.shape, 3)))
    ct_r = r[tile] - np.sum(r[tile] * ct_p, axis=-1, keepdims=True) * ct_p
    every = (slice(None, None, 2),) * 3
    write_voxels(
        folder / "orientations.vtkhdf",
        "orientations",
        {
            "fibre_direction": ct_p[every].astype("f4"),
            "platelet_normal": normalise(ct_r)[every].astype("f4"),
            "valid": (~resin)[every].astype("u1"),
        },
        grid=grid.strided(2),
        provenance=ORIGIN,
    )
    axes = [np.arange(SPACING / 2, n * h, SPACING) for n in (nx, ny, nz)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    at = np.rint(grid.to_index(position)).astype(int)
    of = tile[at[:, 2], at[:, 1], at[:, 0]]
    n = len(position)
    volume = np.full(n, SPACING**3)
    write_particles(
        folder / "charge.vtkhdf",
        "charge",
        position,
        {
            "fibre_direction": p[of],
            "in_plane_direction": q[of],
            "platelet_normal": r[of],
            "volume": volume,
            "platelet_id": of.astype("i8"),
        },
        provenance=ORIGIN,
    )
    F = np.diag([SQUEEZE**-0.5, SQUEEZE**-0.5, SQUEEZE])
    static = {"platelet_id": of.astype("i8"), "reference_position": position, "volume": volume}
    fields = ("fibre_direction", "platelet_normal", "deformation_gradient", "volume_ratio", "velocity", "pressure")
    writer = SeriesWriter.create(folder / "partial.vtkhdf", n, static, fields, ("press_force",), provenance=ORIGIN)
    for time, f in ((0.0, np.eye(3)), (0.5, np.diag(np.diagonal(F) ** 0.5)), (1.0, F)):
        every_f = np.broadcast_to(f, (n, 3, 3))
        values = {
            "fibre_direction": push_affine(p[of], every_f),
            "platelet_normal": push_normal(r[of], every_f),
            "deformation_gradient": every_f.reshape(n, 9),
            "volume_ratio": np.ones(n),
            "velocity": np.zeros((n, 3)),
            "pressure": np.zeros(n),
        }
        writer.append(time, position @ f.T, values, {"press_force": 2e6 * (1 + time)})
    writer.seal(folder / "flow.vtkhdf")
    return Chain(*(folder / f"{name}.vtkhdf" for name in ("volume", "orientations", "charge", "flow")), F, n)

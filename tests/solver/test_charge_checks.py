"""Charges that cannot be are refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ppmc.errors import InputFileError
from ppmc.files import Provenance, read_particles, write_particles
from ppmc.solver.run.charge_checks import check_charge


def write(path: Path, **changed: Any) -> Path:
    grid = np.array(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij")).reshape(3, -1).T
    positions = changed.pop("positions", grid)
    n = len(positions)
    fields = {
        name: np.tile(np.eye(3)[k], (n, 1))
        for k, name in enumerate(("fibre_direction", "in_plane_direction", "platelet_normal"))
    }
    fields |= {"volume": np.ones(n), "platelet_id": np.arange(n)} | changed
    write_particles(path, "charge", positions, fields, provenance=Provenance("test"))
    return path


def test_a_lattice_passes(tmp_path: Path) -> None:
    path = write(tmp_path / "c.vtkhdf")
    check_charge(read_particles(path, "charge"), np.ones(3), str(path))


def test_a_particle_larger_than_its_room(tmp_path: Path) -> None:
    volume = np.ones(64)
    volume[5] = 1e6
    path = write(tmp_path / "c.vtkhdf", volume=volume)
    with pytest.raises(InputFileError, match=r"c\.vtkhdf: /VTKHDF/PointData/volume\[5\] = 1e\+06 mm\^3"):
        check_charge(read_particles(path, "charge"), np.ones(3), str(path))


def test_doubled_particles(tmp_path: Path) -> None:
    grid = np.array(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij")).reshape(3, -1).T
    path = write(tmp_path / "c.vtkhdf", positions=np.concatenate([grid, grid[10:12] + 1e-4]))
    with pytest.raises(InputFileError, match=r"particles 10 and 64 are both at .*; 2 such pairs"):
        check_charge(read_particles(path, "charge"), np.ones(3), str(path))


def test_directions_that_span_no_plane(tmp_path: Path) -> None:
    q = np.tile(np.eye(3)[1], (64, 1))
    q[7] = [-1.0, 0.0, 0.0]
    path = write(tmp_path / "c.vtkhdf", in_plane_direction=q)
    with pytest.raises(InputFileError, match=r"in_plane_direction\[7\] = 0. is parallel to fibre_direction"):
        read_particles(path, "charge")

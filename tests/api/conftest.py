"""A small squeeze as the commands run it, beside which the API is held."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import ppmc
from ppmc.cli import run_command

CHARGE = """
name: charge
seed: 1
charge:
  domain: {shape: box, size: [6 mm, 6 mm, 4 mm]}
  spacing: 1 mm
  orientation: {source: planar_random}
"""
FLOW = """
name: flow
tooling:
  lower: {shape: plane, point: [0, 0, 0], normal: [0, 0, 1]}
  ram: {shape: plane, point: [0, 0, 4], normal: [0, 0, -1], motion: {velocity: [0, 0, -1], travel: 1.2}, wall: no_slip}
material: {model: transversely_isotropic, shear_viscosity: 1, anisotropy_ratio: 10}
solver: {end_time: 1.2, output_interval: 0.4}
"""


def command(folder: Path, text: str, *words: str) -> None:
    """Run a command on the text of a scene."""
    scene = folder / "scene.yaml"
    scene.write_text(text)
    assert run_command([words[0], str(scene), *words[1:]]) == 0


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that the commands ``charge`` and ``solve`` have written."""
    folder = tmp_path_factory.mktemp("commands")
    charge = str(folder / "charge.vtkhdf")
    command(folder, CHARGE, "charge", "--output", charge)
    command(folder, FLOW, "solve", "--input", charge, "--output", str(folder / "flow.vtkhdf"))
    return folder


@pytest.fixture(scope="session")
def solved() -> Callable[..., ppmc.Flow]:
    """Return what solves the same from Python."""

    def solve(charge: ppmc.Charge | Path, **options: object) -> ppmc.Flow:
        tools = {
            "lower": ppmc.tools.plane((0, 0, 0), (0, 0, 1)),
            "ram": ppmc.tools.plane(
                (0, 0, "4 mm"), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, "-1 mm/s"), travel=1.2), wall="no_slip"
            ),
        }
        material = ppmc.materials.TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=10.0)
        keys = {"end_time": 1.2, "output_interval": 0.4} | options
        return ppmc.solve(charge, tools, material, **keys)  # type: ignore[arg-type]

    return solve


@pytest.fixture(scope="session")
def charge() -> ppmc.Charge:
    """The same charge, made in memory."""
    return ppmc.Charge.box((6, 6, "4 mm"), spacing=1, orientation=ppmc.PlanarRandom(seed=1))


@pytest.fixture(scope="session")
def flow(charge: ppmc.Charge, solved: Callable[..., ppmc.Flow]) -> ppmc.Flow:
    """The same flow, in memory."""
    return solved(charge)

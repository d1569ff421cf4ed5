"""The flow front beside a mask: a volume, a picture (D Figs 6 and 7); surfaces that split a part (A Fig 4.5)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ppmc.analysis.figures.surfaces import dominant_surfaces
from ppmc.analysis.flow.comparisons import compare_with_mask, read_picture
from ppmc.errors import InputFileError
from ppmc.files import open_series
from ppmc.particles import Particles
from ppmc.scene.sections.analysis import FrontMask
from tests.analysis.conftest import Chain
from tests.analysis.test_fill_knit_ensemble import lattice


def picture(folder: Path, low: tuple[float, float], high: tuple[float, float], dark: bool = False) -> Path:
    """Paint a rectangle (mm) into a picture of 20 x 14 mm whose lower left corner is (-1, -2) mm, 0.1 mm a pixel."""
    x, y = np.meshgrid(-1 + (np.arange(200) + 0.5) / 10, -2 + (np.arange(140) + 0.5) / 10, indexing="ij")
    inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    path = folder / "front.png"
    Image.fromarray(np.where((inside != dark).T[::-1], 255, 0).astype(np.uint8)).save(path)
    return path


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize(("time", "size"), [(None, (12 * 2**0.5, 8 * 2**0.5)), (0.05, (12.0, 8.0))])
def test_overlap_with_a_picture(
    dark: bool, time: float | None, size: tuple[float, float], chain: Chain, tmp_path: Path
) -> None:
    """The squeezed block covers (0, 0) to `size`; the picture shows the part of it beyond x1 = 3 mm, and 1 mm more."""
    path = picture(tmp_path, (3.0, 0.0), (size[0] + 1.0, size[1]), dark)
    section = FrontMask(path=path, time=time, origin=(-1.0, -2.0), pixel=0.1, material="dark" if dark else "bright")
    with open_series(chain.flow, "flow") as flow:
        found = compare_with_mask(flow, path, section, 2)
    assert found.time == (0.0 if time else 1.0)
    assert found.seen[2] == pytest.approx((size[0] - 3) / (size[0] + 1), abs=0.015)
    assert np.isnan(found.seen[:2]).all() and np.isnan(found.difference.overlap)


def test_overlap_with_the_mask_of_a_volume(chain: Chain) -> None:
    """The phantom is the block at the start: 12 x 8 x 3 mm."""
    with open_series(chain.flow, "flow") as flow:
        start = compare_with_mask(flow, chain.volume, FrontMask(path=chain.volume, time=0.0), 2)
        end = compare_with_mask(flow, chain.volume, FrontMask(path=chain.volume), 2)
        with pytest.raises(InputFileError, match="holds"):
            compare_with_mask(flow, chain.charge, FrontMask(path=chain.charge), 2)
    assert start.difference.overlap == pytest.approx(1, abs=1e-6)
    assert end.difference.overlap == pytest.approx(1 / 3, abs=0.01)
    # Along x1 and x2: 8 x 3 and 12 x 3 mm beside 11.31 x 1.5 and 16.97 x 1.5 mm.
    grown = 2**0.5 / 2
    expected = [0.5 / (1 + grown - 0.5)] * 2 + [0.5]
    assert end.seen == pytest.approx(expected, abs=0.01)


def test_pictures_of_nothing_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    Image.new("L", (5, 5), 255).save(path)
    with pytest.raises(InputFileError, match="every pixel"):
        read_picture(path, "bright")
    with pytest.raises(InputFileError, match="no pixel"):
        read_picture(path, "dark")
    path.write_text("no picture")
    with pytest.raises(InputFileError, match="cannot be read"):
        read_picture(path, "dark")


def test_pictures_stand_upright(tmp_path: Path) -> None:
    marked = read_picture(picture(tmp_path, (-1, -2), (0, -1)), "bright")
    assert marked.shape == (200, 140)
    assert marked[0, 0] and not marked[-1, 0] and not marked[0, -1]


def test_surfaces_split_a_part_by_direction() -> None:
    """Three slabs along x1, x2, x3: each surface encloses its slab."""
    x = lattice((0, 0, 0), (18, 12, 8), 0.5)
    which = np.minimum((x[:, 0] // 6).astype(int), 2)
    s = Particles("s", x, np.full(len(x), 0.125), np.eye(3)[which])
    for i, surface in enumerate(dominant_surfaces(s, 0.5)):
        a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
        volume = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
        assert volume == pytest.approx(6 * 12 * 8, rel=0.06)
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        assert np.allclose(low, [6 * i, 0, 0], atol=0.4) and np.allclose(high, [6 * i + 6, 12, 8], atol=0.4)
        assert surface.values.min() > 0.3 and surface.values.max() > 0.9


def test_directions_that_nothing_favours_have_no_surface() -> None:
    x = lattice((0, 0, 0), (8, 8, 4), 0.5)
    s = Particles("s", x, np.ones(len(x)), np.tile([1.0, 0, 0], (len(x), 1)))
    sizes = [len(surface.points) for surface in dominant_surfaces(s, 0.5)]
    assert sizes[0] > 100 and sizes[1:] == [0, 0]
    assert [len(q.points) for q in dominant_surfaces(Particles("s", x, np.ones(len(x))), 0.5)] == [0, 0, 0]

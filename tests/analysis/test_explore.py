"""The short cuts of the notebooks draw what the report draws."""

from __future__ import annotations

import numpy as np
import pytest

import ppmc
from ppmc.analysis.averages.regions import box, everything
from ppmc.analysis.explore import disk_figure, fourth_frame, region_frame, view_figure
from ppmc.analysis.figures import views
from ppmc.analysis.flow.disk import disk_tensors
from ppmc.errors import SceneError
from ppmc.orientation.tensor_ode import TensorModel
from tests.analysis.conftest import Chain, blank_pictures


@pytest.mark.parametrize("model", [None, TensorModel()], ids=["exact", "integrated"])
def test_disk_figure_holds_the_exact_profile(model: TensorModel | None) -> None:
    heights = np.array([0.0, 0.3, 0.6])
    drawing = disk_figure(5.0, 1.0, heights, model)
    for ax, tensor in zip(drawing.axes, disk_tensors(5.0, heights), strict=True):
        assert "[–]" in ax.get_xlabel() and "[–]" in ax.get_ylabel()
        for line, (i, j) in zip(ax.lines, ((0, 0), (1, 1), (2, 2), (0, 2)), strict=True):
            assert np.allclose(line.get_xdata(), heights)
            assert np.abs(np.asarray(line.get_ydata()) - tensor[:, i, j]).max() < 1e-6


def test_views_in_one_call(chain: Chain, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[object] = []

    def keep(wanted: list[object]) -> object:
        jobs.extend(wanted)
        return blank_pictures(wanted)

    monkeypatch.setattr(views, "render", keep)
    end = ppmc.Flow.read(chain.flow)[-1]
    for name in ("fibre_direction", "platelet_normal", "dominant_direction", "iso_surface"):
        jobs.clear()
        drawing = view_figure(end, name)
        assert len(jobs) == 3 and len(drawing.axes) >= 3
    jobs.clear()
    view_figure(end, "fibre_direction", cut=([0, 4, 0], [0, 1, 0]))
    assert all(job.points[:, 1].max() <= 4 for job in jobs)  # type: ignore[attr-defined]
    with pytest.raises(SceneError, match="no view 'colour'"):
        view_figure(end, "colour")
    with pytest.raises(SceneError, match="nothing that"):
        view_figure(end, "fibre_direction", cut=([-99, 0, 0], [1, 0, 0]))


def test_frames_of_both_orders_agree(chain: Chain) -> None:
    end = ppmc.Flow.read(chain.flow)[-1]
    regions = [everything(), box("half", [0, 0, 0], [8, 12, 2])]
    second, fourth = region_frame(end, regions), fourth_frame(end, regions)
    assert second.region.tolist() == ["whole", "half"]
    assert np.allclose(fourth.A1111 + fourth.A1122 + fourth.A1133, second.A11)
    assert np.allclose(fourth.N1133 + fourth.N2233 + fourth.N3333, second.N33)

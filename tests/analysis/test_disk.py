"""The centre-gated disk of J's appendix against the exact table at r = 20, r0 = 1."""

from __future__ import annotations

import numpy as np
import pytest

from ppmc.analysis.flow.disk import disk_deformation_gradient, disk_tensor_mode, disk_tensors, disk_velocity_gradient

TABLE = """
0    .00042 .95214 .04744 0       .95214 .00042 .04744 0
.05  .03312 .93384 .03304 -.03290 .49922 .00038 .50041 .47559
.1   .08115 .89884 .02000 -.04022 .20321 .00032 .79646 .39026
.2   .16647 .82388 .00964 -.04005 .05704 .00025 .94271 .22615
.3   .24397 .75039 .00564 -.03709 .02360 .00020 .97620 .14826
.4   .31970 .67676 .00354 -.03365 .01144 .00016 .98840 .10399
.5   .39783 .59992 .00225 -.02991 .00586 .00013 .99401 .07472
.6   .48222 .51640 .00138 -.02578 .00296 .00010 .99693 .05330
.7   .57729 .42194 .00077 -.02108 .00138 .00008 .99854 .03646
.8   .68882 .31083 .00035 -.01554 .00052 .00005 .99942 .02254
.9   .82524 .17466 .00009 -.00873 .00011 .00003 .99986 .01058
"""
ROWS = np.array([[float(v) for v in line.split()] for line in TABLE.strip().splitlines()])


def test_exact_table() -> None:
    A, N = disk_tensors(20.0, ROWS[:, 0])
    found = np.column_stack(
        [A[:, 0, 0], A[:, 1, 1], A[:, 2, 2], A[:, 0, 2], N[:, 0, 0], N[:, 1, 1], N[:, 2, 2], N[:, 0, 2]]
    )
    assert np.abs(found - ROWS[:, 1:]).max() < 1e-5


def test_deformation_gradient_solves_its_equation() -> None:
    """dF/dt = L·F along the path, by central differences, and F = I at the inlet, det F = 1."""
    z, r0, h = 0.4, 1.0, 1e-5
    r = 7.0
    t_r = r / (1 - z * z)  # dt/dr
    dF = (disk_deformation_gradient(r + h, z, r0) - disk_deformation_gradient(r - h, z, r0)) / (2 * h * t_r)
    assert np.abs(dF - disk_velocity_gradient(r, z) @ disk_deformation_gradient(r, z, r0)).max() < 1e-8
    assert np.allclose(disk_deformation_gradient(r0, z, r0), np.eye(3))
    assert np.linalg.det(disk_deformation_gradient(20.0, 0.3)) == pytest.approx(1, abs=1e-13)


def test_tensor_mode_with_exact_closure_equals_affine_motion() -> None:
    heights = np.array([0.0, 0.3])
    A, N = disk_tensor_mode(5.0, heights)
    exact_A, exact_N = disk_tensors(5.0, heights)
    assert np.abs(A - exact_A).max() < 1e-6
    assert np.abs(N - exact_N).max() < 1e-6
    assert np.allclose(
        (A[1, 0, 0], A[1, 1, 1], A[1, 2, 2], A[1, 0, 2]), (0.196319, 0.724881, 0.078800, -0.120440), atol=1e-6
    )


@pytest.mark.parametrize("inlet", [1.0, 2.0, 5.0])
def test_normals_cross_at_one_over_r_whatever_the_inlet(inlet: float) -> None:
    _, N = disk_tensors(20.0, np.array([0.05, 0.2]), inlet)
    assert N[0, 0, 0] == pytest.approx(N[0, 2, 2], abs=2e-3 + (inlet / 20) ** 2)
    assert N[1, 2, 2] > 0.9

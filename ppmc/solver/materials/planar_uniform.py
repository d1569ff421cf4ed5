r"""Planar uniform fibres about the normal of the nearest tool (D4, D5).

:math:`A = \tfrac12(I - nn)` and its fourth-order partner are reproduced exactly by three directions in the plane, 60
degrees apart, with equal fractions: a trigonometric polynomial of degree four is integrated exactly by three equally
spaced axes.
"""

from typing import Any

import numpy as np

from ppmc.solver.particles.state import ParticleState


def fibres(section: Any, state: ParticleState, normals: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffnesses (n, 3) and directions (n, 3, 3); `normals` (n, 3) must be given."""
    assert normals is not None
    stiffness = 4.0 * section.shear * (section.ratio - 1.0) / 3.0
    return np.full((len(state), 3), stiffness), three_axes(normals)


def three_axes(normals: np.ndarray) -> np.ndarray:
    """Three unit axes 60 degrees apart in the planes normal to `normals` (n, 3); shape (n, 3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angles = np.pi / 3.0 * np.arange(3)
    return np.cos(angles)[None, :, None] * first[:, None, :] + np.sin(angles)[None, :, None] * second[:, None, :]

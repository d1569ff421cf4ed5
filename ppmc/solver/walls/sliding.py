r"""How far a wall's law lets the charge slide, where traction is not in proportion to speed.

Between the centre of a wall layer, which moves at u against the wall, and the wall lie the half-cell, which shears, and
the wall's law :math:`\tau(v, p)`. The slip length s, speed over traction of the law, is what both agree on:

.. math:: t = G\,(I + s\,G)^{-1} u, \qquad |t| = \tau(s\,|t|,\,p), \qquad G = C_t / w ,

or zero where the wall holds the whole traction of a half-cell that is sheared by u alone: there the charge sticks. The
root of a law that does not fall with the speed is the only one, since :math:`|t|` falls with s while :math:`s\,|t|`
rises.
"""

from __future__ import annotations

import numpy as np

from ppmc.errors import SceneError
from ppmc.walls import WallLaw

# Slip lengths that are sought, in units of those that a half-cell has itself: beyond, nothing slides, or nothing rubs.
LEAST, MOST = 1e-12, 1e12
HALVINGS = 60  # of the logarithm of that range: to round-off


def slip_lengths(law: WallLaw, stiffness: np.ndarray, slide: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Slip lengths at which half-cells and a wall's law agree.

    Parameters
    ----------
    law : WallLaw
    stiffness : ndarray, shape (m, 3)
        Eigenvalues of G, Pa s/mm; one is zero, for the direction across the wall.
    slide : ndarray, shape (m, 3)
        Components of u along the eigenvectors, mm/s.
    pressure : ndarray, shape (m,)
        On the wall, Pa, zero or more.

    Returns
    -------
    ndarray, shape (m,), mm/(Pa s)
        Zero where the charge sticks, infinite where nothing rubs.

    Raises
    ------
    SceneError
        If the law gives no tractions.
    """
    holds = law.traction(np.zeros(len(pressure)), pressure)
    if np.shape(holds) != np.shape(pressure) or not (holds >= 0.0).all():
        raise SceneError(
            f"wall {type(law).__name__}: traction() must give an array like its arguments, zero or more, in Pa; at "
            f"speed zero it gave {np.asarray(holds).ravel()[:3]} of shape {np.shape(holds)} for {np.shape(pressure)}"
        )
    stiffness = np.maximum(stiffness, 0.0)
    unit = 1.0 / np.maximum(stiffness.max(axis=1, initial=0.0), 1e-300)

    def traction(slip: np.ndarray) -> np.ndarray:
        parts = stiffness * slide / (1.0 + slip[:, None] * stiffness)
        return np.asarray(np.sqrt(np.einsum("mc,mc->m", parts, parts)))

    def held(slip: np.ndarray) -> np.ndarray:
        found = traction(slip)
        return np.asarray(found <= law.traction(slip * found, pressure))

    low, high = np.log(LEAST * unit), np.log(MOST * unit)
    out = np.where(held(np.exp(high)), 0.0, np.inf)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = held(np.exp(middle))
        high, low = np.where(enough, middle, high), np.where(enough, low, middle)
    out = np.where(np.isinf(out), np.inf, np.exp(high))
    return np.where(held(np.zeros(len(unit))), 0.0, out)

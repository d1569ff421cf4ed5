"""Centre-gated disk: the analytic flow of J A7 (Altan and Rao 1995) and its exact A and N (J Figs 15 and 16).

Local axes: 1 radial, 2 hoop, 3 thickness; lengths in half-thicknesses. A particle stays at its height z and moves
outwards with r² = r0² + 2 Q (1 − z²) t, from isotropy at the inlet radius r0, which J does not give: away from the
midplane A11 and A22 depend on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.orientation.closures import affine_tensors
from ppmc.orientation.tensor_ode import TOLERANCE, TensorModel, integrate

Array = NDArray[np.float64]


def disk_velocity_gradient(radius: ArrayLike, height: ArrayLike, flow_rate: float = 1.0) -> Array:
    """Return L, shape (..., 3, 3), at radius r and height z (J A7); Q is 1 unless given."""
    r, z = np.broadcast_arrays(np.asarray(radius, dtype=float), np.asarray(height, dtype=float))
    L = np.zeros((*r.shape, 3, 3))
    L[..., 1, 1] = flow_rate * (1.0 - z**2) / r**2
    L[..., 0, 0] = -L[..., 1, 1]
    L[..., 0, 2] = -2.0 * flow_rate * z / r
    return L


def disk_deformation_gradient(radius: float, height: ArrayLike, inlet_radius: float = 1.0) -> Array:
    """Return F, shape (..., 3, 3), from the inlet to a radius, in the local axes.

    F = [[1/λ, 0, s], [0, λ, 0], [0, 0, 1]] with λ = r/r0 and s = −z r (1 − λ⁻²)/(1 − z²); |z| < 1.
    """
    z = np.asarray(height, dtype=float)
    stretch = radius / inlet_radius
    F = np.zeros((*z.shape, 3, 3))
    F[..., 0, 0], F[..., 1, 1], F[..., 2, 2] = 1.0 / stretch, stretch, 1.0
    F[..., 0, 2] = -z * radius * (1.0 - stretch**-2) / (1.0 - z**2)
    return F


def disk_tensors(radius: float, height: ArrayLike, inlet_radius: float = 1.0) -> tuple[Array, Array]:
    """Return the exact A and N, shape (..., 3, 3), through the thickness at a radius; |z| < 1."""
    F = disk_deformation_gradient(radius, height, inlet_radius)
    return affine_tensors(F)[0], affine_tensors(np.swapaxes(np.linalg.inv(F), -1, -2))[0]


def disk_tensor_mode(
    radius: float,
    height: ArrayLike,
    inlet_radius: float = 1.0,
    model: TensorModel | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[Array, Array]:
    """Return A and N, shape (..., 3, 3), at a radius by integrating A1 and A2 along the particles' paths; |z| < 1.

    All heights go together: in the variable τ = Q (1 − z²) t every one has r² = r0² + 2τ.
    """
    model = model or TensorModel()
    z = np.asarray(height, dtype=float)
    start = np.broadcast_to(np.eye(3) / 3.0, (*z.shape, 3, 3))
    scale = 1.0 / (1.0 - z**2)

    def gradient(tau: float) -> Array:
        r = np.sqrt(inlet_radius**2 + 2.0 * tau)
        return np.asarray(disk_velocity_gradient(r, z) * scale[..., None, None])

    span = [0.0, 0.5 * (radius**2 - inlet_radius**2)]
    fibre, normal = (integrate(rate, start, gradient, span, tolerance) for rate in (model.rate, model.normal_rate))
    return fibre[-1], normal[-1]

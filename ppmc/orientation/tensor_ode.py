"""Tensor mode: rates of A and N where second-order tensors are the primary variables (J appendix, A1 and A2).

One function serves both: N moves under L as A does under −Lᵀ (W stays, D changes sign). Options that the papers name
and leave off: isotropic and anisotropic rotary diffusion and the reduced strain closure, for A and N alike.
Shapes: tensors (..., 3, 3), the same leading axes for A and L.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppmc.errors import NumericalError
from ppmc.orientation.fitted_closures import CLOSURES

Array = NDArray[np.float64]

TOLERANCE = 1e-9
FIRST_CHANGE = 0.01  # of a component, in the first step tried
FAR_OUT = 2.0  # components of orientation tensors lie between -1/2 and 1
MOST_STEPS = 20_000


class RotaryDiffusion(Protocol):
    """Gives the diffusion tensor C (times the scalar strain rate γ̇ it is the rotary diffusivity)."""

    def tensor(self, second: Array, rate_of_deformation: Array, shear_rate: Array) -> Array:
        """Return C, shape (..., 3, 3)."""
        ...


@dataclass(frozen=True)
class FolgarTucker:
    """Isotropic diffusion C = C_I I (Folgar and Tucker, J. Reinf. Plast. Compos. 3 (1984) 98)."""

    interaction_coefficient: float

    def tensor(self, second: Array, rate_of_deformation: Array, shear_rate: Array) -> Array:
        """Return C_I I."""
        return np.broadcast_to(self.interaction_coefficient * np.eye(3), second.shape)


@dataclass(frozen=True)
class PhelpsTucker:
    """C = b1 I + b2 A + b3 A² + b4 D/γ̇ + b5 D²/γ̇² (Phelps and Tucker, J. Non-Newton. Fluid Mech. 156 (2009) 165)."""

    b1: float
    b2: float = 0.0
    b3: float = 0.0
    b4: float = 0.0
    b5: float = 0.0

    def tensor(self, second: Array, rate_of_deformation: Array, shear_rate: Array) -> Array:
        """Return C."""
        D = rate_of_deformation / _safe(shear_rate)[..., None, None]
        constant = self.b1 * np.eye(3) + self.b2 * second + self.b3 * second @ second
        return np.asarray(constant + self.b4 * D + self.b5 * D @ D)


@dataclass(frozen=True)
class ImprovedArd:
    """iARD: C = C_I (I − C_M D²/|D²|) (Tseng, Chang and Hsu, J. Rheol. 60 (2016) 215)."""

    interaction_coefficient: float
    matrix_coefficient: float

    def tensor(self, second: Array, rate_of_deformation: Array, shear_rate: Array) -> Array:
        """Return C."""
        square = rate_of_deformation @ rate_of_deformation
        size = np.sqrt(0.5 * np.einsum("...ij,...ij->...", square, square))
        return np.asarray(
            self.interaction_coefficient * (np.eye(3) - self.matrix_coefficient * square / _safe(size)[..., None, None])
        )


@dataclass(frozen=True)
class PrincipalArd:
    """pARD: C = C_I R·diag(1, Ω, 1−Ω)·Rᵀ in A's principal axes (Tseng, Chang and Hsu, J. Rheol. 62 (2018) 313)."""

    interaction_coefficient: float
    omega: float = 0.5

    def tensor(self, second: Array, rate_of_deformation: Array, shear_rate: Array) -> Array:
        """Return C."""
        axes = np.linalg.eigh(second)[1][..., ::-1]
        weights = np.array([1.0, self.omega, 1.0 - self.omega])
        return np.asarray(self.interaction_coefficient * np.einsum("...ik,k,...jk->...ij", axes, weights, axes))


@dataclass(frozen=True)
class TensorModel:
    """What moves a second-order orientation tensor.

    Attributes
    ----------
    closure : str
        Name in `CLOSURES`; "natural" is exact for affine motion from isotropy.
    shape_factor : float
        ξ of Jeffery's equation: 1 for long fibres and thin platelets (A1).
    diffusion : RotaryDiffusion, optional
        Off by default: platelets are caged (J section II.A).
    strain_reduction : float
        κ of the reduced strain closure; 1 leaves it off (Wang, O'Gara and Tucker, J. Rheol. 52 (2008) 1179).
    """

    closure: str = "natural"
    shape_factor: float = 1.0
    diffusion: RotaryDiffusion | None = None
    strain_reduction: float = 1.0

    def rate(self, second: Array, velocity_gradient: Array) -> Array:
        """Return dA/dt, shape (..., 3, 3), under L, shape (..., 3, 3) (J A1 with the options)."""
        A, L = np.asarray(second), np.asarray(velocity_gradient)
        transposed = np.swapaxes(L, -1, -2)
        D, W = 0.5 * (L + transposed), 0.5 * (L - transposed)
        fourth = CLOSURES[self.closure](A)
        flow = D @ A + A @ D - 2.0 * np.einsum("...ijkl,...kl->...ij", fourth, D)
        out = W @ A - A @ W + self.shape_factor * flow
        if self.diffusion is not None:
            shear_rate = np.sqrt(2.0 * np.einsum("...ij,...ij->...", D, D))
            C = self.diffusion.tensor(A, D, shear_rate)
            trace = np.trace(C, axis1=-2, axis2=-1)[..., None, None]
            contracted = np.einsum("...ijkl,...kl->...ij", fourth, C)
            spread = 2.0 * C - 2.0 * trace * A - 5.0 * (C @ A + A @ C) + 10.0 * contracted
            out = out + shear_rate[..., None, None] * spread
        if self.strain_reduction < 1.0:
            out = out - (1.0 - self.strain_reduction) * _stretching(A, out)
        return np.asarray(out)

    def normal_rate(self, second: Array, velocity_gradient: Array) -> Array:
        """Return dN/dt under L: the rate of A under −Lᵀ (J A2).

        Diffusion tensors that name D meet −D here, as every other term does.
        """
        return self.rate(second, -np.swapaxes(np.asarray(velocity_gradient), -1, -2))


def integrate(
    rate: Callable[[Array, Array], Array],
    start: ArrayLike,
    velocity_gradient: Callable[[float], Array],
    times: Sequence[float] | Array,
    tolerance: float = TOLERANCE,
) -> Array:
    """Integrate a tensor's rate in time along a particle's path.

    Parameters
    ----------
    rate : callable
        `TensorModel.rate` or `TensorModel.normal_rate`.
    start : array_like, shape (..., 3, 3)
        Tensor at times[0].
    velocity_gradient : callable
        L(t), shape (..., 3, 3), 1/s.
    times : sequence of float
        Increasing times at which to return the tensor, s.
    tolerance : float
        Error of a step, absolute (components are of order one).

    Returns
    -------
    ndarray, shape (len(times), ..., 3, 3)

    Raises
    ------
    NumericalError
        If the step size vanishes, or the closure leads far out of what orientation tensors can be.

    Notes
    -----
    Dormand and Prince's method of order 5(4) with step control (J. Comput. Appl. Math. 6 (1980) 19).
    """
    state = np.array(start, dtype=np.float64)
    out = [state.copy()]
    fastest = float(np.abs(rate(state, velocity_gradient(float(times[0])))).max())
    step = FIRST_CHANGE / max(fastest, FIRST_CHANGE / float(times[-1] - times[0]))
    for begin, end in pairwise(times):
        t = float(begin)
        for _ in range(MOST_STEPS):
            if t >= end:
                break
            h = min(step, end - t)
            with np.errstate(over="ignore", invalid="ignore"):  # too long a step is taken again
                new, error = _step(rate, state, velocity_gradient, t, h)
            size = float(np.abs(error).max()) if np.isfinite(new).all() else np.inf
            if size <= tolerance:
                t = end if h == end - t else t + h
                state = new
                if np.abs(state).max() > FAR_OUT:
                    raise NumericalError(
                        f"orientation tensor: components of {np.abs(state).max():.3g} at t = {t:.6g} s, which no "
                        "orientation has: this closure does not serve this flow; the natural one does"
                    )
            step = h * min(4.0, max(0.2, 0.9 * (tolerance / max(size, 1e-300)) ** 0.2))
            if step < 1e-14 * max(abs(end), 1e-300):
                raise NumericalError(f"orientation tensor: the step at t = {t:.6g} s shrank to nothing")
        else:
            raise NumericalError(
                f"orientation tensor: more than {MOST_STEPS} steps up to t = {end:.6g} s; "
                "closures fitted in principal axes jump where eigenvalues cross: loosen the tolerance"
            )
        out.append(state.copy())
    return np.array(out)


_NODES = (0.0, 0.2, 0.3, 0.8, 8 / 9, 1.0, 1.0)
_STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


def _step(
    rate: Callable[[Array, Array], Array], state: Array, velocity_gradient: Callable[[float], Array], t: float, h: float
) -> tuple[Array, Array]:
    slopes: list[Array] = []
    at = state
    for node, weights in zip(_NODES, _STAGES, strict=True):
        at = state + h * sum((w * k for w, k in zip(weights, slopes, strict=True)), start=np.zeros_like(state))
        slopes.append(rate(at, velocity_gradient(t + node * h)))
    error = h * sum((w * k for w, k in zip(_ERROR, slopes, strict=True)), start=np.zeros_like(state))
    return at, error


def _stretching(second: Array, rate: Array) -> Array:
    """Return 𝕄:rate with 𝕄 = Σ e_i e_i e_i e_i in A's principal axes: the part of a rate that changes eigenvalues.

    What the reduced strain closure slows down is this part and nothing else, whichever diffusion is on: for
    anisotropic diffusion the result is the ARD-RSC model (Phelps and Tucker 2009).
    """
    axes = np.linalg.eigh(second)[1]
    along = np.einsum("...ik,...ij,...jk->...k", axes, rate, axes)
    return np.asarray(np.einsum("...ik,...k,...jk->...ij", axes, along, axes))


def _safe(values: Array) -> Array:
    return np.maximum(values, 1e-300)

r"""Pair weights of the particle method.

Everything in the solver is built from one scalar a pair, :math:`\omega_{ij} = -W'(r_{ij})/r_{ij}`, of the Wendland C2
kernel

.. math:: W(r) = \frac{21}{16\pi h^3}\,(1-q/2)^4\,(1+2q), \qquad q = r/h \le 2,

so that :math:`\omega = \frac{21}{16\pi h^3}\,\frac{5}{h^2}\,(1-q/2)^3`. It is positive inside the support and smooth
at its edge: a particle that enters or leaves a neighbourhood does so without a jump of force.
"""

# mypy: disable-error-code="no-untyped-def"

import math

from ppmc.compile_cache import njit

SUPPORT = 2.0  # support radius in smoothing lengths


@njit(cache=True, inline="always")
def pair_weight(r2: float, h: float) -> float:
    """Weight -W'(r)/r from the squared distance ``r2`` (mm^2) and the smoothing length ``h`` (mm); 1/mm^5."""
    per_h = 1.0 / h
    tail = max(0.0, 1.0 - 0.5 * per_h * math.sqrt(r2))
    return 105.0 / (16.0 * math.pi) * (per_h * per_h * per_h * per_h * per_h) * (tail * tail * tail)


@njit(cache=True, inline="always")
def kernel_value(r2: float, h: float) -> float:
    """Kernel W(r), 1/mm^3, from the squared distance ``r2`` (mm^2) and the smoothing length ``h`` (mm)."""
    q = math.sqrt(r2) / h
    if q >= SUPPORT:
        return 0.0
    tail = 1.0 - 0.5 * q
    tail2 = tail * tail
    return 21.0 / (16.0 * math.pi) * tail2 * tail2 * (1.0 + 2.0 * q) / (h * h * h)

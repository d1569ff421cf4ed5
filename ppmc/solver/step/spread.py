"""Whether the neighbours of particles spread in three dimensions: without that there is no gradient across them.

In one layer of particles nothing is known of the motion across the layer: the gradient has no such part, the material
does not resist it, and a solve finds a smooth wrong answer. The same comes of a lattice drawn out so far that a kernel
no longer reaches along it. A single stray particle, or two that have left the charge, is no such place.
"""

# mypy: disable-error-code="no-untyped-def"

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.errors import NumericalError, SceneError
from ppmc.solver.particles.kernel_shape import inverse_shape
from ppmc.solver.particles.neighbours import Pairs, build_list, weigh_pairs
from ppmc.solver.particles.small_tensors import least_and_most
from ppmc.solver.particles.smoothing import SUPPORT
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.gradient import MOMENT_FLOOR, moment_inverses
from ppmc.solver.step.model import Model

FEWEST = 3  # neighbours of a particle that belongs to the charge: fewer span no plane
MOST_AT_START, MOST_IN_RUN = 0.01, 0.05  # share of such a charge's particles that may lie in a plane or on a line
ENOUGH_LAYERS = 4  # through a thickness: see docs/theory.md


def lies_flat(pairs: Pairs, inverse: np.ndarray) -> np.ndarray:
    """Whether the neighbours of each particle lie in a plane or on a line, shape (n,), bool.

    Parameters
    ----------
    pairs : Pairs
    inverse : ndarray, shape (n, 3, 3)
        Inverse moments as :func:`ppmc.solver.sph.gradient.moment_inverses` gives them: where neighbours do not spread,
        they have been put right, and that shows.
    """
    out = np.zeros(len(inverse), dtype=bool)
    _lies_flat(pairs.count, inverse, pairs.metric, MOMENT_FLOOR * (1.0 + 1e-6), out)
    return out


def check_layers(model: Model, state: ParticleState, source: str) -> None:
    """Refuse a charge, which came from `source`, with parts that are one layer of particles thick.

    Raises
    ------
    SceneError
        If more than a hundredth of the charge is.
    """
    support = SUPPORT * model.smoothing_length
    metric, longest = inverse_shape(state.kernel_shape)
    listed = build_list(state.position, support, 0.0, metric, longest)
    pairs = weigh_pairs(listed, state.position, model.smoothing_length, metric)
    inverse = moment_inverses(pairs, state.position, state.volume)[0]
    flat, belong = lies_flat(pairs, inverse), int(np.sum(pairs.count >= FEWEST))
    if belong == 0:
        raise SceneError(
            f"{source}: no particle has {FEWEST} neighbours within {support:.3g} mm: they make no charge; the spacing"
            f" that it gives is {model.walls.spacing.round(4).tolist()} mm"
        )
    if flat.sum() <= MOST_AT_START * belong:
        return
    where = int(np.flatnonzero(flat)[0])
    thickness = float(np.linalg.norm(np.linalg.eigh(inverse[where])[1][:, 2] * model.walls.spacing))
    raise SceneError(
        f"{source}: {flat.sum()} of {len(state)} particles, the first at {state.position[where].round(3).tolist()} mm,"
        f" lie in a single layer or row, {thickness:.3g} mm thick: no strain can be seen across it; take at least"
        f" {ENOUGH_LAYERS} layers, a charge.spacing of {thickness / ENOUGH_LAYERS:.3g} mm there"
    )


def check_spread(pairs: Pairs, inverse: np.ndarray, state: ParticleState) -> None:
    """Stop a run in which a part of the charge has come to lie in a single layer, or was drawn out beyond its kernels.

    Raises
    ------
    NumericalError
        If more than a twentieth of the charge has.
    """
    flat = lies_flat(pairs, inverse)
    count = int(flat.sum())
    if count <= MOST_IN_RUN * max(int(np.sum(pairs.count >= FEWEST)), 1):
        return
    rows = np.flatnonzero(flat)
    first = rows[np.argmin(state.original[rows])]
    stretch = np.linalg.svd(state.deformation_gradient[rows], compute_uv=False)
    raise NumericalError(
        f"{count} of {len(state)} particles, number {state.original[first]} at"
        f" {state.position[first].round(3).tolist()} mm among them, have neighbours in one layer or row only, drawn out"
        f" to {float(np.median(stretch[:, 0])):.3g} and down to {float(np.median(stretch[:, 2])):.3g} times their"
        " spacing: no strain can be seen across it; take a finer charge.spacing through the thickness"
    )


@njit(cache=True, parallel=True)
def _lies_flat(count, inverse, metric, floor, out):
    for i in prange(out.shape[0]):
        if count[i] < FEWEST:
            continue
        m = inverse[i]
        a, b, c, d, e, f = m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[1, 2], m[0, 2]
        x, y, z = b * c - e * e, f * e - d * c, d * e - f * b
        third = a * x + d * y + f * z
        u, v, w = a * c - f * f, d * f - a * e, a * b - d * d
        if metric.shape[0] == 0:
            first, second = a + b + c, x + u + w
        else:
            # Of C M^-1, with the kernel's shape C, the inverse of its metric G: tr(C M^-1) and tr(cof(M^-1) G).
            g = metric[i]
            ca, cb, cc = g[1] * g[2] - g[4] * g[4], g[0] * g[2] - g[5] * g[5], g[0] * g[1] - g[3] * g[3]
            cd, ce, cf = g[5] * g[4] - g[3] * g[2], g[3] * g[5] - g[4] * g[0], g[3] * g[4] - g[5] * g[1]
            first = ca * a + cb * b + cc * c + 2.0 * (cd * d + ce * e + cf * f)
            second = g[0] * x + g[1] * u + g[2] * w + 2.0 * (g[3] * y + g[4] * v + g[5] * z)
        low, high = least_and_most(first, second, third)
        out[i] = not (low > floor * high)

"""Volume balance: what keeps the transported volume ratio in step with where the particles are.

A flow whose gradients have no trace keeps the packing that each particle sees in its own kernel, as long as neighbours
are spread evenly in it (:mod:`ppmc.solver.particles.neighbours`). Where they are not, at walls above all and late in a
fill, the packing drifts by a few per cent of the strain although every J stays near one. J, and with it the volumetric
part of F, is therefore drawn towards what the packing shows with the strain of each step; the pressure then puts the
packing right, and det F keeps meaning volume. Where the flow is smooth over a kernel, packing keeps its value; what
changes there is how an irregular charge reads as it deforms, and nothing is corrected. Nor is anything where nothing
flows.
"""

import numpy as np

from ppmc.solver.particles.kernel_shape import smoothness, swelling
from ppmc.solver.particles.neighbours import Pairs
from ppmc.solver.particles.smoothing import SUPPORT
from ppmc.solver.particles.state import ParticleState
from ppmc.solver.sph.packing import NearWalls, Packing, inside, interior_mean, packing
from ppmc.solver.walls.tools import Walls

MOST_WRONG = 0.1  # error of packing beyond which the pull grows no more


def measured_packing(
    state: ParticleState, walls: Walls, time: float, pairs: Pairs, inverse_shape: np.ndarray | None, longest: float,
    smoothing_length: float, spacing: float,
) -> Packing:  # fmt: skip
    """Packing of each particle at its present place and volume.

    Arguments are those of :func:`ppmc.solver.sph.packing.packing`, and the longest axis of all kernels; spheres have no
    `inverse_shape`.
    """
    support = SUPPORT * smoothing_length * longest
    near = NearWalls.find(walls.tools.arrays, walls.offsets(time), state.position, support)
    found = packing(
        pairs, state.position, state.volume * state.volume_ratio,
        state.kernel_shape if inverse_shape is None else inverse_shape,
        smoothing_length, spacing * np.cbrt(state.volume_ratio), near,
    )  # fmt: skip
    if inverse_shape is not None:
        found.swollen = swelling(state.kernel_shape, state.lattice_shape)
    return found


def reference_packing(pairs: Pairs, found: Packing, smoothing_length: float) -> np.ndarray:
    """Packing (n,) that a charge has at its start and will be held to."""
    interior = inside(pairs, found, smoothing_length)
    return np.clip(interior_mean(pairs, found.value, interior, smoothing_length), 0.9, 1.1)


def correct_volume(
    state: ParticleState, pairs: Pairs, found: Packing, strain: np.ndarray, rate: float, smoothing_length: float
) -> None:
    """Draw J and the volumetric part of F towards what the packing shows.

    Parameters
    ----------
    state : ParticleState
        Its `volume_ratio` and the volumetric part of its `deformation_gradient` are changed.
    pairs : Pairs
    found : Packing
    strain : ndarray, shape (n,)
        Strain of the step.
    rate : float
        Relative correction for a unit of strain and of error.
    smoothing_length : float
        mm.
    """
    interior = inside(pairs, found, smoothing_length)
    wrong = interior_mean(pairs, found.value, interior, smoothing_length) / state.packing_reference - 1.0
    wrong = np.clip(wrong, -MOST_WRONG, MOST_WRONG)
    rough = 1.0 - smoothness(state.flow_residual)
    pull = np.minimum(rate * np.maximum(strain, strain.mean()), 0.5) * rough * interior
    factor = 1.0 - pull * wrong
    state.volume_ratio *= factor
    state.deformation_gradient *= np.cbrt(factor)[:, None, None]

"""What the velocities of the nodes mean to the particles, and the power that they take."""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.solver.grid.cells import Grid
from ppmc.solver.grid.shapes import NODES, POINTS, functions, sub_points
from ppmc.solver.grid.stiffness import AIR, Stiffness


@dataclass(frozen=True)
class Recovered:
    """Motion of the particles, and powers.

    Attributes
    ----------
    velocity : ndarray, shape (n, 3)
        mm/s.
    gradient : ndarray, shape (n, 3, 3)
        Mean over each particle's share of its cell, with the divergence that the cell keeps in check; 1/s.
    viscous, air, bulk : float
        Power of the body's viscosity, of what fills the cells beside it, and of the stiffness of volume, uN mm/s.
    """

    velocity: np.ndarray
    gradient: np.ndarray
    viscous: float
    air: float
    bulk: float


def at_points(grid: Grid, cell: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (c, 27) and gradients (c, 27, 3), 1/mm, of the functions of cells (c,) at positions (c, 3), mm."""
    value, gradient = np.empty((len(cell), NODES)), np.empty((len(cell), NODES, 3))
    size = grid.size[cell]
    local = 2.0 * (positions - grid.low[cell]) / size - 1.0
    _functions_at(local, value, gradient)
    gradient *= 2.0 / size[:, None]
    return value, gradient


def recover(stiffness: Stiffness, positions: np.ndarray, nodal: np.ndarray) -> Recovered:
    """Motion of particles at positions (n, 3), mm, with the velocities (nodes, 3), mm/s, of the grid."""
    body, material, grid = stiffness.body, stiffness.material, stiffness.body.grid
    cells, n = len(grid.site), len(positions)
    value, gradient = at_points(grid, body.cell, positions)
    around = nodal[grid.nodes[body.cell]]
    velocity = np.einsum("na,nac->nc", value, around)
    found = np.einsum("nac,nad->ncd", around, gradient)
    at = np.repeat(np.arange(cells), np.diff(body.start))
    mean = np.einsum("sac,sad->scd", nodal[grid.nodes[at]], stiffness.gradient)
    own = np.flatnonzero(at == body.cell[body.particle])
    found[body.particle[own]] = mean[own]
    each = nodal[grid.nodes].reshape(cells, -1)
    held = np.einsum("cma,ca->cm", stiffness.moments, each)
    swelling = np.einsum("cmk,ck->cm", stiffness.inverse, held)
    local = 2.0 * (positions - grid.low[body.cell]) / grid.size[body.cell] - 1.0
    kept = np.einsum("nm,nm->n", np.concatenate([np.ones((n, 1)), local], axis=1), swelling[body.cell])
    found += ((kept - np.einsum("naa->n", found)) / 3.0)[:, None, None] * np.eye(3)
    viscous, air = np.zeros(cells), np.zeros(cells)
    _powers(
        grid.size, sub_points()[1], body.share, body.weight, body.start, body.particle, material.shear,
        material.fibre, material.directions, stiffness.pure, each, viscous, air,
    )  # fmt: skip
    trace, mixed = np.einsum("saa->s", mean) / 3.0, np.where(stiffness.pure[at], 0.0, stiffness.volume)
    fibres = 0.0
    for k in range(material.fibre.shape[1]):
        p = material.directions[body.particle, k]
        along = np.einsum("sa,sab,sb->s", p, mean, p) - trace
        fibres += float(np.einsum("s,s,s,s->", mixed, material.fibre[body.particle, k], along, along))
    bulk = float(np.einsum("c,cm,cm->", stiffness.bulk, held, swelling))
    return Recovered(velocity, found, float(viscous.sum()) + fibres, float(air.sum()), bulk)


@njit(cache=True, parallel=True)
def _functions_at(local, value, gradient):
    for i in prange(local.shape[0]):
        functions(local[i], value[i], gradient[i])


@njit(cache=True, parallel=True)
def _powers(size, reference, share, weight, start, particle, shear, fibre, p, pure, nodal, viscous, air):
    for cell in prange(share.shape[0]):
        whole, mean = size[cell, 0] * size[cell, 1] * size[cell, 2], 0.0
        for s in range(start[cell], start[cell + 1]):
            mean += shear[particle[s]]
        mean /= max(start[cell + 1] - start[cell], 1)
        rates = np.empty((3, 3))
        for q in range(POINTS):
            for c in range(3):
                for d in range(3):
                    total = 0.0
                    for a in range(NODES):
                        total += nodal[cell, 3 * a + c] * reference[q, a, d]
                    rates[c, d] = 2.0 / size[cell, d] * total
            third, squares = (rates[0, 0] + rates[1, 1] + rates[2, 2]) / 3.0, 0.0
            for c in range(3):
                for d in range(3):
                    rate = 0.5 * (rates[c, d] + rates[d, c]) - (third if c == d else 0.0)
                    squares += rate * rate
            if share[cell, q] >= 0:
                i = particle[share[cell, q]]
                viscous[cell] += 2.0 * weight[cell, q] * shear[i] * squares
                if pure[cell]:
                    for n in range(p.shape[1]):
                        along = -third
                        for c in range(3):
                            for d in range(3):
                                along += p[i, n, c] * rates[c, d] * p[i, n, d]
                        viscous[cell] += weight[cell, q] * fibre[i, n] * along * along
            else:
                air[cell] += 2.0 * AIR * mean * whole / POINTS * squares

r"""Coarse level of the preconditioner: affine motions of compact tiles.

A pointwise preconditioner leaves a handful of very slow modes, smooth motions of the whole charge, and with stiff
fibres they decide the number of iterations. Here every tile t has twelve modes, :math:`v = c_0 + C (x - X_t)/s_t`,
projected onto the free directions of the contacts, and the Galerkin operator :math:`A_c = Z^T A Z` is made exactly,
particle by particle, and factorised. The correction :math:`Z A_c^{-1} Z^T r` is added to the block-Jacobi one.

Rigid motions that no tool holds cost no power. They are given a stiffness in the coarse operator, so that round-off
is not blown up into a drift.
"""

# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np

from ppmc.compile_cache import njit, prange
from ppmc.errors import NumericalError
from ppmc.solver.system import VelocitySystem

MODES = 12
BATCH = 16  # tiles whose dense blocks are held at once
REGULAR = 1e-10  # of the diagonal, for modes that a flat or constrained tile does not have
LOOSE = 1e-7  # of the mean diagonal, below which a rigid motion counts as held by no tool


@dataclass
class CoarseLevel:
    """Factorised coarse operator with what is needed to go up and down.

    Attributes
    ----------
    tile : ndarray, shape (n,), int32
        Tile of each particle, in the charge's order.
    arm : ndarray, shape (n, 3)
        (x - X_t)/s_t of each particle when the level was made, in the charge's order.
    factor : ndarray, shape (12 tiles, 12 tiles)
        Cholesky factor of the coarse operator, lower triangle.
    """

    tile: np.ndarray
    arm: np.ndarray
    factor: np.ndarray

    def sorted_as(self, original: np.ndarray) -> "SortedLevel":
        """Return the level for particles in their present order, given their numbers in the charge."""
        tile = np.ascontiguousarray(self.tile[original])
        members, start = _members(tile)
        return SortedLevel(tile, start, members, np.ascontiguousarray(self.arm[original]), self.factor)


@dataclass
class SortedLevel:
    """A coarse level in the present order of the particles."""

    tile: np.ndarray
    start: np.ndarray
    members: np.ndarray
    arm: np.ndarray
    factor: np.ndarray

    def correct(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Coarse correction of a free residual, shape (n, 3)."""
        from scipy.linalg import cho_solve

        coarse = np.empty((len(self.start) - 1, MODES))
        _restrict(self.start, self.members, self.arm, residual, coarse)
        solved = cho_solve((self.factor, True), coarse.ravel(), overwrite_b=True, check_finite=False)
        out = np.empty_like(residual)
        _prolong(self.tile, self.arm, solved.reshape(-1, MODES), free, out)
        return out


def make_coarse_level(system: VelocitySystem, tile: np.ndarray, original: np.ndarray) -> CoarseLevel:
    """Assemble and factorise the coarse operator of a system.

    Parameters
    ----------
    system : VelocitySystem
    tile : ndarray, shape (n,), int32
        From :func:`ppmc.solver.tiles.make_tiles`, in the present order of the particles.
    original : ndarray, shape (n,)
        Number of each particle in the charge.

    Returns
    -------
    CoarseLevel

    Raises
    ------
    ppmc.errors.NumericalError
        If the operator is not positive definite, which no finite state leads to.
    """
    from scipy.linalg import LinAlgError, cho_factor

    positions = system.operator.positions
    members, start = _members(tile)
    centre, scale, arm = _frames(positions, tile, members, start)
    matrix = galerkin_operator(system, tile, members, start, centre, scale)
    diagonal = np.einsum("ii->i", matrix)
    per_tile = diagonal.reshape(-1, MODES).max(axis=1)
    diagonal += np.repeat(REGULAR * np.maximum(per_tile, REGULAR * per_tile.max()), MODES)
    _hold_rigid_modes(matrix, centre, scale)
    try:
        factor, _ = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError as error:
        raise NumericalError(f"the coarse operator of the preconditioner broke down ({error})") from error
    level = CoarseLevel(np.empty_like(tile), np.empty_like(arm), np.asarray(factor))
    level.tile[original], level.arm[original] = tile, arm
    return level


def galerkin_operator(
    system: VelocitySystem,
    tile: np.ndarray,
    members: np.ndarray,
    start: np.ndarray,
    centre: np.ndarray,
    scale: np.ndarray,
) -> np.ndarray:
    """Coarse operator Z^T A Z, shape (12 tiles, 12 tiles), from the power of each particle."""
    op, p = system.operator, system.operator.pairs
    tiles = len(start) - 1
    matrix = np.zeros((tiles * MODES, tiles * MODES))
    for first in range(0, tiles, BATCH):
        batch = range(first, min(first + BATCH, tiles))
        near = [_near_tiles(p.start, p.count, p.index, tile, members[start[t] : start[t + 1]], tiles) for t in batch]
        near_bounds = np.cumsum([0, *(len(u) for u in near)])
        block_bounds = np.cumsum([0, *((len(u) * MODES) ** 2 for u in near)])
        blocks = np.zeros(block_bounds[-1])
        _assemble_groups(
            start[first : first + len(batch) + 1], members, near_bounds, np.concatenate(near), block_bounds, blocks,
            p.start, p.count, p.index, p.weight, op.positions, op.volumes, op.inverse, op.shear, op.bulk, op.fibre,
            op.directions, op.control, tile, centre, scale, system.free, system.mass[:, 0], system.drag,
        )  # fmt: skip
        for g, tiles_near in enumerate(near):
            size = len(tiles_near) * MODES
            block = blocks[block_bounds[g] : block_bounds[g + 1]].reshape(size, size)
            rows = (tiles_near[:, None] * MODES + np.arange(MODES)).ravel()
            matrix[np.ix_(rows, rows)] += block
    return matrix


def _hold_rigid_modes(matrix: np.ndarray, centre: np.ndarray, scale: np.ndarray) -> None:
    """Add a stiffness to the rigid motions without power, in place."""
    tiles = len(centre)
    modes = np.zeros((tiles, MODES, 6))
    for a in range(3):
        modes[:, a, a] = 1.0
        spin = np.zeros((3, 3))
        spin[(a + 1) % 3, (a + 2) % 3], spin[(a + 2) % 3, (a + 1) % 3] = -1.0, 1.0
        modes[:, :3, 3 + a] = (centre - centre.mean(axis=0)) @ spin.T
        modes[:, 3:, 3 + a] = scale[:, None] * spin.ravel()
    basis, _ = np.linalg.qr(modes.reshape(-1, 6))
    image = matrix @ basis
    values, vectors = np.linalg.eigh(basis.T @ image)
    typical = float(np.einsum("ii->i", matrix).mean())
    loose = basis @ vectors[:, values < LOOSE * typical]
    matrix += typical * loose @ loose.T


def _members(tile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    members = np.argsort(tile, kind="stable")
    return members, np.searchsorted(tile[members], np.arange(int(tile.max()) + 2)).astype(np.int64)


def _frames(
    positions: np.ndarray, tile: np.ndarray, members: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = np.diff(start)
    centre = np.add.reduceat(positions[members], start[:-1], axis=0) / count[:, None]
    arm = positions - centre[tile]
    spread = np.add.reduceat(np.einsum("na,na->n", arm[members], arm[members]), start[:-1]) / count
    scale = np.sqrt(np.maximum(spread, 1e-12))
    return centre, scale, arm / scale[tile, None]


@njit(cache=True)
def _near_tiles(start, count, index, tile, group, tiles):
    seen = np.zeros(tiles, dtype=np.bool_)
    for i in group:
        seen[tile[i]] = True
        for slot in range(start[i], start[i] + count[i]):
            seen[tile[index[slot]]] = True
    return np.flatnonzero(seen)


@njit(cache=True, parallel=True)
def _restrict(start, members, arm, residual, out):
    for t in prange(len(start) - 1):
        for m in range(MODES):
            out[t, m] = 0.0
        for slot in range(start[t], start[t + 1]):
            i = members[slot]
            for c in range(3):
                r = residual[i, c]
                out[t, c] += r
                out[t, 3 + 3 * c] += r * arm[i, 0]
                out[t, 4 + 3 * c] += r * arm[i, 1]
                out[t, 5 + 3 * c] += r * arm[i, 2]


@njit(cache=True, parallel=True)
def _prolong(tile, arm, coarse, free, out):
    for i in prange(len(tile)):
        t = tile[i]
        v = np.empty(3)
        for c in range(3):
            v[c] = coarse[t, c]
            for k in range(3):
                v[c] += coarse[t, 3 + 3 * c + k] * arm[i, k]
        for r in range(3):
            out[i, r] = free[i, r, 0] * v[0] + free[i, r, 1] * v[1] + free[i, r, 2] * v[2]


@njit(cache=True)
def _motion(x, i, t, centre, scale, free, out):
    # The twelve modes of tile t at particle i on its free directions: out (3, 12).
    for c in range(3):
        for r in range(3):
            f = free[i, r, c]
            out[r, c] = f
            for k in range(3):
                out[r, 3 + 3 * c + k] = f * (x[i, k] - centre[t, k]) / scale[t]


@njit(cache=True)
def _bond_stiffness(d, control, p, out):
    per_r2 = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for r in range(3):
        for c in range(3):
            out[r, c] = control[1] * per_r2 * d[r] * d[c]
        out[r, r] += control[0]
    for k in range(p.shape[0]):
        pd = p[k, 0] * d[0] + p[k, 1] * d[1] + p[k, 2] * d[2]
        for r in range(3):
            nr = p[k, r] * pd - d[r] / 3.0
            for c in range(3):
                out[r, c] += control[2 + k] * per_r2 * nr * (p[k, c] * pd - d[c] / 3.0)


@njit(cache=True)
def _gradient_stiffness(shear, bulk, fibre, p, out):
    # Power of a velocity gradient as a quadratic form in its nine components (row by row).
    out[:, :] = 0.0
    for a in range(3):
        for b in range(3):
            out[3 * a + b, 3 * a + b] += shear
            out[3 * a + b, 3 * b + a] += shear
            out[4 * a, 4 * b] += bulk - 2.0 * shear / 3.0
    for k in range(p.shape[0]):
        for a in range(9):
            ma = p[k, a // 3] * p[k, a % 3] - (1.0 / 3.0 if a % 4 == 0 else 0.0)
            for b in range(9):
                mb = p[k, b // 3] * p[k, b % 3] - (1.0 / 3.0 if b % 4 == 0 else 0.0)
                out[a, b] += fibre[k] * ma * mb


@njit(cache=True, parallel=True)
def _assemble_groups(
    bounds,
    particles,
    near_bounds,
    near_all,
    block_bounds,
    blocks,
    start,
    count,
    index,
    weight,
    x,
    volume,
    inverse,
    shear,
    bulk,
    fibre,
    p,
    control,
    tile,
    centre,
    scale,
    free,
    mass,
    drag,
):
    for g in prange(len(bounds) - 1):
        near = near_all[near_bounds[g] : near_bounds[g + 1]]
        size = len(near) * MODES
        full = blocks[block_bounds[g] : block_bounds[g + 1]].reshape(size, size)
        gradient, coupling = np.zeros((9, size)), np.zeros((size, 9))
        touched, flag = np.empty(len(near), np.int64), np.zeros(len(near), np.bool_)
        own, other, weighted = np.zeros((3, MODES)), np.zeros((3, MODES)), np.zeros((3, MODES))
        h, d, back = np.empty((3, 3)), np.empty(3), np.empty(3)
        stiff, product = np.empty((9, 9)), np.zeros((9, size))
        for member in range(bounds[g], bounds[g + 1]):
            i = particles[member]
            t_own = np.searchsorted(near, tile[i])
            _motion(x, i, tile[i], centre, scale, free, own)
            touched[0] = t_own
            flag[t_own] = True
            n_touched = 1
            oo = t_own * MODES
            for a in range(MODES):
                for b in range(MODES):
                    total = 0.0
                    for r in range(3):
                        total += own[r, a] * mass[i] * own[r, b]
                        for c in range(3):
                            total += own[r, a] * drag[i, r, c] * own[c, b]
                    full[oo + a, oo + b] += total
            _gradient_stiffness(volume[i] * shear[i], volume[i] * bulk[i], volume[i] * fibre[i], p[i], stiff)
            for slot in range(start[i], start[i] + count[i]):
                j = index[slot]
                t_other = np.searchsorted(near, tile[j])
                _motion(x, j, tile[j], centre, scale, free, other)
                if not flag[t_other]:
                    flag[t_other] = True
                    touched[n_touched] = t_other
                    n_touched += 1
                for c in range(3):
                    d[c] = x[j, c] - x[i, c]
                a_ij = volume[j] * weight[slot]
                _bond_stiffness(d, control[i], p[i], h)
                for r in range(3):
                    back[r] = a_ij * (inverse[i, r, 0] * d[0] + inverse[i, r, 1] * d[1] + inverse[i, r, 2] * d[2])
                    for c in range(3):
                        h[r, c] *= a_ij
                # Zero-energy part in the gradient alone.
                for ra in range(3):
                    for ca in range(3):
                        for rb in range(3):
                            for cb in range(3):
                                stiff[3 * ra + ca, 3 * rb + cb] += h[ra, rb] * d[ca] * d[cb]
                for side in range(2):
                    t = t_other if side == 0 else t_own
                    sign = 1.0 if side == 0 else -1.0
                    motion = other if side == 0 else own
                    for m in range(MODES):
                        for r in range(3):
                            weighted[r, m] = sign * (
                                h[r, 0] * motion[0, m] + h[r, 1] * motion[1, m] + h[r, 2] * motion[2, m]
                            )
                    o = t * MODES
                    for m in range(MODES):
                        for r in range(3):
                            for c in range(3):
                                gradient[3 * r + c, o + m] += sign * motion[r, m] * back[c]
                                coupling[o + m, 3 * r + c] -= weighted[r, m] * d[c]
                    for m in range(MODES):
                        for q in range(MODES):
                            total = (
                                weighted[0, m] * motion[0, q]
                                + weighted[1, m] * motion[1, q]
                                + weighted[2, m] * motion[2, q]
                            )
                            full[o + m, o + q] += sign * total
                    if side == 0:
                        for m in range(MODES):
                            for q in range(MODES):
                                total = (
                                    weighted[0, m] * own[0, q] + weighted[1, m] * own[1, q] + weighted[2, m] * own[2, q]
                                )
                                full[o + m, oo + q] -= total
                                full[oo + q, o + m] -= total
            # Insert the gradient's dependence on the modes: coupling G + (coupling G)^T + G^T stiff G.
            for ta in range(n_touched):
                oa = touched[ta] * MODES
                for m in range(MODES):
                    for a in range(9):
                        total = 0.0
                        for b in range(9):
                            total += stiff[a, b] * gradient[b, oa + m]
                        product[a, oa + m] = 0.5 * total + coupling[oa + m, a]
            for ta in range(n_touched):
                oa = touched[ta] * MODES
                for tb in range(n_touched):
                    ob = touched[tb] * MODES
                    for m in range(MODES):
                        for q in range(MODES):
                            total = 0.0
                            for a in range(9):
                                total += (
                                    product[a, oa + m] * gradient[a, ob + q] + gradient[a, oa + m] * product[a, ob + q]
                                )
                            full[oa + m, ob + q] += total
            for ta in range(n_touched):
                oa = touched[ta] * MODES
                flag[touched[ta]] = False
                for m in range(MODES):
                    for a in range(9):
                        gradient[a, oa + m] = 0.0
                        coupling[oa + m, a] = 0.0

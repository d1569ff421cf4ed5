"""Small blocks of particles shared by the solver tests, and the operator in plain NumPy as the kernels' oracle."""

import numpy as np

from ppmc.solver.particles.kernel_shape import full, inverse_shape
from ppmc.solver.particles.neighbours import build_list, weigh_pairs
from ppmc.solver.sph.operator import Operator, assemble


def lattice(shape: tuple[int, int, int], jitter: float = 0.0, seed: int = 0) -> np.ndarray:
    """Particles of spacing 1 in a block that begins at the origin."""
    axes = [np.arange(n) + 0.5 for n in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points + jitter * np.random.default_rng(seed).uniform(-1.0, 1.0, points.shape)


def unit_vectors(n: int, seed: int = 1) -> np.ndarray:
    """Random unit vectors, one direction a particle: shape (n, 1, 3)."""
    v = np.random.default_rng(seed).normal(size=(n, 1, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def stretched(n: int, aspect: float, seed: int) -> np.ndarray:
    """Shape tensors (n, 6) of unit determinant, axes anyhow, the longest `aspect` times the shortest."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    values = aspect ** np.column_stack([np.zeros(n), rng.uniform(0.0, 1.0, n), np.ones(n)])
    values /= np.cbrt(np.prod(values, axis=1))[:, None]
    tensors = np.einsum("nab,nb,ncb->nac", axes, values**2, axes)
    return np.ascontiguousarray(tensors.reshape(-1, 9)[:, [0, 4, 8, 1, 5, 2]])


def make_operator(
    positions: np.ndarray, directions: np.ndarray, shear: float = 1.0, ratio: float = 100.0, bulk: float = 50.0,
    shape: np.ndarray | None = None,
) -> Operator:  # fmt: skip
    """Operator with unit volumes and equal material everywhere; kernels are spheres or have a `shape`, (n, 6), each."""
    n = len(positions)
    metric, longest = (None, 1.0) if shape is None else inverse_shape(shape)
    pairs = weigh_pairs(build_list(positions, 2.7, 0.05, metric, longest), positions, 1.3, metric)
    fibre = np.full((n, directions.shape[1]), 4.0 * shear * (ratio - 1.0) / max(directions.shape[1], 1))
    return assemble(pairs, positions, np.ones(n), np.full(n, shear), np.full(n, bulk), fibre, directions)


def dense_matrix(operator: Operator) -> np.ndarray:
    """Return the operator as a matrix (3n, 3n), column by column."""
    n = len(operator.positions)
    matrix = np.empty((3 * n, 3 * n))
    for column in range(3 * n):
        unit = np.zeros((n, 3))
        unit.flat[column] = 1.0
        matrix[:, column] = operator.apply(unit).ravel()
    return matrix


def wendland_weight(r: np.ndarray, h: float) -> np.ndarray:
    """-W'(r)/r by central difference of the textbook kernel, not from the formula the code uses."""

    def kernel(r: np.ndarray) -> np.ndarray:
        q = np.minimum(r / h, 2.0)
        return 21.0 / (16.0 * np.pi * h**3) * (1.0 - q / 2.0) ** 4 * (2.0 * q + 1.0)

    return -(kernel(r + 1e-5) - kernel(r - 1e-5)) / 2e-5 / r


def power_by_definition(
    operator: Operator, velocities: np.ndarray, h: float = 1.3, shape: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Twice the energy v . A v and the velocity gradients, straight from the formulas, particle by particle."""
    x, volumes = operator.positions, operator.volumes
    n = len(x)
    power, gradients = 0.0, np.zeros((n, 3, 3))
    metric = np.broadcast_to(np.eye(3), (n, 3, 3)) if shape is None else np.linalg.inv(full(shape))
    for i in range(n):
        d = x - x[i]
        away = np.sqrt(np.einsum("ja,ab,jb->j", d, metric[i], d))
        near = np.flatnonzero((away > 0.0) & (away < 2.0 * h))
        d, r, away = d[near], np.linalg.norm(d[near], axis=1), away[near]
        # Weights are kept in single precision; that rounding aside, both sides are the same to round-off.
        a = volumes[near] * wendland_weight(away, h).astype(np.float32).astype(np.float64)
        moment = np.einsum("j,ja,jb->ab", a, d, d)
        dv = velocities[near] - velocities[i]
        gradient = np.einsum("j,ja,jb->ab", a, dv, d) @ np.linalg.inv(moment)
        gradients[i] = gradient
        rate = 0.5 * (gradient + gradient.T)
        dev = rate - np.trace(rate) / 3.0 * np.eye(3)
        power += (
            volumes[i] * 2.0 * operator.shear[i] * np.sum(dev * dev)
            + volumes[i] * operator.bulk[i] * np.trace(rate) ** 2
        )
        residual = dv - d @ gradient.T
        normal = d / r[:, None]
        planar = operator.fibre[i].sum() / 4.0 + 3.0 * operator.shear[i]
        bond = 2.0 * (planar**5 * operator.shear[i]) ** (1.0 / 6.0)
        stiff = bond * np.einsum("ja,ja->j", normal, residual) ** 2
        for k, p in enumerate(operator.directions[i]):
            m = np.outer(p, p) - np.eye(3) / 3.0
            power += volumes[i] * operator.fibre[i, k] * np.sum(rate * m) ** 2
            stiff = stiff + 0.1 * operator.fibre[i, k] * np.einsum("ja,ja->j", normal @ m, residual) ** 2
        power += np.sum(a * volumes[i] * (operator.shear[i] * np.sum(residual**2, axis=1) + stiff / np.trace(moment)))
    return power, gradients

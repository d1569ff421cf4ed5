r"""Shape of the support under stretch.

Past a stretch of about two a fixed sphere loses its neighbours in one direction and gains too many in another. A
shape tensor C with metric :math:`C^{-1}` follows the deformation, :math:`C \leftarrow A C A^T` with unit determinant,
and its axes are kept within a limited ratio. Only the weights change with it: moments, gradients and adjoint stay as
they are.
"""

import numpy as np


def convect_shape(shape: np.ndarray, increment: np.ndarray, aspect_limit: float) -> np.ndarray:
    """Shape tensors after an increment of deformation.

    Parameters
    ----------
    shape : ndarray, shape (n, 6)
        C as XX, YY, ZZ, XY, YZ, XZ.
    increment : ndarray, shape (n, 3, 3)
        A.
    aspect_limit : float
        Largest ratio of two axes of the ellipsoid.

    Returns
    -------
    ndarray, shape (n, 6)
    """
    moved = increment @ full(shape) @ np.swapaxes(increment, -1, -2)
    values, vectors = np.linalg.eigh(moved)
    values = np.maximum(values, values[:, 2:] / aspect_limit**2)
    values /= np.cbrt(np.prod(values, axis=1))[:, None]
    return six(np.einsum("nab,nb,ncb->nac", vectors, values, vectors))


def inverse_shape(shape: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse shape tensors, shape (n, 6), and the longest axis of all."""
    tensors = full(shape)
    return six(np.linalg.inv(tensors)), float(np.sqrt(np.linalg.eigvalsh(tensors)[:, 2].max()))


def full(six_components: np.ndarray) -> np.ndarray:
    """Symmetric tensors (n, 3, 3) from XX, YY, ZZ, XY, YZ, XZ (n, 6)."""
    return six_components[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)


def six(tensors: np.ndarray) -> np.ndarray:
    """Components XX, YY, ZZ, XY, YZ, XZ (n, 6) of symmetric tensors (n, 3, 3)."""
    flat = tensors.reshape(-1, 9)
    return np.ascontiguousarray(flat[:, [0, 4, 8, 1, 5, 2]])

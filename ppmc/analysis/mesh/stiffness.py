"""Orientation-averaged stiffness of transversely isotropic platelets (Advani and Tucker, J. Rheol. 31 (1987) 751)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Six components in the order XX, YY, ZZ, XY, YZ, XZ, as everywhere on disk.
_ROW, _COLUMN = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])


@dataclass(frozen=True)
class Lamina:
    """Engineering constants of a unidirectional platelet, axis 1 along the fibres; moduli in Pa."""

    axial_modulus: float
    transverse_modulus: float
    axial_poisson_ratio: float
    transverse_poisson_ratio: float
    shear_modulus: float

    def stiffness(self) -> Array:
        """Return the 6 x 6 matrix in the order 11, 22, 33, 12, 23, 13 with engineering shear strains.

        Raises
        ------
        ValueError
            If the constants make no stable material (a stiffness that is not positive definite).
        """
        E1, E2, v12, v23 = (
            self.axial_modulus, self.transverse_modulus, self.axial_poisson_ratio, self.transverse_poisson_ratio
        )  # fmt: skip
        S = np.zeros((6, 6))
        S[0, 0], S[1, 1], S[2, 2] = 1 / E1, 1 / E2, 1 / E2
        S[0, 1] = S[1, 0] = S[0, 2] = S[2, 0] = -v12 / E1
        S[1, 2] = S[2, 1] = -v23 / E2
        S[3, 3] = S[5, 5] = 1 / self.shear_modulus
        S[4, 4] = 2 * (1 + v23) / E2
        if np.linalg.eigvalsh(S).min() <= 0:
            raise ValueError(f"{self} is no stable material: its compliance is not positive definite")
        return np.asarray(np.linalg.inv(S))


def averaged_stiffness(second: Array, fourth: Array, lamina: Lamina) -> Array:
    """Return the volume-averaged stiffness tensor of platelets with the orientation tensors A and 𝔸.

    Parameters
    ----------
    second : ndarray, shape (..., 3, 3)
    fourth : ndarray, shape (..., 3, 3, 3, 3)
    lamina : Lamina

    Returns
    -------
    ndarray, shape (..., 3, 3, 3, 3)
        C_ijkl in Pa: B1 𝔸 + B2 (Aδ + δA) + B3 (four permutations) + B4 δδ + B5 (δδ + δδ): a Voigt average, an upper
        bound.
    """
    C = lamina.stiffness()
    b1 = C[0, 0] + C[1, 1] - 2 * C[0, 1] - 4 * C[3, 3]
    b2 = C[0, 1] - C[1, 2]
    b3 = C[3, 3] + 0.5 * (C[1, 2] - C[1, 1])
    b4, b5 = C[1, 2], 0.5 * (C[1, 1] - C[1, 2])
    A, d = np.asarray(second), np.eye(3)
    pair = np.einsum("...ij,kl->...ijkl", A, d) + np.einsum("...kl,ij->...ijkl", A, d)
    cross = (
        np.einsum("...ik,jl->...ijkl", A, d)
        + np.einsum("...il,jk->...ijkl", A, d)
        + np.einsum("...jl,ik->...ijkl", A, d)
        + np.einsum("...jk,il->...ijkl", A, d)
    )
    unit = np.einsum("ij,kl->ijkl", d, d)
    shear = np.einsum("ik,jl->ijkl", d, d) + np.einsum("il,jk->ijkl", d, d)
    return np.asarray(b1 * fourth + b2 * pair + b3 * cross + b4 * unit + b5 * shear)


def stiffness_matrix(tensor: Array) -> Array:
    """Return C_ijkl as (..., 6, 6) in the order 11, 22, 33, 12, 23, 13, for engineering shear strains."""
    return np.asarray(tensor)[..., _ROW[:, None], _COLUMN[:, None], _ROW[None, :], _COLUMN[None, :]]


def engineering_moduli(matrix: Array) -> Array:
    """Return E1, E2, E3, G12, G23, G13, shape (..., 6), Pa, of stiffness matrices, shape (..., 6, 6)."""
    return np.asarray(1.0 / np.diagonal(np.linalg.inv(matrix), axis1=-2, axis2=-1))

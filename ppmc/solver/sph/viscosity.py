r"""Stress of the orientation-averaged viscosity, in its rank-one form.

J5 is rank one plus isotropic: with :math:`m_k = p_k\otimes p_k - I/3`,

.. math:: \tau = \sum_k 4\eta_{23}(R-1)\,v_k\,(D:m_k)\,m_k + 2\eta_{23}\,\mathrm{dev}\,D .

The operator takes :math:`\eta_{23}` a particle, the stiffnesses :math:`4\eta_{23}(R-1)v_k` and the directions
:math:`p_k`. The functions here are the same in plain NumPy, for tests, output and single material points.
"""

import numpy as np


def viscous_stress(rate: np.ndarray, shear: np.ndarray, fibre: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Deviatoric viscous stress.

    Parameters
    ----------
    rate : ndarray, shape (n, 3, 3)
        Rate of deformation D, 1/s (only its symmetric part counts).
    shear : ndarray, shape (n,)
        eta23, Pa s.
    fibre : ndarray, shape (n, k)
        Fibre stiffness 4 eta23 (R - 1) v_k of each direction, Pa s.
    directions : ndarray, shape (n, k, 3)
        Unit directions p_k.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        tau, Pa (J5, A3).
    """
    rate = 0.5 * (rate + np.swapaxes(rate, -1, -2))
    third = np.einsum("nii->n", rate)[:, None, None] / 3.0 * np.eye(3)
    m = directions[..., :, None] * directions[..., None, :] - np.eye(3) / 3.0
    along = np.einsum("nij,nkij->nk", rate, m)
    return 2.0 * shear[:, None, None] * (rate - third) + np.einsum("nk,nk,nkij->nij", fibre, along, m)


def viscosity_tensor(shear: float, ratio: float, directions: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Fourth-order viscosity of J5, averaged over directions with volume fractions (A3).

    Parameters
    ----------
    shear : float
        eta23, Pa s.
    ratio : float
        Anisotropy ratio R.
    directions : ndarray, shape (k, 3)
        Unit directions.
    fractions : ndarray, shape (k,)
        Volume fractions.

    Returns
    -------
    ndarray, shape (3, 3, 3, 3)
        Maps D to the deviatoric stress; Pa s.
    """
    eye = np.eye(3)
    symmetric = 0.5 * (np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye))
    deviator = symmetric - np.einsum("ij,kl->ijkl", eye, eye) / 3.0
    m = directions[:, :, None] * directions[:, None, :] - eye / 3.0
    return 2.0 * shear * deviator + 4.0 * shear * (ratio - 1.0) * np.einsum("k,kij,klm->ijlm", fractions, m, m)


def dissipation(rate: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Power per volume, D : sigma, shape (n,), Pa/s."""
    return np.einsum("nij,nij->n", rate, stress)

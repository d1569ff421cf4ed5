r"""Relations between the composition of a platelet and its viscosities.

Notation of J: :math:`\eta_{11}` along the fibre, :math:`\eta_{23} = \eta_{12} = \kappa\eta_0` in shear,
:math:`R_\eta = \eta_{11}/\eta_{22}` with :math:`\eta_{22} = 4\eta_{11}\eta_{23}/(\eta_{11}+\eta_{23})`.
"""

import math

HEXAGONAL_PACKING = math.pi / math.sqrt(12.0)


def shear_factor(fibre_volume_fraction: float) -> float:
    r"""Shear viscosity of the platelet over that of the matrix, :math:`\kappa`.

    Parameters
    ----------
    fibre_volume_fraction : float
        Vf, below the hexagonal packing limit of 0.9069.

    Returns
    -------
    float
        :math:`\kappa = 1 / (1 - \sqrt{V_f/F})`, :math:`F = \pi/\sqrt{12}` (J, section II.B); 5.359 at Vf = 0.60.

    Raises
    ------
    ValueError
        If the fraction is not between 0 and the packing limit.
    """
    if not 0.0 <= fibre_volume_fraction < HEXAGONAL_PACKING:
        raise ValueError(f"fibre volume fraction {fibre_volume_fraction} is not between 0 and {HEXAGONAL_PACKING:.4f}")
    return 1.0 / (1.0 - math.sqrt(fibre_volume_fraction / HEXAGONAL_PACKING))


def ratio_from_viscosities(axial: float, shear: float) -> float:
    r"""Anisotropy ratio :math:`R_\eta = (\eta_{11}/\eta_{23} + 1)/4` (J, section II.B)."""
    return 0.25 * (axial / shear + 1.0)


def axial_viscosity(ratio: float, shear: float) -> float:
    r"""Axial viscosity :math:`\eta_{11} = (4R_\eta - 1)\,\eta_{23}`."""
    return (4.0 * ratio - 1.0) * shear


def transverse_viscosity(ratio: float, shear: float) -> float:
    r"""Transverse extensional viscosity :math:`\eta_{22} = 4\eta_{11}\eta_{23}/(\eta_{11}+\eta_{23})`."""
    axial = axial_viscosity(ratio, shear)
    return 4.0 * axial * shear / (axial + shear)


def ratio_from_aspect(aspect_ratio: float, rule: str, fibre_volume_fraction: float = 0.6) -> float:
    r"""Anisotropy ratio from an aspect ratio a = L_f/D_f of fibres or L/H of platelets.

    Parameters
    ----------
    aspect_ratio : float
        a.
    rule : {"pipes", "shear_lag"}
        ``pipes``: :math:`\eta_{11}/\eta_{23} = (V_f/2)\,a^2`; ``shear_lag``: :math:`a^2/4`. The papers give the
        proportionality to :math:`a^2` but not the factor, so the rule is the user's to choose.
    fibre_volume_fraction : float
        Vf, used by ``pipes``.

    Returns
    -------
    float
        R, never below 1 (the Newtonian limit).

    Raises
    ------
    ValueError
        If the rule is unknown.
    """
    if rule == "pipes":
        viscosity_ratio = 0.5 * fibre_volume_fraction * aspect_ratio**2
    elif rule == "shear_lag":
        viscosity_ratio = 0.25 * aspect_ratio**2
    else:
        raise ValueError(f"rule {rule!r} is none of 'pipes', 'shear_lag'")
    return max(1.0, ratio_from_viscosities(viscosity_ratio, 1.0))

"""From the scene's domain to a lattice of particles."""

from __future__ import annotations

from pathlib import Path

from ppmc.charge.domains.lattice import Lattice, box_lattice, filled_lattice
from ppmc.scene.sections.charge import BoxDomain, ChargeSection, DrapedDomain


def lattice_of(section: ChargeSection, folder: Path = Path()) -> Lattice:
    """Return the particles of a charge that is not draped.

    Parameters
    ----------
    section : ChargeSection
        Domain, spacing and layers.
    folder : Path
        Folder that relative paths of surfaces refer to.

    Raises
    ------
    SceneError
        If the spacing does not suit the domain, or the domain has no ends or a faulty outline.
    InputFileError
        If a surface cannot be read or is not closed.
    """
    domain, spacing, layers = section.domain, section.spacing, section.layers
    if isinstance(domain, BoxDomain):
        return box_lattice(domain.origin, domain.size, spacing, layers)
    if isinstance(domain, DrapedDomain):
        raise TypeError("a draped charge is made by ppmc.charge.domains.drape")
    from ppmc.geometry.domain import closed_domain

    solid = closed_domain(domain, folder)
    lower, upper = solid.bounds
    what = f"the {domain.shape} of charge.domain"
    return filled_lattice(lower, upper, solid.volume, solid.contains, spacing, layers, what=what)

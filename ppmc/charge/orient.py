"""From the scene's choice of orientations to a frame for every particle."""

from __future__ import annotations

import numpy as np

from ppmc.charge.domains.lattice import Lattice
from ppmc.charge.orientations.directions import planar_random, uniform_frames
from ppmc.charge.orientations.frames import GIVEN, RANDOM, Frames
from ppmc.charge.platelets.platelets import random_platelets
from ppmc.scene.sections.charge import (
    OrientationSource,
    PlanarRandomOrientation,
    PlateletsOrientation,
    UniformOrientation,
)


def frames_of(section: OrientationSource, lattice: Lattice, generator: np.random.Generator) -> Frames:
    """Return the frames of a charge whose orientations need no file.

    Parameters
    ----------
    section : OrientationSource
        Any source but ``ct``, which reads a file and is served by `ppmc.charge.orientations.from_ct`.
    lattice : Lattice
        The particles.
    generator : numpy.random.Generator
        Source of all random draws.

    Raises
    ------
    TypeError
        If the source is not one of these.
    """
    if isinstance(section, UniformOrientation):
        p, r = uniform_frames(lattice.n, section.fibre_direction, section.platelet_normal)
        return Frames.of(p, r, GIVEN)
    if isinstance(section, PlanarRandomOrientation):
        r = np.tile(np.asarray(section.normal, dtype=float), (lattice.n, 1))
        return Frames.of(planar_random(r, generator), r, RANDOM)
    if isinstance(section, PlateletsOrientation):
        return random_platelets(section, lattice, generator)
    raise TypeError(f"orientation source {type(section).__name__} needs a file")

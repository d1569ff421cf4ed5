"""The section ``material``: the registry of viscosity models, told apart by ``model``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ppmc.scene.sections.materials.newtonian import Newtonian
from ppmc.scene.sections.materials.orientation_mixture import OrientationMixture
from ppmc.scene.sections.materials.planar_uniform import PlanarUniform
from ppmc.scene.sections.materials.transversely_isotropic import TransverselyIsotropic

MaterialSection = Annotated[
    Newtonian | TransverselyIsotropic | OrientationMixture | PlanarUniform, Field(discriminator="model")
]

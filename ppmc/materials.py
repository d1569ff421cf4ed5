"""Materials for :func:`ppmc.solve`: the viscosity models that a scene's section ``material`` knows."""

from ppmc.scene.sections.materials.newtonian import Newtonian
from ppmc.scene.sections.materials.orientation_mixture import OrientationMixture
from ppmc.scene.sections.materials.planar_uniform import PlanarUniform
from ppmc.scene.sections.materials.transversely_isotropic import TransverselyIsotropic

__all__ = ["Newtonian", "OrientationMixture", "PlanarUniform", "TransverselyIsotropic"]

"""What the materials that a scene can name have in common: each is a section of the scene and a law at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ppmc.materials.law import Material
from ppmc.scene.base import Section


class MaterialBase(Section, Material):
    """A material with a name, ``model``, by which scenes call it."""

    if TYPE_CHECKING:
        model: str

    def described(self) -> dict[str, Any]:
        """Return its section, every default written out."""
        return self.model_dump(mode="json")

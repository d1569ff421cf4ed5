"""What every parametric part gives."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from ppmc.scene.base import Section
from ppmc.scene.units import PositiveVelocity

if TYPE_CHECKING:
    from ppmc.geometry.parts.meshes.hexahedra import HexMesh
    from ppmc.geometry.surfaces.surface import ClosedSurface


class Part(Section):
    """A part and the press that makes it; subclasses declare dimensions and derive the rest.

    The dictionaries that methods return are sections of a scene, in mm and s.
    """

    closing_speed: PositiveVelocity = 3.55
    """Speed of the moving tool."""

    @property
    def charge_volume(self) -> float:
        """Volume of the charge, mm^3."""
        raise NotImplementedError

    @property
    def cavity_volume(self) -> float:
        """Volume of the closed cavity, mm^3; equal to the charge's, unless the part is a short shot."""
        raise NotImplementedError

    @property
    def stroke(self) -> float:
        """Distance that the moving tool travels, mm."""
        raise NotImplementedError

    @property
    def closing_time(self) -> float:
        """Time from first contact to closure, s."""
        return self.stroke / self.closing_speed

    def tooling(self) -> dict[str, dict[str, Any]]:
        """Return the tools as a scene's section `tooling`."""
        raise NotImplementedError

    def charge_domain(self) -> dict[str, Any]:
        """Return the charge cavity as a scene's `charge.domain`."""
        raise NotImplementedError

    def orientation(self) -> dict[str, Any]:
        """Return how the papers filled the charge, as a scene's `charge.orientation`; random platelets by default."""
        return {"source": "platelets", "length": 12.7, "width": 6.35, "wall_softness": 0.38}

    def material(self) -> dict[str, Any]:
        """Return J's material as a scene's `material` (section III.B): anisotropy ratio 61,215."""
        return {
            "model": "transversely_isotropic",
            "matrix_viscosity": 1.0,
            "fibre_volume_fraction": 0.6,
            "anisotropy_ratio": 61_215.0,
        }

    def regions(self) -> dict[str, dict[str, Any]]:
        """Return inspection regions of the closed part as a scene's `analysis.regions`."""
        raise NotImplementedError

    def paths(self) -> dict[str, dict[str, Any]]:
        """Return inspection paths of the closed part as a scene's `analysis.paths`."""
        return {}

    def mesh(self, size: float) -> HexMesh:
        """Return a structural mesh of the closed part with elements of about `size` mm."""
        raise NotImplementedError

    def cavity(self, size: float = 1.0) -> ClosedSurface:
        """Return the surface of the closed cavity, as fine as a mesh of `size` mm."""
        return self.mesh(size).surface()

    def scene_sections(self) -> dict[str, Any]:
        """Return the sections of a scene, all but the spacing of particles and how often to write."""
        sections = {
            "charge": {"domain": self.charge_domain(), "orientation": self.orientation()},
            "tooling": self.tooling(),
            "material": self.material(),
            "solver": {"end_time": self.closing_time},
            "analysis": {"regions": self.regions(), "paths": self.paths()},
        }
        # Copied, so that YAML shows every list where it is used and no aliases.
        return json.loads(json.dumps(sections))

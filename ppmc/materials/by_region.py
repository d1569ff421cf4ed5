"""Several materials in one charge, told apart by where the material was at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ppmc.materials.law import Array, LocalState, Material, Reference
from ppmc.materials.section import MaterialBase
from ppmc.scene.base import Section
from ppmc.scene.units import LengthVector

if TYPE_CHECKING:
    from ppmc.materials import MaterialSection


class Region(Section):
    """A box of the charge as it lay at the start, and what is in it."""

    low: LengthVector = Field(examples=[[0, 0, 0]])
    """Lowest corner, mm."""
    high: LengthVector = Field(examples=[["93.5 mm", "34 mm", "3 mm"]])
    """Highest corner, mm."""
    material: MaterialSection
    """What is in it."""

    @model_validator(mode="after")
    def _extent(self) -> Region:
        if any(a >= b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"`high` {list(self.high)} must be above `low` {list(self.low)} along each axis")
        return self


class ByRegion(MaterialBase):
    """A material for each region of the charge, which it keeps as the charge flows; the first that fits counts."""

    model: Literal["by_region"] = "by_region"
    """Name of the model."""
    regions: tuple[Region, ...] = Field(min_length=1)
    """Boxes and what is in them."""
    elsewhere: MaterialSection
    """What is in none of them."""

    @model_validator(mode="after")
    def _alike(self) -> ByRegion:
        if len({part.follows_walls for part in self.parts}) > 1:
            raise ValueError(
                "directions that follow walls and directions that follow the charge cannot be mixed by region"
            )
        return self

    @property
    def parts(self) -> tuple[Material, ...]:
        """The materials of all regions, then that of everywhere else."""
        return (*(region.material for region in self.regions), self.elsewhere)

    @property
    def ratio(self) -> float:
        """Largest anisotropy ratio R."""
        return max(part.ratio for part in self.parts)

    @property
    def rate_dependent(self) -> bool:  # type: ignore[override]
        """Whether that of any part is."""
        return any(part.rate_dependent for part in self.parts)

    @property
    def follows_walls(self) -> bool:  # type: ignore[override]
        """Whether all parts do."""
        return self.elsewhere.follows_walls

    def shear_at(self, rate: Any) -> Any:
        """Return the largest shear viscosity, Pa s, at effective rates, 1/s."""
        return np.max([part.shear_at(rate) for part in self.parts], axis=0)

    def reference(self, closing_rate: float) -> Reference:
        """Return that of the part that a squeeze with this closing rate, 1/s, finds stiffest."""
        return max((part.reference(closing_rate) for part in self.parts), key=lambda found: found.squeeze)

    def part_of(self, positions: Array) -> NDArray[np.int64]:
        """Number of the part in `parts`, shape (n,), of material that began at `positions` (n, 3), mm."""
        out = np.full(len(positions), len(self.regions))
        for k in reversed(range(len(self.regions))):
            region = self.regions[k]
            out[((positions >= region.low) & (positions <= region.high)).all(axis=1)] = k
        return out

    def remarks(self, positions: Array) -> list[str]:
        """Return which regions hold nothing of the charge, beside what their materials have to say."""
        part, out = self.part_of(positions), []
        for k, region in enumerate(self.regions):
            if not np.any(part == k):
                box = f"{list(region.low)} to {list(region.high)} mm"
                out.append(
                    f"material.regions[{k}], {box}, holds no particle of the charge or none that an earlier has not"
                )
        return out + [line for k, one in enumerate(self.parts) for line in one.remarks(positions[part == k])]

    def directions(self, local: LocalState) -> Array:
        """Return the directions of each point's part, shape (n, k, 3); those that it lacks are p, without stiffness."""
        found = [(rows, part.directions(local.rows(rows))) for rows, part in self._split(local)]
        most = max((directions.shape[1] for _, directions in found), default=0)
        out = np.repeat(local.fibre_direction[:, None, :], most, axis=1)
        for rows, directions in found:
            out[rows, : directions.shape[1]] = directions
        return out

    def viscosities(self, rate: Array, directions: Array, local: LocalState) -> tuple[Array, Array]:
        """Return those of each point's part, shapes (n,) and (n, k)."""
        shear, stiffness = np.empty(len(local)), np.zeros(directions.shape[:2])
        for rows, part in self._split(local):
            own = local.rows(rows)
            count = part.directions(own).shape[1]
            shear[rows], found = part.viscosities(rate[rows], directions[rows][:, :count], own)
            stiffness[rows, :count] = found
        return shear, stiffness

    def _split(self, local: LocalState) -> list[tuple[NDArray[np.int64], Material]]:
        """Return the points of each part that has any, and the part."""
        part = self.part_of(local.reference_position)
        rows = [np.flatnonzero(part == k) for k in range(len(self.parts))]
        return [(r, p) for r, p in zip(rows, self.parts, strict=True) if len(r)]

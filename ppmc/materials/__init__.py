"""Materials, one a file: what a scene may call by ``model``, and what is passed from Python.

A file in this folder that holds a subclass of :class:`ppmc.materials.section.MaterialBase` with a literal ``model`` is
a material of scenes; nothing else has to know of it. A material of one's own need not be in here: any
:class:`ppmc.materials.law.Material` can be passed where a scene's section could.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import BaseModel, Field, PlainSerializer, WrapValidator

from ppmc.materials.law import LocalState, Material, Reference, effective_rate
from ppmc.materials.section import MaterialBase
from ppmc.scene.base import kinds_in


def _unfinished() -> list[type[BaseModel]]:
    """Return the sections of this folder that wait for `MaterialSection`, those inside others first."""
    modules = {kind.__module__ for kind in MATERIALS.values()}
    kinds = [kind for name in sorted(modules) for kind in vars(import_module(name)).values()]
    sections = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
    return [kind for kind in sections if not kind.__pydantic_complete__]


def _as_it_is(value: Any, validate: Callable[[Any], Any]) -> Any:
    """Let a ready material pass; everything else is a section to be validated."""
    return value if isinstance(value, Material) else validate(value)


MATERIALS: dict[str, type[MaterialBase]] = kinds_in(sys.modules[__name__], MaterialBase, "model")
"""The materials that scenes know, by ``model``."""
globals().update({kind.__name__: kind for kind in MATERIALS.values()})

if TYPE_CHECKING:
    # For editors and type checkers only; they cannot look into a folder.
    from ppmc.materials.by_region import ByRegion as ByRegion
    from ppmc.materials.carreau_yasuda import CarreauYasuda as CarreauYasuda
    from ppmc.materials.newtonian import Newtonian as Newtonian
    from ppmc.materials.orientation_mixture import OrientationMixture as OrientationMixture
    from ppmc.materials.planar_uniform import PlanarUniform as PlanarUniform
    from ppmc.materials.power_law import PowerLaw as PowerLaw
    from ppmc.materials.transversely_isotropic import TransverselyIsotropic as TransverselyIsotropic

    MaterialSection = Material
else:
    MaterialSection = Annotated[
        Union[tuple(MATERIALS.values())],  # noqa: UP007
        Field(discriminator="model"),
        WrapValidator(_as_it_is),
        PlainSerializer(lambda material: material.described()),
    ]
    # Materials made of others could not name them before all were known.
    for _kind in _unfinished():
        _kind.model_rebuild(_types_namespace={"MaterialSection": MaterialSection})

__all__ = ["MATERIALS", "LocalState", "Material", "MaterialBase", "MaterialSection", "Reference", "effective_rate"]

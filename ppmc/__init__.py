"""Fibre orientation in compression-moulded prepreg platelets: CT, charge, flow and analysis.

The stages as functions and objects; each is loaded when it is first used:

>>> import ppmc
>>> charge = ppmc.Charge.box((12, 12, 6), spacing=0.75, orientation=ppmc.PlanarRandom(seed=1))
>>> tools = {
...     "lower": ppmc.tools.plane((0, 0, 0), (0, 0, 1)),
...     "ram": ppmc.tools.plane((0, 0, 6), (0, 0, -1), motion=ppmc.tools.velocity((0, 0, -3), travel=3)),
... }
>>> material = ppmc.materials.TransverselyIsotropic(shear_viscosity=1.0, anisotropy_ratio=100.0)
>>> flow = ppmc.solve(charge, tools, material, end_time=1.0)
>>> flow[-1].A
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from ppmc import errors, materials, tools
    from ppmc.api.analysis import Analysis, analyze
    from ppmc.api.charge import Charge
    from ppmc.api.flow import Flow
    from ppmc.api.orientations import AlongTool, Collimated, FromCT, FromFile, PlanarRandom, Platelets, Regional
    from ppmc.api.orienting import orient
    from ppmc.api.reading import read
    from ppmc.api.solving import solve
    from ppmc.api.voxels import Voxels
    from ppmc.errors import PpmcError, PpmcWarning
    from ppmc.particles import Particles
    from ppmc.scene.sections.solver import SolverSection as SolverSettings

_HOMES = {
    "AlongTool": "ppmc.api.orientations",
    "Analysis": "ppmc.api.analysis",
    "Charge": "ppmc.api.charge",
    "Collimated": "ppmc.api.orientations",
    "Flow": "ppmc.api.flow",
    "FromCT": "ppmc.api.orientations",
    "FromFile": "ppmc.api.orientations",
    "Particles": "ppmc.particles",
    "PlanarRandom": "ppmc.api.orientations",
    "Platelets": "ppmc.api.orientations",
    "PpmcError": "ppmc.errors",
    "PpmcWarning": "ppmc.errors",
    "Regional": "ppmc.api.orientations",
    "SolverSettings": "ppmc.scene.sections.solver:SolverSection",
    "Voxels": "ppmc.api.voxels",
    "analyze": "ppmc.api.analysis",
    "errors": "ppmc.errors:",
    "materials": "ppmc.materials:",
    "orient": "ppmc.api.orienting",
    "read": "ppmc.api.reading",
    "solve": "ppmc.api.solving",
    "tools": "ppmc.tools:",
}
"""Where each public name stands: a module, the name in it if that is another, nothing after the colon for itself."""

__all__ = [
    "AlongTool",
    "Analysis",
    "Charge",
    "Collimated",
    "Flow",
    "FromCT",
    "FromFile",
    "Particles",
    "PlanarRandom",
    "Platelets",
    "PpmcError",
    "PpmcWarning",
    "Regional",
    "SolverSettings",
    "Voxels",
    "__version__",
    "analyze",
    "errors",
    "materials",
    "orient",
    "read",
    "solve",
    "tools",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'ppmc' has no attribute '{name}'")
    home, colon, inner = _HOMES[name].partition(":")
    module = import_module(home)
    value = module if colon and not inner else getattr(module, inner or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Name what can be loaded, for editors that complete."""
    return sorted({*globals(), *_HOMES})

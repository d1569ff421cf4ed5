"""One reader of Abaqus input files, for orientations and for structural meshes.

Readers that are kept elsewhere fall short where it matters: meshio 5.3 knows a fixed list of element types in capitals
and neither parts, instances, systems, comments between lines nor element numbers; abaqus-parse only writes; ccxinp
comes with pyFormex under the GPL, and gmsh writes the format without reading it.
"""

from ppmc.geometry.abaqus.axes import material_axes
from ppmc.geometry.abaqus.deck import Body, Deck, files_of, read_deck
from ppmc.geometry.abaqus.elements import vtk_nodes

__all__ = ["Body", "Deck", "files_of", "material_axes", "read_deck", "vtk_nodes"]

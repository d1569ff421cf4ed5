"""Hexahedral meshes of the parts."""

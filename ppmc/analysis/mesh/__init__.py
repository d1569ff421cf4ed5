"""Structural meshes: read, mapped to, written."""

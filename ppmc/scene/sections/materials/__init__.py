"""Viscosity models of the charge, one file each; the union in :mod:`ppmc.scene.sections.material` is their registry."""

"""Viscosity models of the charge, one file each; the union in :mod:`ppmc.scene.material` is their registry."""

"""Velocities on a background grid, particles as its material: unlike platelets slide over one another in it."""

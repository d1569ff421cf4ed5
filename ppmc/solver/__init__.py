"""Flow solver: particles of anisotropic viscous platelets between closing tools."""

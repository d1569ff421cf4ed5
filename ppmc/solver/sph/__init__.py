"""The particle method: gradients, forces, packing and transport on arrays."""

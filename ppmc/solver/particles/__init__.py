"""Particles: their state, their neighbours, and the kernels between them."""

"""Particles of any product and their averages over regions and paths."""

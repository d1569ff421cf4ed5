"""Rigid tools: shapes, motion, signed distances, checks."""

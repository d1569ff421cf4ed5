"""Geometry: tools as signed distances, closed surfaces of charges, parametric parts.

A tool is a solid. Its signed distance is positive outside it, where material may be, and the gradient of the distance
is the tool's outward normal, which points into the cavity.
"""

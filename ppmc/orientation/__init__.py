"""Algebra of directions that all stages share: frames, orientation tensors and their transport."""

from ppmc.orientation.frames import (
    angle_between_axes,
    in_plane_from_normal,
    normalise,
    orthonormal_frame,
    push_affine,
    push_normal,
    shear_angle,
)
from ppmc.orientation.tensors import SIX, from_six, orientation_tensor, orientation_tensor4, to_six, to_six_by_six

__all__ = [
    "SIX",
    "angle_between_axes",
    "from_six",
    "in_plane_from_normal",
    "normalise",
    "orientation_tensor",
    "orientation_tensor4",
    "orthonormal_frame",
    "push_affine",
    "push_normal",
    "shear_angle",
    "to_six",
    "to_six_by_six",
]

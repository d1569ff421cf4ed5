"""The contracts between stages: what each file holds, how it is written, and how it is read with care.

This package knows no physics; `fields` has the tables, everything else follows them.
"""

from ppmc.files.fields import FIELDS, Field
from ppmc.files.grid import VoxelGrid
from ppmc.files.growing import SeriesWriter, growing_folder
from ppmc.files.guard import product_of
from ppmc.files.lock import Claim, one_writer
from ppmc.files.memory_series import MemorySeries, write_series
from ppmc.files.particles import ParticleFile, read_particles, write_particles
from ppmc.files.provenance import Provenance, file_digest
from ppmc.files.series import SeriesFile, load_series, open_series
from ppmc.files.state import read_state, write_state
from ppmc.files.storage import check_output, is_product, whole_file
from ppmc.files.voxels import MemoryVoxels, VoxelFile, VoxelWriter, read_voxels, write_voxels

__all__ = [
    "FIELDS",
    "Claim",
    "Field",
    "MemorySeries",
    "MemoryVoxels",
    "ParticleFile",
    "Provenance",
    "SeriesFile",
    "SeriesWriter",
    "VoxelFile",
    "VoxelGrid",
    "VoxelWriter",
    "check_output",
    "file_digest",
    "growing_folder",
    "is_product",
    "load_series",
    "one_writer",
    "open_series",
    "product_of",
    "read_particles",
    "read_state",
    "read_voxels",
    "whole_file",
    "write_particles",
    "write_series",
    "write_state",
    "write_voxels",
]

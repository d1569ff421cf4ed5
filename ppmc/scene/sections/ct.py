"""How orientations are found in a CT volume."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ppmc.scene.base import Section
from ppmc.scene.units import (
    Angle,
    LengthVector,
    NonNegativeLength,
    PositiveLength,
    PositiveLengthVector,
)


class VolumeSource(Section):
    """Where the grey values are, and what a file without a header needs to be told."""

    path: str | None = None
    """File, or folder of image slices; relative to the scene file. ``--input`` has precedence."""

    dataset: str | None = None
    """Dataset in an HDF5, Zarr or .npz file; not needed where there is only one of three dimensions."""

    channel: int | str | None = None
    """Channel of a hyperstack or of coloured slices: its number, counted from 0, or its name."""

    time: int | None = Field(default=None, ge=0)
    """Time step of a hyperstack, counted from 0."""

    index: tuple[Annotated[int, Field(ge=0)], ...] | None = Field(default=None, examples=[[0]])
    """Entries, counted from 0, of the leading axes of an array of more than three dimensions."""

    series: int | None = Field(default=None, ge=0)
    """Which of several series of images in a TIFF file, counted from 0."""

    no_data: Literal["refuse", "mask"] | float = "refuse"
    """What happens to voxels that are no grey value (NaN, infinite, above 1e15 in size): refused, or left out like
    those outside a mask. A number is a grey value that stands for no data and is left out too."""

    shape: tuple[int, int, int] | None = Field(default=None, examples=[[512, 512, 512]])
    """Number of voxels (nz, ny, nx) of a raw file; x varies fastest."""

    dtype: Literal["uint8", "int8", "uint16", "int16", "float32", "float64"] | None = None
    """Number type of a raw file."""

    byte_order: Literal["little", "big"] = "little"
    """Byte order of a raw file."""

    header_bytes: int = Field(default=0, ge=0)
    """Bytes before the first voxel of a raw file."""

    voxel_size: PositiveLength | PositiveLengthVector | None = None
    """Edge length of a voxel, mm, one for all axes or one for each (x, y, z); that of the file unless given."""

    @model_validator(mode="after")
    def _has_voxels(self) -> Self:
        if self.shape is not None and min(self.shape) < 1:
            raise ValueError(f"shape must be three positive counts [nz, ny, nx], got {list(self.shape)}")
        return self


class Registration(Section):
    """Where the scanned block stands in the tool's coordinates."""

    origin: LengthVector | None = None
    """Position of the centre of the first voxel in tool coordinates, mm; the file's own unless given."""

    rotation: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Rotation of the block about the tool's x, then y, then z axis, degrees."""


class MaskSection(Section):
    """Which voxels belong to the specimen; gradients elsewhere have no say."""

    path: str | None = None
    """Volume of the same shape, non-zero inside; relative to the scene file."""

    dataset: str | None = None
    """Dataset in an HDF5 file."""

    segment: bool = False
    """Find the specimen by its grey values (Otsu), voids filled, instead of reading a mask."""

    exclude_voids: bool = False
    """With ``segment``: leave out dark voids inside the specimen too."""

    field_of_view: bool = True
    """Leave out what lies around a round field of view that is filled with one value; only where there is no other
    mask."""

    @model_validator(mode="after")
    def _is_one_way(self) -> Self:
        if self.path is not None and self.segment:
            raise ValueError("give either a mask 'path' or 'segment: true', not both")
        return self


class CtSection(Section):
    """Fibre direction p and platelet normal r by the structure tensor.

    Lengths that are not given follow from the voxel size and the platelet thickness.
    """

    source: VolumeSource = VolumeSource()
    """The grey values."""

    registration: Registration | None = None
    """Place of the block in the tool's coordinates."""

    mask: MaskSection | None = None
    """The specimen; the volume's own mask, if it has one, unless given."""

    platelet_thickness: PositiveLength | None = None
    """Thickness of a platelet, mm; taken from the phantom section unless given. Sets the windows."""

    normals: bool = True
    """Find platelet normals too. Without them the file has p, eigenvalues and their certainty, from one fixed window:
    the quickest setting."""

    follow: bool | None = None
    """Windows for p follow the fibre, or the platelets' plane where their thickness is known, instead of being the same
    everywhere; ``false`` is quicker. Unless given they do where normals are wanted."""

    sigma: PositiveLength | None = None
    """Standard deviation of the Gaussian that differentiates, mm. Unless given it is one voxel, 0.9 where the platelet
    thickness is known, and as much more as the volume's noise asks for where it is not."""

    fibre_window: NonNegativeLength | LengthVector | None = None
    """Standard deviation of the window for p, mm, one for all axes or one for each (x, y, z); it is then the same
    everywhere. Unless given it is round and follows the fibre, or, where the platelet thickness is known, is thin and
    wide in the local plane of the platelets."""

    normal_window: PositiveLength | None = None
    """Standard deviation of the larger window for r, mm."""

    side_steps: int | None = Field(default=None, ge=0, le=4)
    """Windows displaced by up to this many voxels along r stand in for the centred one where they see a purer
    direction, so that a voxel next to an interface takes that of one side; 0 switches this off."""

    stride: int = Field(default=1, ge=1, le=64)
    """Orientations at every so many voxels along each axis."""

    least_confidence: float = Field(default=0.05, ge=0.0, lt=1.0)
    """Voxels whose p is less certain than this are marked invalid."""

    noise_level: float | None = Field(default=None, ge=0.0)
    """Standard deviation of the grey values' noise; measured from the volume unless given."""

    correct_noise: bool = True
    """Subtract the tensor that noise alone would give (it tilts p where voxels are not cubes)."""

    memory: float = Field(default=1024.0, gt=0.0)
    """Memory to use at most, MiB."""

    threads: int = Field(default=0, ge=0, le=1024)
    """Threads; 0 takes all cores. The result does not depend on it."""

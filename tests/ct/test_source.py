"""Volumes of every kind are read alike, and what is wrong with a file is said once and clearly."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile

from ppmc.ct.source import open_volume
from ppmc.errors import InputFileError, PpmcError, SceneError
from ppmc.files import Provenance, VoxelGrid, write_voxels
from ppmc.scene.ct import VolumeSource

GREY = np.random.default_rng(0).integers(0, 255, (5, 6, 7)).astype(np.uint8)
BOX = (slice(1, 4), slice(2, 6), slice(0, 5))


def raw(folder):
    GREY.tofile(folder / "a.raw")
    return folder / "a.raw", VolumeSource(shape=GREY.shape, dtype="uint8")


def raw_big_endian(folder):
    (folder / "a.raw").write_bytes(b"head" + GREY.astype(">u2").tobytes())
    return folder / "a.raw", VolumeSource(shape=GREY.shape, dtype="uint16", byte_order="big", header_bytes=4)


def tiff_pages(folder):
    tifffile.imwrite(folder / "a.tif", GREY, photometric="minisblack")
    return folder / "a.tif", VolumeSource()


def tiff_compressed(folder):
    tifffile.imwrite(folder / "a.tiff", GREY, photometric="minisblack", compression="zlib")
    return folder / "a.tiff", VolumeSource()


def tiff_slices(folder):
    for k, plane in enumerate(GREY):
        tifffile.imwrite(folder / f"slice{k + 7}.tif", plane)  # slice10 must come after slice9
    return folder, VolumeSource()


def hdf5(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["scan/grey"] = GREY
        file["other"] = np.zeros(3)
    return folder / "a.h5", VolumeSource()


def zarr_array(folder):
    zarr = pytest.importorskip("zarr")
    zarr.save(str(folder / "a.zarr"), GREY)
    return folder / "a.zarr", VolumeSource()


def own(folder):
    path = folder / "a.vtkhdf"
    grid = VoxelGrid(GREY.shape, (0.1, 0.1, 0.2), (1.0, 2.0, 3.0))
    write_voxels(path, "volume", {"grey": GREY}, grid=grid, provenance=Provenance("test"))
    return path, VolumeSource()


@pytest.mark.parametrize("make", [raw, raw_big_endian, tiff_pages, tiff_compressed, tiff_slices, hdf5, zarr_array, own])
def test_every_kind_gives_the_same_voxels(tmp_path, make):
    path, source = make(tmp_path)
    with open_volume(path, source) as volume:
        assert volume.shape == GREY.shape
        assert np.array_equal(volume.read(BOX), GREY[BOX])
        assert np.array_equal(volume.grey(BOX, 3.0, 2.0), ((GREY[BOX] - 3.0) / 2.0).astype(np.float32))


@pytest.mark.parametrize("make", [raw, tiff_compressed, tiff_slices, hdf5, zarr_array, own])
def test_threads_may_read_at_once(tmp_path, make, monkeypatch):
    grey = np.random.default_rng(1).integers(0, 255, (40, 64, 64)).astype(np.uint8)
    monkeypatch.setitem(globals(), "GREY", grey)
    path, source = make(tmp_path)
    with open_volume(path, source) as volume, ThreadPoolExecutor(8) as pool:
        boxes = [(slice(z, z + 3), slice(z, 64), slice(None)) for z in range(37)] * 10
        for box, got in zip(boxes, pool.map(volume.read, boxes), strict=True):
            assert np.array_equal(got, grey[box])


def test_slices_may_be_numbered_in_steps_or_not_at_all(tmp_path):
    for names in (["a00", "a05", "a10", "a15"], ["bottom", "middle", "top"], ["s1_of_9", "s2_of_9", "s3_of_9"]):
        folder = tmp_path / names[0]
        folder.mkdir()
        for name in names:
            tifffile.imwrite(folder / f"{name}.tif", GREY[0])
        with open_volume(folder, VolumeSource()) as volume:
            assert volume.shape == (len(names), *GREY[0].shape)


def test_own_file_states_its_grid(tmp_path):
    path, source = own(tmp_path)
    with open_volume(path, source) as volume:
        assert volume.spacing == (0.1, 0.1, 0.2)
        assert volume.origin == (1.0, 2.0, 3.0)


def read_all(path: Path, source: VolumeSource) -> None:
    with open_volume(path, source) as volume:
        volume.grey(tuple(slice(0, n) for n in volume.shape))


def missing(folder):
    return folder / "none.tif", VolumeSource(), "no such file"


def wrong_raw_size(folder):
    path, _ = raw(folder)
    return path, VolumeSource(shape=(5, 6, 8), dtype="uint8"), "210 bytes.*needs 240"


def raw_untold(folder):
    path, _ = raw(folder)
    return path, VolumeSource(), "needs ct: source: shape"


def unknown_ending(folder):
    (folder / "a.xyz").write_bytes(b"x")
    return folder / "a.xyz", VolumeSource(), "unknown kind of file '.xyz'"


def truncated_tiff(folder):
    path, source = tiff_pages(folder)
    path.write_bytes(path.read_bytes()[:-50])
    return path, source, "truncated|cannot be read as TIFF"


def truncated_compressed_tiff(folder):
    path = folder / "c.tif"
    with tifffile.TiffWriter(path) as file:
        for plane in GREY:
            file.write(plane, compression="zlib")
    path.write_bytes(path.read_bytes()[:-60])
    return path, VolumeSource(), "truncated|damaged|cannot be read"


def no_tiff_at_all(folder):
    (folder / "a.tif").write_bytes(b"hello")
    return folder / "a.tif", VolumeSource(), "cannot be read as TIFF"


def mixed_pages(folder):
    with tifffile.TiffWriter(folder / "m.tif") as file:
        file.write(GREY[0])
        file.write(GREY[1, :4])
    return folder / "m.tif", VolumeSource(), r"page 1 is \(4, 7\).*first slice is \(6, 7\)"


def mixed_slices(folder):
    tiff_slices(folder)
    tifffile.imwrite(folder / "slice9.tif", GREY[0, :4])
    return folder, VolumeSource(), r"slice9.tif: is \(4, 7\).*\(6, 7\)"


def mixed_types(folder):
    tiff_slices(folder)
    tifffile.imwrite(folder / "slice9.tif", GREY[0].astype(np.uint16))
    return folder, VolumeSource(), "slice9.tif.*uint16"


def truncated_slice(folder):
    tiff_slices(folder)
    path = folder / "slice9.tif"
    path.write_bytes(path.read_bytes()[:-20])
    return folder, VolumeSource(), "slice9.tif.*(truncated|cannot be read)"


def missing_slice(folder):
    tiff_slices(folder)
    (folder / "slice9.tif").unlink()
    return folder, VolumeSource(), "slice10.tif.*2 above.*slices are missing"


def colour(folder):
    tifffile.imwrite(folder / "rgb.tif", np.zeros((4, 5, 6, 3), np.uint8), photometric="rgb")
    return folder / "rgb.tif", VolumeSource(), "grey-value slices"


def empty_folder(folder):
    return folder, VolumeSource(), "folder without .tif"


def nan_voxel(folder):
    bad = GREY.astype(np.float32)
    bad[3, 4, 5] = np.nan
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = bad
    return folder / "a.h5", VolumeSource(), r"\[3, 4, 5\] is not a finite number"


def flat_dataset(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = np.zeros((4, 5))
    return folder / "a.h5", VolumeSource(dataset="grey"), "three dimensions"


def two_datasets(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["a"] = GREY
        file["b"] = GREY
    return folder / "a.h5", VolumeSource(), "dataset.*a, b"


def wrong_dataset(folder):
    path, _ = hdf5(folder)
    return path, VolumeSource(dataset="nothing"), "nothing is missing"


def external_link(folder):
    hdf5(folder)
    with h5py.File(folder / "l.h5", "w") as file:
        file["grey"] = h5py.ExternalLink("a.h5", "/scan/grey")
    return folder / "l.h5", VolumeSource(dataset="grey"), "link"


def truncated_hdf5(folder):
    path, source = hdf5(folder)
    path.write_bytes(path.read_bytes()[:-200])
    return path, source, "truncated|cannot be opened"


def text_dataset(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = np.full((2, 2, 2), b"a")
    return folder / "a.h5", VolumeSource(dataset="grey"), "must be integer"


@pytest.mark.parametrize(
    "make",
    [missing, wrong_raw_size, raw_untold, unknown_ending, truncated_tiff, truncated_compressed_tiff, no_tiff_at_all,
     mixed_pages, mixed_slices, mixed_types, truncated_slice, missing_slice, colour,
     empty_folder, nan_voxel, flat_dataset, two_datasets, wrong_dataset,
     external_link, truncated_hdf5, text_dataset],
)  # fmt: skip
def test_bad_input_is_refused_by_name(tmp_path, make):
    path, source, message = make(tmp_path)
    with pytest.raises(PpmcError, match=message) as caught:
        read_all(path, source)
    assert isinstance(caught.value, InputFileError | SceneError)
    assert path.name in str(caught.value) or path.is_dir()

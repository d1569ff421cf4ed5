"""Volumes of every kind are read alike, and what is wrong with a file is said once and clearly."""

import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile

from ppmc.ct.formats.hdf5 import FILTERS
from ppmc.ct.source import open_volume
from ppmc.errors import InputFileError, PpmcError, SceneError
from ppmc.files import Provenance, VoxelGrid, write_voxels
from ppmc.scene.sections.ct import VolumeSource

GREY = np.random.default_rng(0).integers(0, 255, (5, 6, 7)).astype(np.uint8)
BOX = (slice(1, 4), slice(2, 6), slice(0, 5))


def tiff_one_by_one(folder):
    with tifffile.TiffWriter(folder / "a.tif") as file:
        for plane in GREY:
            file.write(plane, compression="zlib")
    return folder / "a.tif", VolumeSource()


def tiff_imagej(folder):
    both = np.stack([GREY, 255 - GREY], axis=1)
    tifffile.imwrite(folder / "a.tif", both, imagej=True, metadata={"axes": "ZCYX"})
    return folder / "a.tif", VolumeSource(channel=0)


def tiff_imagej_without_directories(folder):
    path, source = tiff_imagej(folder)
    data = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        count = int.from_bytes(data[page.offset : page.offset + 2], "big" if file.byteorder == ">" else "little")
        at = page.offset + 2 + 12 * count
    data[at : at + 4] = bytes(4)  # the first directory is the last: as ImageJ writes above 4 GB
    path.write_bytes(data)
    return path, source


def tiff_frames(folder):
    tifffile.imwrite(folder / "a.tif", GREY, imagej=True, metadata={"axes": "TYX"})
    return folder / "a.tif", VolumeSource()


def tiff_ome(folder):
    grey = np.stack([np.stack([255 - GREY, GREY])] * 2)
    tifffile.imwrite(
        folder / "a.ome.tif", grey, metadata={"axes": "TCZYX", "Channel": {"Name": ["resin", "fibre"]}}, ome=True
    )
    return folder / "a.ome.tif", VolumeSource(channel="fibre", time=1)


def tiff_colour(folder):
    colour = np.stack([GREY, 0 * GREY, 0 * GREY], axis=-1)
    tifffile.imwrite(folder / "a.tif", colour, photometric="rgb")
    return folder / "a.tif", VolumeSource(channel=0)


def tiff_chunks(folder):
    tifffile.imwrite(folder / "part_00.tif", GREY[:2], photometric="minisblack")
    tifffile.imwrite(folder / "part_01.tif", GREY[2:4], photometric="minisblack")
    tifffile.imwrite(folder / "part_02.tif", GREY[4:])
    (folder / "notes.txt").write_text("scan of Monday")
    (folder / "._part_00.tif").write_bytes(b"resource fork")
    return folder, VolumeSource()


def hdf5_four_axes(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = GREY[None, ..., None]
    return folder / "a.h5", VolumeSource()


def hdf5_index(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = np.stack([0 * GREY, GREY, 0 * GREY])[None]
    return folder / "a.h5", VolumeSource(index=[0, 1])


def hdf5_compressed(folder):
    plugin = pytest.importorskip("hdf5plugin")
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("grey", data=GREY, chunks=(1, 6, 7), **plugin.Bitshuffle(cname="lz4"))
    return folder / "a.h5", VolumeSource()


def numpy_array(folder):
    np.save(folder / "a.npy", np.asfortranarray(GREY))
    return folder / "a.npy", VolumeSource()


def numpy_archive(folder):
    np.savez(folder / "a.npz", grey=GREY, other=np.zeros(3))
    return folder / "a.npz", VolumeSource(dataset="grey")


MHD = """ObjectType = Image
NDims = 3
BinaryData = True
BinaryDataByteOrderMSB = {msb}
CompressedData = {compressed}
TransformMatrix = 1 0 0 0 1 0 0 0 1
Offset = 1 2 3
ElementSpacing = 0.1 0.1 0.2
DimSize = 7 6 5
ElementType = {kind}
ElementDataFile = {file}
"""


def metaimage(folder):
    (folder / "a.raw").write_bytes(GREY.astype(">u2").tobytes())
    (folder / "a.mhd").write_text(MHD.format(msb="True", compressed="False", kind="MET_USHORT", file="a.raw"))
    return folder / "a.mhd", VolumeSource()


def metaimage_compressed(folder):
    head = MHD.format(msb="False", compressed="True", kind="MET_UCHAR", file="LOCAL")
    (folder / "a.mha").write_bytes(head.encode() + zlib.compress(GREY.tobytes()))
    return folder / "a.mha", VolumeSource()


def nrrd_file(folder):
    nrrd = pytest.importorskip("nrrd")
    directions = np.diag([0.1, 0.1, 0.2])
    nrrd.write(str(folder / "a.nrrd"), GREY, {"space directions": directions, "space dimension": 3}, index_order="C")
    return folder / "a.nrrd", VolumeSource()


def nifti_file(folder):
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(GREY.transpose(), np.diag([0.1, 0.1, 0.2, 1.0]))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, folder / "a.nii.gz")
    return folder / "a.nii.gz", VolumeSource()


def dicom_slice(k, position, series="1.2.3"):
    pydicom = pytest.importorskip("pydicom")
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

    head = FileMetaDataset()
    head.MediaStorageSOPClassUID, head.MediaStorageSOPInstanceUID = CTImageStorage, f"1.2.{k + 1}"
    head.TransferSyntaxUID = ExplicitVRLittleEndian
    out = Dataset()
    out.file_meta = head
    out.SOPClassUID, out.SOPInstanceUID, out.SeriesInstanceUID = CTImageStorage, f"1.2.{k + 1}", series
    out.Rows, out.Columns, out.SamplesPerPixel, out.PhotometricInterpretation = 6, 7, 1, "MONOCHROME2"
    out.BitsAllocated = out.BitsStored = 8
    out.HighBit, out.PixelRepresentation = 7, 0
    out.PixelSpacing, out.ImageOrientationPatient = [0.1, 0.1], [1, 0, 0, 0, 1, 0]
    out.ImagePositionPatient = [0, 0, position]
    out.PixelData = GREY[k].tobytes()
    return pydicom, out


def dicom_series(folder, positions=(0.0, 0.2, 0.4, 0.6, 0.8), series=("1.2.3",) * 5):
    # Names say nothing about the order.
    for k, name in enumerate(("e", "b", "d", "a", "c")):
        pydicom, out = dicom_slice(k, positions[k], series[k])
        pydicom.dcmwrite(folder / name, out, enforce_file_format=True)
    return folder, VolumeSource()


def pictures(folder):
    image = pytest.importorskip("PIL.Image")
    for k, plane in enumerate(GREY):
        image.fromarray(plane).save(folder / f"s{k}.png")
    return folder, VolumeSource()


def ome_zarr(folder):
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(str(folder / "a.zarr"), mode="w", zarr_format=2)
    root.create_array("0", data=np.stack([0 * GREY, GREY])[None], chunks=(1, 1, 2, 6, 7))
    axes = [{"name": n, "type": "space", "unit": "micrometer"} if n in "zyx" else {"name": n} for n in "tczyx"]
    scale = {"type": "scale", "scale": [1, 1, 200, 100, 100]}
    root.attrs["multiscales"] = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": [scale]}]}]
    root.attrs["omero"] = {"channels": [{"label": "resin"}, {"label": "fibre"}]}
    return folder / "a.zarr", VolumeSource(channel="fibre")


NEW = [tiff_one_by_one, tiff_imagej, tiff_imagej_without_directories, tiff_frames, tiff_ome, tiff_colour, tiff_chunks,
       hdf5_four_axes, hdf5_index, hdf5_compressed, numpy_array, numpy_archive, metaimage, metaimage_compressed,
       nrrd_file, nifti_file, dicom_series, pictures, ome_zarr]  # fmt: skip


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


@pytest.mark.parametrize(
    "make", [raw, raw_big_endian, tiff_pages, tiff_compressed, tiff_slices, hdf5, zarr_array, own, *NEW]
)
def test_every_kind_gives_the_same_voxels(tmp_path, make):
    path, source = make(tmp_path)
    with open_volume(path, source) as volume:
        assert volume.shape == GREY.shape
        assert np.array_equal(volume.read(BOX), GREY[BOX])
        assert np.array_equal(volume.grey(BOX, 3.0, 2.0), ((GREY[BOX] - 3.0) / 2.0).astype(np.float32))


@pytest.mark.parametrize("make", [raw, tiff_compressed, tiff_slices, hdf5, zarr_array, own, tiff_ome, tiff_imagej])
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
    return folder / "m.tif", VolumeSource(), r"not alike and form 2 series.*\(6, 7\).*\(4, 7\)"


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
    return folder / "rgb.tif", VolumeSource(), "has 3 channels .* choose one with ct: source: channel"


def empty_folder(folder):
    return folder, VolumeSource(), "folder without slices"


def nan_voxel(folder):
    bad = GREY.astype(np.float32)
    bad[3, 4, 5] = np.nan
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = bad
    return folder / "a.h5", VolumeSource(), r"\[3, 4, 5\] is nan, which is no grey value"


def flat_dataset(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = np.zeros((4, 5))
    return folder / "a.h5", VolumeSource(dataset="grey"), "three dimensions"


def two_datasets(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["a"] = GREY
        file["b"] = GREY
    return folder / "a.h5", VolumeSource(), r"dataset.*a \(5, 6, 7\), b"


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


MICRO = {"axes": "ZYX", "spacing": 200.0, "unit": "um"}


def test_voxel_sizes_come_from_the_file(tmp_path):
    tifffile.imwrite(tmp_path / "i.tif", GREY, imagej=True, resolution=(1 / 100, 1 / 100), metadata=MICRO)
    sizes = {f"PhysicalSize{a}": n for a, n in zip("XYZ", (0.1, 0.1, 0.2), strict=True)}
    units = {f"PhysicalSize{a}Unit": "mm" for a in "XYZ"}
    tifffile.imwrite(tmp_path / "o.ome.tif", GREY, ome=True, metadata={"axes": "ZYX", **sizes, **units})
    paths = [tmp_path / "i.tif", tmp_path / "o.ome.tif", *(make(tmp_path)[0] for make in (metaimage, ome_zarr))]
    for path in paths:
        with open_volume(path, VolumeSource(channel=1 if path.suffix == ".zarr" else None)) as volume:
            assert volume.spacing == pytest.approx((0.1, 0.1, 0.2)), path
    with open_volume(tmp_path / "a.mhd", VolumeSource()) as volume:
        assert volume.origin == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("make", [nrrd_file, nifti_file, dicom_series])
def test_voxel_sizes_come_from_medical_headers(tmp_path, make):
    path, source = make(tmp_path)
    with open_volume(path, source) as volume:
        assert volume.spacing == pytest.approx((0.1, 0.1, 0.2))


@pytest.mark.parametrize("unit", ["pixel", "", "\\u00B5m"])
def test_units_that_are_no_lengths_give_no_voxel_size(tmp_path, unit):
    tifffile.imwrite(tmp_path / "i.tif", GREY, imagej=True, resolution=(0.01, 0.01), metadata=MICRO | {"unit": unit})
    with open_volume(tmp_path / "i.tif", VolumeSource()) as volume:
        assert (volume.spacing is None) == (unit in ("pixel", ""))
    tifffile.imwrite(tmp_path / "plain.tif", GREY, resolution=(72, 72), resolutionunit="INCH", photometric="minisblack")
    with open_volume(tmp_path / "plain.tif", VolumeSource()) as volume:
        assert volume.spacing is None


def imagej_untold(folder):
    return tiff_imagej(folder)[0], VolumeSource(), r"has 2 channels .*choose one with ct: source: channel: 0"


def ome_untold(folder):
    return tiff_ome(folder)[0], VolumeSource(channel=0), r"has 2 times .*choose one with ct: source: time: 0"


def ome_wrong_name(folder):
    return tiff_ome(folder)[0], VolumeSource(channel="air", time=0), "no channel 'air'; its channels are resin, fibre"


def channel_beyond(folder):
    return tiff_imagej(folder)[0], VolumeSource(channel=2), "channel: 2 does not exist; there are 2"


def imagej_cut(folder):
    path, source = tiff_imagej_without_directories(folder)
    with tifffile.TiffFile(path) as file:
        end = file.pages[0].dataoffsets[0] + 2 * GREY.size - 10
    path.write_bytes(path.read_bytes()[:end])
    return path, source, "truncated"


def stray_preview(folder):
    tiff_chunks(folder)
    tifffile.imwrite(folder / "preview.tif", GREY[0])
    return folder, VolumeSource(), "preview.tif: is not named like the other 3 slices"


def two_kinds(folder):
    tiff_slices(folder)
    pictures(folder)
    return folder, VolumeSource(), "more than one kind"


def five_axes(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file["grey"] = np.stack([GREY, GREY])
    return folder / "a.h5", VolumeSource(), r"has 4 dimensions .*ct: source: index: \[0\]"


def only_a_link(folder):
    hdf5(folder)
    with h5py.File(folder / "master.nxs", "w") as file:
        file["entry/data"] = h5py.ExternalLink("a.h5", "/scan/grey")
    return folder / "master.nxs", VolumeSource(), r"other files \(entry/data -> a.h5:/scan/grey\)"


def mhd_without_data(folder):
    path, source = metaimage(folder)
    (folder / "a.raw").unlink()
    return path, source, "its data file .*a.raw is missing"


def mhd_short(folder):
    path, source = metaimage(folder)
    (folder / "a.raw").write_bytes(bytes(100))
    return path, source, "has 100 bytes, the header of a.mhd needs 420"


def dicom_gap(folder):
    return *dicom_series(folder, (0.0, 0.2, 0.4, 0.8, 1.0)), "0.4 above the slice before, the others 0.2"


def dicom_two_series(folder):
    return *dicom_series(folder, series=("1.2.3",) * 4 + ("1.2.4",)), "holds 2 series"


def picture_of_other_size(folder):
    pictures(folder)
    pytest.importorskip("PIL.Image").fromarray(GREY[0, :4]).save(folder / "s3.png")
    return folder, VolumeSource(), "s3.png: is .* all slices must be alike"


def numpy_pickle(folder):
    np.save(folder / "a.npy", np.array([{}]), allow_pickle=True)
    return folder / "a.npy", VolumeSource(), "cannot be read as a NumPy array"


@pytest.mark.parametrize(
    "make",
    [imagej_untold, ome_untold, ome_wrong_name, channel_beyond, imagej_cut, stray_preview, two_kinds, five_axes,
     only_a_link, mhd_without_data, mhd_short, dicom_gap, dicom_two_series, picture_of_other_size, numpy_pickle],
)  # fmt: skip
def test_what_is_not_settled_is_refused_with_the_remedy(tmp_path, make):
    test_bad_input_is_refused_by_name(tmp_path, make)


def test_a_filter_that_is_not_there_is_named(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("grey", data=GREY, chunks=(1, 6, 7), compression="gzip")
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda code: False)
    monkeypatch.setitem(FILTERS, 1, "bitshuffle")
    with pytest.raises(
        InputFileError, match=r"filter that is not installed \(1 bitshuffle\): pip install 'ppmc\[hdf5\]'"
    ):
        read_all(tmp_path / "a.h5", VolumeSource())


@pytest.mark.parametrize(("name", "make"), [("nrrd", nrrd_file), ("nibabel", nifti_file), ("pydicom", dicom_series)])
def test_a_library_that_is_not_there_is_named_with_its_extra(tmp_path, monkeypatch, name, make):
    path, source = make(tmp_path)
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputFileError, match=r"pip install 'ppmc\[volumes\]'"):
        read_all(path, source)


EVERYWHERE = tuple(slice(0, n) for n in GREY.shape)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e20, 9.97e36, -3.4e38])
def test_voxels_without_data_are_refused_or_left_out(tmp_path, value):
    bad = GREY.astype(np.float32)
    bad[3, 4, 5] = value
    np.save(tmp_path / "a.npy", bad)
    with open_volume(tmp_path / "a.npy", VolumeSource()) as volume:
        for ask in (volume.grey, volume.checked):
            with pytest.raises(InputFileError, match=r"\[3, 4, 5\] is .*no_data: mask"):
                ask(EVERYWHERE)
        # Outside of a mask that the scene gives they have no say.
        mask = np.ones(GREY.shape, np.uint8)
        mask[3, 4, 5] = 0
        grey = volume.within(lambda box: mask[box]).grey(EVERYWHERE, 7.0, 2.0)
        assert grey[3, 4, 5] == 0.0 and np.isfinite(grey).all()
    with open_volume(tmp_path / "a.npy", VolumeSource(no_data="mask")) as volume:
        assert volume.read_mask is not None
        assert np.argwhere(volume.read_mask(EVERYWHERE) == 0).tolist() == [[3, 4, 5]]
        assert volume.grey(EVERYWHERE)[3, 4, 5] == 0.0
        none = volume.within(lambda box: np.zeros(GREY.shape, np.uint8)[box])
        assert none.read_mask is not None and not none.read_mask(EVERYWHERE).any()


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_a_fill_value_is_left_out(tmp_path, dtype):
    np.save(tmp_path / "a.npy", GREY.astype(dtype))
    for fill in (float(GREY[2, 2, 2]), -5.0, 0.5, 1e9):
        with open_volume(tmp_path / "a.npy", VolumeSource(no_data=fill)) as volume:
            assert volume.read_mask is not None
            assert np.array_equal(volume.read_mask(EVERYWHERE) == 0, fill == GREY)

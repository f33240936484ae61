"""Volumes from files: round trips, and files that are damaged or lie."""

from __future__ import annotations

import bz2
import gzip
import io
import os
import stat
import subprocess
import sys
import time
import zipfile
import zlib

import nrrd
import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import formats, read_volume

VALUES = (np.arange(2 * 3 * 4).reshape(2, 3, 4) * 3 - 7).astype(np.int16)


def packed(data: bytes, suffix: str) -> bytes:
    return gzip.compress(data) if suffix == ".gz" else data


def npy_bytes(array, **options) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


def nrrd_header(**fields) -> str:
    lines = {"type": "short", "dimension": 3, "sizes": "4 3 2", "endian": "little", "encoding": "raw", **fields}
    text = "".join(f"{name.replace('_', ' ')}: {value}\n" for name, value in lines.items() if value is not None)
    return "NRRD0004\n# a comment\n" + text + "\n"


def meta_header(**fields) -> str:
    lines = {
        "ObjectType": "Image",
        "NDims": 3,
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "ElementSpacing": "1 2 3",
        "Offset": "5 6 7",
        "DimSize": "4 3 2",
        "ElementType": "MET_SHORT",
        **fields,
    }
    # Data follow this line, so that it is the last one.
    lines["ElementDataFile"] = lines.pop("ElementDataFile", "LOCAL")
    return "".join(f"{name} = {value}\n" for name, value in lines.items() if value is not None)


@pytest.mark.parametrize("suffix", ["", ".gz"])
@pytest.mark.parametrize("dtype", ["bool", "int8", "uint8", ">i2", "<u2", "int32", "float16", ">f4", "float64"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy(tmp_path, suffix, dtype, order):
    path = tmp_path / f"a.npy{suffix}"
    array = np.asarray(np.abs(VALUES) % 100, dtype=dtype, order=order)
    path.write_bytes(packed(npy_bytes(array), suffix))
    field = ss.open(path, spacing=(1, 2, 3))
    assert np.array_equal(field.values, array)
    assert field.spacing == (1, 2, 3) and field.origin == (0, 0, 0)


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_npy_versions(tmp_path, version):
    with (tmp_path / "a.npy").open("wb") as stream:
        np.lib.format.write_array(stream, VALUES, version=version)
    assert np.array_equal(ss.open(tmp_path / "a.npy").values, VALUES)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_takes_the_only_volume_or_the_named_one(tmp_path, save):
    path = tmp_path / "a.npz"
    save(path, volume=VALUES, axis=np.arange(4), title=np.array("text"))
    assert np.array_equal(ss.open(path).values, VALUES)
    save(path, first=VALUES, second=VALUES + 1)
    assert np.array_equal(ss.open(path, name="second").values, VALUES + 1)
    with pytest.raises(ss.InvalidInput, match="2 arrays with three axes: first, second"):
        ss.open(path)
    with pytest.raises(ss.InvalidInput, match="first, second"):
        ss.open(path, name="third")
    save(path, axis=np.arange(4))
    with pytest.raises(ss.InvalidInput, match="0 arrays"):
        ss.open(path)


def test_pickles_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.full((2, 2, 2), None), allow_pickle=True)
    with pytest.raises(ss.InvalidInput, match="Python objects"):
        ss.open(tmp_path / "a.npy")
    np.savez(tmp_path / "a.npz", a=np.full((2, 2, 2), None))
    with pytest.raises(ss.InvalidInput, match="Python objects"):
        ss.open(tmp_path / "a.npz")


@pytest.mark.parametrize("suffix", ["", ".gz"])
@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ASCII"])
@pytest.mark.parametrize("detached", [False, True])
def test_nrrd_as_pynrrd_writes_it(tmp_path, suffix, encoding, detached):
    path = tmp_path / ("a.nhdr" if detached else "a.nrrd")
    header = {"encoding": encoding, "spacings": [1.0, 2.0, 3.0], "content": "numbers"}
    nrrd.write(str(path), VALUES, header, detached_header=detached, index_order="C")
    if suffix:
        data, path = path.read_bytes(), path.with_name(path.name + suffix)
        path.write_bytes(gzip.compress(data))
    volume = read_volume(path)
    assert np.array_equal(volume.values, VALUES)
    assert volume.spacing == (1, 2, 3) and volume.details["content"] == "numbers"
    assert ss.open(path).spacing == (1, 2, 3)
    assert ss.open(path, spacing=(4, 5, 6), origin=(1, 1, 1)).spacing == (4, 5, 6)


@pytest.mark.parametrize(
    "dtype", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
)
@pytest.mark.parametrize("order", ["<", ">"])
def test_nrrd_types(tmp_path, dtype, order):
    array = (np.abs(VALUES) % 100).astype(np.dtype(dtype).newbyteorder(order))
    nrrd.write(str(tmp_path / "a.nrrd"), array, index_order="C")
    assert np.array_equal(ss.open(tmp_path / "a.nrrd").values, array)


def test_nrrd_axes_are_put_along_those_of_the_world(tmp_path):
    # x runs backwards; the file's fastest axis is z.
    header = nrrd_header(
        space_directions="(0,0,3) (-1,0,0) (0,2,0)", space_dimension=3, space_origin="(10,20,30)", sizes="4 3 2"
    )
    path = tmp_path / "a.nrrd"
    path.write_bytes(header.encode() + VALUES.tobytes())
    field = ss.open(path)
    assert field.spacing == (1, 2, 3)
    assert field.origin == (8, 20, 30)
    for (c, b, a), value in np.ndenumerate(VALUES):
        x, y, z = 10 - b, 20 + 2 * c, 30 + 3 * a
        i, j, k = x - 8, (y - 20) // 2, (z - 30) // 3
        assert field.values[k, j, i] == value


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"sizes": "4 3 3"}, "48 bytes|72 bytes"),
        ({"sizes": "4 3 -2"}, "-2"),
        ({"sizes": "4 3 0"}, "sizes"),
        ({"sizes": "4294967296 4294967296 4294967296"}, "sizes"),
        ({"sizes": "100000 100000 1000"}, "bytes"),
        ({"sizes": "4 3 2 1", "dimension": 4}, "4 axes"),
        ({"sizes": "12 2", "dimension": 2}, "2 axes"),
        ({"dimension": 4}, "4 axes"),
        ({"sizes": "a b c"}, "header"),
        ({"sizes": None}, "sizes"),
        ({"type": "block"}, "block"),
        ({"type": None}, "type"),
        ({"encoding": "hex"}, "hex"),
        ({"endian": None}, "endian"),
        ({"endian": "middle"}, "endian"),
        ({"spacings": "1 0 1"}, "spacings"),
        ({"spacings": "1 inf 1"}, "spacings"),
        ({"spacings": "1 1"}, "spacings"),
        ({"space_directions": "(1,0,0) (0,0,0) (0,0,1)", "space_dimension": 3}, "the directions of axes"),
        ({"space_directions": "(1,0,0) none (0,0,1)", "space_dimension": 3}, "the directions of axes"),
        ({"space_origin": "(1,nan,0)", "space_dimension": 3}, "space origin"),
        ({"byte_skip": 1}, "47 bytes"),
        ({"byte_skip": 1000}, "bytes before"),
        ({"byte_skip": -5}, "byte skip"),
        ({"line_skip": 7}, "lines"),
        ({"line_skip": -7}, "line skip"),
        ({"data_file": "/etc/passwd"}, "folder"),
        ({"data_file": "../a.raw"}, "folder"),
        ({"data_file": "sub/../../a.raw"}, "folder"),
        ({"data_file": "."}, "folder"),
        ({"data_file": "missing.raw"}, "no such file"),
        ({"data_file": "LIST"}, "several"),
        ({"data_file": "a%03d.raw 1 2 1"}, "several"),
    ],
)
def test_nrrd_that_lies_is_refused(tmp_path, fields, text):
    (tmp_path / "in").mkdir()
    (tmp_path / "a.raw").write_bytes(VALUES.tobytes())
    path = tmp_path / "in" / "a.nrrd"
    path.write_bytes(nrrd_header(**fields).encode() + VALUES.astype("<i2").tobytes())
    with pytest.raises(ss.InvalidInput, match=text):
        ss.open(path)


def test_nrrd_skips(tmp_path):
    data = b"one\ntwo\nxx" + VALUES.tobytes()
    (tmp_path / "a.raw").write_bytes(data)
    path = tmp_path / "a.nhdr"
    for fields in ({"line_skip": 2, "byte_skip": 2}, {"byte_skip": -1}):
        path.write_text(nrrd_header(data_file="a.raw", **fields).rstrip("\n") + "\n")
        assert np.array_equal(ss.open(path).values, VALUES)


def test_nrrd_data_file_may_not_leave_its_folder_by_a_link(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "a.raw").write_bytes(VALUES.tobytes())
    (tmp_path / "in" / "link.raw").symlink_to(tmp_path / "a.raw")
    (tmp_path / "in" / "a.nhdr").write_text(nrrd_header(data_file="link.raw"))
    with pytest.raises(ss.InvalidInput, match="folder"):
        ss.open(tmp_path / "in" / "a.nhdr")
    (tmp_path / "in" / "here.raw").write_bytes(VALUES.tobytes())
    (tmp_path / "in" / "a.nhdr").write_text(nrrd_header(data_file="here.raw"))
    assert np.array_equal(ss.open(tmp_path / "in" / "a.nhdr").values, VALUES)


@pytest.mark.parametrize(
    "header",
    [b"NRRD", b"NRRD0004\nsizes", b"NRRD0009\n\n", b"NRRD0004\n" + b"#" * (1 << 21), b"NRRD0004\n\xff\xfe: \x00\n\n"],
)
def test_nrrd_headers_that_are_damaged_are_refused(tmp_path, header):
    (tmp_path / "a.nrrd").write_bytes(header)
    with pytest.raises(ss.InvalidInput, match="header"):
        ss.open(tmp_path / "a.nrrd")


@pytest.mark.parametrize("suffix", ["", ".gz"])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("msb", [False, True])
@pytest.mark.parametrize("local", [False, True])
def test_metaimage(tmp_path, suffix, compressed, msb, local):
    data = VALUES.astype(">i2" if msb else "<i2").tobytes()
    data = zlib.compress(data) if compressed else data
    fields = {"BinaryDataByteOrderMSB": msb, "CompressedData": compressed}
    if compressed:
        fields["CompressedDataSize"] = len(data)
    path = tmp_path / ("a.mha" if local else "a.mhd")
    fields["ElementDataFile"] = "LOCAL" if local else "a.zraw"
    (tmp_path / "a.zraw").write_bytes(data)
    path = path.with_name(path.name + suffix)
    path.write_bytes(packed(meta_header(**fields).encode() + (data if local else b""), suffix))
    field = ss.open(path)
    assert np.array_equal(field.values, VALUES)
    assert field.spacing == (1, 2, 3) and field.origin == (5, 6, 7)


def test_metaimage_by_content_and_with_a_header_in_the_data(tmp_path):
    (tmp_path / "a.dat").write_bytes(b"#" * 10 + VALUES.tobytes())
    for skip in (10, -1):
        (tmp_path / "volume.header").write_text(meta_header(HeaderSize=skip, ElementDataFile="a.dat"))
        assert np.array_equal(ss.open(tmp_path / "volume.header").values, VALUES)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"DimSize": "4 3 3"}, "72 bytes"),
        ({"DimSize": "4 3 -2"}, "DimSize"),
        ({"DimSize": "4 3"}, "DimSize"),
        ({"DimSize": "4 3 two"}, "DimSize"),
        ({"DimSize": "4294967296 4294967296 4294967296"}, "DimSize"),
        ({"NDims": 2}, "NDims"),
        ({"NDims": 4}, "NDims"),
        ({"ElementType": "MET_OTHER"}, "ElementType"),
        ({"ElementType": None}, "ElementType"),
        ({"ElementNumberOfChannels": 0}, "ElementNumberOfChannels"),
        ({"ElementNumberOfChannels": 3}, "48 bytes of samples; wanted 144"),
        ({"BinaryData": "False"}, "BinaryData"),
        ({"BinaryDataByteOrderMSB": "perhaps"}, "True or False"),
        ({"ElementSpacing": "1 0 1"}, "ElementSpacing"),
        ({"ElementSpacing": "1 nan 1"}, "ElementSpacing"),
        ({"Offset": "1 2"}, "Offset"),
        ({"TransformMatrix": "1 0 0 1 0 0 0 0 1"}, "the directions of axes"),
        ({"HeaderSize": "x"}, "HeaderSize"),
        ({"HeaderSize": "-7"}, "HeaderSize"),
        ({"ElementDataFile": "/etc/passwd"}, "folder"),
        ({"ElementDataFile": "../a.raw"}, "folder"),
        ({"ElementDataFile": "gone.raw"}, "no such file"),
        ({"ElementDataFile": "LIST"}, "one data file"),
        ({"ElementDataFile": "s%02d.raw 1 3 1"}, "one data file"),
        ({"ElementDataFile": None}, "ElementDataFile"),
    ],
)
def test_metaimage_that_lies_is_refused(tmp_path, fields, text):
    data = b"" if fields.get("ElementDataFile", 0) is None else VALUES.tobytes()
    (tmp_path / "a.mha").write_bytes(meta_header(**fields).encode() + data)
    with pytest.raises(ss.InvalidInput, match=text):
        ss.open(tmp_path / "a.mha")


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_raw(tmp_path, suffix):
    path = tmp_path / f"a.raw{suffix}"
    path.write_bytes(packed(b"abc" + VALUES.astype(">i2").tobytes(), suffix))
    field = ss.open(path, shape=(2, 3, 4), dtype=">i2", offset=3, spacing=(1, 2, 3))
    assert np.array_equal(field.values, VALUES) and field.spacing == (1, 2, 3)
    with pytest.raises(ss.InvalidInput, match="shape and dtype"):
        ss.open(path)
    with pytest.raises(ss.InvalidInput, match="dtype"):
        ss.open(path, shape=(2, 3, 4))
    with pytest.raises(ss.InvalidInput, match="54 bytes|bytes"):
        ss.open(path, shape=(2, 3, 5), dtype=">i2")
    with pytest.raises(ss.InvalidInput, match="wanted 48 bytes"):
        ss.open(path, shape=(2, 3, 4), dtype=">i2")
    for options in (
        {"shape": (2, 3)},
        {"shape": "2x3x4"},
        {"shape": (2, 3, -4)},
        {"shape": (2, 3, 4.5)},
        {"offset": -1},
        {"dtype": "O"},
        {"dtype": "nothing"},
        {"offset": 1000},
    ):
        with pytest.raises(ss.InvalidInput, match="wanted|found"):
            ss.open(path, **{"shape": (2, 3, 4), "dtype": ">i2", "offset": 3, **options})


def test_options_of_raw_samples_are_refused_elsewhere(tmp_path):
    np.save(tmp_path / "a.npy", VALUES)
    with pytest.raises(ss.InvalidInput, match="raw samples"):
        ss.open(tmp_path / "a.npy", shape=(2, 3, 4), dtype="int16")
    with pytest.raises(ss.InvalidInput, match="for a file of one volume"):
        ss.open(tmp_path / "a.npy", name="a")


@pytest.mark.parametrize("cut", [1, 20, 60, 100])
@pytest.mark.parametrize("kind", ["a.npy", "a.npz", "a.nrrd", "a.mha", "b.npy.gz", "b.nrrd.gz", "c.nrrd", "c.mha"])
def test_cut_files_are_refused(tmp_path, kind, cut):
    """At whatever byte a file ends, the error is ours."""
    array = np.random.default_rng(1).integers(0, 255, (4, 5, 6)).astype(np.uint8)
    writers = {
        "a.npy": npy_bytes(array),
        "b.npy.gz": gzip.compress(npy_bytes(array)),
        "a.nrrd": nrrd_header(type="uchar", sizes="6 5 4").encode() + array.tobytes(),
        "b.nrrd.gz": gzip.compress(nrrd_header(type="uchar", sizes="6 5 4").encode() + array.tobytes()),
        "c.nrrd": nrrd_header(type="uchar", sizes="6 5 4", encoding="gzip").encode() + gzip.compress(array.tobytes()),
        "a.mha": meta_header(ElementType="MET_UCHAR", DimSize="6 5 4").encode() + array.tobytes(),
        "c.mha": meta_header(ElementType="MET_UCHAR", DimSize="6 5 4", CompressedData="True").encode()
        + zlib.compress(array.tobytes()),
    }
    stream = io.BytesIO()
    np.savez_compressed(stream, a=array)
    writers["a.npz"] = stream.getvalue()
    data = writers[kind]
    path = tmp_path / kind
    path.write_bytes(data)
    assert np.array_equal(ss.open(path).values, array)
    path.write_bytes(data[:-cut])
    with pytest.raises(ss.InvalidInput, match="found"):
        ss.open(path)


def peak_memory(function) -> int:
    """Return the bytes that were allocated at most while `function` ran and raised."""
    import tracemalloc

    tracemalloc.start()
    try:
        with pytest.raises(ss.InvalidInput) as caught:
            function()
        assert "bytes" in str(caught.value) or "numbers" in str(caught.value)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


BOMB = 64 * 1024 * 1024


@pytest.mark.slow
def test_bombs_end_where_the_header_says(tmp_path):
    """Files that unpack to much more than their header says take no more memory than that."""
    nothing = b"\0" * BOMB
    (tmp_path / "a.nrrd").write_bytes(nrrd_header(encoding="gzip").encode() + gzip.compress(nothing))
    (tmp_path / "b.nrrd").write_bytes(nrrd_header(encoding="bzip2").encode() + bz2.compress(nothing))
    (tmp_path / "a.mha").write_bytes(meta_header(CompressedData="True").encode() + zlib.compress(nothing))
    (tmp_path / "a.npy.gz").write_bytes(gzip.compress(npy_bytes(VALUES) + nothing))
    import tracemalloc

    for name in ("a.nrrd", "b.nrrd", "a.mha", "a.npy.gz"):
        tracemalloc.start()
        ss.open(tmp_path / name)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < BOMB / 4, name
    (tmp_path / "a.raw.gz").write_bytes(gzip.compress(nothing))
    assert peak_memory(lambda: ss.open(tmp_path / "a.raw.gz", shape=(2, 3, 4), dtype="int16")) < BOMB / 4


def test_headers_that_promise_too_much_take_no_memory(tmp_path):
    """A header may say terabytes: what the packed file can hold at most is known before anything is allocated."""
    many = "30000 30000 30000"
    (tmp_path / "a.nrrd").write_bytes(nrrd_header(sizes=many).encode() + bytes(100))
    (tmp_path / "b.nrrd").write_bytes(nrrd_header(sizes=many, encoding="gzip").encode() + gzip.compress(bytes(100)))
    (tmp_path / "c.nrrd").write_bytes(nrrd_header(sizes=many, encoding="ascii").encode() + b"1 2 3")
    (tmp_path / "a.mha").write_bytes(meta_header(DimSize=many).encode() + bytes(100))
    (tmp_path / "d.nrrd.gz").write_bytes(gzip.compress(nrrd_header(sizes=many).encode() + bytes(100)))
    data = npy_bytes(np.zeros((1, 1, 1), np.int16)).replace(b"(1, 1, 1)", b"(9000, 9000, 9000)")
    data = data[:118] + data[118:].replace(b" " * 9, b"", 1)
    (tmp_path / "a.npy").write_bytes(data)
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", data)
    for name in ("a.nrrd", "b.nrrd", "c.nrrd", "a.mha", "d.nrrd.gz"):
        assert peak_memory(lambda name=name: ss.open(tmp_path / name)) < 8e6, name


@pytest.mark.parametrize("packing", ["npy", "npz"])
def test_npy_that_lies_is_refused(tmp_path, packing):
    for shape in ((90000, 90000, 90000), (2, 3, 5), (2**40, 2**40, 2**40), (2, -3, 4)):
        stream = io.BytesIO()
        stream.write(b"\x93NUMPY\x01\x00")
        text = f"{{'descr': '<i2', 'fortran_order': False, 'shape': {shape!r}, }}".ljust(117) + "\n"
        stream.write(len(text).to_bytes(2, "little") + text.encode() + VALUES.tobytes())
        path = tmp_path / f"a.{packing}"
        if packing == "npy":
            path.write_bytes(stream.getvalue())
        else:
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("a.npy", stream.getvalue())
        with pytest.raises(ss.InvalidInput, match="bytes|shape"):
            ss.open(path)


def test_more_than_memory_is_out_of_memory(tmp_path, monkeypatch):
    from sheetsplat import _memory

    monkeypatch.setattr(_memory, "available", lambda: 1000)
    (tmp_path / "a.raw").write_bytes(bytes(2000))
    with pytest.raises(ss.OutOfMemory, match="memory"):
        ss.open(tmp_path / "a.raw", shape=(20, 10, 10), dtype="uint8")


def test_a_sparse_file_larger_than_memory_is_out_of_memory(tmp_path):
    path = tmp_path / "a.raw"
    with path.open("wb") as stream:
        stream.truncate(30000 * 30000 * 3000)
    with pytest.raises(ss.OutOfMemory, match="MB"):
        ss.open(path, shape=(3000, 30000, 30000), dtype="uint8")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b"\x1f\x8b",
        b"\x1f\x8b\x08\x00garbage",
        b"PK\x03\x04garbage",
        b"\x93NUMPY",
        b"\x93NUMPY\x09\x00aa",
        bytes(300),
    ],
)
@pytest.mark.parametrize("name", ["a", "a.npy", "a.npz", "a.nrrd", "a.gz"])
def test_unknown_files_are_refused(tmp_path, content, name):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ss.InvalidInput, match="cannot be read"):
        ss.open(tmp_path / name)


def test_missing_files_folders_and_rights(tmp_path):
    with pytest.raises(ss.InvalidInput, match="no such file"):
        ss.open(tmp_path / "a.npy")
    with pytest.raises(ss.InvalidInput, match="folder"):
        ss.open(tmp_path)
    path = tmp_path / "a.npy"
    np.save(path, VALUES)
    path.chmod(0)
    if os.geteuid() != 0:
        with pytest.raises(ss.Error, match="cannot be read"):
            ss.open(path)
    path.chmod(stat.S_IRUSR)
    assert ss.open(str(path)).size == 24


def test_four_axes_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 2, 3)))
    with pytest.raises(ss.InvalidInput, match="4 axes"):
        ss.open(tmp_path / "a.npy")


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "shape", "dtype"),
    [
        ("aneurism_128x128x128_uint8", (128, 128, 128), "uint8"),
        ("stent_128x128x256_int16", (256, 128, 128), "int16"),
        ("hydrogen_64x64x64_float32", (64, 64, 64), "float32"),
        ("lobster_120x120x34_uint8", (34, 120, 120), "uint8"),
    ],
)
def test_measured_volumes(data_dir, name, shape, dtype):
    path = data_dir / f"{name}.nrrd"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    field = ss.open(path)
    assert field.shape == shape and field.values.dtype == dtype
    expected, _ = nrrd.read(str(path), index_order="C")
    assert np.array_equal(field.values, expected)


def test_open_lists_all_formats():
    text = " ".join(str(ss.open.__doc__).split())
    assert formats.LISTED_REGULAR in text and formats.LISTED_SCATTERED in text
    assert all(one.shown for one in formats.FORMATS)


@pytest.mark.parametrize("dtype", ["1:2:3", ",,,", "f4,f4", "(2,2)f4", "O", "U3", "M8[s]", "{'names': 1}", 3])
def test_wrong_types_of_raw_samples(tmp_path, dtype):
    (tmp_path / "v.raw").write_bytes(bytes(64))
    with pytest.raises(ss.InvalidInput, match="the type of the samples cannot be used"):
        ss.open(tmp_path / "v.raw", shape=(4, 4, 4), dtype=dtype)


def test_skipped_parts_have_a_budget(tmp_path, monkeypatch):
    """A small packed file may unpack to gigabytes; what the header skips of them is bounded before any is read."""
    from sheetsplat.io import source

    path = tmp_path / "a.nrrd"
    samples = VALUES.tobytes()
    bomb = gzip.compress(b"\n" * 50_000_000, 9)
    for fields, told in (
        ({"line_skip": 10**9}, "at most 1000000 lines"),
        ({"line_skip": 60_000_000}, "at most 1000000 lines"),
        ({"byte_skip": 10**9, "encoding": "gzip"}, "bytes before the samples"),
        ({"byte_skip": 10**15}, "bytes before the samples"),
    ):
        packed = fields.get("encoding") == "gzip"
        path.write_bytes(nrrd_header(**fields).encode() + (bomb if packed else b"\n" * 100))
        began = time.process_time()
        with pytest.raises(ss.InvalidInput, match=told):
            ss.open(path)
        assert time.process_time() - began < 2.0
    # Lines of any length count by their bytes.
    monkeypatch.setattr("sheetsplat.io.nrrd_files.MOST_SKIPPED", 1000)
    path.write_bytes(nrrd_header(line_skip=3).encode() + b"x" * 5000 + b"\n\n\n" + samples)
    with pytest.raises(ss.InvalidInput, match="at most 1000 bytes"):
        ss.open(path)
    assert source.MOST_SKIPPED > 10**8
    # Within the budget they are skipped, in plain and in packed files.
    for compress in (bytes, gzip.compress):
        encoding = "raw" if compress is bytes else "gzip"
        path.write_bytes(nrrd_header(byte_skip=7, encoding=encoding).encode() + compress(b"1234567" + samples))
        assert np.array_equal(ss.open(path, prefilter=False).values, VALUES)


def test_packed_samples_have_a_budget(tmp_path, monkeypatch):
    """A few kilobytes may unpack to gigabytes, in bzip2 and in files within files; that is known before any is read."""
    from sheetsplat.io import source

    path = tmp_path / "a.nrrd"
    nothing = bytes(1 << 22)
    promised = nrrd_header(sizes="1500 1500 1600", encoding="bzip2").encode()
    path.write_bytes(promised + bz2.compress(nothing) * 4)
    began = time.process_time()
    with pytest.raises(ss.InvalidInput, match="more than 1032 times as many as the file has"):
        ss.open(path)
    assert time.process_time() - began < 2.0
    # Few bytes may repeat themselves.
    for encoding, compress in (("bzip2", bz2.compress), ("gzip", lambda data: gzip.compress(data, 9))):
        packed = compress(nothing)
        path.write_bytes(nrrd_header(sizes="128 128 128", encoding=encoding).encode() + packed)
        assert not read_volume(path).values.any()
        monkeypatch.setattr(source, "_PACKED_SAMPLES", 0)
        twice = tmp_path / "a.nrrd.gz"
        twice.write_bytes(gzip.compress(path.read_bytes(), 9))
        with pytest.raises(ss.InvalidInput, match="do not repeat themselves"):
            ss.open(path if encoding == "bzip2" else twice)
        monkeypatch.undo()


def test_packed_tables_have_a_budget(tmp_path, monkeypatch):
    """No header says how many rows a table has: a small packed one that repeats itself is not read to its end."""
    from sheetsplat.io import source

    path = tmp_path / "a.csv.gz"
    rows = b"".join(b"%d,%d,%d,%d\n" % (n, n % 7, n % 11, n) for n in range(1000))
    path.write_bytes(gzip.compress(b"x,y,z,value\n" + rows))
    assert len(ss.io.read_scattered(path).values) == 1000
    same = gzip.compress(b"1,2,3,4\n" * 1_000_000, 9)
    path.write_bytes(gzip.compress(b"x,y,z,value\n") + same * 60)
    began = time.process_time()
    with pytest.raises(ss.InvalidInput, match="more than 200 times as long as the file"):
        ss.open(path)
    assert time.process_time() - began < 10.0
    # Few bytes may repeat themselves, and files that are not packed.
    path.write_bytes(gzip.compress(b"x,y,z,value\n") + same)
    assert len(ss.io.read_scattered(path).values) == 1_000_000
    monkeypatch.setattr(source, "_UNPACKED", 0)
    with pytest.raises(ss.InvalidInput, match="does not repeat itself"):
        ss.open(path)
    path.write_bytes(b"x,y,z,value\n" + b"1,2,3,4\n" * 1000)
    assert len(ss.io.read_scattered(path).values) == 1000


def test_metaimage_says_what_its_samples_and_lengths_are(tmp_path):
    def opened(**fields):
        path = tmp_path / "a.mha"
        path.write_bytes(meta_header(**fields).encode() + VALUES.astype("<i2").tobytes())
        return read_volume(path), ss.open(path, prefilter=False)

    volume, field = opened(Modality="MET_MOD_CT", DistanceUnits="mm", Comment="a head", Name="head")
    assert field.quantity == ss.Quantity("CT number", "HU", "mm")
    assert volume.details == {"name": "head", "comment": "a head", "modality": "MET_MOD_CT", "distanceunits": "mm"}
    assert opened(Modality="MET_MOD_MR")[1].quantity == ss.Quantity()
    assert opened(DistanceUnits="?", Modality="MET_MOD_UNKNOWN")[0].details == {}
    # Shifted numbers, and those that cannot be below 0, are not in Hounsfield units.
    for fields in ({"ElementToIntensityFunctionOffset": "-1024"}, {"ElementType": "MET_USHORT"}):
        assert opened(Modality="MET_MOD_CT", **fields)[1].quantity.unit == ""


def hdf5_of_one_chunk(path, chunk, repeated):
    """Write a volume that is one packed chunk again and again along each axis; return the file's bytes."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        shape = tuple(repeated * size for size in chunk.shape)
        made = file.create_dataset("v", shape, chunk.dtype, chunks=chunk.shape, compression="gzip")
        packed = zlib.compress(chunk.tobytes())
        for at in np.ndindex(*3 * (repeated,)):
            made.id.write_direct_chunk(tuple(np.multiply(at, chunk.shape)), packed)
    return path.read_bytes()


@pytest.mark.slow
def test_ctrl_c_stops_readers_at_once(tmp_path, rng):
    """What is read in one piece is small, whatever the file promises."""
    noise = bz2.compress(rng.integers(0, 256, 1_500_000, dtype=np.uint8).tobytes())
    files = {
        "bzip2.nrrd": nrrd_header(sizes="900 900 900", encoding="bzip2").encode() + noise * 10,
        "gzip.nrrd": nrrd_header(sizes="900 900 900", encoding="gzip").encode() + gzip.compress(bytes(10**7)) * 200,
        "ascii.nrrd": nrrd_header(sizes="200 200 200", encoding="ascii").encode() + b"12345 " * 8_000_000,
        "a.csv": b"x,y,z,value\n" + b"1.25,2.5,3.75,1e-3\n" * 2_000_000,
        "a.obj": b"v 0 0 0\nv 0 0 1\nv 1 0 0\n" + b"f 1 2 3\n" * 3_000_000,
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    files["chunks.h5"] = hdf5_of_one_chunk(tmp_path / "chunks.h5", rng.integers(0, 4, (90, 90, 90), dtype=np.uint8), 10)
    # In a process of its own: an interrupt that comes too late must not reach another test.
    pairs = [str(path) for name in files for path in (_first_use(tmp_path, name), tmp_path / name)]
    late = dict.fromkeys(files, np.inf)
    for _ in range(3):
        done = subprocess.run([sys.executable, "-c", INTERRUPTED, *pairs], capture_output=True, text=True, timeout=240)
        found = dict(line.split() for line in done.stdout.splitlines())
        assert found.keys() == files.keys(), done.stdout + done.stderr
        # Processor time, the least of up to three: the machine may be busy.
        late = {name: min(seconds, float(found[name])) for name, seconds in late.items()}
        if max(late.values()) < 0.15:
            break
    assert max(late.values()) < 0.15, late


INTERRUPTED = """
import os, signal, sys, threading, time
from pathlib import Path
import sheetsplat as ss
signal.signal(signal.SIGINT, signal.default_int_handler)
def interrupt():
    while time.process_time() < begun + 0.2:
        time.sleep(0.002)
    sent.append(time.process_time())
    os.kill(os.getpid(), signal.SIGINT)
for small, large in zip(sys.argv[1::2], sys.argv[2::2]):
    ss.open(small)
    sent, thread = [], threading.Thread(target=interrupt)
    begun = time.process_time()
    thread.start()
    try:
        ss.open(large)
        os._exit(1)
    except KeyboardInterrupt:
        print(Path(large).name, time.process_time() - sent[0], flush=True)
    thread.join()
"""


def _first_use(folder, name):
    """Return a small file of the same format, which imports its reader."""
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    path = folder / f"small-{name}"
    if name.endswith(".nrrd"):
        path.write_bytes(nrrd_header().encode() + VALUES.astype("<i2").tobytes())
    elif name.endswith(".h5"):
        hdf5_of_one_chunk(path, VALUES.astype(np.uint8), 1)
    elif name.endswith(".csv"):
        path.write_text("x,y,z,value,radius\n" + "".join(f"{x},{y},{z},1,1\n" for x, y, z in corners))
    else:
        lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {' '.join(map(str, face))}" for face in faces]
        path.write_text("\n".join(lines) + "\n")
    return path

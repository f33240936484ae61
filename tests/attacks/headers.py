"""What DICOM series, OME-Zarr folders, OpenVDB's module and pages in notebooks say, replaced by what nobody expects."""

from __future__ import annotations

import copy
import json
import random
import shutil
import struct
import sys
import tempfile
import traceback
import types
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import sheetsplat as ss
from attacks import Tally, soon
from attacks.lines import viewer
from attacks.messages import Faults, good, rest, spoiled
from attacks.values import FOREIGN, json_value

_SECONDS = 20
_SHAPE = (3, 4, 5)
_PLACES = 40
_TEXTS = (
    "", " ", "nan", "inf", "-inf", "1e400", "9" * 400, "-1", "0", "1\\2", "1\\2\\3\\4\\5\\6\\7", "1\\nan\\3", "x\\y\\z",
    "0\\0\\0\\0\\0\\0", "1e-320\\1e-320", "1e308\\1e308\\1e308", "\\" * 50, "a\0b", "x" * 5000, "99999999", "\x1b[31m",
)  # fmt: skip
_TAGS = (
    "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "RescaleSlope", "RescaleIntercept", "Rows",
    "Columns", "NumberOfFrames", "SeriesInstanceUID", "SeriesNumber", "SeriesDescription", "BitsAllocated",
    "BitsStored", "HighBit", "PixelRepresentation", "SamplesPerPixel", "PhotometricInterpretation", "Modality",
    "PixelData", "PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence", "SliceThickness",
)  # fmt: skip


def _replaced(written: bytes, tag: Any, value: bytes, rng: random.Random) -> bytes:
    """Return an explicit little-endian file with another value, of another type, for an element that it has."""
    named = struct.pack("<HH", tag.group, tag.element)
    at = written.find(named, 132)
    if at < 0:
        return written
    is_long = written[at + 4 : at + 6] in (b"OW", b"OB", b"SQ", b"UN", b"UT")
    size = struct.unpack_from("<I", written, at + 8)[0] + 12 if is_long else written[at + 6] + 256 * written[at + 7] + 8
    value += b" " * (len(value) % 2)
    kind = rng.choice((b"LT", b"US", b"DS", b"IS", written[at + 4 : at + 6] if not is_long else b"LO"))
    return written[:at] + named + kind + struct.pack("<H", len(value)) + value + written[at + size :]


def _dicom(folder: Path, rng: random.Random) -> Callable[[], object]:
    """Write a series with foreign elements in one of its files, or in all."""
    import pydicom
    from pydicom.dataelem import DataElement
    from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
    from pydicom.tag import Tag
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

    pydicom.config.settings.writing_validation_mode = pydicom.config.IGNORE
    chosen = {tag: rng.randrange(4) for tag in rng.sample(_TAGS, rng.choice((1, 1, 2, 4)))}
    texts = {tag: rng.choice(_TEXTS) for tag in chosen}
    where = rng.choice((0, 1, None))
    for z in range(3):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = CTImageStorage
        meta.MediaStorageSOPInstanceUID = f"1.2.{z + 1}"
        meta.TransferSyntaxUID = ExplicitVRLittleEndian
        data = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
        data.SOPClassUID, data.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        data.SeriesInstanceUID, data.SeriesNumber, data.Modality = "1.2", 1, "CT"
        data.Rows, data.Columns, data.SamplesPerPixel = _SHAPE[1], _SHAPE[2], 1
        data.PhotometricInterpretation = "MONOCHROME2"
        data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 1
        data.ImagePositionPatient, data.ImageOrientationPatient = [1, 2, 3 * z], [1, 0, 0, 0, 1, 0]
        data.PixelSpacing, data.RescaleSlope, data.RescaleIntercept = [0.5, 0.5], 1, 0
        data.PixelData = np.arange(20, dtype="<i2").tobytes()
        for tag, how in chosen.items():
            if where not in (None, z):
                continue
            if how == 0:
                data.pop(tag, None)
            elif how < 3:
                continue
            else:
                inner = Dataset()
                inner.PixelSpacing = [1, 1]
                data[tag] = DataElement(Tag(tag), "SQ", [inner] * rng.choice((0, 1, 3)))
        pydicom.dcmwrite(folder / f"{z}.dcm", data)
        if where in (None, z):
            written = (folder / f"{z}.dcm").read_bytes()
            for tag in (one for one, how in chosen.items() if how in (1, 2)):
                written = _replaced(written, Tag(tag), texts[tag].encode(), rng)
            (folder / f"{z}.dcm").write_bytes(written)
    return lambda: ss.open(folder)


def _zarr(folder: Path, rng: random.Random) -> Callable[[], object]:
    """Write an OME-Zarr folder one of whose JSON files says something foreign."""
    import zarr

    version = rng.choice((2, 3))
    path = folder / "a.zarr"
    group = zarr.create_group(str(path), zarr_format=version)
    group.create_array("0", data=np.arange(60.0).reshape(_SHAPE), chunks=(2, 3, 3))
    scale = [{"type": "scale", "scale": [1.0, 0.5, 0.5]}]
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    told = {
        "multiscales": [
            {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}
        ],
        "omero": {"channels": [{"label": "a"}]},
    }
    group.attrs.update(told if version == 2 else {"ome": {"version": "0.5", **told}})
    files = sorted(one for one in path.rglob("*") if one.name in (".zattrs", ".zarray", ".zgroup", "zarr.json"))
    for file in rng.sample(files, rng.choice((1, 1, 1, 2))):
        wrong = spoiled(rng, json.loads(file.read_text()))
        file.write_text(json.dumps(json_value(rng) if rng.random() < 0.05 else wrong))
    return rng.choice((lambda: ss.open(path), lambda: ss.open_bricks(path, brick=16)))


def _openvdb(folder: Path, rng: random.Random) -> Callable[[], object]:
    """Write a file that a module of that name reads, which answers one question by a foreign object."""
    (folder / "a.vdb").write_bytes(b" BDV\0\0\0\0" + bytes(100))
    asked = ("name", "valueTypeName", "count", "box", "low", "linear", "place", "copy", "all", "grid")
    which = rng.choice(asked)
    # The module is no enemy: it gives no number that takes minutes to write down.
    kind = rng.choice(sorted(name for name in FOREIGN if name != "decimal"))
    made = FOREIGN[kind]

    def told(what: str, right: Any) -> Any:
        return made() if what == which else right

    class Transform:
        isLinear = told("linear", True)  # noqa: N815  # Names of OpenVDB.

        def indexToWorld(self, at: Any) -> Any:  # noqa: N802
            return told("place", tuple(0.5 * part for part in at))

    class Grid:
        name, valueTypeName = told("name", "density"), told("valueTypeName", "float")  # noqa: N815
        transform = Transform()

        def activeVoxelCount(self) -> Any:  # noqa: N802
            return told("count", 60)

        def evalActiveVoxelBoundingBox(self) -> Any:  # noqa: N802
            return told("box", (told("low", (0, 0, 0)), (2, 3, 4)))

        def copyToArray(self, values: Any, ijk: Any) -> None:  # noqa: N802
            values[...] = told("copy", 1.0)

    module = types.ModuleType("openvdb")
    module.__dict__["readAllGridMetadata"] = lambda _: told("all", [Grid()])
    module.__dict__["read"] = lambda *_: told("grid", Grid())

    def opened() -> object:
        sys.modules["openvdb"] = module
        try:
            return ss.open(folder / "a.vdb")
        finally:
            del sys.modules["openvdb"]

    opened.__doc__ = f"{which}: {kind}"
    return opened


KINDS: dict[str, Callable[[Path, random.Random], Callable[[], object]]] = {
    "dicom": _dicom,
    "ome-zarr": _zarr,
    "openvdb": _openvdb,
}


def foreign_headers(seed: int, count: int) -> Tally:
    """Open data whose headers say what nobody expects: finite samples, or an error of the package, in time."""
    tally, rng = Tally(), random.Random(seed)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for number in range(count):
            kind = rng.choice(sorted(KINDS))
            folder = Path(tempfile.mkdtemp())
            opened = KINDS[kind](folder, rng)
            try:
                said = f"{number}: {kind} {opened.__doc__ or ''}"
                tally.did(f"{kind}: opened")
                with soon(tally, said, _SECONDS):
                    field = opened()
                    tally.did(f"{kind}: read")
                    if isinstance(field, ss.RegularField) and not np.isfinite(field.values).all():
                        tally.failed(f"{said}: samples that are not finite")
            except ss.Error as error:
                if not 0 < len(str(error)) < 4000:
                    tally.failed(f"{said}: a message of {len(str(error))} characters")
            except Exception as error:  # Whatever else is raised is what is looked for.
                frames = traceback.extract_tb(error.__traceback__)[-6:]
                places = [f"{Path(at.filename).name}:{at.lineno}" for at in frames]
                tally.failed(f"{said}: {type(error).__name__}: {str(error)[:200]!r} {places}")
            finally:
                shutil.rmtree(folder, ignore_errors=True)
    return tally


def notebook_messages(seed: int, count: int) -> Tally:
    """Send a widget what no page in a notebook sends: nothing is raised or logged, and places stay few."""
    tally, rng = Tally(), random.Random(seed)
    with Faults() as faults, viewer() as shown:
        widget, session = shown.widget, shown._session
        for number in range(count):
            place = f"p{rng.randrange(_PLACES)}"
            if number % 50 == 0 or rng.random() < 0.5:
                # Nobody else is listened to.
                widget._msg_callbacks(widget, {"place": place, "type": "hello", "width": 32, "height": 24}, None)
            content: Any = {"place": place, **copy.deepcopy(good(rng))}
            if rng.random() < 0.7:
                content = spoiled(rng, content)
            elif rng.random() < 0.2:
                content = FOREIGN[rng.choice(sorted(FOREIGN))]()
            buffers = rng.choice((None, [], [b"x" * 100]))
            try:
                widget._msg_callbacks(widget, content, buffers)
                tally.did("messages")
                if rng.random() < 0.05:
                    widget._msg_callbacks(widget, {"place": f"p{rng.randrange(_PLACES)}", "type": "bye"}, None)
                if rng.random() < 0.02:
                    shown._repr_mimebundle_(include=FOREIGN[rng.choice(("set", "None", "list of texts"))]())
            except Exception as error:  # Whatever is raised here is what is looked for.
                tally.failed(f"{number}: {type(error).__name__}: {error} by {str(type(content))}")
            if number % 50 == 49 and not rest(session):
                tally.failed(f"no rest after message {number}")
                break
            for fault in faults.taken():
                tally.failed(f"{number}: {fault[-1500:]}")
    return tally

"""Meshes that meshio writes."""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import read_scattered

meshio = pytest.importorskip("meshio", reason="meshio is not installed")

POINTS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (2, 1, 1)], float)
CELLS = [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]]), ("triangle", [[1, 4, 5]])]
HEAT = np.arange(6.0) + 1
FORMATS = {
    "a.msh": {"file_format": "gmsh22"},
    "b.msh": {"file_format": "gmsh"},
    "a.med": {},
    "a.xdmf": {},
    "b.xdmf": {"data_format": "XML"},
}


def write(path, options=None, cells=CELLS):
    loads = [np.arange(len(rows)) + 10.0 * n for n, (_, rows) in enumerate(cells)]
    mesh = meshio.Mesh(POINTS, cells, point_data={"heat": HEAT}, cell_data={"load": loads})
    meshio.write(path, mesh, **(FORMATS[path.name] if options is None else options))
    return path


# meshio uses what NumPy is going to drop.
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FORMATS)
def test_what_meshio_writes(tmp_path, name, capfd):
    # What meshio writes for Gmsh 4 has cells of one kind.
    cells = CELLS[:1] if name == "b.msh" else CELLS
    path = write(tmp_path / name, cells=cells)
    # meshio warns of what it adds when it writes.
    capfd.readouterr()
    mesh = read_scattered(path)
    assert mesh.scalar == "heat" and np.array_equal(mesh.values, HEAT) and np.allclose(mesh.points, POINTS)
    assert any(np.array_equal(one, CELLS[0][1]) for one in mesh.cells)
    of_cells = read_scattered(path, scalar="load")
    assert sorted(of_cells.values) == [0, 1, 10][: 2 + (len(cells) > 1)]
    assert np.allclose(of_cells.points[:2], [POINTS[rows].mean(axis=0) for rows in CELLS[0][1]])
    assert ss.open(path).size >= 5 and capfd.readouterr() == ("", "")
    with pytest.raises(ss.InvalidInput, match="'none'.*heat"):
        ss.open(path, scalar="none")
    for damaged in (path.read_bytes()[:100], path.read_bytes()[: -len(path.read_bytes()) // 2], b"\n"):
        path.write_bytes(damaged)
        with pytest.raises(ss.Error):
            ss.open(path)


@pytest.mark.filterwarnings("ignore")
def test_xdmf_stays_in_its_folder(tmp_path):
    """A pipe stands in for the other file: opening it would wait for ever."""
    os.mkfifo(tmp_path / "secret.h5")
    folder = tmp_path / "inner"
    folder.mkdir()
    text = write(folder / "a.xdmf").read_text()
    for name in ("../secret.h5", str(tmp_path / "secret.h5")):
        (folder / "a.xdmf").write_text(text.replace("a.h5", name))
        with pytest.raises(ss.InvalidInput, match="own folder"):
            ss.open(folder / "a.xdmf")
    for change, match in (
        (('Format="HDF"', 'Format="Binary"'), "format 'Binary'"),
        (("<Domain>", '<Domain><xi:include href="../secret.h5"/>'), "include"),
        (('<Xdmf Version="3.0">', '<!DOCTYPE a [<!ENTITY b "c">]><Xdmf Version="3.0">'), "document type"),
    ):
        assert change[0] in text
        (folder / "a.xdmf").write_text(text.replace(*change))
        with pytest.raises(ss.InvalidInput, match=match):
            ss.open(folder / "a.xdmf")
    (folder / "a.xdmf").write_text(text)
    with h5py.File(folder / "a.h5", "a") as file:
        file["x"] = h5py.ExternalLink("../secret.h5", "/")
    with pytest.raises(ss.InvalidInput, match="link to another file"):
        ss.open(folder / "a.xdmf")


@pytest.mark.filterwarnings("ignore")
def test_med_holds_no_more_than_is_stored(tmp_path):
    path = write(tmp_path / "a.med")
    with h5py.File(path, "a") as file:
        file.create_dataset("huge", (10**12,), "f8", chunks=(1024,))
    with pytest.raises(ss.InvalidInput, match="0 stored bytes of /huge"):
        ss.open(path)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("what", ["a text", "a virtual dataset", "a virtual dataset beside XDMF"])
def test_heaps_that_lead_back_are_refused(tmp_path, what):
    """The HDF5 library would go round in them for ever, and no signal ends it."""
    path = write(tmp_path / ("a.xdmf" if "XDMF" in what else "a.med"))
    damaged = path.with_suffix(".h5") if "XDMF" in what else path
    with h5py.File(damaged, "a") as file:
        if what == "a text":
            del file["ENS_MAA/mesh"].attrs["ESP"]
            file["ENS_MAA/mesh"].attrs["ESP"] = "a text where a number was"
        else:
            layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
            layout[:] = h5py.VirtualSource(".", "none", shape=(3,))
            file.create_virtual_dataset("virtual", layout)
    data = damaged.read_bytes()
    heap = data.index(b"GCOL\x01")
    damaged.write_bytes(data[: heap + 24] + (2**64 - 16).to_bytes(8, "little") + data[heap + 32 :])
    with pytest.raises(ss.InvalidInput, match="in a heap"):
        ss.open(path)


@pytest.mark.filterwarnings("ignore")
def test_xdmf_takes_numbers_alone(tmp_path):
    path = write(tmp_path / "a.xdmf")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["data0"]
        file["data0"] = ["a text of any length"] * 6
    with pytest.raises(ss.InvalidInput, match="a dataset '/data0' of"):
        ss.open(path)

"""Files of triangle meshes: what is read, and what damaged files are told; thin meshes as fields."""

from __future__ import annotations

import gzip
import struct
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import fit
from sheetsplat.fit._mesh import close
from sheetsplat.io import read_scattered

CORNERS = [(float(x), float(y), float(z)) for z, y, x in product((0, 1), repeat=3)]
FACES = """1 3 2, 2 3 4, 5 6 7, 6 8 7, 1 2 5, 2 6 5, 3 7 4, 4 7 8, 1 5 3, 3 5 7, 2 4 6, 4 8 6"""
TRIANGLES = [[int(one) - 1 for one in face.split()] for face in FACES.split(",")]


def obj(corners=CORNERS, first: str = "f 1 3 2") -> str:
    """Return a box, the vertices in lines 1 to 8 and the faces from line 9 on."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners]
    return "\n".join([*lines, first, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in TRIANGLES[1:])]) + "\n"


def text_ply(vertices: int = 8, faces: int = 12, lists: str = "uchar int vertex_indices", **lines: str) -> str:
    """Return a box, the vertices in lines 10 to 17 and the faces from line 18 on; `lines` replace some: l18=..."""
    rows = [f"{x:g} {y:g} {z:g}" for x, y, z in CORNERS] + [f"3 {a} {b} {c}" for a, b, c in TRIANGLES]
    for name, line in lines.items():
        rows[int(name[1:]) - 10] = line
    head = f"ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
    return head + f"element face {faces}\nproperty list {lists}\nend_header\n" + "\n".join(rows) + "\n"


def binary_ply(
    order: str = "<", vertices: int = 8, faces: int = 12, counts: str = "uchar", quads: bool = False
) -> bytes:
    """Return a box whose faces have a flag beside their list; `quads`: one of the faces has four corners."""
    listed = [list(face) for face in TRIANGLES]
    if quads:
        listed = [[0, 2, 3, 1], *listed[2:]]
    body = b"".join(struct.pack(order + "3f", *one) for one in CORNERS)
    for face in listed:
        body += struct.pack(f"{order}B{len(face)}iB", len(face), *face, 7)
    head = f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\nelement vertex {vertices}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(listed) if faces == 12 else faces}\nproperty list {counts} int vertex_indices\n"
    return (head + "property uchar flags\nend_header\n").encode() + body


READABLE = {
    "a.obj": obj(),
    "backwards.obj": obj(first="f -8 -6 -7"),
    "normals and textures.obj": "mtllib a.mtl\no box\n" + obj(first="f 1/1/1 3//2 2/4") + "vn 0 0 1\nvt 0 0\ns off\n",
    "continued.obj": obj(first="f 1 \\\n 3 2"),
    "weights and colours.obj": obj().replace("v 1.0 1.0 1.0", "v 1.0 1.0 1.0 0.5 0.5 0.5"),
    "a.ply": text_ply(),
    "index.ply": text_ply(lists="int16 uint vertex_index"),
    "little.ply": binary_ply(),
    "big.ply": binary_ply(">"),
    "quads.ply": binary_ply(quads=True),
    "quad.ply": text_ply(faces=11, l18="4 0 2 3 1", l19="3 4 5 6").replace("3 4 5 6\n3 4 5 6", "3 4 5 6"),
}


@pytest.mark.parametrize("name", READABLE)
@pytest.mark.parametrize("packed", [False, True])
def test_meshes_are_read(tmp_path: Path, name: str, packed: bool) -> None:
    content = READABLE[name] if isinstance(READABLE[name], bytes) else READABLE[name].encode()
    path = tmp_path / (name + ".gz" * packed)
    path.write_bytes(gzip.compress(content) if packed else content)
    vertices, triangles = fit.read_mesh(path)
    assert np.array_equal(vertices, CORNERS) and len(triangles) == 12
    if "quad" not in name:
        assert triangles.tolist() == TRIANGLES
    assert close("the mesh", vertices, triangles).volume == pytest.approx(1)


def test_vertices_of_no_triangle_are_no_part_of_the_solid(tmp_path: Path) -> None:
    """They made the grid that is filled, and so its time and memory, as large as the box around them."""
    path = tmp_path / "a.obj"
    path.write_text(obj())
    expected = read_scattered(path)
    path.write_text(obj() + "v 1e5 2e5 -3e5\n")
    found = read_scattered(path)
    assert np.array_equal(found.points, expected.points)
    corners = np.concatenate([CORNERS, [(1e5, 2e5, -3e5)]])
    kernels = fit.solid(corners, TRIANGLES, kernels=300)
    assert np.array_equal(kernels.centers, fit.solid(CORNERS, TRIANGLES, kernels=300).centers)


DAMAGED = {
    "vertex 0": ("a.obj", obj(first="f 0 3 2"), "vertex 0 in line 9; wanted vertices that count from 1"),
    "vertex 9": ("a.obj", obj(first="f 1 3 9"), "vertex 9, in line 9; wanted vertices from 1 to 8"),
    "vertex -9": ("a.obj", obj(first="f -9 3 2"), "vertex -9 in line 9"),
    "a word": ("a.obj", obj(first="f a 3 2"), "'f a 3 2' in line 9"),
    "a fraction": ("a.obj", obj(first="f 1.5 3 2"), "in line 9; wanted f and numbers of vertices"),
    "endless number": ("a.obj", obj(first=f"f 1 2 {'9' * 30}"), "in line 9; wanted numbers of vertices"),
    "two corners": ("a.obj", obj(first="f 1 3"), "a face of 2 vertices, in line 9"),
    "two coordinates": ("a.obj", obj().replace("v 1.0 1.0 1.0", "v 1.0 1.0"), "'v 1.0 1.0' in line 8"),
    "not finite": ("a.obj", obj().replace("v 1.0 1.0 1.0", "v 1.0 1.0 nan"), "vertex 7 at"),
    "no face": ("a.obj", obj().split("f ")[0], "8 vertices and no face"),
    "10^15 faces": ("a.ply", text_ply(faces=10**15), "1000000000000000 of face"),
    "10^15 vertices": ("a.ply", text_ply(vertices=10**15), "1000000000000000 of vertex"),
    "10^18 vertices": ("a.ply", text_ply(vertices=10**18 - 1), "element vertex"),
    "cut text": ("a.ply", text_ply().rsplit("\n", 4)[0] + "\n", "9 of face up to line 27; wanted 12"),
    "cut in vertices": ("a.ply", "\n".join(text_ply().split("\n")[:14]), "bytes after the header; wanted at least"),
    "fewer in the header": ("a.ply", text_ply(faces=11), "1 more lines, from line 29 on"),
    "text vertex 90": (
        "a.ply",
        text_ply(l29="3 3 7 90"),
        "vertex 90, in face 11, line 29; wanted vertices from 0 to 7",
    ),
    "text vertex -5": ("a.ply", text_ply(l29="3 3 7 -5"), "vertex -5, in face 11, line 29"),
    "count of a list": ("a.ply", text_ply(l20="4 4 5 6"), "'4 4 5 6' in face 2, line 20"),
    "count below 0": ("a.ply", text_ply(l20="-1 4 5 6"), "'-1 4 5 6' in face 2, line 20"),
    "text two corners": ("a.ply", text_ply(l20="2 4 5"), "a face of 2 vertices, in face 2, line 20"),
    "text word": ("a.ply", text_ply(l11="a b c"), "'a b c' in vertex 1, line 11; wanted x, y, z"),
    "counts of float": ("a.ply", text_ply(lists="float int vertex_indices"), "counts are of type 'float', in line 8"),
    "entries of float": ("a.ply", text_ply(lists="uchar float vertex_indices"), "list of float32"),
    "entries of nothing": (
        "a.ply",
        text_ply(lists="uchar blah vertex_indices"),
        "entries are of type 'blah', in line 8",
    ),
    "another list": ("a.ply", text_ply(lists="uchar int corners"), "wanted a list vertex_indices"),
    "no list": ("a.ply", text_ply().replace("property list uchar int", "property int"), "wanted a list vertex_indices"),
    "no z": ("a.ply", text_ply().replace("property float z", "property float w"), "vertices without z"),
    "faces twice": ("a.ply", text_ply().replace("end_header", "element face 0\nend_header"), "wanted one element face"),
    "binary 10^15 faces": ("a.ply", binary_ply(faces=10**15), "1000000000000000 of face"),
    "binary 10^15 vertices": ("a.ply", binary_ply(vertices=10**15), "1000000000000000 of vertex"),
    "binary cut": ("a.ply", binary_ply()[:-5], "bytes for face 11"),
    "binary left": ("a.ply", binary_ply() + b"\0" * 3, "3 more bytes after the last element"),
    "binary one more": ("a.ply", binary_ply(faces=13), "0 bytes for face 12"),
    "binary counts of float": ("a.ply", binary_ply(counts="float"), "counts are of type 'float'"),
    "binary wide counts": ("a.ply", binary_ply(counts="uint"), "bytes for face"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_meshes_are_told(tmp_path: Path, name: str) -> None:
    file, content, told = DAMAGED[name]
    (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    for reader in (fit.read_mesh, ss.open):
        with pytest.raises(ss.InvalidInput) as caught:
            reader(tmp_path / file)
        assert told in str(caught.value) and file in str(caught.value)
    # Packed, the length is not known beforehand.
    (tmp_path / f"{file}.gz").write_bytes(gzip.compress((tmp_path / file).read_bytes()))
    with pytest.raises(ss.InvalidInput):
        fit.read_mesh(tmp_path / f"{file}.gz")


def turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])


@pytest.mark.parametrize("size", [(1e6, 1, 1), (1000, 1, 1), (1000, 1000, 1), (1e4, 1e2, 1)])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_rods_and_plates_are_as_thin_as_they_are(
    tmp_path: Path, size: tuple[float, float, float], angle: float
) -> None:
    axes = turn(angle) if angle else np.eye(3)
    path = tmp_path / "a.obj"
    path.write_text(obj((np.array(CORNERS) * size @ axes.T).tolist()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        field = ss.open(path)
    assert "ellipsoids" in read_scattered(path).details["mesh"] and 15_000 < field.size < 25_000
    # In the axes of the box: full inside, and empty where spheres of 20,000 cells would reach.
    rng = np.random.default_rng(5)
    inside = (0.1 + 0.8 * rng.random((500, 3))) * size
    assert field.at(inside @ axes.T).min() > 0.9
    outside = inside.copy()
    outside[:, 2] = size[2] + rng.choice([-1.0, 1.0], 500) * (0.6 + rng.random(500)) * size[2]
    outside[outside[:, 2] < size[2], 2] -= size[2]
    assert np.abs(field.at(outside @ axes.T)).max() == 0.0


def test_why_a_thread_is_not_seen(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(obj((np.array(CORNERS) * (1e6, 1, 1)).tolist()))
    with pytest.warns(ss.PictureWarning, match="kernels fall between pixels or slices"):
        ss.render(path, size=50, backend="cpu")

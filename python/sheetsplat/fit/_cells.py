"""Cells of meshes, and the neighbours of their points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import as_array, shown
from sheetsplat.errors import complain, unusable

from ._kernels import Floats, Numbers

# The corners that share an edge with each corner, by the number of corners, in the order of VTK and of meshio.
_TETRA = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
_PYRAMID = ((1, 3, 4), (0, 2, 4), (1, 3, 4), (0, 2, 4), (0, 1, 2, 3))
_WEDGE = ((1, 2, 3), (0, 2, 4), (0, 1, 5), (0, 4, 5), (1, 3, 5), (2, 3, 4))
_HEXAHEDRON = ((1, 3, 4), (0, 2, 5), (1, 3, 6), (0, 2, 7), (0, 5, 7), (1, 4, 6), (2, 5, 7), (3, 4, 6))

CORNERS: Mapping[int, tuple[tuple[int, ...], ...]] = {4: _TETRA, 5: _PYRAMID, 6: _WEDGE, 8: _HEXAHEDRON}
# Points without cells have edges in their place.
_WITH_EDGES = {2: ((1,), (0,)), **CORNERS}
_NAMES = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
_WANTED = "arrays (M, 4) of tetrahedra, (M, 5) of pyramids, (M, 6) of wedges or (M, 8) of hexahedra"
_FAILED = unusable("fit.delaunay: cells")


def grid_cells(shape: tuple[int, int, int]) -> Numbers:
    """Return the hexahedra of a structured grid [k, j, i] with i fastest, (M, 8)."""
    nk, nj, ni = shape
    k, j, i = np.meshgrid(np.arange(nk - 1), np.arange(nj - 1), np.arange(ni - 1), indexing="ij")
    corner = ((k * nj + j) * ni + i).reshape(-1, 1)
    square = np.array([0, 1, ni + 1, ni])
    return np.asarray(corner + np.concatenate([square, square + ni * nj]), dtype=np.int64)


def _block(given: Any, columns: int | None) -> Numbers:
    array = as_array(_FAILED, given, _WANTED)
    if array.ndim != 2 or array.dtype.kind not in "iu" or (columns is not None and array.shape[1] != columns):
        raise complain(_FAILED, f"an array of {array.dtype} of shape {array.shape}", _WANTED)
    if array.shape[1] not in CORNERS:
        raise complain(_FAILED, f"cells of {array.shape[1]} corners", _WANTED, "split other cells into these")
    return array.astype(np.int64)


def _from_stream(connectivity: Any, ends: Any) -> list[Numbers]:
    """Return blocks of cells from their points, one cell after another, and the end of each cell."""
    points, stops = as_array(_FAILED, connectivity, _WANTED), as_array(_FAILED, ends, _WANTED)
    if points.dtype.kind not in "iu" or stops.dtype.kind not in "iu" or points.ndim != 1 or stops.ndim != 1:
        raise complain(_FAILED, f"connectivity of {points.dtype}, ends of {stops.dtype}", "whole numbers in one row")
    stops = stops.astype(np.int64)
    sizes = np.diff(stops, prepend=0)
    if (sizes < 0).any() or (len(stops) and stops[-1] != len(points)):
        raise complain(_FAILED, f"{len(points)} numbers that do not end with the last cell", "ends up to their number")
    blocks = []
    for size in np.unique(sizes):
        if int(size) not in CORNERS:
            raise complain(_FAILED, f"cells of {size} corners", _WANTED, "split other cells into these, or drop them")
        starts = (stops - sizes)[sizes == size]
        blocks.append(points[starts[:, None] + np.arange(size)].astype(np.int64))
    return blocks


def cell_blocks(cells: object, count: int) -> list[Numbers]:
    """Return cells of `count` points as arrays (M, corners), or InvalidInput.

    `cells` may be an array, a sequence of arrays, a mapping from names of meshio, blocks with `type` and `data`, or an
    object with `connectivity` and `ends`.
    """
    if hasattr(cells, "connectivity") and hasattr(cells, "ends"):
        blocks = _from_stream(cells.connectivity, cells.ends)
    elif isinstance(cells, np.ndarray):
        blocks = [_block(cells, None)]
    elif isinstance(cells, Mapping):
        blocks = []
        for name, data in cells.items():
            if name not in _NAMES:
                raise complain(_FAILED, f"cells of kind {shown(name)}", "any of: " + ", ".join(_NAMES))
            blocks.append(_block(data, _NAMES[name]))
    elif isinstance(cells, Iterable) and not isinstance(cells, str | bytes):
        blocks = []
        for one in cells:
            if hasattr(one, "type") and hasattr(one, "data") and not isinstance(one, np.ndarray):
                # Surfaces, edges and points of meshes in files are ignored.
                if one.type in _NAMES:
                    blocks.append(_block(one.data, _NAMES[one.type]))
            else:
                blocks.append(_block(one, None))
    else:
        raise complain(_FAILED, shown(cells), _WANTED)
    blocks = [block for block in blocks if len(block)]
    if not blocks:
        raise complain(_FAILED, "no cell that has a volume", _WANTED)
    for block in blocks:
        if block.min() < 0 or block.max() >= count:
            raise complain(
                _FAILED, f"point numbers from {block.min()} to {block.max()}", f"numbers of the {count} points, from 0"
            )
    return blocks


def _changes(keys: Numbers) -> NDArray[np.bool_]:
    """Return where sorted numbers differ from the one before."""
    new = np.ones(len(keys), dtype=bool)
    np.not_equal(keys[1:], keys[:-1], out=new[1:])
    return new


class Neighbourhoods:
    """Edges between points of cells, both ways, sorted by their first point.

    Parameters
    ----------
    blocks
        Cells, or edges in place of cells, arrays (M, corners).
    count
        Number of points.

    Attributes
    ----------
    starts
        Where the edges of each point begin, (count + 1,).
    degrees
        Number of edges of each point, (count,).
    at, other
        First and second point of each edge.
    share
        Weight of an edge in the second moments of its first point. Each cell at a point has the same weight and its
        edges there weights of 3 together, so that a point on a face of a grid has the moments of one inside.
    """

    def __init__(self, blocks: list[Numbers], count: int) -> None:
        first: list[NDArray[np.int64]] = []
        weight: list[Floats] = []
        cells = np.zeros(count)
        for block in blocks:
            for corner, others in enumerate(_WITH_EDGES[block.shape[1]]):
                cells += np.bincount(block[:, corner], minlength=count)
                for other in others:
                    first.append(block[:, corner] * count + block[:, other])
                    weight.append(np.full(len(block), 3.0 / len(others)))
        # For arrays of this size sorting is ten times as fast as the hashes of numpy.unique.
        keys = np.concatenate(first)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        new = _changes(keys)
        share = np.add.reduceat(np.concatenate(weight)[order], np.flatnonzero(new))
        keys = keys[new]
        at, self.other = np.divmod(keys, count)
        # In degenerate cells an edge may join a point to itself.
        real = at != self.other
        at, self.other, share = at[real], self.other[real], share[real]
        self.starts = np.searchsorted(at, np.arange(count + 1))
        self.share = share / cells[at]
        self.at = at
        self.count = count
        self.degrees = np.diff(self.starts)

    def edges(self) -> Numbers:
        """Return each edge once, (E, 2)."""
        once = self.at < self.other
        return np.stack([self.at[once], self.other[once]], axis=1)

    def ring(self, block: Numbers) -> tuple[Numbers, Numbers]:
        """Return the different pairs of an item in (M, corners) and one of its points or their neighbours."""
        items = np.repeat(np.arange(len(block)), block.shape[1])
        points = block.reshape(-1)
        lengths = self.degrees[points]
        offsets = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        around = self.other[np.repeat(self.starts[points], lengths) + offsets]
        keys = np.concatenate([items * self.count + points, np.repeat(items, lengths) * self.count + around])
        keys.sort()
        item, point = np.divmod(keys[_changes(keys)], self.count)
        return item, point

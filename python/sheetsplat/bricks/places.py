"""Where the bricks of a picture lie in it: all of them at once, since single ones are asked for again and again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat.camera import Camera

Floats = NDArray[np.float64]
#: First column, first row, the column and the row behind the last ones.
Rect = tuple[int, int, int, int]

# Pixels by which rays that pass a cell may meet it, by rounding.
_NEAR = 1e-6
# Which end of a box each of its corners has along x, y, z; numbers of the corners at both ends of each of its edges.
_CORNERS = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)])
_EDGES = np.array([(n, n | bit) for bit in (1, 2, 4) for n in range(8) if not n & bit]).T


def unit_pixel(camera: Camera, size: tuple[int, int]) -> float:
    """Return the width of a pixel: world units, or in perspective per unit of depth."""
    if camera.kind == "orthographic":
        return camera.height / size[1]
    return 2.0 * math.tan(math.radians(camera.fov_y) / 2.0) / size[1]


@dataclass(frozen=True, eq=False)
class Places:
    """Where bricks lie in a picture.

    Attributes
    ----------
    size
        (width, height) of the picture.
    seen
        Which bricks have points that can be seen, in the view or not, (N,).
    depths
        Depths of the nearest and the farthest corner of the box of these points, (N, 2).
    columns, rows
        Places of its corners in pixels, (N, 8).
    around
        Whether the box reaches behind the near plane: it may be anywhere in the picture, (N,).
    rects
        The pixels that a brick can change, (N, 4) as `Rect`; empty where there are none.
    """

    size: tuple[int, int]
    seen: NDArray[np.bool_]
    depths: Floats
    columns: Floats
    rows: Floats
    around: NDArray[np.bool_]
    rects: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        cells: Floats,
        within: tuple[Floats, Floats],
        axes: Sequence[Floats],
        camera: Camera,
        size: tuple[int, int],
        to_world: Floats | None = None,
    ) -> Places:
        """Return the places of bricks.

        Parameters
        ----------
        cells
            The bricks' points, (N, 2, 3).
        within
            The lower and the upper corner of the box of all points that can be seen.
        axes
            World directions that point right, up, and back towards the viewer.
        camera, size
            Of the picture.
        to_world
            What takes coordinates of cells and `within` to the world's, (3, 3); None: they are these.
        """
        right, up, back = axes
        boxes = np.stack((np.maximum(cells[:, 0], within[0]), np.minimum(cells[:, 1], within[1])), axis=1)
        seen: NDArray[np.bool_] = np.all(boxes[:, 0] < boxes[:, 1], axis=1)
        boxes[~seen] = within
        corners = boxes[:, _CORNERS, np.arange(3)]
        away = (corners if to_world is None else corners @ to_world.T) - np.asarray(camera.eye)
        depth = -(away @ back)
        x, y = away @ right, away @ up
        around = np.zeros(len(boxes), bool)
        in_view = seen
        if camera.kind == "perspective":
            in_view = seen & (depth.max(axis=1) > camera.near)
            around = in_view & (depth.min(axis=1) <= camera.near)
            ahead = np.where(depth > camera.near, depth, camera.near)
            x, y = x / ahead, y / ahead
        width, height = size
        pixel = unit_pixel(camera, size)
        columns = x / pixel + 0.5 * width - height * camera.shift[0]
        rows = 0.5 * height - y / pixel + height * camera.shift[1]
        ends = [
            np.clip(np.floor(columns.min(axis=1)) - 1, 0, width),
            np.clip(np.floor(rows.min(axis=1)) - 1, 0, height),
            np.clip(np.ceil(columns.max(axis=1)) + 1, 0, width),
            np.clip(np.ceil(rows.max(axis=1)) + 1, 0, height),
        ]
        rects = np.stack(ends, axis=1).astype(np.int64)
        rects[around] = 0, 0, width, height
        rects[~in_view] = 0
        return cls(size, seen, np.stack((depth.min(axis=1), depth.max(axis=1)), axis=1), columns, rows, around, rects)

    def footprint(self, number: int) -> Rect | None:
        """Return the rectangle of pixels that a brick can change, or None where there are none."""
        x0, y0, x1, y1 = self.rects[number].tolist()
        return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None

    def middle(self, number: int) -> tuple[int, int] | None:
        """Return column and row of a pixel that a brick can change, in its footprint; None where none is known."""
        x0, y0, x1, y1 = self.rects[number].tolist()
        if self.around[number]:
            return None
        x, y = math.floor(self.columns[number].mean()), math.floor(self.rows[number].mean())
        return (x - x0, y - y0) if x0 <= x < x1 and y0 <= y < y1 else None

    def outline(self, number: int) -> NDArray[np.bool_]:
        """Return which pixels of its footprint a brick can change, (h, w): those whose rays meet its cell."""
        x0, y0, x1, y1 = self.footprint(number) or (0, 0, 0, 0)
        if self.around[number]:
            return np.ones((y1 - y0, x1 - x0), bool)
        first, second = _EDGES
        columns, rows = self.columns[number][:, None], self.rows[number][:, None]
        low, high = np.minimum(rows[first], rows[second]), np.maximum(rows[first], rows[second])
        steep = np.where(high > low, rows[second] - rows[first], 1.0)
        centres = np.arange(y0, y1) + 0.5
        above, below = centres - _NEAR, centres + _NEAR
        ends = []
        for edge in (above, below):
            share = (np.clip(edge, low, high) - rows[first]) / steep
            share = np.where(high > low, share, 0.0)
            ends.append(columns[first] + share * (columns[second] - columns[first]))
        level = (high == low) & (low >= above) & (low <= below)
        ends.append(np.where(level, columns[second], ends[0]))
        touched = (high >= above) & (low <= below)
        left = np.where(touched, np.minimum.reduce(ends), np.inf).min(axis=0) - _NEAR
        right = np.where(touched, np.maximum.reduce(ends), -np.inf).max(axis=0) + _NEAR
        pixels = np.arange(x0, x1) + 0.5
        inside: NDArray[np.bool_] = (pixels >= left[:, None]) & (pixels <= right[:, None])
        return inside


__all__ = ["Places", "Rect", "unit_pixel"]

"""The toy train: a mesh of boxes, cylinders and cones, each a closed surface; they overlap.

The x axis runs along the track, y up and z across it. The locomotive faces -x; the rails lie at y = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]
# Vertices, (V, 3), and triangles, (T, 3).
Mesh = tuple[Floats, NDArray[np.int64]]

# Corners of a circle.
_CORNERS = 24


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _prism(outline: Floats, along: Vector, origin: Vector, u: Vector = _X, v: Vector = _Y, taper: float = 1.0) -> Mesh:
    """Return a prism or cone: an outline (n, 2) in the axes u, v, counter-clockwise about `along` = u x v's direction.

    The far end is `taper` times as large, about the origin of the outline.
    """
    flat = outline[:, :1] * np.asarray(u) + outline[:, 1:] * np.asarray(v)
    base = np.asarray(origin) + flat
    top = np.asarray(origin) + np.asarray(along) + taper * flat
    n = len(outline)
    here = np.arange(n)
    following = np.roll(here, -1)
    triangles = [
        (here, following, n + following),
        (here, n + following, n + here),
        (np.full(n, 2 * n), following, here),
        (np.full(n, 2 * n + 1), n + here, n + following),
    ]
    middle = [base.mean(axis=0), top.mean(axis=0)]
    return np.concatenate([base, top, middle]), np.concatenate([np.stack(one, axis=1) for one in triangles])


def _box(lower: Vector, upper: Vector) -> Mesh:
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    outline = np.array([(0.0, 0.0), (x1 - x0, 0.0), (x1 - x0, y1 - y0), (0.0, y1 - y0)])
    return _prism(outline, (0.0, 0.0, z1 - z0), lower)


def _circle(radius: float, share: float = 1.0) -> Floats:
    angle = np.linspace(0.0, 2.0 * np.pi * share, _CORNERS, endpoint=share < 1.0)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _rod(start: Vector, length: float, radius: float) -> Mesh:
    """Return a cylinder along x."""
    return _prism(_circle(radius), (length, 0.0, 0.0), start, _Y, _Z)


def _tower(foot: Vector, height: float, radius: float, taper: float = 1.0) -> Mesh:
    """Return a cylinder or cone along y."""
    return _prism(_circle(radius), (0.0, height, 0.0), foot, _Z, _X, taper)


def _wheel(middle: Vector, radius: float, width: float) -> list[Mesh]:
    """Return a wheel that turns about z, with a hub."""
    x, y, z = middle
    return [
        _prism(_circle(radius), (0.0, 0.0, width), (x, y, z - 0.5 * width)),
        _prism(_circle(0.3 * radius), (0.0, 0.0, 1.6 * width), (x, y, z - 0.8 * width)),
    ]


def _wheels(places: list[float], radius: float) -> list[Mesh]:
    parts = []
    for x in places:
        for z in (-0.75, 0.75):
            parts += _wheel((x, radius, z), radius, 0.16)
        parts.append(_prism(_circle(0.09), (0.0, 0.0, 1.5), (x, radius, -0.75)))
    return parts


def _roof(x: float, length: float, y: float, half: float, height: float) -> Mesh:
    """Return half an elliptic cylinder along x."""
    arc = _circle(1.0, 0.5) * np.array([half, height])
    # Counter-clockwise about x in the axes y, z: from -z over the top to z.
    outline = np.stack([arc[:, 1], -arc[:, 0]], axis=1)
    return _prism(outline, (length, 0.0, 0.0), (x, y, 0.0), _Y, _Z)


def _locomotive(x: float) -> list[Mesh]:
    parts = [
        _box((x + 0.3, 0.75, -0.7), (x + 6.6, 1.05, 0.7)),
        _rod((x + 0.6, 1.85, 0.0), 4.2, 0.78),
        _rod((x + 0.35, 1.85, 0.0), 0.9, 0.86),
        _rod((x + 0.2, 1.85, 0.0), 0.2, 0.5),
        _rod((x + 2.0, 1.85, 0.0), 0.12, 0.84),
        _rod((x + 3.3, 1.85, 0.0), 0.12, 0.84),
        _tower((x + 0.9, 2.5, 0.0), 1.1, 0.24, 1.0),
        _tower((x + 0.9, 3.3, 0.0), 0.5, 0.26, 1.8),
        _tower((x + 2.55, 2.4, 0.0), 0.55, 0.42, 0.75),
        _tower((x + 3.85, 2.4, 0.0), 0.45, 0.3, 0.7),
        _rod((x + 0.05, 2.95, 0.0), 0.35, 0.2),
        # The cab: floor, front, pillars, low sides, roof.
        _box((x + 4.7, 0.95, -0.95), (x + 6.6, 1.15, 0.95)),
        _box((x + 4.7, 1.0, -0.95), (x + 4.88, 3.3, 0.95)),
        _box((x + 4.7, 1.0, -0.95), (x + 6.4, 2.1, -0.8)),
        _box((x + 4.7, 1.0, 0.8), (x + 6.4, 2.1, 0.95)),
        _box((x + 6.2, 1.0, -0.95), (x + 6.4, 3.3, -0.8)),
        _box((x + 6.2, 1.0, 0.8), (x + 6.4, 3.3, 0.95)),
        _roof(x + 4.5, 2.3, 3.2, 1.1, 0.42),
        # Cowcatcher and buffers.
        _prism(np.array([(0.0, 0.0), (0.9, 0.0), (0.9, 0.75)]), (0.0, 0.0, 1.4), (x - 0.45, 0.12, -0.7)),
        _rod((x + 0.0, 0.95, -0.5), 0.4, 0.13),
        _rod((x + 0.0, 0.95, 0.5), 0.4, 0.13),
    ]
    parts += _wheels([x + 1.0, x + 1.9], 0.42)
    parts += _wheels([x + 3.1, x + 4.5, x + 5.9], 0.66)
    for side in (-0.93, 0.93):
        parts.append(_box((x + 3.0, 0.58, side - 0.05), (x + 6.0, 0.74, side + 0.05)))
        parts.append(_rod((x + 1.0, 0.95, side * 0.93), 1.1, 0.24))
        parts.append(_box((x + 2.0, 0.82, side - 0.05), (x + 3.3, 0.94, side + 0.05)))
    return parts


def _tender(x: float) -> list[Mesh]:
    return [
        _box((x, 0.75, -0.8), (x + 2.9, 0.95, 0.8)),
        _box((x, 0.9, -0.95), (x + 2.9, 1.1, 0.95)),
        _box((x, 0.9, -0.95), (x + 2.9, 2.1, -0.78)),
        _box((x, 0.9, 0.78), (x + 2.9, 2.1, 0.95)),
        _box((x, 0.9, -0.95), (x + 0.2, 2.0, 0.95)),
        _box((x + 2.7, 0.9, -0.95), (x + 2.9, 2.1, 0.95)),
        _tower((x + 0.9, 1.05, 0.0), 1.25, 0.82, 0.2),
        _tower((x + 1.9, 1.05, 0.1), 1.45, 0.8, 0.15),
        *_wheels([x + 0.7, x + 2.2], 0.45),
    ]


def _coach(x: float) -> list[Mesh]:
    parts = [
        _box((x, 0.75, -0.95), (x + 5.2, 1.0, 0.95)),
        _box((x, 0.95, -0.95), (x + 5.2, 1.75, -0.8)),
        _box((x, 0.95, 0.8), (x + 5.2, 1.75, 0.95)),
        _box((x, 2.6, -0.95), (x + 5.2, 2.9, 0.95)),
        _roof(x - 0.15, 5.5, 2.85, 1.1, 0.45),
        _rod((x + 1.2, 3.3, 0.0), 2.8, 0.2),
        *_wheels([x + 0.7, x + 1.6, x + 3.6, x + 4.5], 0.45),
    ]
    for post in np.linspace(x, x + 5.0, 6):
        for side in (-0.95, 0.8):
            parts.append(_box((float(post), 0.95, side), (float(post) + 0.2, 2.7, side + 0.15)))
    for end in (x, x + 5.0):
        parts.append(_box((end, 0.95, -0.95), (end + 0.2, 1.75, 0.95)))
        parts.append(_box((end, 0.95, -0.25), (end + 0.2, 2.7, 0.25)))
    return parts


def _wagon(x: float) -> list[Mesh]:
    return [
        _box((x, 0.75, -0.9), (x + 3.6, 0.95, 0.9)),
        _rod((x + 0.15, 1.75, 0.0), 3.3, 0.85),
        _rod((x + 0.8, 1.75, 0.0), 0.14, 0.92),
        _rod((x + 2.66, 1.75, 0.0), 0.14, 0.92),
        _tower((x + 1.8, 2.4, 0.0), 0.5, 0.3),
        _box((x + 0.5, 0.9, -0.6), (x + 0.8, 1.4, 0.6)),
        _box((x + 2.8, 0.9, -0.6), (x + 3.1, 1.4, 0.6)),
        *_wheels([x + 0.8, x + 2.8], 0.45),
    ]


def train_mesh() -> Mesh:
    """Return the vertices, (V, 3), and triangles, (T, 3), of the toy train: closed surfaces that overlap."""
    parts = [
        *_locomotive(0.0),
        _box((6.4, 0.8, -0.12), (7.1, 0.95, 0.12)),
        *_tender(6.9),
        _box((9.6, 0.8, -0.12), (10.5, 0.95, 0.12)),
        *_coach(10.3),
        _box((15.3, 0.8, -0.12), (16.2, 0.95, 0.12)),
        *_wagon(16.0),
    ]
    starts = np.cumsum([0, *(len(corners) for corners, _ in parts)])
    faces = [triangles + start for (_, triangles), start in zip(parts, starts, strict=False)]
    return np.concatenate([corners for corners, _ in parts]), np.concatenate(faces)

"""Solids filled with kernels, bent by a lattice of control points: stand-ins for the subdivision volumes of [NM06]."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import complain

from ._dataset import Vector

if TYPE_CHECKING:
    from sheetsplat import EllipsoidField, Scene, TransferFunction
    from sheetsplat.fit import Kernels

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Mesh = tuple[Floats, Numbers]

_CORNERS = 24


@dataclass(frozen=True, eq=False)
class SolidDataset:
    """A solid made of kernels, with all that is needed to draw it.

    Attributes
    ----------
    name
        Short name, fit for a file name.
    kernels
        Its kernels, of density 1.
    description
        What it is and how it was made, in one or two sentences.
    stand_in_for
        The data set of a paper in whose place this one is used.
    suggested
        Options of a picture that shows it well: ``points`` of a transfer function, ``clim``, and ``direction`` and
        ``up`` of a camera.
    """

    name: str
    kernels: Kernels
    description: str = ""
    stand_in_for: str | None = None
    suggested: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "suggested", MappingProxyType(dict(self.suggested)))

    def __repr__(self) -> str:
        """Return a short description."""
        return f"SolidDataset({self.name!r}, {len(self.kernels)} kernels)"

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """World-aligned box around all supports, as :attr:`sheetsplat.EllipsoidField.bounds`."""
        return self.field().bounds

    @property
    def clim(self) -> tuple[float, float]:
        """The suggested range of values."""
        lower, upper = self.suggested.get("clim", (0.0, 1.0))
        return float(lower), float(upper)

    def field(self, **options: Any) -> EllipsoidField:
        """Return the solid as a field of kernels; `options` are those of :class:`sheetsplat.EllipsoidField`."""
        return self.kernels.field(**options)

    def transfer_function(self) -> TransferFunction:
        """Return the suggested transfer function, else a grey ramp over :attr:`clim`."""
        import sheetsplat

        lower, upper = self.clim
        ramp = [(lower, 0.0, 0.0, 0.0, 0.0), (upper, 1.0, 1.0, 1.0, 0.2)]
        return sheetsplat.TransferFunction(list(self.suggested.get("points", ramp)))

    def scene(self, **options: Any) -> Scene:
        """Return the suggested picture; `options` are those of :class:`sheetsplat.Scene` and win."""
        import sheetsplat

        arguments: dict[str, Any] = {"lights": [sheetsplat.Light((0.3, 0.5, 1.0))], **options}
        given = arguments.pop("field", None)
        transfer_function = arguments.pop("transfer_function", None)
        return sheetsplat.Scene(
            self.field() if given is None else given,
            self.transfer_function() if transfer_function is None else transfer_function,
            **arguments,
        )


def _mesh_of_file(dataset: str, name: str) -> Mesh:
    from sheetsplat.fit import read_mesh

    folder = os.environ.get("SHEETSPLAT_DATA", "")
    path = Path(folder) / name
    if not folder or not path.is_file():
        raise complain(
            f"the data set {dataset} cannot be made",
            f"no file {name} in the folder {folder}" if folder else "no folder of data, SHEETSPLAT_DATA is not set",
            f"the mesh {name}",
            "set the environment variable SHEETSPLAT_DATA to the folder that holds it",
        )
    return read_mesh(path)


def _made(
    name: str,
    mesh: Mesh,
    kernels: int,
    bend: Callable[[Floats], Floats] | None,
    color: tuple[float, float, float],
    description: str,
    stand_in_for: str,
    direction: Vector,
) -> SolidDataset:
    """Fill a mesh, and bend it: `bend` takes places in the unit cube around it, (N, 3), and returns where they go."""
    from sheetsplat import fit

    filled = fit.solid(*mesh, kernels=kernels)
    if bend is not None:
        lower, upper = filled.centers.min(axis=0), filled.centers.max(axis=0)
        lattice = fit.control_lattice((lower, upper), (5, 5, 5))
        size = float((upper - lower).max())
        moved = bend((lattice.reshape(-1, 3) - 0.5 * (lower + upper)) / size)
        control = (moved * size + 0.5 * (lower + upper)).reshape(lattice.shape)
        filled = fit.free_form_deformation(filled, control, box=(lower, upper))
    low, mid, high = (tuple(shade * part for part in color) for shade in (0.5, 0.8, 1.0))
    return SolidDataset(
        name=name,
        kernels=filled,
        description=description,
        stand_in_for=stand_in_for,
        suggested={
            "clim": (0.0, 1.0),
            "points": [(0.0, *low, 0.0), (0.25, *low, 0.0), (0.6, *mid, 0.25), (1.0, *high, 0.5)],
            "direction": direction,
            "up": (0.0, 1.0, 0.0),
        },
    )


def _twist(angle: float, lean: float) -> Callable[[Floats], Floats]:
    """Return a map that turns places about the y axis by `angle` radians from bottom to top, and leans them along x."""

    def bend(at: Floats) -> Floats:
        turn = angle * (at[:, 1] + 0.5)
        x = np.cos(turn) * at[:, 0] + np.sin(turn) * at[:, 2]
        z = np.cos(turn) * at[:, 2] - np.sin(turn) * at[:, 0]
        return np.stack([x + lean * (at[:, 1] + 0.5) ** 2, at[:, 1], z], axis=1)

    return bend


def _swell(amount: float) -> Callable[[Floats], Floats]:
    """Return a map that makes the lower half wider and the upper half narrower, and bows the back."""

    def bend(at: Floats) -> Floats:
        wide = 1.0 - amount * np.sin(np.pi * at[:, 1])
        return np.stack([at[:, 0] * wide, at[:, 1] - 0.5 * amount * (2.0 * at[:, 2]) ** 2, at[:, 2] * wide], axis=1)

    return bend


def _curve(angle: float, hump: float) -> Callable[[Floats], Floats]:
    """Return a map that bends the x axis into an arc of `angle` radians in the plane of x and z, with a hump in y."""

    def bend(at: Floats) -> Floats:
        along = angle * at[:, 0]
        radius = 1.0 / angle
        return np.stack(
            [
                (radius - at[:, 2]) * np.sin(along),
                at[:, 1] + hump * np.cos(np.pi * at[:, 0]),
                radius - (radius - at[:, 2]) * np.cos(along),
            ],
            axis=1,
        )

    return bend


def chess_piece(kernels: int = 84_000, *, deformed: bool = True) -> SolidDataset:
    """Return a chess knight filled with kernels, twisted and leaning.

    Needs ``mesh_chess_knight.obj`` in the folder that ``SHEETSPLAT_DATA`` names.

    Parameters
    ----------
    kernels
        About how many.
    deformed
        Whether a lattice of control points bends it; spheres become ellipsoids by that.
    """
    return _made(
        "chess_piece",
        _mesh_of_file("chess_piece", "mesh_chess_knight.obj"),
        kernels,
        _twist(0.9, 0.15) if deformed else None,
        (0.95, 0.8, 0.55),
        "A chess knight (Randy Brown) filled with spheres of three sizes, then twisted by a Bezier lattice.",
        "Chess piece, 84k kernels, of the 2006 paper",
        (-0.5, -0.25, -1.0),
    )


def monster(kernels: int = 91_000, *, deformed: bool = True) -> SolidDataset:
    """Return the cow Spot filled with kernels, swollen below.

    Needs ``mesh_spot.obj`` in the folder that ``SHEETSPLAT_DATA`` names.

    Parameters
    ----------
    kernels
        About how many.
    deformed
        Whether a lattice of control points bends it; spheres become ellipsoids by that.
    """
    return _made(
        "monster",
        _mesh_of_file("monster", "mesh_spot.obj"),
        kernels,
        _swell(0.25) if deformed else None,
        (0.45, 0.85, 0.35),
        "The cow Spot (Keenan Crane) filled with spheres of three sizes, then swollen by a Bezier lattice.",
        "Monster, 91k kernels, of the 2006 paper",
        (0.7, -0.3, 1.0),
    )


def toy_car(kernels: int = 173_000, *, deformed: bool = True) -> SolidDataset:
    """Return a toy cannon filled with kernels, bent in an arc.

    Needs ``mesh_toy_cannon.obj`` in the folder that ``SHEETSPLAT_DATA`` names.

    Parameters
    ----------
    kernels
        About how many.
    deformed
        Whether a lattice of control points bends it; spheres become ellipsoids by that.
    """
    return _made(
        "toy_car",
        _mesh_of_file("toy_car", "mesh_toy_cannon.obj"),
        kernels,
        _curve(0.7, 0.08) if deformed else None,
        (0.85, 0.4, 0.3),
        "A toy cannon (Rikk Carey) filled with spheres of three sizes, then bent by a Bezier lattice.",
        "Toy car, 173k kernels, of the 2006 paper",
        (-0.6, -0.35, -1.0),
    )


def toy_train(kernels: int = 199_000, *, deformed: bool = True) -> SolidDataset:
    """Return a toy train of boxes, cylinders and cones filled with kernels, on a bend.

    Parameters
    ----------
    kernels
        About how many.
    deformed
        Whether a lattice of control points bends it; spheres become ellipsoids by that.
    """
    return _made(
        "toy_train",
        train_mesh(),
        kernels,
        _curve(0.9, 0.03) if deformed else None,
        (0.4, 0.6, 0.9),
        "A locomotive with tender, coach and wagon, of boxes, cylinders and cones filled with spheres of three sizes, "
        "then bent by a Bezier lattice.",
        "Toy train, 199k kernels, of the 2006 paper",
        (-0.55, -0.45, -1.0),
    )


# A train of primitives. Each is a closed surface; they overlap. x along the track, y up, z across; the locomotive looks
# along -x, the rails lie at y = 0.


def _prism(outline: Floats, along: Vector, origin: Vector, u: Vector, v: Vector, taper: float = 1.0) -> Mesh:
    """Return a prism or cone: an outline (n, 2) in the axes u, v, counter-clockwise about `along` = u x v's direction.

    The far end is `taper` times as large, about the origin of the outline.
    """
    flat = outline[:, :1] * np.asarray(u) + outline[:, 1:] * np.asarray(v)
    base = np.asarray(origin) + flat
    top = np.asarray(origin) + np.asarray(along) + taper * flat
    n = len(outline)
    middle = np.stack([base.mean(axis=0), top.mean(axis=0)])
    here = np.arange(n)
    following = (here + 1) % n
    triangles = np.concatenate(
        [
            np.stack([here, following, n + following], axis=1),
            np.stack([here, n + following, n + here], axis=1),
            np.stack([np.full(n, 2 * n), following, here], axis=1),
            np.stack([np.full(n, 2 * n + 1), n + here, n + following], axis=1),
        ]
    )
    return np.concatenate([base, top, middle]), triangles


def _box(lower: Vector, upper: Vector) -> Mesh:
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    outline = np.array([(0.0, 0.0), (x1 - x0, 0.0), (x1 - x0, y1 - y0), (0.0, y1 - y0)])
    return _prism(outline, (0.0, 0.0, z1 - z0), lower, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def _circle(radius: float, share: float = 1.0) -> Floats:
    angle = np.linspace(0.0, 2.0 * np.pi * share, _CORNERS, endpoint=share < 1.0)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _rod(start: Vector, length: float, radius: float) -> Mesh:
    """Return a cylinder along x."""
    return _prism(_circle(radius), (length, 0.0, 0.0), start, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _tower(foot: Vector, height: float, radius: float, taper: float = 1.0) -> Mesh:
    """Return a cylinder or cone along y."""
    return _prism(_circle(radius), (0.0, height, 0.0), foot, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), taper)


def _wheel(middle: Vector, radius: float, width: float) -> list[Mesh]:
    """Return a wheel that turns about z, with a hub."""
    x, y, z = middle
    axes: tuple[Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    return [
        _prism(_circle(radius), (0.0, 0.0, width), (x, y, z - 0.5 * width), *axes),
        _prism(_circle(0.3 * radius), (0.0, 0.0, 1.6 * width), (x, y, z - 0.8 * width), *axes),
    ]


def _wheels(places: list[float], radius: float) -> list[Mesh]:
    parts = []
    for x in places:
        for z in (-0.75, 0.75):
            parts += _wheel((x, radius, z), radius, 0.16)
        parts.append(_prism(_circle(0.09), (0.0, 0.0, 1.5), (x, radius, -0.75), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    return parts


def _roof(x: float, length: float, y: float, half: float, height: float) -> Mesh:
    """Return half an elliptic cylinder along x."""
    arc = _circle(1.0, 0.5) * np.array([half, height])
    # Counter-clockwise about x in the axes y, z: from -z over the top to z.
    outline = np.stack([arc[:, 1], -arc[:, 0]], axis=1)
    return _prism(outline, (length, 0.0, 0.0), (x, y, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


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
        # The cab: a floor, a front, pillars, low sides, a roof.
        _box((x + 4.7, 0.95, -0.95), (x + 6.6, 1.15, 0.95)),
        _box((x + 4.7, 1.0, -0.95), (x + 4.88, 3.3, 0.95)),
        _box((x + 4.7, 1.0, -0.95), (x + 6.4, 2.1, -0.8)),
        _box((x + 4.7, 1.0, 0.8), (x + 6.4, 2.1, 0.95)),
        _box((x + 6.2, 1.0, -0.95), (x + 6.4, 3.3, -0.8)),
        _box((x + 6.2, 1.0, 0.8), (x + 6.4, 3.3, 0.95)),
        _roof(x + 4.5, 2.3, 3.2, 1.1, 0.42),
        # The catcher of cows, and buffers.
        _prism(
            np.array([(0.0, 0.0), (0.9, 0.0), (0.9, 0.75)]),
            (0.0, 0.0, 1.4),
            (x - 0.45, 0.12, -0.7),
            (1.0, 0.0, 0.0),
            (0.0, 1.0, 0.0),
        ),
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
    vertices, triangles, count = [], [], 0
    for corners, faces in parts:
        vertices.append(corners)
        triangles.append(faces + count)
        count += len(corners)
    return np.concatenate(vertices), np.concatenate(triangles)

"""Solids filled with kernels and deformed by control points, in place of the subdivision volumes of [NM06]."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField

from ._dataset import DrawableDataset, Floats, Mesh, Vector
from ._train import train_mesh

if TYPE_CHECKING:
    from sheetsplat.fit import Kernels


@dataclass(frozen=True, eq=False)
class SolidDataset(DrawableDataset):
    """A solid made of kernels, and how to draw it.

    Attributes
    ----------
    kernels
        Its kernels, of density 1.

    Examples
    --------
    >>> train = ss.datasets.toy_train(2000)
    >>> image = ss.render(train, size=(32, 32))
    """

    kernels: Kernels

    def __repr__(self) -> str:
        """Return a short description."""
        return f"SolidDataset({self.name!r}, {len(self.kernels)} kernels)"

    def field(self, **options: Any) -> EllipsoidField:
        """Return the solid as a field of kernels; `options` are those of :class:`sheetsplat.EllipsoidField`."""
        return self.kernels.field(**options)


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
    color: Vector,
    description: str,
    stand_in_for: str,
    direction: Vector,
) -> SolidDataset:
    """Fill a mesh and deform it: `bend` maps places in the unit cube around it, (N, 3)."""
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
        name,
        filled,
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
    """Return a map that twists by `angle` radians about the y axis from bottom to top, and shears along x."""

    def bend(at: Floats) -> Floats:
        turn = angle * (at[:, 1] + 0.5)
        x = np.cos(turn) * at[:, 0] + np.sin(turn) * at[:, 2]
        z = np.cos(turn) * at[:, 2] - np.sin(turn) * at[:, 0]
        return np.stack([x + lean * (at[:, 1] + 0.5) ** 2, at[:, 1], z], axis=1)

    return bend


def _swell(amount: float) -> Callable[[Floats], Floats]:
    """Return a map that widens the lower half, narrows the upper half, and lowers the ends along z."""

    def bend(at: Floats) -> Floats:
        wide = 1.0 - amount * np.sin(np.pi * at[:, 1])
        return np.stack([at[:, 0] * wide, at[:, 1] - 0.5 * amount * (2.0 * at[:, 2]) ** 2, at[:, 2] * wide], axis=1)

    return bend


def _curve(angle: float, hump: float) -> Callable[[Floats], Floats]:
    """Return a map that bends the x axis into an arc of `angle` radians in the plane of x and z, with a hump in y."""

    def bend(at: Floats) -> Floats:
        along = angle * at[:, 0]
        radius = 1.0 / angle
        x, y = (radius - at[:, 2]) * np.sin(along), at[:, 1] + hump * np.cos(np.pi * at[:, 0])
        return np.stack([x, y, radius - (radius - at[:, 2]) * np.cos(along)], axis=1)

    return bend


def chess_piece(kernels: int = 84_000, *, deformed: bool = True) -> SolidDataset:
    """Return a chess knight filled with kernels, twisted and sheared.

    Needs ``mesh_chess_knight.obj`` in the folder that ``SHEETSPLAT_DATA`` names.

    Parameters
    ----------
    kernels
        Approximate number.
    deformed
        Whether it is deformed by control points, by which spheres become ellipsoids.

    Examples
    --------
    >>> piece = ss.datasets.chess_piece()  # doctest: +SKIP
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
    """Return the cow Spot filled with kernels, widened below.

    Needs ``mesh_spot.obj`` in the folder that ``SHEETSPLAT_DATA`` names.

    Parameters as for `chess_piece`.

    Examples
    --------
    >>> monster = ss.datasets.monster()  # doctest: +SKIP
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

    Parameters as for `chess_piece`.

    Examples
    --------
    >>> car = ss.datasets.toy_car()  # doctest: +SKIP
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
    """Return a toy train of boxes, cylinders and cones filled with kernels, bent in an arc.

    Parameters as for `chess_piece`.

    Examples
    --------
    >>> train = ss.datasets.toy_train(2000)
    >>> train.field().normalization
    'threshold'
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

"""Solids filled with kernels and deformed by control points, in place of the subdivision volumes of [NM06]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.generators.train import Floats, Mesh, Vector, train_mesh
from sheetsplat import fit


@dataclass(frozen=True)
class Solid:
    """A solid made of kernels of density 1, the points of a transfer function, and a direction to look along."""

    kernels: fit.Kernels
    points: tuple[tuple[float, ...], ...]
    direction: Vector


def _made(mesh: Mesh, kernels: int, bend: Callable[[Floats], Floats] | None, color: Vector, direction: Vector) -> Solid:
    """Fill a mesh and deform it: `bend` maps places in the unit cube around it, (N, 3)."""
    filled = fit.solid(*mesh, kernels=kernels)
    if bend is not None:
        lower, upper = filled.centers.min(axis=0), filled.centers.max(axis=0)
        lattice = fit.control_lattice((lower, upper), (5, 5, 5))
        size = float((upper - lower).max())
        moved = bend((lattice.reshape(-1, 3) - 0.5 * (lower + upper)) / size)
        control = (moved * size + 0.5 * (lower + upper)).reshape(lattice.shape)
        filled = fit.free_form_deformation(filled, control, box=(lower, upper))
    low, mid, high = (tuple(shade * part for part in color) for shade in (0.5, 0.8, 1.0))
    points = ((0.0, *low, 0.0), (0.25, *low, 0.0), (0.6, *mid, 0.25), (1.0, *high, 0.5))
    return Solid(filled, points, direction)


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


def chess_piece(mesh: Path, kernels: int = 84_000, *, deformed: bool = True) -> Solid:
    """Return the chess knight of ``mesh_chess_knight.obj`` filled with about `kernels` spheres, twisted and sheared.

    The deformation makes ellipsoids of the spheres; `deformed` False leaves it out.
    """
    bend = _twist(0.9, 0.15) if deformed else None
    return _made(fit.read_mesh(mesh), kernels, bend, (0.95, 0.8, 0.55), (-0.5, -0.25, -1.0))


def monster(mesh: Path, kernels: int = 91_000, *, deformed: bool = True) -> Solid:
    """Return the cow of ``mesh_spot.obj`` filled with kernels, widened below; parameters as for `chess_piece`."""
    bend = _swell(0.25) if deformed else None
    return _made(fit.read_mesh(mesh), kernels, bend, (0.45, 0.85, 0.35), (0.7, -0.3, 1.0))


def toy_car(mesh: Path, kernels: int = 173_000, *, deformed: bool = True) -> Solid:
    """Return the cannon of ``mesh_toy_cannon.obj`` filled with kernels, in an arc; parameters as for `chess_piece`."""
    bend = _curve(0.7, 0.08) if deformed else None
    return _made(fit.read_mesh(mesh), kernels, bend, (0.85, 0.4, 0.3), (-0.6, -0.35, -1.0))


def toy_train(kernels: int = 199_000, *, deformed: bool = True) -> Solid:
    """Return a train of boxes, cylinders and cones filled with kernels, in an arc; parameters as for `chess_piece`."""
    bend = _curve(0.9, 0.03) if deformed else None
    return _made(train_mesh(), kernels, bend, (0.4, 0.6, 0.9), (-0.55, -0.45, -1.0))

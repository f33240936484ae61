"""Shadows and ambient occlusion of fields in bricks: light volumes of the whole, made of what each brick holds.

A light volume is made from a grid along the axes of the world, of absorption, or of the scalar in mode isosurface
(``cpp/src/light/grids.cpp``). Every brick fills the elements in its cell; the pieces of all bricks add up to the
grid of one process, and from it come the same volumes, which all bricks are drawn with.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._sheetsplat import LightVolumes
from sheetsplat._waiting import asked
from sheetsplat.bricks.draw import native_part
from sheetsplat.bricks.needs import field_of
from sheetsplat.bricks.partition import EVERYWHERE, MERGED
from sheetsplat.bricks.resident import renderer_of
from sheetsplat.bricks.tasks import Tasks
from sheetsplat.bricks.view import BrickView
from sheetsplat.fields import Field
from sheetsplat.scene import Scene


@dataclass(frozen=True, eq=False)
class Piece:
    """A box of the elements of a grid.

    Attributes
    ----------
    first
        The first element, [w, v, u].
    values
        float32, [w, v, u].
    """

    first: tuple[int, int, int]
    values: NDArray[np.float32]

    def add_to(self, values: NDArray[np.float32], first: tuple[int, int, int]) -> None:
        """Add it to a larger box."""
        inside = tuple(
            slice(start - outer, start - outer + count)
            for start, outer, count in zip(self.first, first, self.values.shape, strict=True)
        )
        values[inside] += self.values


#: What some bricks hold: a box of each grid, by its number; none where all of it is 0.
LightPieces = dict[int, Piece]


def planned_light(view: BrickView, field: Field) -> BrickView:
    """Return the view with how its light volumes are made.

    Parameters
    ----------
    view
        The picture.
    field
        Any field with the kernels' options, which is not read.

    Raises
    ------
    InvalidInput, Unsupported
        As `Renderer.plan`.
    """
    if not view.is_dimmed:
        return view.replace(light=None)
    native = Scene.of_checked([((field,), view.transfer_function)], view.options).native
    native = view.part(native, EVERYWHERE, view.depths, supports=view.supports)
    renderer = renderer_of(view.settings, "wholes")
    return view.replace(light=renderer.plan_light(native, view.camera.native, size=view.size))


def pieces_of(view: BrickView, source: Any, number: int) -> LightPieces:
    """Return what a brick holds of the grids of a view.

    Raises
    ------
    InvalidInput, Unsupported, OutOfMemory, Cancelled
        As `Renderer.render`.
    """
    native = native_part(view, number, field_of(source, view, number), view.depths)
    found = renderer_of(view.settings).light_pieces(
        native, view.camera.native, size=view.size, light=view.light, progress=asked()
    )
    return {grid: Piece(first, values) for grid, first, values in found}


def merged_pieces(_: Any, *parts: LightPieces) -> LightPieces:
    """Return what several bricks hold together."""
    boxes: dict[int, list[Piece]] = {}
    for part in parts:
        for grid, piece in part.items():
            boxes.setdefault(grid, []).append(piece)
    return {grid: _joined(found) for grid, found in boxes.items()}


def _joined(pieces: list[Piece]) -> Piece:
    if len(pieces) == 1:
        return pieces[0]
    starts = np.array([piece.first for piece in pieces])
    w, v, u = starts.min(axis=0).tolist()
    ends = starts + [piece.values.shape for piece in pieces]
    values = np.zeros(ends.max(axis=0) - (w, v, u), np.float32)
    for piece in pieces:
        piece.add_to(values, (w, v, u))
    return Piece((w, v, u), values)


def light_volumes(view: BrickView, *parts: LightPieces) -> LightVolumes:
    """Return the light volumes of a view.

    Parameters
    ----------
    view
        The picture, as `planned_light` returns it.
    parts
        What all bricks hold, always in the same order.

    Raises
    ------
    OutOfMemory, Cancelled
        As `Renderer.render`.
    """
    grids = [np.zeros(shape, np.float32) for shape in view.light.shapes]
    for part in parts:
        for number, piece in part.items():
            piece.add_to(grids[number], (0, 0, 0))
    made: LightVolumes = renderer_of(view.settings).light_volumes(view.light, grids, progress=asked())
    return made


def light_of(tasks: Tasks, view: BrickView, key: Any, dimming: Sequence[int]) -> tuple[Any, int]:
    """Return what makes the light volumes of a picture, None where it needs none, and of how many bricks.

    Parameters
    ----------
    tasks
        Of the picture.
    view
        The picture, as `planned_light` returns it.
    key
        The same for the same samples or kernels: the volumes of the last picture may do.
    dimming
        The bricks that may dim light.
    """
    if view.light is None:
        return None, 0

    def make() -> Any:
        pieces = [tasks.place("light-brick", pieces_of, number) for number in dimming if view.light.shapes]
        merged = tasks.merged("merge-light", merged_pieces, pieces, MERGED)
        return tasks.anywhere("make-light", light_volumes, *merged)

    light, is_new = tasks.kept(light_key(view, key), make)
    return light, len(dimming) if is_new else 0


def light_key(view: BrickView, key: Any) -> bytes:
    """Return what is the same for views with the same light volumes.

    Parameters
    ----------
    view
        The picture, as `planned_light` returns it.
    key
        The same for the same samples or kernels.
    """
    names = ("mode", "reference_length", "filter", "clip")
    looks = (view.transfer_function.points[:, [0, 4]], [view.options[name] for name in names])
    cells = [brick.cell for brick in view.partition.bricks]
    told = pickle.dumps((key, view.light, looks, cells, view.levels, view.allowed, view.settings), 5)
    return hashlib.blake2b(told, digest_size=16).digest()

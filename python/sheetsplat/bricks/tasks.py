"""What workers of dask.distributed do for pictures in bricks: each function is a task that a client submits."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.draw import draw_brick, forget_renderers, is_hidden, renderer_of
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.kernel_source import Columns, Segments, Store
from sheetsplat.bricks.kernel_survey import KernelSurvey, merge_kernel_surveys, sorted_piece
from sheetsplat.bricks.kernel_survey import survey_of as survey_of_piece
from sheetsplat.bricks.levels import LevelStore, coarsen_brick
from sheetsplat.bricks.light import light_volumes, merged_pieces, pieces_of
from sheetsplat.bricks.light_error import (
    Lines,
    Probes,
    Spots,
    chosen_spots,
    errors_of,
    lines_of,
    merged_lines,
    merged_spots,
    spots_of,
)
from sheetsplat.bricks.needs import field_of
from sheetsplat.bricks.partial import Finished, Partial, finish, merge
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.probe import Probing
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource, box_text
from sheetsplat.bricks.statistics import BrickSurvey, SurveyPlan, merge_surveys, survey_of
from sheetsplat.bricks.view import BrickView
from sheetsplat.errors import Cancelled, Error, OutOfMemory, complain


def _here() -> str:
    """Return the address of the worker that runs this."""
    from distributed import get_worker  # type: ignore[import-not-found, import-untyped, unused-ignore]

    return str(get_worker().address)


@contextmanager
def naming(what: str, doing: str = "drawn") -> Iterator[None]:
    """Name the worker, and what it does, in errors."""
    try:
        yield
    except Cancelled:
        raise
    except Error as error:
        found = f"{error.what}: {error.found}" if error.found else error.what
        what = f"{what} cannot be {doing} by worker {_here()}"
        raise complain(what, found, error.wanted, error.advice, kind=type(error)) from None
    except MemoryError:
        what = f"{what} cannot be {doing} by worker {_here()}"
        raise complain(what, "too little memory", "memory for it", "use smaller bricks", kind=OutOfMemory) from None


def let_go_of_all() -> None:
    """Let this process forget all bricks, and what was made of them, and give their memory back."""
    residents().clear()
    forget_renderers()
    gc.collect()
    # The allocator keeps what was freed; not every C library has this.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def _brick_text(source: Any, partition: Partition, number: int) -> str:
    """Return how messages call a brick."""
    core = partition.bricks[number].samples
    return f"brick {number} {'' if core is None else box_text(core) + ' '}of {source.name}"


def is_wanted(_: float) -> bool:
    """Return whether the task that runs in this thread was not cancelled meanwhile."""
    from distributed import get_worker
    from distributed.worker import thread_state  # type: ignore[attr-defined, import-not-found, unused-ignore]

    task = get_worker().state.tasks.get(thread_state.key)
    return task is not None and task.state != "cancelled"


@dataclass(frozen=True, eq=False)
class Drawn:
    """What a brick adds to a picture, and what was done for it.

    `counts`: reads, bytes read, 1 where it was drawn, 1 where that was with a coarser level.
    """

    part: Partial
    counts: tuple[int, ...]


def render_brick(view: BrickView, source: Any, number: int, light: Lit | None, *before: Drawn) -> Drawn:
    """Draw a brick behind others that cover some of its pixels."""
    with naming(_brick_text(source, view.partition, number)):
        in_front = None if view.any_order else _in_front(view, number, [one.part for one in before])
        if in_front is not None and is_hidden(view, number, in_front):
            return Drawn(_passed(view, number, in_front), (0, 0, 0, 0))
        counts = residents().counts
        reads, count, coarse = counts.reads, counts.bytes_read, counts.coarse
        field = field_of(source, view, number)
        volumes = None if light is None else light.light
        part = draw_brick(view, number, field, renderer_of(view.settings), in_front, is_wanted, volumes)
        return Drawn(part, (counts.reads - reads, counts.bytes_read - count, 1, counts.coarse - coarse))


def _in_front(view: BrickView, number: int, parts: Sequence[Partial]) -> NDArray[np.float32]:
    """Return the opacity in front of a footprint, (h, w): where several parts cover a pixel the last has the most."""
    rect = view.footprint(number)
    assert rect is not None
    x0, y0, x1, y1 = rect
    found = np.zeros((y1 - y0, x1 - x0), np.float32)
    for part in parts:
        found = np.maximum(found, part.opacity(rect))
    return found


def _passed(view: BrickView, number: int, in_front: NDArray[np.float32]) -> Partial:
    """Return what a hidden brick adds: nothing but the opacity in front of it."""
    rect = view.footprint(number)
    assert rect is not None
    rgba = np.zeros((*in_front.shape, 4), np.float32)
    rgba[..., 3] = in_front
    depth = np.full(in_front.shape, np.inf, np.float32) if "depth" in view.outputs else None
    return Partial(view.mode, rect, rgba=rgba, depth=depth, is_behind=True)


def merge_parts(_: Any, *parts: Drawn) -> Drawn:
    """Merge parts, from front to back."""
    return Drawn(merge(*(one.part for one in parts)), _sum(*(one.counts for one in parts)))


def _sum(*counts: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(map(sum, zip(*counts, strict=True)))


def finish_picture(
    view: BrickView, of_light: tuple[int, int] | None, *parts: Drawn
) -> tuple[Finished, tuple[int, ...]]:
    """Merge the last parts; return the picture, and what was done for it; `of_light`: what `counts_of` says."""
    drawn = merge_parts(view, *parts)
    reads, count = of_light or (0, 0)
    return finish(view, drawn.part), _sum(drawn.counts, (reads, count, 0, 0))


@dataclass(frozen=True, eq=False)
class Lit:
    """What some bricks hold of the grids of light, or the light volumes of all; and how much was read for it."""

    light: Any
    reads: int = 0
    bytes_read: int = 0

    @classmethod
    def of(cls, light: Any, parts: Sequence[Lit]) -> Lit:
        """Return what was made of parts."""
        return cls(light, sum(one.reads for one in parts), sum(one.bytes_read for one in parts))


def light_brick(view: BrickView, source: Any, number: int) -> Lit:
    """Return what a brick holds of the grids that light volumes are made from."""
    with naming(_brick_text(source, view.partition, number)):
        counts = residents().counts
        reads, count = counts.reads, counts.bytes_read
        field = field_of(source, view, number)
        pieces = pieces_of(view, number, field, renderer_of(view.settings), is_wanted)
        return Lit(pieces, counts.reads - reads, counts.bytes_read - count)


def merge_light(_: Any, *parts: Lit) -> Lit:
    """Return what several bricks hold together."""
    return Lit.of(merged_pieces(one.light for one in parts), parts)


def make_light(view: BrickView, *parts: Lit) -> Lit:
    """Return the light volumes of a view, from what all bricks hold."""
    with naming("light of a picture in bricks"):
        made = light_volumes(view, [one.light for one in parts], renderer_of(view.settings), is_wanted)
        return Lit.of(made, parts)


def counts_of(_: Any, light: Lit) -> tuple[int, int]:
    """Return how much was read for light: reads, and bytes."""
    return light.reads, light.bytes_read


def light_spots(shared: tuple[BrickView, Probes], source: Any, number: int, light: Lit) -> Spots:
    """Return what a brick shows at some pixels."""
    view, probes = shared
    with naming(_brick_text(source, view.partition, number)):
        field, renderer = field_of(source, view, number), renderer_of(view.settings)
        return spots_of(view, number, field, renderer, light.light, probes, is_wanted)


def merge_spots(_: Any, *parts: Spots) -> Spots:
    """Return what several bricks show."""
    return merged_spots(parts)


def choose_spots(shared: tuple[BrickView, Probes], *parts: Spots) -> Spots:
    """Return the points from which lines to the lights are looked at."""
    return chosen_spots(*shared, merged_spots(parts))


def light_lines(shared: tuple[BrickView, Probes], source: Any, number: int, light: Lit, chosen: Spots) -> Lines:
    """Return what a brick leaves of light on lines from points."""
    view, _ = shared
    with naming(_brick_text(source, view.partition, number)):
        field, renderer = field_of(source, view, number), renderer_of(view.settings)
        return lines_of(view, number, field, renderer, light.light, chosen, is_wanted)


def merge_lines(_: Any, *parts: Lines) -> Lines:
    """Return what several bricks leave of light."""
    return merged_lines(parts)


def measure_light(shared: tuple[BrickView, Probes], chosen: Spots, *parts: Lines) -> tuple[float, float]:
    """Return the errors of shadows and of ambient occlusion."""
    return errors_of(shared[1], chosen, parts)


def survey_brick(shared: tuple[Partition, SurveyPlan], source: BrickSource, number: int) -> BrickSurvey:
    """Return what is known of the samples of a brick."""
    partition, plan = shared
    with naming(_brick_text(source, partition, number)):
        return survey_of(source, partition, number, plan)


def coarsen_one(shared: tuple[Partition, LevelStore, int], source: BrickSource, number: int) -> None:
    """Write the coarser levels of a brick."""
    partition, store, count = shared
    with naming(_brick_text(source, partition, number), "read"):
        coarsen_brick(source, partition, number, store, count)


def survey_piece(shared: tuple[int, str], pieces: Pieces, number: int) -> KernelSurvey:
    """Return what is known of a piece of scattered kernels."""
    with naming(f"piece {number} of {pieces.name}", "read"):
        return survey_of_piece(pieces, number, shared[0])


def sort_piece(shared: tuple[Columns, Partition, int, Store], pieces: Pieces, number: int) -> Segments:
    """Write the kernels of a piece to the bricks that they belong to."""
    columns, partition, rows, store = shared
    with naming(f"piece {number} of {pieces.name}", "sorted"):
        return sorted_piece(pieces, number, columns, partition, rows, store)


def probe_brick(
    probing: Probing, source: BrickSource, number: int, places: NDArray[np.float64]
) -> dict[int, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Return the sums of a brick at places, by its number."""
    with naming(_brick_text(source, probing.partition, number), "read"):
        return {number: probing.sums(source, number, places)}


def merge_values(_: Any, *parts: dict[int, Any]) -> dict[int, Any]:
    """Return the sums of several bricks."""
    return {number: found for part in parts for number, found in part.items()}


def merge_brick_surveys(_: Any, *parts: BrickSurvey) -> BrickSurvey:
    """Return what is known of several bricks."""
    return merge_surveys(parts)


def merge_piece_surveys(shared: tuple[int, str], *parts: KernelSurvey) -> KernelSurvey:
    """Return what is known of several pieces."""
    return merge_kernel_surveys(parts, shared[1])


def merge_segments(_: Any, *parts: Segments) -> Segments:
    """Return where the kernels of several pieces were written."""
    return Segments.joined(parts)


def nothing(*_: Any) -> None:
    """Wait for all that is given."""


def same(value: Any) -> Any:
    """Return a value."""
    return value

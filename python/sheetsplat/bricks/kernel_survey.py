"""What looks and bricks need to know of all scattered kernels, found piece by piece: a sample, and ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.kernel_source import Columns, Segments, Store, sort_piece
from sheetsplat.bricks.partition import Partition
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField, joined_bounds

Floats = NDArray[np.float64]

# Kernels in the sample, at most: all look statistics count no more than some millions of positions.
_SAMPLE = 500_000


@dataclass(frozen=True, eq=False)
class KernelSurvey:
    """What is known of the kernels of some pieces.

    Attributes
    ----------
    template
        A field without kernels that has their options.
    columns
        Of their tables.
    count
        Of kernels.
    centres, supports
        Boxes around centres, and around supports.
    value_range, longest
        Smallest and largest value, largest semi-axis.
    sample
        Table of every n-th kernel.
    ends
        Table of kernels with the outermost centres.
    """

    template: EllipsoidField
    columns: Columns
    count: int
    centres: Bounds
    supports: Bounds
    value_range: tuple[float, float]
    longest: float
    sample: Floats
    ends: Floats


def stride_of(count: int) -> int:
    """Return of how many kernels one is in the sample."""
    return max(1, -(-count // _SAMPLE))


def survey_piece(field: EllipsoidField, first: int, stride: int) -> KernelSurvey:
    """Return what is known of the kernels of a piece; `first`: the number of its first row among all."""
    columns = Columns.of(field)
    table = columns.table(field)
    centers = table[:, :3]
    ends = np.unique(np.concatenate((centers.argmin(axis=0), centers.argmax(axis=0))))
    empty = field.with_rows(*columns.arrays(table[:0]), value_range=(0.0, 0.0))
    return KernelSurvey(
        empty,
        columns,
        field.size,
        field.centre_bounds,
        field.bounds,
        field.value_range,
        float(field.scales.max()),
        table[-first % stride :: stride],
        table[ends],
    )


def merge_kernel_surveys(parts: Sequence[KernelSurvey], name: str) -> KernelSurvey:
    """Return what is known of the kernels of several surveys, which are in the order of the pieces.

    Raises
    ------
    InvalidInput
        For pieces with other columns, or other options.
    """
    first = parts[0]
    for one in parts[1:]:
        if one.columns != first.columns or one.template != first.template:
            raise complain(
                f"{name} cannot be opened in bricks",
                f"pieces of different kinds: {_told(first)}, and {_told(one)}",
                "the same kinds of kernels everywhere",
            )
    ends = np.concatenate([one.ends for one in parts])
    centers = ends[:, :3]
    outermost = np.unique(np.concatenate((centers.argmin(axis=0), centers.argmax(axis=0))))
    lows, highs = zip(*(one.value_range for one in parts), strict=True)
    return replace(
        first,
        count=sum(one.count for one in parts),
        centres=joined_bounds([one.centres for one in parts]),
        supports=joined_bounds([one.supports for one in parts]),
        value_range=(min(lows), max(highs)),
        longest=max(one.longest for one in parts),
        sample=np.concatenate([one.sample for one in parts]),
        ends=ends[outermost],
    )


def _told(one: KernelSurvey) -> str:
    kinds = "spheres" if one.columns.axes == 1 else "ellipsoids"
    weights = "with weights" if one.columns.weighted else "without weights"
    return f"{kinds} {weights}, falloff {one.template.falloff:g}, normalization {one.template.normalization}"


def sample_of(found: KernelSurvey, stride: int) -> EllipsoidField:
    """Return the field of the sample: with a stride those with the outermost centres too, by which slices are set."""
    table = found.sample if stride == 1 else np.concatenate((found.sample, found.ends))
    return found.template.with_rows(*found.columns.arrays(table), value_range=found.value_range)


def survey_of(pieces: Pieces, number: int, stride: int) -> KernelSurvey:
    """Return what is known of one piece."""
    first = sum(pieces.counts[:number])
    field = pieces.read(number)
    if field.size != pieces.counts[number]:
        found, wanted = f"{field.size} rows in piece {number}", f"{pieces.counts[number]}, as when it was opened"
        raise complain(f"{pieces.name} cannot be read", found, wanted)
    return survey_piece(field, first, stride)


def sorted_piece(
    pieces: Pieces, number: int, columns: Columns, partition: Partition, rows: int, store: Store
) -> Segments:
    """Read a piece, and return the segments of what `sort_piece` keeps of it."""
    return sort_piece(columns.table(pieces.read(number)), number, columns, partition, rows, store)


__all__ = ["KernelSurvey", "merge_kernel_surveys", "sample_of", "sorted_piece", "stride_of", "survey_of"]

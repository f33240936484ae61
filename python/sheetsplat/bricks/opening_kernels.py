"""`open_bricks` of scattered data: kernels are sorted into bricks once, and read from there when a picture asks.

Of all kernels it is first found, piece by piece, what looks and bricks need to know of them: a sample, and ranges.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sheetsplat._checks import Bounds
from sheetsplat._waiting import part
from sheetsplat.bricks.cluster import each
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.kernel_source import KernelSource, Table, field_of_table, joined_segments, sort_piece, table_of
from sheetsplat.bricks.partition import Partition, partition_points
from sheetsplat.bricks.readers import refused
from sheetsplat.bricks.store import FileStore, MemoryStore, Store
from sheetsplat.errors import complain
from sheetsplat.fields import BrickedKernels, EllipsoidField, KernelFacts, joined_bounds
from sheetsplat.io.kernels import log_base
from sheetsplat.notices import warn

# Rows of a segment: fewer where there are few kernels, so that neighbours do not read whole bricks.
_LEAST_ROWS, _MOST_ROWS = 256, 1 << 16
_SEGMENTS = 1 << 18
# Kernels in the sample, at most: all look statistics count no more than some millions of positions.
_SAMPLE = 500_000


@dataclass(frozen=True, eq=False)
class KernelSurvey:
    """What is known of the kernels of some pieces.

    Attributes
    ----------
    template
        A field without kernels that has their options.
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
    count: int
    centres: Bounds
    supports: Bounds
    value_range: tuple[float, float]
    longest: float
    sample: Table
    ends: Table


def survey_of(shared: tuple[int, str], pieces: Pieces, number: int) -> KernelSurvey:
    """Return what is known of one piece; `shared`: the stride, and the name of all pieces."""
    field, (stride, _) = pieces.read(number), shared
    if field.size != pieces.counts[number] and not (pieces.skips and field.size < pieces.counts[number]):
        found, wanted = f"{field.size} rows in piece {number}", f"{pieces.counts[number]}, as when it was opened"
        raise complain(f"{pieces.name} cannot be read", found, wanted)
    table = table_of(field)
    return KernelSurvey(
        field_of_table(table[:0], field, (0.0, 0.0)),
        field.size,
        field.centre_bounds,
        field.bounds,
        field.value_range,
        float(field.scales.max()),
        table[-sum(pieces.counts[:number]) % stride :: stride],
        _outermost(table),
    )


def _outermost(table: Table) -> Table:
    """Return the kernels of a table with the outermost centres."""
    centers = table["center"]
    found: Table = table[np.unique(np.concatenate((centers.argmin(axis=0), centers.argmax(axis=0))))]
    return found


def merge_kernel_surveys(shared: tuple[int, str], *parts: KernelSurvey) -> KernelSurvey:
    """Return what is known of the kernels of several surveys, which are in the order of the pieces.

    Raises
    ------
    InvalidInput
        For pieces with other columns, or other options.
    """
    first = parts[0]
    for one in parts[1:]:
        if one.sample.dtype != first.sample.dtype or one.template != first.template:
            raise refused(
                shared[1],
                f"pieces that are not alike: {_told(first)}, and {_told(one)}",
                "the same kinds of kernels everywhere",
            )
    lows, highs = zip(*(one.value_range for one in parts), strict=True)
    return replace(
        first,
        count=sum(one.count for one in parts),
        centres=joined_bounds([one.centres for one in parts]),
        supports=joined_bounds([one.supports for one in parts]),
        value_range=(min(lows), max(highs)),
        longest=max(one.longest for one in parts),
        sample=np.concatenate([one.sample for one in parts]),
        ends=_outermost(np.concatenate([one.ends for one in parts])),
    )


def _told(one: KernelSurvey) -> str:
    kinds = "spheres" if one.sample["axes"].shape[1] == 1 else "ellipsoids"
    weights = "with weights" if "weight" in (one.sample.dtype.names or ()) else "without weights"
    return f"{kinds} {weights}, falloff {one.template.falloff:g}, normalization {one.template.normalization}"


def sample_of(found: KernelSurvey, stride: int) -> EllipsoidField:
    """Return the field of the sample: with a stride those with the outermost centres too, by which slices are set."""
    table = found.sample if stride == 1 else np.concatenate((found.sample, found.ends))
    return field_of_table(table, found.template, found.value_range)


def open_kernels(
    pieces: Pieces, most: int, scratch: str | None, client: Any, given: Mapping[str, Any]
) -> BrickedKernels:
    """Return the field of pieces.

    Each piece is read twice: for what is known of all kernels, and to sort them.

    Parameters
    ----------
    pieces
        The kernels.
    most
        Kernels of a brick, about.
    scratch
        A folder for sorted kernels, which all workers see; None: the one for temporary files. Kernels in memory stay
        there.
    client
        Its workers read and sort; None: this process.
    given
        Options of `open_bricks`: log.

    Raises
    ------
    InvalidInput
        For pieces of different kinds, and what reading them raises.
    Error
        Where sorted kernels cannot be kept.
    """
    if pieces.in_memory:
        # They are here already, and are sent to workers once.
        client = None
    rows = sum(pieces.counts)
    # Of so many kernels one is in the sample.
    stride = max(1, -(-rows // _SAMPLE))
    with part(0.0, 0.5):
        task, merge = ("survey-kernels", survey_of), ("merge-surveys", merge_kernel_surveys)
        found: KernelSurvey = each(client, pieces, (stride, pieces.name), len(pieces.counts), task, merge)
    if found.count < rows:
        warn(f"{rows - found.count} of {rows} rows of {pieces.name} are left out, because numbers are not finite")
    sample = sample_of(found, stride)
    partition = partition_points(found.sample["center"], math.ceil(found.count / most))
    with part(0.5, 1.0):
        segments, store = _sorted(pieces, found, partition, scratch, client)
    facts = KernelFacts(
        found.count,
        stride,
        found.centres,
        found.supports,
        found.value_range,
        sample.default_slice_spacing,
    )
    # The same kernels cut in another way have other bricks, and with other options other fields.
    one = found.template
    told = (pieces.token, most, one.normalization, one.falloff, one.w0, one.cell_volume, one.base, one.periodic)
    token = hashlib.blake2b(repr(told).encode(), digest_size=12).hexdigest()
    source = KernelSource(
        pieces.name, token, found.template.without_end(), found.sample.dtype, store, segments, partition, found.longest
    )
    field = BrickedKernels.of(sample, source, facts)
    if "log" not in given:
        return field
    # Without a floor all values must be above 0.
    floor = log_base(np.asarray([found.value_range[0]]), pieces.name, given["log"])
    return field.logarithmic(floor).with_quantity(floor=floor)


def _sorted(
    pieces: Pieces, found: KernelSurvey, partition: Partition, scratch: str | None, client: Any
) -> tuple[Table, Store]:
    rows = min(max(found.count // _SEGMENTS, _LEAST_ROWS), _MOST_ROWS)
    store: Store = MemoryStore()
    if not pieces.in_memory:
        store = FileStore.new(scratch, "sorted kernels", "all kernels")
    shared = (partition, rows, store)
    task, merge = ("sort-kernels", sort_piece), ("merge-segments", joined_segments)
    return each(client, pieces, shared, len(pieces.counts), task, merge, doing="sorted"), store

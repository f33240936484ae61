"""`open_bricks` of scattered data: kernels are sorted into bricks once, and read from there when a picture asks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sheetsplat._waiting import part
from sheetsplat.bricks.cluster import each
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.kernel_source import KernelSource, Segments
from sheetsplat.bricks.kernel_survey import (
    KernelSurvey,
    merge_kernel_surveys,
    sample_of,
    sorted_piece,
    stride_of,
    survey_of,
)
from sheetsplat.bricks.partition import Partition, partition_points
from sheetsplat.bricks.store import FileStore, MemoryStore, Store
from sheetsplat.fields import BrickedKernels, KernelFacts
from sheetsplat.io.kernels import log_base

# Rows of a segment: fewer where there are few kernels, so that neighbours do not read whole bricks.
_LEAST_ROWS, _MOST_ROWS = 256, 1 << 16
_SEGMENTS = 1 << 18


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
        For pieces that are not alike, and what reading them raises.
    Error
        Where sorted kernels cannot be kept.
    """
    if pieces.in_memory:
        # They are here already, and are sent to workers once.
        client = None
    stride = stride_of(sum(pieces.counts))
    with part(0.0, 0.5):
        task, merge = ("survey-kernels", survey_of), ("merge-surveys", merge_kernel_surveys)
        found: KernelSurvey = each(client, pieces, (stride, pieces.name), len(pieces.counts), task, merge)
    sample = sample_of(found, stride)
    partition = partition_points(found.sample[:, :3], math.ceil(found.count / most))
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
    told = (pieces.token, most, one.normalization, one.falloff, one.w0, one.cell_volume, one.base)
    token = hashlib.blake2b(repr(told).encode(), digest_size=12).hexdigest()
    source = KernelSource(pieces.name, token, found.template, found.columns, store, segments, partition, found.longest)
    field = BrickedKernels.of(sample, source, facts)
    if "log" not in given:
        return field
    # Without a floor all values must be above 0.
    floor = log_base(np.asarray([found.value_range[0]]), pieces.name, given["log"])
    return field.logarithmic(floor).with_quantity(floor=floor)


def _sorted(
    pieces: Pieces, found: KernelSurvey, partition: Partition, scratch: str | None, client: Any
) -> tuple[Segments, Store]:
    rows = min(max(found.count // _SEGMENTS, _LEAST_ROWS), _MOST_ROWS)
    store: Store = MemoryStore()
    if not pieces.in_memory:
        store = FileStore.new(scratch, "sorted kernels", "all kernels")
    shared = (found.columns, partition, rows, store)
    task, merge = ("sort-kernels", sorted_piece), ("merge-segments", Segments.joined)
    return each(client, pieces, shared, len(pieces.counts), task, merge, doing="sorted"), store

"""`open_bricks` of scattered data: kernels are sorted into bricks once, and read from there when a picture asks."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sheetsplat._waiting import counted, part
from sheetsplat.bricks.kernel_pieces import FieldPieces, Pieces
from sheetsplat.bricks.kernel_source import FileStore, KernelSource, MemoryStore, Segments, Store
from sheetsplat.bricks.kernel_survey import (
    KernelSurvey,
    merge_kernel_surveys,
    sample_of,
    sorted_piece,
    stride_of,
    survey_of,
)
from sheetsplat.bricks.partition import Partition, partition_points
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
        For pieces of different kinds, and what reading them raises.
    Error
        Where sorted kernels cannot be kept.
    """
    if isinstance(pieces, FieldPieces):
        # They are here already, and are sent to workers once.
        client = None
    stride = stride_of(sum(pieces.counts))
    with part(0.0, 0.5):
        if client is None:
            counts = len(pieces.counts)
            found = merge_kernel_surveys([survey_of(pieces, n, stride) for n in counted(counts)], pieces.name)
        else:
            from sheetsplat.bricks.cluster import survey_kernels

            found = survey_kernels(client, pieces, stride)
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
    store: Store = MemoryStore() if isinstance(pieces, FieldPieces) else FileStore.new(scratch)
    if client is None:
        every = counted(len(pieces.counts))
        parts = [sorted_piece(pieces, number, found.columns, partition, rows, store) for number in every]
        return Segments.joined(parts), store
    from sheetsplat.bricks.cluster import sort_kernels

    return sort_kernels(client, pieces, found.columns, partition, rows, store), store

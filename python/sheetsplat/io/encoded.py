"""Encoded fields, .ssk, which `sheetsplat.fit.encode` makes; the format: docs/encoding.md."""

from __future__ import annotations

from sheetsplat import _memory
from sheetsplat.errors import complain
from sheetsplat.io.records import Scattered
from sheetsplat.io.source import Source

# Bytes of a file that are kept in memory.
_MOST = 1 << 31


def read(source: Source) -> Scattered:
    """Return the kernels of an encoded field, and the field itself."""
    from sheetsplat.encode.encoding import decoded

    _memory.require(source.path.stat().st_size, f"the bytes of {source.path}")
    source.stream.seek(0)
    data = source.stream.read(_MOST + 1)
    if len(data) > _MOST:
        raise complain(
            f"{source.path} cannot be read", "more than 2 GB", "an encoded field", "encode a part of the data"
        )
    field = decoded(data, str(source.path))
    return Scattered(
        points=field.centers,
        values=field.values,
        scalar=field.name or "scalar",
        format="ssk",
        scales=field.scales,
        rotations=field.rotations,
        weights=field.weights,
        normalization=field.normalization,
        w0=field.w0,
        falloff=field.falloff,
        base=field.base,
        unit=field.quantity.unit,
        length_unit=field.quantity.length_unit,
        made=field,
    )

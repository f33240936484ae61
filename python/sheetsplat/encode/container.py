"""Files of encoded fields, .ssk: chunks, each with a length and a checksum.

All numbers are little-endian. A file begins with the bytes "SSK" and 1, the version. Chunks follow: a letter, the
length of what it holds (4 bytes), the lowest 16 bits of the CRC-32 of the letter and of that, and that itself.

- "G": sparse lattices (`lattice_chunks`), the first chunk.
- "L": one or several levels of them, from the coarsest on: as many chunks as "G" says. Each is a coarser field together
  with those before it, and states its own bound.
- "E": scattered kernels (`kernel_chunks`), in place of the two.
- "N": names and units, JSON.

A file that ends early holds the chunks that are whole: a coarser field.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

from sheetsplat.errors import complain

MAGIC = b"SSK\x01"
_HEAD = struct.Struct("<cIH")
_KINDS = (b"G", b"L", b"E", b"N")


class Chunk(NamedTuple):
    """A letter, and what it holds."""

    kind: bytes
    data: bytes


def _check(kind: bytes, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(kind)) & 0xFFFF


def written(chunks: list[Chunk]) -> bytes:
    """Return the bytes of a file of chunks."""
    heads = (_HEAD.pack(one.kind, len(one.data), _check(*one)) + one.data for one in chunks)
    return MAGIC + b"".join(heads)


def chunks_in(data: bytes, what: str) -> tuple[list[Chunk], bool]:
    """Return the chunks of a file, and whether it is whole; `what` names it in messages.

    Raises
    ------
    InvalidInput
        For other bytes than those of `written`, or the first of them.
    """
    if not data.startswith(MAGIC):
        raise damaged(what, f"the bytes {data[:4]!r}", f"an encoded field of version 1, which begins with {MAGIC!r}")
    found: list[Chunk] = []
    at = len(MAGIC)
    while at < len(data):
        if len(data) - at < _HEAD.size:
            return found, False
        kind, length, check = _HEAD.unpack_from(data, at)
        if kind not in _KINDS:
            raise damaged(what, f"a chunk {kind!r} at byte {at}", "G, L, E or N")
        at += _HEAD.size
        if len(data) - at < length:
            return found, False
        inside = data[at : at + length]
        if _check(kind, inside) != check:
            raise damaged(what, f"a chunk {kind.decode()} whose checksum is another", "what was written")
        found.append(Chunk(kind, inside))
        at += length
    return found, True


def damaged(what: str, found: str, wanted: str) -> Exception:
    """Return the error for bytes that are no encoded field."""
    return complain(f"{what} cannot be read", found, wanted, "encode the data again, or copy the file again")

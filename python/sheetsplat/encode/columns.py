"""Columns of whole numbers as bytes: the high bits of all columns through LZMA, their low bits as they are.

A block of columns of `count` numbers each is, with little-endian fields and varints (seven bits a byte, the lowest
first, the high bit of every byte but the last set):

1. for each column: a byte, the number k of low bits (0 to 56), plus 128 where differences to the number before are
   coded (of the first number: to 0); a byte, the number P of planes, 8 (P − 1) + k at most 63; a varint, the least
   number n of the column or of its differences (−2 n − 1 where it is negative, else 2 n);
2. a varint, the length of the stream, and the stream: raw LZMA2 with lc = lp = pb = 0 and a dictionary of 1 MiB.
   It holds for each column its planes, the lowest first: `count` bytes, bits k to k + 7 of the numbers less the least;
3. for each column, for each number its k low bits, the lowest first, all bits one after another, eight a byte from the
   lowest, the last byte filled with zeros.

The high bits of a column have few values, whose shares the coder learns; below them bits are noise, which no coder
makes smaller and which costs the learning. k is where the sum is least.
"""

from __future__ import annotations

import lzma
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Error, complain

Whole = NDArray[np.int64]

_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 0, "lp": 0, "pb": 0, "dict_size": 1 << 20}]
_DELTA = 128
_MOST_LOW = 56
# What a coder spends until it knows how often one value of a byte comes.
_BITS_OF_VALUE = 10.0
# So many k are tried, below the bits of the middle half of a column.
_TRIED = 8


def damaged(found: str, wanted: str) -> Error:
    """Return the error of bytes that no writer makes."""
    return complain("packed ellipsoids cannot be read", found, wanted, "use the bytes as they were written")


class Bytes:
    """Bytes that are read from the front, with every size checked against what is left."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = memoryview(data), 0

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return len(self._data) - self._at

    def take(self, size: int) -> memoryview:
        """Return the next bytes; InvalidInput where there are fewer."""
        if size > self.left:
            raise damaged(f"{self.left} bytes", f"{size} more")
        self._at += size
        return self._data[self._at - size : self._at]

    def varint(self) -> int:
        """Return a whole number below 2**64."""
        value = shift = 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 127) << shift
            if value >> 64:
                raise damaged("a number of more than 64 bits", "at most 64")
            if byte < 128:
                return value
            shift += 7
            if shift > 63:
                raise damaged("a number of more than ten bytes", "at most ten")


def varint(value: int) -> bytes:
    """Return a whole number, at least 0, in groups of seven bits."""
    groups = bytearray()
    while value > 127:
        groups.append(value & 127 | 128)
        value >>= 7
    return bytes((*groups, value))


@dataclass(frozen=True)
class _Split:
    """A column less its least number, and where its high bits begin."""

    rest: NDArray[np.uint64]
    least: int
    low: int
    delta: bool
    bits: float

    def planes(self) -> list[NDArray[np.uint8]]:
        high = self.rest >> np.uint64(self.low)
        count = -(-int(high.max(initial=0)).bit_length() // 8)
        return [(high >> np.uint64(8 * plane)).astype(np.uint8) for plane in range(count)]


def _entropy(plane: NDArray[np.uint8]) -> float:
    """Return the bits of a plane, with those of learning its values."""
    counts = np.bincount(plane, minlength=256)
    counts = counts[counts > 0]
    return float(-(counts * np.log2(counts / len(plane))).sum() + _BITS_OF_VALUE * (len(counts) - 1))


def _split(column: Whole) -> _Split:
    """Return the best split of a column."""
    found = []
    for delta in (False, True):
        numbers = np.diff(column, prepend=0) if delta else column
        least = int(numbers.min()) if len(numbers) else 0
        rest = (numbers - least).astype(np.uint64)
        lower, upper = np.percentile(rest, (25, 75)) if len(rest) else (0.0, 0.0)
        most = min(int(upper - lower).bit_length() + 1, _MOST_LOW)
        for low in range(max(0, most - _TRIED), most + 1):
            split = _Split(rest, least, low, delta, 0.0)
            bits = low * len(rest) + sum(map(_entropy, split.planes()))
            found.append(_Split(rest, least, low, delta, bits))
    return min(found, key=lambda split: split.bits)


def bits_of(column: Whole) -> float:
    """Return about how many bits a column takes."""
    return _split(column).bits


def write_columns(columns: Sequence[Whole]) -> bytes:
    """Return columns of equally many numbers as a block; numbers and differences are below 2**63 in magnitude."""
    head, high, low = bytearray(), bytearray(), []
    for column in columns:
        split = _split(column)
        planes = split.planes()
        least = -2 * split.least - 1 if split.least < 0 else 2 * split.least
        head += bytes((split.low | _DELTA * split.delta, len(planes))) + varint(least)
        high += b"".join(plane.tobytes() for plane in planes)
        shifts = np.arange(split.low, dtype=np.uint64)
        low.append(((split.rest[:, None] >> shifts) & np.uint64(1)).astype(np.uint8).reshape(-1))
    stream = lzma.compress(bytes(high), format=lzma.FORMAT_RAW, filters=_FILTERS) if high else b""
    rest = np.packbits(np.concatenate(low), bitorder="little").tobytes() if low else b""
    return bytes(head) + varint(len(stream)) + stream + rest


def _expanded(stream: bytes, size: int) -> NDArray[np.uint8]:
    """Return `size` bytes of a stream; InvalidInput where it holds more, fewer, or none."""
    if not size and not stream:
        return np.empty(0, np.uint8)
    coder = lzma.LZMADecompressor(format=lzma.FORMAT_RAW, filters=_FILTERS)
    try:
        # (One byte more, so that a stream which goes on is found out.)
        found = coder.decompress(stream, max_length=size + 1)
    except lzma.LZMAError:
        raise damaged("a damaged stream", "LZMA2") from None
    if len(found) != size or not coder.eof or coder.unused_data:
        raise damaged("a stream of another length", f"one of {size} bytes")
    return np.frombuffer(found, np.uint8)


def read_columns(data: Bytes, count: int, columns: int) -> list[Whole]:
    """Return the columns of a block. The caller has made sure that memory for them is there.

    Raises
    ------
    InvalidInput
        For everything that `write_columns` does not write.
    """
    heads = []
    for _ in range(columns):
        low, planes = data.take(2)
        least = data.varint()
        low, delta = low & ~_DELTA, bool(low & _DELTA)
        if low > _MOST_LOW or 8 * (planes - 1) + low > 63:
            raise damaged(f"{low} low bits and {planes} planes", "numbers of at most 64 bits")
        heads.append((low, delta, planes, -(least + 1) // 2 if least & 1 else least // 2))
    stream = bytes(data.take(data.varint()))
    rest = np.frombuffer(data.take(-(-count * sum(low for low, *_ in heads) // 8)), np.uint8)
    high = _expanded(stream, count * sum(planes for _, _, planes, _ in heads))
    plane = bit = 0
    found = []
    for low, delta, planes, least in heads:
        numbers = np.zeros(count, np.uint64)
        for place in range(planes):
            numbers |= high[plane : plane + count].astype(np.uint64) << np.uint64(8 * place + low)
            plane += count
        if low:
            # (Bits of a column may begin within a byte.)
            first, end = bit // 8, -(-(bit + count * low) // 8)
            bits = np.unpackbits(rest[first:end], bitorder="little")[bit - 8 * first :][: count * low]
            for place in range(low):
                numbers |= bits[place::low].astype(np.uint64) << np.uint64(place)
            bit += count * low
        column = numbers.view(np.int64) + np.int64(least)
        # Sums of damaged differences wrap, and are refused by what they stand for.
        found.append(np.cumsum(column) if delta else column)
    return found

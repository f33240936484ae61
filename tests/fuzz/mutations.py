"""Ways to spoil a file: bits, numbers, lengths, blocks, other files' heads, and what is packed inside it."""

from __future__ import annotations

import base64
import bz2
import contextlib
import gzip
import io
import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from random import Random

#: Most mutations of one file.
_MOST = 4
#: How many mutations files have, by turns: one that goes deep is alone.
_TIMES = (1, 1, 1, 2, 2, 3, 4)
#: Most bytes of what mutations make.
_LONGEST = 1 << 20
#: Bytes in which the first mutations happen: headers are there.
_ENDS = (16, 64, 300, 1000, 1 << 40)

_NUMBERS = [
    *(b"0", b"-1", b"1", b"3", b"1.5", b"", b"nan", b"-nan", b"inf", b"-inf", b"1e400", b"-1e-400", b"0x10", b"1e9"),
    *(b"255", b"65536", b"2147483647", b"2147483648", b"4294967295", b"4294967297", b"1000000000", b"-2147483649"),
    *(b"9223372036854775807", b"18446744073709551615", b"99999999999999999999999", b"7" * 5000, b"1_0", b"\xd9\xa3"),
]
_BINARY = [
    struct.pack(order + kind, value)
    for order in "<>"
    for kind, value in [
        *[("b", -1), ("h", -1), ("h", 0x7FFF), ("i", -1), ("i", 0), ("i", 1), ("i", 2**31 - 1), ("i", 10**9)],
        *[("q", 0), ("q", -1), ("q", 2**40), ("q", 2**62), ("q", 2**63 - 1), ("I", 2**32 - 1)],
        *[("d", float("nan")), ("d", 1e308), ("d", -1e308), ("d", 5e-324), ("f", float("nan")), ("f", 1e38)],
        *[("f", float("inf")), ("f", -1.0), ("d", 0.0)],
    ]
]
_DIGITS = re.compile(rb"-?[0-9][0-9.e+-]*")
_WORDS = re.compile(rb"[A-Za-z_][A-Za-z_0-9:.-]{1,40}")
_STRANGE = [
    *(b"float64", b"<i8", b">f2", b"object", b"uint8", b"complex128", b"<U9999", b"utf-7", b"zlib", b"gzip", b"raw"),
    *(b"ascii", b"null", b"true", b"{}", b"[]", b"LOCAL", b"LIST", b"../../etc/passwd", b"/dev/zero", b"\0", b"%s%n"),
]
_PACKED = re.compile(rb"\x1f\x8b|BZh|\xfd7zXZ\0|\x78[\x01\x5e\x9c\xda]")
_BASE64 = re.compile(rb"[A-Za-z0-9+/]{16,}={0,2}")


def _bit(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _byte(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return data[:at] + rng.randbytes(1) + data[at + 1 :]


def _replaced(rng: Random, data: bytes, pattern: re.Pattern[bytes], by: Sequence[bytes]) -> bytes:
    found = list(pattern.finditer(data[:20_000]))
    if not found:
        return data
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(by) + data[one.end() :]


def _number(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return _replaced(rng, data, _DIGITS, _NUMBERS)


def _word(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Put another word of the file, or a strange one, where a word is."""
    own = _WORDS.findall(data[:20_000])
    return _replaced(rng, data, _WORDS, rng.choice([own, _STRANGE]) if own else _STRANGE)


def _binary(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    whole = rng.choice(_BINARY)
    at -= at % rng.choice([1, 2, 4, 8])
    return data[:at] + whole + data[at + len(whole) :]


def _cut(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return data[:at]


def _insert(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return data[:at] + rng.randbytes(rng.randint(1, 24)) + data[at:]


def _drop(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    return data[:at] + data[at + rng.randint(1, 40) :]


def _block(rng: Random, data: bytes, at: int) -> tuple[int, int]:
    """Return where a block begins and ends."""
    return at, min(len(data), at + rng.choice([1, 4, 8, 16, 64, 512, len(data)]))


def _again(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Repeat a block, once or many times."""
    start, end = _block(rng, data, at)
    times = min(rng.choice([1, 1, 2, 30, 3000]), _LONGEST // max(1, end - start))
    return data[:end] + data[start:end] * times + data[end:]


def _swapped(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Exchange two blocks."""
    first, end = _block(rng, data, at)
    other, last = _block(rng, data, rng.randrange(len(data)))
    if other < first:
        first, end, other, last = other, last, first, end
    end = min(end, other)
    return data[:first] + data[other:last] + data[end:other] + data[first:end] + data[last:]


def _blank(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    start, end = _block(rng, data, at)
    return data[:start] + rng.choice([b"\0", b"\xff", b" ", b"\n", b"9"]) * (end - start) + data[end:]


def _lines(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Leave out, repeat or exchange lines."""
    lines = data.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(3):
        case 0:
            del lines[one]
        case 1:
            lines.insert(other, lines[one])
        case _:
            lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def _foreign(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Put the head of another file before this one's body, or the other way round, or a block of it somewhere."""
    if not donors:
        return data
    other = rng.choice(donors)
    size = rng.choice([4, 8, 16, 64, 348, 1000])
    match rng.randrange(4):
        case 0:
            return other[:size] + data[size:]
        case 1:
            return data[:size] + other[size:]
        case 2:
            return other[:size] + data
        case _:
            start = rng.randrange(max(1, len(other)))
            return data[:at] + other[start : start + size] + data[at + size :]


# What is packed


def _unpacked(data: bytes, at: int) -> tuple[bytes, int, Callable[[bytes], bytes]] | None:
    """Return what is packed in a stream that begins there, where it ends, and what packs it again."""
    start = data[at : at + 6]
    pack: Callable[[bytes], bytes]
    unpack: zlib._Decompress | bz2.BZ2Decompressor | lzma.LZMADecompressor
    if start[:2] == b"\x1f\x8b":
        unpack, pack = zlib.decompressobj(31), gzip.compress
    elif start[:3] == b"BZh":
        unpack, pack = bz2.BZ2Decompressor(), bz2.compress
    elif start == b"\xfd7zXZ\0":
        unpack, pack = lzma.LZMADecompressor(), lzma.compress
    else:
        unpack, pack = zlib.decompressobj(), zlib.compress
    with contextlib.suppress(zlib.error, OSError, EOFError, lzma.LZMAError, ValueError):
        content = unpack.decompress(data[at:], _LONGEST)
        if unpack.eof and content:
            return content, len(data) - len(unpack.unused_data), pack
    return None


def _in_archive(rng: Random, data: bytes, donors: Sequence[bytes]) -> bytes:
    """Spoil a member of a ZIP archive, whose checksums are right then."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {one: archive.read(one) for one in archive.infolist()}
    chosen = rng.choice(list(members))
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for one, content in members.items():
            archive.writestr(one, mutated(rng, content, donors, 1) if one is chosen else content)
    return made.getvalue()


def _inside(rng: Random, data: bytes, at: int, donors: Sequence[bytes]) -> bytes:
    """Spoil what is packed, or written as text, in the file; its checksum is right then, its length may not be."""
    if data[:4] == b"PK\x03\x04":
        with contextlib.suppress(Exception):
            return _in_archive(rng, data, donors)
    streams = [one.start() for one in _PACKED.finditer(data) if _unpacked(data, one.start()) is not None]
    texts = [one for one in _BASE64.finditer(data[:50_000]) if len(one[0]) % 4 == 0]
    if streams and (not texts or rng.random() < 0.5):
        start = rng.choice(streams)
        content, end, pack = _unpacked(data, start) or (b"", start, bytes)
        packed = pack(mutated(rng, content, donors, 1))
        # Where lengths stand elsewhere the stream must keep its own.
        if rng.random() < 0.5:
            packed = packed[: end - start].ljust(end - start, b"\0")
        return data[:start] + packed + data[end:]
    if texts:
        one = rng.choice(texts)
        content = mutated(rng, base64.b64decode(one[0]), donors, 1)
        return data[: one.start()] + base64.b64encode(content) + data[one.end() :]
    return _bit(rng, data, at, donors)


_Way = Callable[[Random, bytes, int, Sequence[bytes]], bytes]
#: Each way with its share.
_WAYS: dict[_Way, int] = {
    _bit: 3,
    _byte: 2,
    _number: 6,
    _word: 3,
    _binary: 5,
    _cut: 1,
    _insert: 2,
    _drop: 2,
    _again: 2,
    _swapped: 2,
    _blank: 1,
    _lines: 2,
    _foreign: 2,
    _inside: 4,
}


def mutated(rng: Random, data: bytes, donors: Sequence[bytes] = (), most: int = _MOST) -> bytes:
    """Return the bytes of a file after up to that many mutations, most of them near its beginning.

    Parameters
    ----------
    rng
        The same state of it makes the same bytes.
    data
        Of the file.
    donors
        Other files, whose heads and blocks may be put into it.
    most
        Mutations.
    """
    for _ in range(min(most, rng.choice(_TIMES))):
        if not data:
            break
        at = rng.randrange(min(len(data), rng.choice(_ENDS)))
        way = rng.choices(list(_WAYS), list(_WAYS.values()))[0]
        data = way(rng, data, at, donors)[:_LONGEST]
    return data

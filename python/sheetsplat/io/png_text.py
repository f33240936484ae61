"""The text in a PNG that says how it was made.

Read here and not by Pillow, so that nothing is decompressed and no chunk is read before its length is checked.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import IO

from sheetsplat.errors import complain
from sheetsplat.io.source import Source

KEYWORD = "sheetsplat"
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNKS = 100_000
_AT_ONCE = 1 << 20


def is_png(path: Path) -> bool:
    """Return whether a file that can be read begins as a PNG does."""
    if not path.is_file():
        return False
    with Source(path) as source:
        return source.head(len(_SIGNATURE)) == _SIGNATURE


def _is_as_written(stream: IO[bytes], kind: bytes, start: bytes, length: int) -> bool:
    """Return whether the rest of a chunk, which is read, fits its checksum."""
    check, rest = zlib.crc32(kind + start), length - len(start)
    while rest and (piece := stream.read(min(rest, _AT_ONCE))):
        check, rest = zlib.crc32(piece, check), rest - len(piece)
    return stream.read(4) == struct.pack(">I", check) and not rest


def read_text(path: Path, most: int, keyword: str = KEYWORD, *, whole: bool = False) -> str | None:
    """Return the uncompressed text of a keyword, or None without one.

    InvalidInput for files that are no PNG, that are cut off or damaged before or in the text, for more than `most`
    characters, and for more than one text. With `whole` for files that are damaged anywhere, too.
    """
    failed = f"{path} cannot be read as a picture with a description"
    found: str | None = None
    with Source(path) as source:
        stream = source.stream
        if stream.read(len(_SIGNATURE)) != _SIGNATURE:
            raise complain(failed, "another format", "a PNG")
        for _ in range(_MOST_CHUNKS):
            head = stream.read(8)
            if len(head) < 8:
                raise complain(failed, "the end of the file before the end of the picture", "a whole PNG")
            length, kind = struct.unpack(">I4s", head)
            if kind == b"IEND":
                if whole and (not _is_as_written(stream, kind, b"", length) or length or stream.read(1)):
                    raise complain(failed, "a damaged end", "the file as it was written")
                return found
            start = stream.read(min(length, len(keyword) + 1))
            if kind != b"tEXt" or start != keyword.encode() + b"\0":
                if not whole:
                    stream.seek(length - len(start) + 4, 1)
                elif not _is_as_written(stream, kind, start, length):
                    raise complain(failed, "a wrong checksum", "the file as it was written")
                continue
            if found is not None:
                raise complain(failed, f"two texts {keyword!r}", "one")
            if length - len(start) > most:
                raise complain(failed, f"{length - len(start)} bytes of text {keyword!r}", f"at most {most}")
            text, check = stream.read(length - len(start)), stream.read(4)
            if len(text) < length - len(start) or len(check) < 4:
                raise complain(failed, f"the end of the file in the text {keyword!r}", "a whole PNG")
            if struct.unpack(">I", check)[0] != zlib.crc32(kind + start + text):
                raise complain(failed, f"a wrong checksum of the text {keyword!r}", "the text as it was written")
            found = text.decode("latin-1")
    raise complain(failed, f"more than {_MOST_CHUNKS} chunks", "a picture")

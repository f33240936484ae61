"""The text in a PNG that says how it was made.

Read here and not by Pillow, so that nothing is decompressed and no chunk is read before its length is checked.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from sheetsplat.errors import complain
from sheetsplat.io.source import Source

KEYWORD = "sheetsplat"
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNKS = 100_000


def is_png(path: Path) -> bool:
    """Return whether a file that can be read begins as a PNG does."""
    if not path.is_file():
        return False
    with Source(path) as source:
        return source.head(len(_SIGNATURE)) == _SIGNATURE


def read_text(path: Path, most: int, keyword: str = KEYWORD) -> str | None:
    """Return the uncompressed text of a keyword, or None without one.

    InvalidInput for files that are no PNG, that are cut off or damaged before or in the text, for more than `most`
    characters, and for more than one text.
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
                return found
            start = stream.read(min(length, len(keyword) + 1))
            if kind != b"tEXt" or start != keyword.encode() + b"\0":
                stream.seek(length - len(start) + 4, 1)
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

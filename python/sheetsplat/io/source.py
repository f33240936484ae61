"""Byte streams of files, plain or gzipped, with a bound on the number of bytes they can hold."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import os
import re
import stat
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, OutOfMemory, Unsupported, Words, complain, missing_package
from sheetsplat.io.stored import StoredSamples, fetch_of

# Largest compression ratio of deflate (RFC 1951: a match of 258 bytes in two bits), and a margin for short files.
DEFLATE_RATIO = 1032
_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEFLATE_SLACK = 4096
_MOST_FILES = 100_000
_NUMBERS = re.compile("([0-9]{1,18})")
# Bytes that are unpacked at once: Ctrl-C waits for them, some 30 ms where bzip2 packed noise.
_CHUNK = 1 << 19
# What a packed text without a header may unpack to: tables of numbers that differ are packed to a hundredth at best.
_UNPACKED, _REPEATED = 1 << 26, 200
# What packed samples may unpack to, whatever packed them: files within files and bzip2 grow a million times, and a few
# kilobytes would be read for half a minute.
_PACKED_SAMPLES = 1 << 30
#: Most bytes before the samples that are unpacked and thrown away: more than headers of other programs have.
MOST_SKIPPED = 1 << 28


@contextlib.contextmanager
def guarded(path: Path, kind: str = "") -> Iterator[None]:
    """Turn errors of parsers and libraries into InvalidInput, and MemoryError into OutOfMemory; all readers use this.

    Messages have the file and its `kind` ("a picture"). Errors of this package are not changed.
    """
    try:
        yield
    except Error:
        raise
    except MemoryError as error:
        raise complain(
            f"there is not enough memory to read {path}",
            "contents that are too large, or a damaged header",
            "contents that fit",
            kind=OutOfMemory,
        ) from error
    except ImportError as error:
        raise missing_package(f"{path} cannot be read" + (f" as {kind}" if kind else ""), error) from error
    except Exception as error:
        reason = str(error).strip().splitlines()[:1] or [type(error).__name__]
        what = f"{path} cannot be read" + (f" as {kind}" if kind else "")
        raise complain(what, f"damaged or cut-off data ({reason[0]})", "a whole file", "fetch it again") from error


class _ZlibStream(io.RawIOBase):
    """A zlib stream inside another stream, decompressed in pieces."""

    def __init__(self, inner: BinaryIO) -> None:
        self._inner = inner
        self._unpack = zlib.decompressobj()

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with decompressed bytes and return their number."""
        view = memoryview(buffer).cast("B")
        while True:
            packed = self._unpack.unconsumed_tail or self._inner.read(1 << 16)
            out = self._unpack.decompress(packed, len(view))
            if not (out or packed or self._unpack.eof):
                raise EOFError("the packed stream ends early")
            if out or self._unpack.eof:
                view[: len(out)] = out
                return len(out)


def _zlib(stream: BinaryIO) -> BinaryIO:
    return cast(BinaryIO, io.BufferedReader(_ZlibStream(stream)))


def _gzip(stream: BinaryIO) -> BinaryIO:
    return cast(BinaryIO, gzip.GzipFile(mode="rb", fileobj=stream))


def _regular(path: Path) -> BinaryIO:
    """Open a regular file; InvalidInput for folders, pipes and devices, which may block or never end."""
    # Without O_NONBLOCK, opening a pipe waits for a writer.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(path, flags)
    except ValueError as error:
        raise complain("the file cannot be read", f"the name {shown(str(path))} ({error})", "a path") from None
    kind = os.fstat(handle).st_mode
    if stat.S_ISREG(kind):
        return os.fdopen(handle, "rb")
    os.close(handle)
    found = "a folder" if stat.S_ISDIR(kind) else "a pipe, a device or the like"
    raise complain(f"{path} cannot be read", found, "a regular file")


class Source(contextlib.ExitStack):
    """A file read from its beginning, decompressed if it is gzipped. Its context is `guarded`.

    Raises Error where the file cannot be read, and on leaving the context InvalidInput where it is damaged.

    Attributes
    ----------
    path
        The file.
    suffix
        Of its name, in small letters, before .gz.
    packed
        Whether it is gzipped.
    stream
        The decompressed bytes, seekable.
    inner
        Where the caller asks for one part of the file, its name: "/group/density".
    fetch
        Returns so many bytes of the file, as it is stored, from a position on: fetch(position, count).
    """

    def __init__(self, path: Path, inner: str = "") -> None:
        super().__init__()
        self.path, self.inner = path, inner
        self.suffix = (Path(path.stem) if path.suffix.lower() == ".gz" else path).suffix.lower()
        try:
            self._file: BinaryIO = _regular(path)
            self.packed = self._file.read(2) == b"\x1f\x8b"
            self._file.seek(0)
            size = os.fstat(self._file.fileno()).st_size
        except OSError as error:
            if isinstance(error, FileNotFoundError):
                raise complain(f"{path} cannot be read", "no such file", "", "check the path") from None
            raise complain(f"{path} cannot be read", error.strerror or str(error), kind=Error) from None
        self.stream = _gzip(self._file) if self.packed else self._file
        self._size = size
        self._end = size * DEFLATE_RATIO + _DEFLATE_SLACK if self.packed else size
        self.fetch = fetch_of(self._file.fileno(), path)
        self.enter_context(guarded(path))
        self.callback(self._file.close)

    def head(self, count: int) -> bytes:
        """Return the first bytes and go back to the beginning."""
        self.stream.seek(0)
        head = self.stream.read(count)
        self.stream.seek(0)
        return head

    def length(self, limit: int) -> int:
        """Return the number of decompressed bytes, at most `limit`; none are kept."""
        if not self.packed:
            return min(limit, self._end)
        count = 0
        self.stream.seek(0)
        while piece := self.stream.read(min(_CHUNK, limit - count)):
            count += len(piece)
        self.stream.seek(0)
        return count

    def refuse_repetition(self) -> None:
        """Raise InvalidInput where a packed text has grown so much that it says the same over and over.

        For formats whose headers do not promise how much there is.
        """
        if self.packed and self.stream.tell() > max(_UNPACKED, _REPEATED * self._file.tell()):
            found = f"a packed text that is more than {_REPEATED} times as long as the file"
            raise complain(f"{self.path} cannot be read", found, "one that does not repeat itself", "unpack it first")

    def refuse_growth(self, count: int) -> None:
        """Raise InvalidInput where a packed file promises so many bytes of samples that they cannot differ much."""
        if count > max(_PACKED_SAMPLES, DEFLATE_RATIO * self._size):
            found = f"{count} bytes of samples, more than {DEFLATE_RATIO} times as many as the file has"
            raise complain(
                f"{self.path} cannot be read", found, "samples that do not repeat themselves", "unpack them first"
            )

    def at_most(self) -> int:
        """Return an upper bound on the bytes that are left, exact for plain files."""
        return max(0, self._end - self.stream.tell())

    def payload(self, encoding: str) -> Payload:
        """Return the rest of the file as data with the encoding "raw", "gzip", "zlib" or "bzip2"."""
        if encoding == "raw":
            return Payload(self, self.stream, self.at_most(), exact=not self.packed)
        if encoding == "bzip2":
            return Payload(self, cast(BinaryIO, bz2.BZ2File(self.stream)), None)
        bound = self.at_most() * DEFLATE_RATIO + _DEFLATE_SLACK
        return Payload(self, _gzip(self.stream) if encoding == "gzip" else _zlib(self.stream), bound)

    def samples(
        self,
        dtype: np.dtype[Any],
        count: int,
        start: int,
        *,
        encoding: str = "raw",
        skip: int = 0,
        located: bool = False,
    ) -> Any:
        """Return `count` values behind `start` bytes of the file and `skip` bytes of what the encoding unpacks.

        A skip of −1: they are the last of the file. `located`: `StoredSamples`, of which nothing is read.

        Raises what `Payload` does, and InvalidInput for packed values at the end of a file.
        """
        if skip == -1:
            if encoding != "raw" or self.packed:
                wanted = "a number of bytes before them"
                raise complain(f"{self.path} cannot be read", "packed samples at the end of the file", wanted)
            start, skip = max(start, self._size - count * dtype.itemsize), 0
        self.stream.seek(start)
        payload = self.payload(encoding)
        payload.skip(skip)
        return payload.located(dtype, count) if located else payload.array(dtype, count)


def hdf5_start(source: Source) -> int | None:
    """Return the byte at which HDF5 begins in a file, behind what its user put before it; None for other files.

    What a user puts there, as MATLAB does, has 512 bytes or a multiple that is a power of two; here at most 2^20.
    """
    for start in (0, *(512 << power for power in range(12))):
        source.stream.seek(start)
        begin = source.stream.read(len(_HDF5))
        if begin == _HDF5:
            source.stream.seek(0)
            return start
        if len(begin) < len(_HDF5):
            break
    source.stream.seek(0)
    return None


class Folder(contextlib.ExitStack):
    """A folder whose files are read as one thing. Its context is `guarded`.

    Attributes
    ----------
    path, suffix, inner
        As those of a `Source`.
    """

    def __init__(self, path: Path, inner: str = "") -> None:
        super().__init__()
        self.path, self.inner = path, inner
        self.suffix = path.suffix.lower()
        self.enter_context(guarded(path))

    def files(self) -> list[Path]:
        """Return the regular files in it by their names, hidden ones left out; InvalidInput for too many."""
        found = []
        for number, entry in enumerate(os.scandir(self.path)):
            if number >= _MOST_FILES:
                raise complain(f"{self.path} cannot be read", f"more than {_MOST_FILES} files", "fewer")
            if not entry.name.startswith(".") and entry.is_file():
                found.append(Path(entry.path))
        return sorted(found, key=_by_numbers)


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    """Return a key by which slice2 comes before slice10."""
    return [(int(part) if part.isdigit() and part.isascii() else -1, part) for part in _NUMBERS.split(path.name)]


def opened(path: str | os.PathLike[str]) -> Source | Folder:
    """Open a file, a folder, or a part of either: FILE:/part. Errors are those of `Source`."""
    try:
        text = os.fspath(path)
    except Exception:  # Objects of others raise whatever they like.
        raise complain("the data cannot be read", shown(path), "a path") from None
    file, colon, inner = text.rpartition(":/")
    if not colon or os.path.lexists(text) or not os.path.exists(file):
        file, inner = text, ""
    there = Folder if os.path.isdir(file) else Source
    return there(Path(file), f"/{inner}" if inner else "")


class Payload:
    """The samples of a file: a stream, and an upper bound on its length (None: not known).

    After `array`, `surplus` is whether a byte is left.
    """

    def __init__(self, source: Source, stream: IO[bytes], bound: int | None, *, exact: bool = False) -> None:
        self._source, self._stream, self._bound, self._exact = source, stream, bound, exact
        self.surplus = False
        # The byte behind what was read, if there is one.
        self._ahead = b""
        self._wanted = ""
        self._advice: str | Words = "the file is cut off or its header is wrong; fetch it again"

    def expect(self, wanted: str, advice: str | Words) -> None:
        """Set the error message for a file that is too short, where no header declares its length."""
        self._wanted, self._advice = wanted, advice

    def skip(self, count: int) -> None:
        """Skip decompressed bytes: those of plain files at once, `MOST_SKIPPED` of packed ones at most."""
        if self._bound is not None and count > self._bound:
            raise self._short(count, self._bound, "bytes before the samples", about=not self._exact)
        if self._exact:
            self._stream.seek(count - len(self._ahead), os.SEEK_CUR)
            self._ahead, self._bound = b"", (self._bound or 0) - count
            return
        if count > MOST_SKIPPED:
            wanted = f"at most {MOST_SKIPPED} in a packed file"
            raise complain(f"{self._source.path} cannot be read", f"{count} bytes before the samples", wanted)
        left = count
        while left > 0 and (piece := self._read(min(left, _CHUNK))):
            left -= len(piece)
        if left > 0:
            raise self._short(count, count - left, "bytes before the samples")
        if self._bound is not None:
            self._bound = max(0, self._bound - count)

    def read(self, count: int) -> bytes:
        """Return the next few bytes. InvalidInput where the file has fewer."""
        found = self._read(count)
        if len(found) < count:
            raise self._short(count, len(found), "samples")
        self._bound = None if self._bound is None else max(0, self._bound - count)
        return found

    def _read(self, count: int) -> bytes:
        """Return at most so many bytes, with the one that was read ahead."""
        ahead, self._ahead = self._ahead[:count], self._ahead[count:]
        return ahead + self._stream.read(count - len(ahead))

    def _short(self, wanted: int, found: int, what: str, *, about: bool = False) -> Error:
        return complain(
            f"{self._source.path} cannot be read",
            f"{'at most ' if about else ''}{found} bytes of {what}",
            self._wanted or f"{wanted} bytes, as the header says",
            self._advice,
        )

    def located(self, dtype: np.dtype[Any], count: int) -> StoredSamples:
        """Return where `count` values lie in the file. Unsupported for packed ones, else as `array`."""
        needed = count * dtype.itemsize
        if not self._exact:
            wanted = "samples that are not packed"
            what = f"{self._source.path} cannot be read in parts"
            raise complain(what, "packed samples", wanted, "unpack them first", kind=Unsupported)
        if self._bound is not None and needed > self._bound:
            raise self._short(needed, self._bound, "samples")
        return StoredSamples.dense(self._source.path, dtype, (count,), self._stream.tell() - len(self._ahead))

    def array(self, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        """Return `count` values. InvalidInput where the file has fewer, OutOfMemory where they do not fit."""
        needed = count * dtype.itemsize
        if self._bound is not None and needed > self._bound:
            raise self._short(needed, self._bound, "samples", about=not self._exact)
        if not self._exact:
            self._source.refuse_growth(needed)
        _memory.require(needed, f"the samples of {self._source.path}")
        values = np.empty(count, dtype)
        view = memoryview(values.view(np.uint8).data) if count else memoryview(b"")
        filled = 0
        while piece := self._read(min(_CHUNK, needed - filled)):
            view[filled : filled + len(piece)] = piece
            filled += len(piece)
        if filled < needed:
            raise self._short(needed, filled, "samples")
        # Reading to the end of a packed stream compares its checksum.
        self._ahead = self._ahead or self._stream.read(1)
        self.surplus = bool(self._ahead)
        self._bound = None if self._bound is None else max(0, self._bound - needed)
        return values

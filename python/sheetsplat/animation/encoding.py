"""Frames to video files, by the ffmpeg that the package imageio-ffmpeg brings."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
import subprocess
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import IO

from sheetsplat._processes import start
from sheetsplat._waiting import call
from sheetsplat.errors import Error, complain, missing_package
from sheetsplat.io.pictures import whole_file

_EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2"
# Colours of screens, which players take for those of television unless the file says so.
_COLOURS = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"]
_YUV = ["-vf", f"{_EVEN},scale=out_color_matrix=bt709:out_range=tv,format=yuv420p", *_COLOURS]
_PALETTE = "split[a][b];[a]palettegen=stats_mode=full[p];[b][p]paletteuse=dither=sierra2_4a"
# Arguments of ffmpeg by the suffix of the film.
_FORMATS = {
    ".mp4": ["-c:v", "libx264", "-preset", "medium", "-crf", "17", *_YUV, "-movflags", "+faststart", "-f", "mp4"],
    ".webm": ["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-row-mt", "1", *_YUV, "-f", "webm"],
    ".gif": ["-filter_complex", _PALETTE, "-loop", "0", "-f", "gif"],
}
#: Suffixes of films.
SUFFIXES = tuple(_FORMATS)
# Characters of what ffmpeg says about a failure.
_LONGEST = 500


def find_ffmpeg(path: Path) -> str:
    """Return the program, or Unsupported where imageio-ffmpeg is not installed."""
    try:
        import imageio_ffmpeg  # type: ignore[import-not-found, import-untyped, unused-ignore]

        found: str = imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError as error:
        raise missing_package(f"{path} cannot be written", error) from error
    except RuntimeError as error:
        raise complain(f"{path} cannot be written", str(error), "a program ffmpeg", kind=Error) from None
    return found


@contextlib.contextmanager
def nameless_file(path: Path) -> Iterator[str]:
    """Yield a name by which this and other processes can write a file that gets the name `path` at the end.

    Until then it has no name, so that a process that is killed leaves nothing behind. Where a file system has no such
    files, it is a temporary one beside `path`.
    """
    try:
        kind = path.stat().st_mode
    except OSError:
        kind = stat.S_IFREG
    target = path.resolve()
    handle = -1
    if stat.S_ISREG(kind):
        with contextlib.suppress(OSError):
            handle = os.open(target.parent, os.O_TMPFILE | os.O_RDWR, 0o666)
    if handle < 0:
        with whole_file(path) as made:
            yield os.fspath(made)
        return
    try:
        yield f"/proc/{os.getpid()}/fd/{handle}"
        # A name of its own first: only a renaming replaces a file.
        named = target.with_name(f".{secrets.token_hex(8)}{path.suffix}")
        # Python follows the link to the file only where a folder is given, which an absolute path does not need.
        os.link(f"/proc/self/fd/{handle}", named, src_dir_fd=handle, follow_symlinks=True)
        try:
            named.replace(target)
        except OSError:
            named.unlink()
            raise
    except OSError as error:
        raise complain(f"{path} cannot be written", error.strerror or str(error), "a new file", kind=Error) from None
    finally:
        os.close(handle)


class Encoder:
    """A running ffmpeg that takes frames."""

    def __init__(self, process: subprocess.Popen[bytes], messages: IO[bytes], path: Path) -> None:
        self._process = process
        self._messages = messages
        self._path = path

    def write(self, frame: bytes) -> None:
        """Hand over a frame, red, green, blue, rows from the top."""
        assert self._process.stdin is not None
        try:
            call(partial(self._process.stdin.write, frame))
        except OSError:
            raise self._failure() from None

    def finish(self) -> None:
        """Wait until the film is written; Error where it cannot be."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        if call(self._process.wait) != 0:
            raise self._failure()

    def _failure(self) -> Error:
        self._process.wait()
        self._messages.seek(0)
        words = " ".join(self._messages.read().decode("utf-8", "replace").split())
        found = f"ffmpeg failed: {words[-_LONGEST:] or self._process.returncode}"
        return complain(f"{self._path} cannot be written", found, "a film", kind=Error)


@contextlib.contextmanager
def encoder(path: Path, size: tuple[int, int], fps: float) -> Iterator[Encoder]:
    """Yield what takes the frames of a film; the file appears whole at the end, or not at all."""
    program = find_ffmpeg(path)
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", f"{fps:.6g}", "-i", "pipe:0"]
    common = ["-hide_banner", "-loglevel", "error", "-nostdin", "-y"]
    # Nothing about time or machine, so that equal films are equal files.
    plain = ["-an", "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"]
    with nameless_file(path) as name, tempfile.TemporaryFile() as messages:
        command = [program, *common, *source, *plain, *_FORMATS[path.suffix.lower()], name]
        process = start(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=messages)
        try:
            made = Encoder(process, messages, path)
            yield made
            made.finish()
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()

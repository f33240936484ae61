"""Folders of frames: which are there already, and whether they are of this film."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from sheetsplat.animation.drawing import FRAME_KEYWORD
from sheetsplat.errors import Error, complain
from sheetsplat.io.png_text import read_text

_NAME = re.compile(r"frame_\d{4,6}\.png")
# Temporary files of a film that was killed.
_LEFT = re.compile(r"\.[0-9a-f]{16}\.png")
_LONGEST_MARK = 200


def name_of(number: int) -> str:
    """Return the name of the file of a frame."""
    return f"frame_{number:04}.png"


def make_folder(folder: Path) -> None:
    """Make a folder, or take one that is there; Error where that cannot be."""
    failed = f"{folder} cannot be written"
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise complain(failed, f"no folder {folder.parent}", "a path in an existing folder", kind=Error) from None
    except OSError as error:
        raise complain(failed, error.strerror or str(error), "a folder", kind=Error) from None


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder against other films, of this and of other processes; Error where one holds it.

    The system lets it go with the process, however that ends.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        found = "another film that is being written into it"
        raise complain(f"the film cannot be written into {folder}", found, "a folder of its own", kind=Error) from None
    except OSError:
        # A file system without such locks.
        pass
    try:
        yield
    finally:
        os.close(handle)


def frames_there(folder: Path, count: int, mark: Callable[[int], str], *, overwrite: bool) -> set[int]:
    """Return the numbers of the frames in a folder that need not be drawn again.

    Parameters
    ----------
    folder
        The folder. Temporary files that a killed film left in it are removed.
    count
        Number of frames of this film.
    mark
        Returns what a frame of this film says about itself; "" for nothing.
    overwrite
        Draw all of them, in place of any frames that are there.

    Raises
    ------
    InvalidInput
        For a folder with anything but frames of this film; files whose names begin with a dot do not count.
    """
    failed = f"the film cannot be written into {folder}"
    advice = "choose another folder, or pass overwrite=True to replace frames"
    there: set[int] = set()
    names = {name_of(number): number for number in range(count)}
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise complain(failed, error.strerror or str(error), "a folder that can be read", kind=Error) from None
    for entry in entries:
        if _LEFT.fullmatch(entry.name):
            entry.unlink(missing_ok=True)
            continue
        if entry.name.startswith("."):
            continue
        wanted = "a new or empty folder, or one with frames of this film"
        if not _NAME.fullmatch(entry.name) or entry.is_symlink() or not entry.is_file():
            raise complain(failed, f"{entry.name}, which is no frame", wanted, "choose another folder")
        if overwrite:
            if entry.name not in names:
                entry.unlink()
            continue
        own = _mark(entry)
        if entry.name not in names or not own or own != mark(names[entry.name]):
            raise complain(failed, f"{entry.name}, which is a frame of another film, or damaged", wanted, advice)
        there.add(names[entry.name])
    return there


def _mark(path: Path) -> str | None:
    """Return what a PNG says about which frame it is; None for anything that does not say it, or is damaged."""
    try:
        return read_text(path, _LONGEST_MARK, FRAME_KEYWORD, whole=True)
    except Error:
        return None

"""Films that are killed, that run out of space, that meet rubbish, or each other."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sheetsplat as ss
from attacks import Tally

FRAMES = 14
FILM = f"""
import os, sys, numpy as np, sheetsplat as ss
k = np.mgrid[0:12, 0:12, 0:12]
ball = np.clip(1 - np.sqrt(((k - 5.5) ** 2).sum(axis=0)) / 6, 0, 1)
film = ss.turntable(ball, frames={FRAMES}, size=24, backend="reference", quality="draft")
"""
# Argument 1: the output; 2: how many processes; 3: the most bytes of a file, 0 for any.
_SAVE = """
import resource, time
if int(sys.argv[3]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
print("begun", flush=True)
try:
    film.save(sys.argv[1], workers=int(sys.argv[2]))
except ss.Error as error:
    print(f"{type(error).__name__}: {error}", flush=True)
    sys.exit(9)
"""
_PATIENCE = 120.0
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)


def film() -> ss.Animation:
    """Return the film that all processes make."""
    names: dict[str, Any] = {}
    exec(FILM, names)
    made: ss.Animation = names["film"]
    return made


def started(output: Path, workers: int = 1, most_bytes: int = 0) -> subprocess.Popen[bytes]:
    """Return a process that will save the film, and say "begun" before."""
    command = [sys.executable, "-c", FILM + _SAVE, os.fspath(output), str(workers), str(most_bytes)]
    # Where this process ignores Ctrl-C, as one in the background does, so would that one.
    return subprocess.Popen(
        command,
        bufsize=0,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler) and None,
    )


def begun(output: Path, workers: int = 1, most_bytes: int = 0) -> subprocess.Popen[bytes]:
    """Return a process that is about to save the film."""
    process = started(output, workers, most_bytes)
    assert process.stdout is not None and process.stdout.readline() == b"begun\n"
    return process


def ended(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Return exit code and last words of a process."""
    try:
        told, _ = process.communicate(timeout=_PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return -1, "it hung"
    return process.returncode, told.decode(errors="replace").strip()


def content(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def left_alive(session: int) -> list[str]:
    """Return the processes of a session that are still there after some seconds."""
    found: list[str] = []
    for _ in range(100):
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    parts = (entry / "stat").read_text().rpartition(")")[2].split()
                except OSError:
                    continue
                if parts[0] != "Z" and int(parts[3]) == session:
                    found.append(entry.name)
        if not found:
            return []
        time.sleep(0.1)
    return found


def kills_of_films(seed: int, count: int) -> Tally:
    """Kill films at random moments, some of them twice, and let them be made whole: to the same bytes."""
    tally, rng, made = Tally(), random.Random(seed), film()
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        expected: dict[str, Any] = {}
        for suffix in ("", ".gif", ".mp4"):
            made.save(root / f"whole{suffix}")
            whole = root / f"whole{suffix}"
            expected[suffix] = content(whole) if whole.is_dir() else whole.read_bytes()
        for number in range(count):
            place = root / f"film{number}"
            place.mkdir()
            suffix = rng.choice(("", "", "", ".gif", ".mp4"))
            output, workers = place / f"film{suffix}", rng.choice((1, 1, 2))
            said = f"film {number} ({suffix or 'folder'}, {workers} processes)"
            for _ in range(rng.choice((1, 1, 2))):
                process = begun(output, workers)
                time.sleep(rng.uniform(0.0, 0.35 if workers == 1 else 1.2))
                sent = rng.choice(SIGNALS)
                os.kill(process.pid, sent)
                code, told = ended(process)
                tally.did(f"films killed by {sent.name}", code != 0)
                tally.did("films that were done before", code == 0)
                if code not in (0, -sent, 1, 128 + sent, -signal.SIGINT):
                    tally.failed(f"{said}: code {code} by {sent.name}, {told}")
                if alive := left_alive(process.pid):
                    tally.failed(f"{said}: processes {alive} go on")
            if suffix and output.exists() and output.read_bytes() != expected[suffix]:
                tally.failed(f"{said}: half a film")
            if suffix and [one for one in place.iterdir() if one != output]:
                tally.failed(f"{said}: left {sorted(content(place))}")
            try:
                made.save(output)
            except ss.Error as error:
                tally.failed(f"{said}: {error}")
                continue
            found = content(output) if output.is_dir() else output.read_bytes()
            tally.did("films made whole to the same bytes", found == expected[suffix])
            if found != expected[suffix]:
                tally.failed(f"{said}: other bytes; {sorted(found) if isinstance(found, dict) else len(found)}")
            shutil.rmtree(place)
    return tally


def _spoiled(rng: random.Random, path: Path, frames: dict[str, bytes]) -> str:
    """Put rubbish in the place of a frame; return what was done."""
    whole = frames[path.name]
    another = rng.choice([name for name in frames if name != path.name])
    kind = rng.choice(
        ("noise", "cut", "flipped", "flipped", "flipped", "another frame", "empty", "link", "folder", "pipe", "longer")
    )
    path.unlink()
    if kind == "noise":
        path.write_bytes(rng.randbytes(rng.choice((1, 8, 500, 5000))))
    elif kind == "cut":
        path.write_bytes(whole[: rng.randrange(len(whole))])
    elif kind == "flipped":
        at = rng.randrange(len(whole))
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << rng.randrange(8)]) + whole[at + 1 :])
    elif kind == "another frame":
        path.write_bytes(frames[another])
    elif kind == "empty":
        path.touch()
    elif kind == "link":
        path.symlink_to(path.with_name(another))
    elif kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.write_bytes(whole + rng.randbytes(9))
    return kind


def rubbish_frames(seed: int, count: int) -> Tally:
    """Replace frames by rubbish: the film is refused, naming one, or made whole to the same bytes."""
    tally, rng, made = Tally(), random.Random(seed), film()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "film"
        made.save(folder)
        expected = content(folder)
        paths = [folder / one for one in expected]
        for number in range(count):
            spoiled = {path: _spoiled(rng, path, expected) for path in rng.sample(paths, rng.choice((1, 1, 2)))}
            said = f"{number}: { ({path.name: kind for path, kind in spoiled.items()}) }"
            for kind in spoiled.values():
                tally.did(f"frames: {kind}")
            try:
                made.save(folder)
            except ss.InvalidInput as error:
                tally.did("films that were refused")
                if not any(path.name in str(error) for path in spoiled):
                    tally.failed(f"{said}: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{said}: {type(error).__name__}: {error}")
            else:
                tally.did("films made whole")
                if content(folder) != expected:
                    tally.failed(f"{said}: other bytes")
            shutil.rmtree(folder)
            folder.mkdir()
            for one, bytes_ in expected.items():
                (folder / one).write_bytes(bytes_)
    return tally


def full_disks_of_films(seed: int, count: int) -> Tally:
    """Let films run out of space at random sizes: one error, and nothing half-written."""
    tally, rng, made = Tally(), random.Random(seed), film()
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        made.save(root / "whole")
        expected = content(root / "whole")
        for number in range(count):
            place = root / f"film{number}"
            place.mkdir()
            suffix = rng.choice(("", ".mp4", ".gif"))
            output = place / f"film{suffix}"
            most = rng.randrange(1, 3000)
            code, told = ended(begun(output, rng.choice((1, 2)), most))
            tally.did(f"films {suffix} with a full disk".replace("  ", " "), code == 9)
            said = f"film {number}{suffix}, {most} bytes: code {code}, {told}"
            if code not in (0, 9) or (code == 9 and "cannot be written" not in told):
                tally.failed(said)
            if suffix and code == 9 and content(place):
                tally.failed(f"{said}; left {sorted(content(place))}")
            if not suffix:
                there = content(output)
                if not there.items() <= expected.items():
                    tally.failed(f"{said}; left {sorted(there)}")
                made.save(output)
                if content(output) != expected:
                    tally.failed(f"{said}; other bytes")
            shutil.rmtree(place)
    return tally


def two_films_in_one_folder(seed: int, count: int) -> Tally:
    """Save a film twice at once: each is made whole, or refused in one error that says why."""
    tally, rng, made = Tally(), random.Random(seed), film()
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        made.save(root / "whole")
        expected = content(root / "whole")
        for number in range(count):
            folder = root / f"film{number}"
            both = [started(folder)]
            time.sleep(rng.uniform(0.0, 0.1))
            both.append(started(folder))
            for code, told in map(ended, both):
                tally.did("films made whole", code == 0)
                tally.did("films that were refused", code == 9)
                if code not in (0, 9) or (code == 9 and "another" not in told):
                    tally.failed(f"{number}: code {code}, {told}")
            made.save(folder)
            if content(folder) != expected:
                tally.failed(f"{number}: {sorted(content(folder))}")
            shutil.rmtree(folder)
    return tally


#: Names that file systems take, and programs trip over.
NAMES: tuple[bytes, ...] = (
    b"-y",
    b"--",
    b"a b",
    b"a\nb",
    b"%03d",
    b"%s%n",
    b"a:b",
    b"concat:a|b",
    b"pipe:1",
    b"file:x",
    b"\xff\xfe",
    b"'",
    b'"',
    b"$(ls)",
    b"`ls`",
    "é✓".encode(),
    "\u202e".encode(),
    b"*",
    b"?",
    b"[a]",
    b"#",
    b"~",
    b".hidden",
    b"x" * 240,
    b"a\\b",
    b"\x01",
)


def odd_names(seed: int, count: int) -> Tally:
    """Save a film by names that programs trip over: as a file of each kind, and as a folder."""
    tally, rng = Tally(), random.Random(seed)
    made = film()[:2]
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for suffix in ("", ".gif", ".mp4"):
            made.save(root / f"whole{suffix}")
        where = {suffix: root / f"whole{suffix}" for suffix in ("", ".gif", ".mp4")}
        for number in range(count):
            stem = rng.choice(NAMES) if rng.random() < 0.7 else rng.choice(NAMES) + rng.choice(NAMES)[:10]
            suffix = rng.choice(("", ".gif", ".mp4"))
            place = root / f"place{number}"
            place.mkdir()
            output = Path(os.fsdecode(os.path.join(os.fsencode(place), stem[:250] + suffix.encode())))
            try:
                made.save(output)
                whole = where[suffix]
                same = content(output) == content(whole) if not suffix else output.read_bytes() == whole.read_bytes()
                tally.did("films of odd names", same)
                if not same or len(list(place.iterdir())) != 1:
                    tally.failed(f"{output!r}: {[str(one).encode(errors='replace') for one in place.iterdir()]}")
            except ss.Error as error:
                tally.did("films that were refused")
                if list(place.iterdir()) or (suffix and b"\n" not in stem):
                    tally.failed(f"{output!r}: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{output!r}: {type(error).__name__}: {error}")
            shutil.rmtree(place)
        for what, make in _PLACES.items():
            refused(tally, what, made, make(root))
    return tally


def _pipe(root: Path) -> Path:
    os.mkfifo(root / "pipe.mp4")
    return root / "pipe.mp4"


def _pipe_as_folder(root: Path) -> Path:
    os.mkfifo(root / "pipe")
    return root / "pipe"


_PLACES: dict[str, Callable[[Path], Path]] = {
    "a pipe as film": _pipe,
    "a pipe as folder": _pipe_as_folder,
    "a folder that cannot be written": lambda root: Path("/proc/self/film"),
    "a film where nothing can be written": lambda root: Path("/proc/self/film.mp4"),
    "a device": lambda root: Path("/dev/null"),
    "a folder in a file": lambda root: root / "whole.gif" / "film",
}


def refused(tally: Tally, what: str, made: ss.Animation, output: Path) -> None:
    """Save a film where it cannot be: an error at once, by a thread that may hang."""
    found: list[str] = []

    def save() -> None:
        try:
            made.save(output)
            found.append("saved")
        except ss.Error:
            found.append("")
        except BaseException as error:
            found.append(f"{type(error).__name__}: {error}")

    thread = threading.Thread(target=save, daemon=True)
    thread.start()
    thread.join(30.0)
    tally.did("places that were refused", found == [""])
    if found != [""]:
        tally.failed(f"{what}: {found or 'it hung'}")

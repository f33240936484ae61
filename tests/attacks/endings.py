"""Viewers that are ended while pages are open, and whose data change under them."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from attacks import Tally
from attacks.lines import HELLO, viewer
from attacks.messages import Faults, Listener, hostile, rest, volumes
from attacks.websocket import Line, frame

_SECONDS = 60.0
_MOST_PAGES = 6
_ASKED: tuple[dict[str, Any], ...] = (
    {"type": "save", "width": 400, "height": 300, "shown": False},
    {"type": "film", "what": "turn", "frames": 40, "fps": 9, "kind": "gif", "width": 64, "height": 48},
    {"type": "set", "changes": {"shadows": True, "quality": "best"}},
    {"type": "set", "changes": {"mode": "isosurface"}},
    {"type": "measure", "what": "error"},
)


def _page(url: str, asked: list[dict[str, Any]], closed: list[bool], begun: threading.Barrier) -> None:
    """Open a page, ask for things, and take what comes until the line ends."""
    ended = False
    line = None
    try:
        line = Line(url).open()
        line.socket.settimeout(_SECONDS)
        line.send(frame(HELLO) + b"".join(frame(json.dumps(one).encode()) for one in asked))
        begun.wait(_SECONDS)
        while line.socket.recv(1 << 16):
            pass
        ended = True
    except TimeoutError:
        begun.abort()
    except (OSError, AssertionError):
        begun.abort()
        ended = True
    finally:
        if line is not None:
            line.socket.close()
        closed.append(ended)


class _Viewer(subprocess.Popen[str]):
    """`sheetsplat view` of a small volume in a folder, which takes Ctrl-C also where this program does not."""

    def __init__(self, folder: Path) -> None:
        super().__init__(
            [sys.executable, "-m", "sheetsplat", "view", "v.npy", "--no-browser", "--backend", "cpu"],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder / "tmp"), "PYTHONFAULTHANDLER": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Jobs in the background ignore Ctrl-C unless told otherwise.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
        )

    def link(self) -> str:
        """Return the link that it prints."""
        assert self.stdout is not None
        return self.stdout.readline().strip()

    def ended(self) -> tuple[str, str]:
        """Return what it said on stderr until it ended, and "" or that it did not end; then it says where it is."""
        try:
            return self.communicate(timeout=_SECONDS)[1], ""
        except subprocess.TimeoutExpired:
            self.send_signal(signal.SIGABRT)
            return self.communicate()[1], "does not end"


def _with_pages(rng: random.Random, process: _Viewer, how: signal.Signals) -> tuple[list[bool], str]:
    """Open pages, send a signal while they wait; return for each whether its line was closed, and what happened."""
    pages, wait = rng.randrange(_MOST_PAGES), rng.choice((0.0, rng.uniform(0, 0.3), rng.uniform(0, 2)))
    asked = [rng.choices(_ASKED, k=rng.randrange(4)) for _ in range(pages)]
    url, closed, begun = process.link(), [], threading.Barrier(pages + 1)
    threads = [threading.Thread(target=_page, args=(url, one, closed, begun)) for one in asked]
    for thread in threads:
        thread.start()
    said = f"with {pages} pages after {wait:.2f} s"
    try:
        begun.wait(_SECONDS)
        time.sleep(wait)
    except threading.BrokenBarrierError:
        said += ", a page did not come"
    process.send_signal(how)
    for thread in threads:
        thread.join()
    return closed, said


# What the command may say, and how it may end. Python itself ends by the signal where it comes before the package is
# read, or after the command has ended.
_ENDS = {signal.SIGINT: (0,), signal.SIGTERM: (128 + signal.SIGTERM,)}
_SAID = ("", "Ctrl-C ends the viewer")
_EARLY_ENDS = {signal.SIGINT: (1, -signal.SIGINT), signal.SIGTERM: (128 + signal.SIGTERM, -signal.SIGTERM)}
_TWICE_ENDS = (0, 1, -signal.SIGINT)


def ends_of_viewers(seed: int, count: int) -> Tally:
    """End `sheetsplat view` by a signal at random moments, with pages open, before its link, twice: in silence."""
    tally, rng = Tally(), random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tmp").mkdir()
        z, y, x = np.mgrid[-1:1:40j, -1:1:40j, -1:1:40j]
        np.save(folder / "v.npy", np.exp(-3 * (x**2 + y**2 + z**2)).astype(np.float32))
        for number in range(count):
            how, kind = rng.choice(tuple(_ENDS)), rng.choice(("pages", "pages", "early", "twice"))
            with _Viewer(folder) as process:
                closed: list[bool] = []
                codes, words = _ENDS[how], _SAID
                if kind == "early":
                    wait = rng.uniform(0, 3)
                    time.sleep(wait)
                    process.send_signal(how)
                    said = f"{wait:.2f} s after the start"
                    # The link may have come.
                    codes, words = (*codes, *_EARLY_ENDS[how]), (*words, "Aborted!")
                else:
                    closed, said = _with_pages(rng, process, how)
                    if kind == "twice":
                        wait = rng.uniform(0, 0.5)
                        time.sleep(wait)
                        process.send_signal(signal.SIGINT)
                        said += f", Ctrl-C {wait:.2f} s later"
                        codes, words = (*codes, *_TWICE_ENDS), (*words, "Aborted!")
                told, fault = process.ended()
            if kind == "early" and "Traceback" in told and f"sheetsplat{os.sep}" not in told:
                # Python itself was not there yet.
                told = ""
            said = f"{number}: {how.name} {said}"
            tally.did(f"viewers ended by {how.name}, {kind}, code {process.returncode}")
            tally.did("pages that were open", len(closed))
            if fault or process.returncode not in codes or any(line.strip() not in words for line in told.splitlines()):
                tally.failed(f"{said}: {fault} code {process.returncode}, {told[-5000:]}")
            if not all(closed):
                tally.failed(f"{said}: {closed.count(False)} pages were not closed")
            left = [str(one) for one in (folder / "tmp").rglob("*")] + [str(one) for one in folder.glob(".*")]
            if left:
                tally.failed(f"{said}: left {left[:5]}")
                break
    return tally


def _changed(rng: random.Random, path: Path, whole: bytes) -> str:
    """Change a file while it may be read; return how."""
    how = rng.choice(("gone", "cut", "noise", "another shape", "another type", "whole", "whole"))
    if how == "gone":
        path.unlink(missing_ok=True)
    elif how == "cut":
        path.write_bytes(whole[: rng.randrange(len(whole))])
    elif how == "noise":
        path.write_bytes(rng.randbytes(len(whole)))
    elif how == "whole":
        path.write_bytes(whole)
    else:
        shape = [rng.randrange(2, 20) for _ in range(3)] if how == "another shape" else (14, 14, 14)
        kind = rng.choice((np.float64, np.uint8, np.int32)) if how == "another type" else np.float32
        with path.open("wb") as file:
            np.save(file, np.random.default_rng(rng.randrange(99)).integers(0, 99, shape).astype(kind))
    return how


def swapped_fields(seed: int, count: int) -> Tally:
    """Change files and arrays under a session that shows them by turns: pictures or errors that are told."""
    tally, rng = Tally(), random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        paths = [Path(name) / f"{at}.npy" for at in range(3)]
        array = volumes()["first"].copy()
        for path in paths:
            np.save(path, volumes()["first"])
        whole = paths[0].read_bytes()
        many = {"array": array, **{path.stem: str(path) for path in paths}}
        with Faults() as faults, viewer(None, choices=many) as shown:
            session = shown._session
            page = Listener(session)
            session.receive(page.client, json.loads(HELLO))
            for number in range(count):
                tally.did("changes: " + _changed(rng, rng.choice(paths), whole))
                if rng.random() < 0.3:
                    array[...] = np.float32(rng.choice((0, 1, 50, np.nan, np.inf))) * rng.random()
                session.receive(page.client, {"type": "set", "changes": {"choice": rng.randrange(len(many))}})
                if rng.random() < 0.2:
                    session.receive_text(page.client, hostile(rng))
                if number % 10 == 9 and not rest(session):
                    tally.failed(f"no rest after change {number}")
                    break
                for fault in faults.taken():
                    tally.failed(f"{number}: {fault[-1500:]}")
                if page.wrong:
                    tally.failed(f"{number}: {page.wrong}")
                    page.wrong = ""
            array[...] = volumes()["first"]
            for at, path in enumerate(paths):
                path.write_bytes(whole)
                before = page.last_frame
                fresh = {"choice": at + 1, "automatic": True, "mode": "composite", "quality": "draft"}
                session.receive(page.client, {"type": "set", "changes": {"choice": 0}})
                rest(session)
                session.receive(page.client, {"type": "set", "changes": fresh})
                if not page.wait(before):
                    tally.failed(f"no picture of {path.name} when it is whole again")
                tally.did("pictures of whole files")
    return tally

"""Thousands of frames in one process: a viewer whose pages come and go, and bricks on workers; nothing grows."""

from __future__ import annotations

import json
import os
import random
import struct
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import sheetsplat as ss
from attacks import Tally
from attacks.bricks import SIZE, cluster, samples
from attacks.lines import HELLO, memory, viewer
from attacks.messages import PATIENCE, Faults, Listener, rest
from attacks.websocket import BINARY, CLOSE, TEXT, Line, frame

_WORKERS, _BRICK = 2, 18
# Of so many frames one is drawn by the workers; a page comes or goes, and the bricks are opened again.
_BY_WORKERS, _VISITS, _OPENED = 4, 10, 200
_MOST_PAGES = 4
# What is kept of the same work after a third of the frames, in bytes, threads and files, may vary by so much. Dask's
# scheduler, which is in this process, keeps the groups of tasks of all pictures: bytes of a picture.
_GROWTH, _MORE = 15e6, 6
_KEPT_BY_SCHEDULER = 8e3
# RMSE of pictures in bricks: rounding of float32.
_ROUNDING = 1e-6


def resident(pid: int) -> int:
    """Return the bytes of another process in memory."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _entries(pid: int, of: str) -> int:
    return len(os.listdir(f"/proc/{pid}/{of}"))


@dataclass(frozen=True)
class _Use:
    """What this process and the workers hold: bytes, threads and open files."""

    memory: int
    threads: int
    files: int
    worker_memory: tuple[int, ...]
    worker_threads: tuple[int, ...]
    worker_files: tuple[int, ...]

    @classmethod
    def now(cls, workers: list[int]) -> _Use:
        """Return what they hold now."""
        here = os.getpid()
        return cls(
            memory(),
            _entries(here, "task"),
            _entries(here, "fd"),
            tuple(resident(one) for one in workers),
            tuple(_entries(one, "task") for one in workers),
            tuple(_entries(one, "fd") for one in workers),
        )

    def beyond(self, before: _Use, pictures: int) -> list[str]:
        """Return what is more than it was so many pictures of the workers ago, by more than it may vary."""
        found = []
        for name, most in (("memory", _GROWTH), ("threads", _MORE), ("files", _MORE)):
            kept = _KEPT_BY_SCHEDULER * pictures if name == "memory" else 0
            if getattr(self, name) - getattr(before, name) > most + kept:
                found.append(name)
            name = f"worker_{name}"
            if any(now - then > most for now, then in zip(getattr(self, name), getattr(before, name), strict=True)):
                found.append(name)
        return found

    def __str__(self) -> str:
        """Return it in a line."""
        workers = ", ".join(
            f"{size / 1e6:.0f} MB, {threads} threads, {files} files"
            for size, threads, files in zip(self.worker_memory, self.worker_threads, self.worker_files, strict=True)
        )
        return f"{self.memory / 1e6:.0f} MB, {self.threads} threads, {self.files} files; workers: {workers}"


class _Page(threading.Thread):
    """A page in a browser: it takes frames, and says that it drew them, until it is told to go."""

    def __init__(self, url: str, rng: random.Random) -> None:
        super().__init__(daemon=True)
        self._line = Line(url).open()
        self._line.socket.settimeout(PATIENCE)
        self._goes_politely = rng.random() < 0.5
        self._going = False
        self.frames, self.wrong = 0, ""
        self._line.send(frame(HELLO))
        self.start()

    def run(self) -> None:
        """Take what comes until the line ends."""
        try:
            while True:
                kind, payload = self._line.receive()
                if kind == CLOSE:
                    return
                if kind not in (BINARY, TEXT):
                    continue
                told = payload if kind == TEXT else payload[4 : 4 + struct.unpack("<I", payload[:4])[0]]
                message = json.loads(told)
                if message["type"] == "frame":
                    self.frames += 1
                    drawn = {"type": "drawn", "number": message["number"]}
                    self._line.send(frame(json.dumps(drawn).encode()))
        except (OSError, AssertionError) as error:
            if not self._going:
                self.wrong = f"{type(error).__name__}: {error}"
        finally:
            self._line.socket.close()

    def go(self) -> None:
        """Leave: with a word, or by tearing the line."""
        self._going = True
        with suppress(OSError):
            if self._goes_politely:
                self._line.send(frame(struct.pack(">H", 1000), CLOSE))
            else:
                self._line.socket.shutdown(2)
        self.join(PATIENCE)
        if self.is_alive():
            self.wrong = self.wrong or "its line is not closed"


class _Visitors:
    """The pages that are open."""

    def __init__(self, url: str, rng: random.Random, tally: Tally) -> None:
        self._url, self._rng, self._tally = url, rng, tally
        self._open: list[_Page] = []

    def come_or_go(self) -> None:
        """Open a page, or close one."""
        if len(self._open) < self._rng.randrange(_MOST_PAGES + 1):
            self._open.append(_Page(self._url, self._rng))
            self._tally.did("pages that came")
        elif self._open:
            self._leave(self._open.pop(self._rng.randrange(len(self._open))))

    def all_go(self) -> None:
        """Close all pages."""
        while self._open:
            self._leave(self._open.pop())

    def _leave(self, page: _Page) -> None:
        page.go()
        self._tally.did("frames that pages took", page.frames)
        if page.wrong:
            self._tally.failed(f"a page: {page.wrong}")


def _changes(rng: random.Random, number: int) -> dict[str, Any]:
    """Return what a page changes for a frame: the camera, and at times the look, the mode or an effect."""
    eye = [rng.uniform(-60, 60) for _ in range(3)]
    camera = {"kind": "orthographic", "eye": eye, "target": [7, 7, 7], "up": [0, 0, 1], "height": 20}
    changes: dict[str, Any] = {"camera": camera}
    if number % 7 == 0:
        changes["material"] = {"ambient": rng.random(), "diffuse": rng.random()}
    if number % 11 == 0:
        changes["look"] = {"group": 0, "opacity": [[0, 0], [rng.uniform(1, 90), rng.random()]]}
    if number % 13 == 0:
        changes["mode"] = rng.choice(("composite", "isosurface", "mip", "xray"))
    if number % 17 == 0:
        changes["effects"] = {"elimination": rng.random() < 0.5}
    return changes


class _Bricks:
    """A ball in bricks on a cluster, drawn from all sides."""

    def __init__(self, client: Any, rng: random.Random) -> None:
        self._client, self._rng = client, rng
        self._drawn = 0
        self._whole, self._parts = self._opened(None), self._opened(client)

    @staticmethod
    def _opened(client: Any) -> Any:
        return ss.open_bricks(samples(), brick=_BRICK, client=client, quality="draft")

    def draw(self) -> str:
        """Draw a picture by the workers; return what is wrong with it."""
        if self._drawn % _OPENED == _OPENED - 1:
            self._parts = self._opened(self._client)
        options: dict[str, Any] = {
            "size": SIZE,
            "quality": "draft",
            "backend": "cpu",
            "azimuth": self._rng.uniform(0, 360),
            "elevation": self._rng.uniform(-80, 80),
            "mode": self._rng.choice(("composite", "composite", "isosurface", "mip", "xray")),
        }
        pixels = ss.render(self._parts, client=self._client, **options).pixels
        self._drawn += 1
        if self._drawn % 10:
            return ""
        expected = ss.render(self._whole, **options).pixels
        off = float(np.sqrt(np.mean((pixels.astype(np.float64) - expected) ** 2)))
        allowed = _ROUNDING * max(1.0, float(np.abs(expected).max()))
        return "" if off <= allowed else f"RMSE {off:g}, {options}"


@contextmanager
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def long_run(seed: int, count: int) -> Tally:
    """Draw many frames, by a session with pages that come and go and by workers: nothing grows after a third."""
    tally, rng = Tally(), random.Random(seed)
    uses: list[_Use] = []
    with _quiet(), Faults() as faults, cluster(_WORKERS) as client, viewer() as shown:
        bricks, session = _Bricks(client, rng), shown._session
        pids = sorted(client.run(os.getpid).values())
        page, visitors = Listener(session), _Visitors(shown.url, rng, tally)
        session.receive(page.client, json.loads(HELLO))
        for number in range(count):
            if number % _BY_WORKERS == _BY_WORKERS - 1:
                wrong = bricks.draw()
                tally.did("frames by workers")
            else:
                if rng.randrange(_VISITS) == 0:
                    visitors.come_or_go()
                session.receive(page.client, {"type": "set", "changes": _changes(rng, number)})
                wrong = "" if rest(session) else "not drawn"
                tally.did("frames of the session")
            for fault in [wrong, page.wrong, *faults.taken()]:
                if fault:
                    tally.failed(f"frame {number}: {fault[-3000:]}")
            if wrong or page.wrong:
                break
            if number in (count // 3, 2 * count // 3, count - 1):
                visitors.all_go()
                _settle(shown)
                uses.append(_Use.now(pids))
                tally.note(f"after {number + 1} frames: {uses[-1]}")
        visitors.all_go()
        if sorted(client.run(os.getpid).values()) != pids:
            tally.failed("a worker was replaced")
    pictures = 2 * count // 3 // _BY_WORKERS
    grown = uses[-1].beyond(uses[0], pictures) if len(uses) == 3 else ["fewer frames than asked for"]
    if grown:
        tally.failed(f"{', '.join(grown)}: " + "; ".join(map(str, uses)))
    return tally


def _settle(shown: ss.Viewer) -> None:
    """Wait until the server has let go of all pages, and their threads have ended."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and shown._server is not None and shown._server._pages > 0:
        time.sleep(0.01)
    time.sleep(0.5)

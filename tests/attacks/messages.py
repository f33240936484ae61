"""Messages that no page would send, to a session of the viewer."""

from __future__ import annotations

import copy
import json
import logging
import random
import threading
import time
from typing import Any

import numpy as np

from attacks import Tally
from attacks.changes import CHANGES
from attacks.values import deep, json_leaf, json_value
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.protocol import LONGEST
from sheetsplat.viewer.session import Session

SIZE = (32, 24)
PATIENCE = 120.0
# How often a session must show that it still draws, in messages; and how often it is given time to draw what it has.
_ALIVE, _REST = 1000, 40
# Messages that may wait in a session, and frames and answers on their way to a page, whatever is sent.
MOST_WAITING = 1000

_ASKED: tuple[dict[str, Any], ...] = (
    {"type": "hello", "width": 32, "height": 24},
    {"type": "size", "width": 20, "height": 30},
    {"type": "drawn", "number": 3},
    {"type": "pick", "x": 0.5, "y": 0.4, "purpose": "tell"},
    {"type": "look", "direction": [1, 0, 0], "up": None, "kind": "perspective"},
    {"type": "reset"},
    {"type": "save", "width": 24, "height": 16, "shown": True},
    {"type": "undo"},
    {"type": "redo"},
    {"type": "film", "what": "turn", "frames": 2, "fps": 9, "kind": "gif", "width": 16, "height": 16},
    {"type": "film_stop"},
    {"type": "scene"},
    {"type": "code"},
    {"type": "measure", "what": "error"},
    {"type": "measure", "what": "effects"},
    {"type": "stop"},
)


def good(rng: random.Random) -> dict[str, Any]:
    """Return a message as a page sends it."""
    if rng.random() < 0.25:
        return copy.deepcopy(rng.choice(_ASKED))
    names = rng.sample(sorted(CHANGES), rng.choice((1, 1, 1, 2, 5)))
    changes = {name: copy.deepcopy(rng.choice(CHANGES[name])) for name in names}
    if "camera" in changes and rng.random() < 0.7:
        changes["camera"]["eye"] = [rng.uniform(-60, 60) for _ in range(3)]
    return {"type": "set", "changes": changes}


def spoiled(rng: random.Random, value: Any) -> Any:
    """Return a value of JSON with one of its parts in another way: replaced, left out, doubled or added."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        name = rng.choice(sorted(value))
        kind = rng.randrange(12)
        if kind == 0:
            return {other: one for other, one in value.items() if other != name}
        if kind == 1:
            return {**value, str(json_leaf(rng))[:40]: json_value(rng, 2)}
        return {**value, name: spoiled(rng, value[name])}
    if isinstance(value, list) and value and rng.random() < 0.8:
        at, kind = rng.randrange(len(value)), rng.randrange(8)
        if kind == 0:
            return value[:at] + value[at + 1 :]
        if kind == 1:
            return value + [copy.deepcopy(value[at])] * rng.choice((1, 3, 40, 2000))
        return [*value[:at], spoiled(rng, value[at]), *value[at + 1 :]]
    return json_value(rng, 3)


def hostile(rng: random.Random) -> str | bytes:
    """Return a message: mostly one of a page with something wrong in it."""
    kind = rng.randrange(20)
    if kind == 0:
        return rng.randbytes(rng.choice((0, 1, 4, 100, 5000)))
    if kind == 1:
        return deep(rng)
    if kind == 2:
        return json.dumps(json_value(rng))
    if kind == 3:
        return json.dumps({"type": json_leaf(rng), **{str(json_leaf(rng))[:40]: json_value(rng) for _ in range(2)}})
    text = json.dumps(good(rng) if kind == 4 else spoiled(rng, good(rng)))
    if kind == 5:
        return text[: rng.randrange(len(text) + 1)]
    if kind == 6:
        at = rng.randrange(len(text))
        return text[:at] + rng.choice(("NaN", "-Infinity", "\0", '"', "1e999", "\ud800", "]")) + text[at + 1 :]
    if kind == 7:
        return text + " " * rng.choice((1, 100, LONGEST))
    return text


class _Errors(logging.Handler):
    """Keeps what is logged as a fault of the program."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.found.append(self.format(record))


class Faults:
    """Collects what the package, asyncio and aiohttp log as errors, in a `with` block."""

    _NAMES = ("sheetsplat", "asyncio", "aiohttp")

    def __init__(self) -> None:
        self._handler = _Errors()

    def __enter__(self) -> Faults:
        """Listen."""
        for name in self._NAMES:
            logging.getLogger(name).addHandler(self._handler)
        return self

    def __exit__(self, *_: object) -> None:
        """Listen no more."""
        for name in self._NAMES:
            logging.getLogger(name).removeHandler(self._handler)

    def taken(self) -> list[str]:
        """Return what was logged since the last time."""
        found, self._handler.found = self._handler.found, []
        return found


def volumes() -> dict[str, Any]:
    """Return two small volumes by name."""
    z, y, x = np.mgrid[-1:1:14j, -1:1:14j, -1:1:14j]
    first = (100 * np.exp(-2 * (x**2 + y**2 + (1.5 * z) ** 2))).astype(np.float32)
    return {"first": first, "second": first[::2, ::2, ::2].copy()}


class Listener:
    """Takes what a session sends: all of it must be JSON; frames are counted, and said to be drawn."""

    def __init__(self, session: Session) -> None:
        self.session, self.wrong = session, ""
        self.news = threading.Condition()
        self.last_frame = 0
        self.client = session.connect(self._take)

    def _take(self, message: dict[str, Any], payload: bytes) -> None:
        try:
            json.dumps(message, allow_nan=False)
        except (TypeError, ValueError) as error:
            self.wrong = f"{message.get('type')}: {error}"
        if message["type"] == "frame":
            with self.news:
                if message["last"]:
                    self.last_frame = message["number"]
                self.news.notify_all()
            # Another thread: the lock of the client is held.
            threading.Thread(target=self.client.drew).start()

    def wait(self, number: int) -> bool:
        """Wait for a complete picture with a number above one; return whether it came."""
        with self.news:
            return self.news.wait_for(lambda: self.last_frame > number, PATIENCE)


def rest(session: Session) -> bool:
    """Wait until a session has done all that it was asked for; return whether it did."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        with session._wake:
            if session._drawn == session._version and not session._jobs and not session._idle_jobs:
                return True
        time.sleep(0.002)
    return False


def messages(seed: int, count: int) -> Tally:
    """Send messages to a session, and let it draw now and then; nothing may be a fault, or stop it."""
    tally, rng = Tally(), random.Random(seed)
    session = Session(Shown(None, {"backend": "cpu", "threads": 1}, volumes(), None), SIZE)
    recent: list[str | bytes] = []
    with Faults() as faults:
        try:
            page = Listener(session)
            for number in range(count):
                text = hostile(rng)
                recent[:] = [*recent[-_REST:], text]
                try:
                    session.receive_text(page.client, text)
                except Exception as error:  # Whatever is raised here is what is looked for.
                    tally.failed(f"{type(error).__name__}: {error} by {text[:2000]!r}")
                tally.did("messages")
                if number % _REST == _REST - 1 or faults._handler.found:
                    if not rest(session):
                        tally.failed(f"no rest after {recent!r}"[:5000])
                    for fault in faults.taken():
                        tally.failed(f"{fault[-1500:]}\nby one of {recent!r}"[:9000])
                if page.wrong:
                    tally.failed(f"{page.wrong} by one of {recent!r}"[:5000])
                    page.wrong = ""
                if len(session._jobs) + len(session._idle_jobs) > MOST_WAITING:
                    tally.failed(f"{len(session._jobs)} messages wait")
                if number % _ALIVE == _ALIVE - 1 or number == count - 1:
                    before = page.last_frame
                    session.receive(page.client, {"type": "size", "width": SIZE[0], "height": SIZE[1]})
                    session.receive(page.client, {"type": "set", "changes": {"automatic": True, "mode": "composite"}})
                    session.receive(page.client, {"type": "set", "changes": {"camera": CHANGES["camera"][0]}})
                    if not page.wait(before):
                        tally.failed(f"no picture any more after {recent!r}"[:5000])
                        break
                    tally.did("pictures shown after a thousand messages")
        finally:
            session.close()
    return tally

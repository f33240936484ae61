"""Long runs in one process, the same again and again: pictures stay what they were, and memory does not grow."""

from __future__ import annotations

import importlib
import json
import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import sweep_scenes
from numpy.typing import NDArray

import sheetsplat as ss
from attacks.changes import CHANGES
from attacks.forgetful import FORGETFUL
from fuzz.cases import Case
from fuzz.limits import resident
from fuzz.part import RIGHT, Outcome, Part
from fuzz.shrinking import fewest

#: Rounds of the same work: the first ones fill caches, over the others memory is watched.
_ROUNDS, _FIRST_ROUNDS = 6, 2
#: Bytes by which a process may grow over the watched rounds.
_GROWTH = 8 << 20
_SIZE = (48, 40)
#: RMSE of pictures in bricks: rounding of float32.
_ROUNDING = 1e-6


def _grown(sizes: list[int]) -> str:
    """Return by how much memory grew over the watched rounds, or an empty text where it is within bounds."""
    watched = sizes[_FIRST_ROUNDS - 1 :]
    growth = watched[-1] - watched[0]
    if growth <= _GROWTH:
        return ""
    return f"{growth / 2**20:.1f} MiB over {len(watched) - 1} rounds: " + ", ".join(f"{one >> 20}" for one in sizes)


# Frames of changing scenes


def _drawn(renderer: ss.Renderer, number: int) -> NDArray[np.float32] | str:
    """Return the picture of a numbered scene, or the error that refuses it."""
    scene, camera, size = sweep_scenes.build_effects(ss, sweep_scenes.scene_of(number)[1])
    try:
        return np.array(renderer.render(scene, camera, size=size).pixels)
    except ss.Error as error:
        return type(error).__name__


def frames(case: Case, folder: Path) -> Outcome:
    """Draw scenes by one renderer, round by round."""
    renderer = ss.Renderer(case["backend"], threads=case["threads"])
    first: dict[int, NDArray[np.float32] | str] = {}
    sizes = []
    for _ in range(_ROUNDS):
        for number in case["numbers"]:
            found = _drawn(renderer, number)
            before = first.setdefault(number, found)
            same = found == before if isinstance(found, str) else np.array_equal(found, before, equal_nan=True)
            if not same:
                return Outcome("wrong", f"{case['backend']}: a picture that depends on others", f"scene {number}")
        sizes.append(resident())
    grown = _grown(sizes)
    return Outcome("wrong", f"{case['backend']}: memory grows", grown) if grown else RIGHT


# A viewer


_VALUES: list[Any] = [
    *(0, 1, -1, 0.5, 3, 1e308, -1e308, 5e-324, 2**53, 10**30, True, False, None, "", "x", [], {}, [[]], "auto"),
    *([0, 0, 0], [1, 2, 3], [1, 0, 0], [0.0, 1e300, -1], ["a", 1, 2], [1] * 5000, "composite", "mip", "viridis"),
    *("#336699", "good", "best", "isosurface", "bone", "ct_bone", "sigmoid", {"group": 0}, {"strength": 0.5}),
]
# What pages send, beside what they never would.
_MESSAGES: dict[str, Callable[[Random], dict[str, Any]]] = {
    "set": lambda rng: {"changes": {name: rng.choice(CHANGES[name]) for name in rng.sample(list(CHANGES), 2)}},
    "size": lambda rng: {"width": rng.randint(1, 60), "height": rng.randint(1, 60)},
    "hello": lambda rng: {"width": rng.randint(1, 60), "height": rng.randint(1, 60)},
    "drawn": lambda rng: {"number": rng.choice([0, 1, 2**50])},
    "pick": lambda rng: {
        **{"x": rng.uniform(-9, 60), "y": rng.uniform(-9, 60)},
        "purpose": rng.choice(["tell", "centre", "measure"]),
    },
    "look": lambda rng: {"direction": rng.choice([None, [1, 2, 3], [0, 0, 0]]), "up": None, "kind": "perspective"},
    "reset": lambda rng: {},
    "save": lambda rng: {"width": rng.randint(1, 60), "height": rng.randint(1, 60), "shown": rng.random() < 0.5},
    "undo": lambda rng: {},
    "redo": lambda rng: {},
    "scene": lambda rng: {},
    "code": lambda rng: {},
    "measure": lambda rng: {"what": rng.choice(["effects", "error"])},
    "stop": lambda rng: {},
    "film_stop": lambda rng: {},
}


def _spoiled(rng: Random, value: Any) -> Any:
    """Return a message one of whose values, somewhere in it, is another."""
    if isinstance(value, dict) and value and rng.random() < 0.8:
        name = rng.choice(list(value))
        if rng.random() < 0.1:
            return {key: part for key, part in value.items() if key != name}
        return {**value, name: _spoiled(rng, value[name])}
    if isinstance(value, list) and value and rng.random() < 0.6:
        at = rng.randrange(len(value))
        return [*value[:at], _spoiled(rng, value[at]), *value[at + 1 :]]
    return rng.choice(_VALUES)


def _message(rng: Random) -> str:
    """Return a message as a page sends it, or nearly."""
    kind = rng.choice(["set"] * 12 + list(_MESSAGES))
    made: Any = {"type": kind, **_MESSAGES[kind](rng)}
    for _ in range(rng.choice([0, 0, 1, 1, 2])):
        made = _spoiled(rng, made)
    text = json.dumps(made)
    if rng.random() < 0.05:
        at = rng.randrange(len(text) + 1)
        text = text[:at] + rng.choice(['"', "{", "[" * 2000, "\ud800", "NaN", ""]) + text[at + 1 :]
    return text


class _Complaints(logging.Handler):
    """Keeps what the package says went wrong with itself."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(logging.Formatter().format(record))


def _talk(shown: Any, messages: list[str], patience: float) -> str:
    """Send messages to a session; return what is wrong with it afterwards, or an empty text."""
    from sheetsplat.viewer.session import Session

    drawn = threading.Event()
    asked = False

    def deliver(message: Mapping[str, Any], payload: bytes) -> None:
        if message["type"] == "frame":
            threading.Thread(
                target=session.receive, args=(page, {"type": "drawn", "number": message["number"]})
            ).start()
            if asked and message["last"]:
                drawn.set()

    session = Session(shown, _SIZE)
    page = session.connect(deliver)
    try:
        session.receive(page, {"type": "hello", "width": _SIZE[0], "height": _SIZE[1]})
        for text in messages:
            session.receive_text(page, text)
        # Whatever was said, a page that asks for a picture gets one.
        asked = True
        session.receive(page, {"type": "set", "changes": {"automatic": True}})
        session.receive(page, {"type": "size", "width": _SIZE[0] + 1, "height": _SIZE[1]})
        return "" if drawn.wait(patience) else "no picture after all messages"
    finally:
        session.close()


def viewer(case: Case, folder: Path) -> Outcome:
    """Let a session take the messages of a page, round by round."""
    from sheetsplat.viewer.data import Shown

    log, complaints = logging.getLogger("sheetsplat"), _Complaints()
    log.addHandler(complaints)
    z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 14)], indexing="ij")
    values = [(100.0 * np.exp(-2.0 * ((x - shift) ** 2 + y**2 + 1.5 * z**2))).astype(np.float32) for shift in (0, 0.4)]
    sizes = []
    try:
        for _ in range(_ROUNDS):
            shown = Shown(None, {"backend": "cpu", "threads": 1}, None, values)
            wrong = _talk(shown, case["messages"], case["patience"])
            if complaints.texts:
                last = complaints.texts[0].strip().splitlines()[-1]
                return Outcome("wrong", f"viewer: {last.partition(':')[0]}", complaints.texts[0])
            if wrong:
                return Outcome("wrong", f"viewer: {wrong}")
            sizes.append(resident())
    finally:
        log.removeHandler(complaints)
    grown = _grown(sizes)
    return Outcome("wrong", "viewer: memory grows", grown) if grown else RIGHT


# Bricks


@cache
def _cluster() -> Any:
    """Return a client of two worker processes; they end with this process."""
    distributed: Any = importlib.import_module("distributed")
    importlib.import_module("dask").config.set(FORGETFUL)

    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
    )
    return distributed.Client(cluster)


def _volume(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a smooth volume with blocks of other values."""
    shape = tuple(int(n) for n in rng.integers(6, 40, 3))
    k, j, i = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    values = 200 * np.exp(-((k - rng.uniform(-0.5, 0.5)) ** 2 + j**2 + i**2) / rng.uniform(0.05, 1))
    corner = [int(rng.integers(0, n)) for n in shape]
    values[corner[0] :, corner[1] :, : corner[2]] *= rng.random()
    return np.asarray(values.round(), np.uint8)


def bricks(case: Case, folder: Path) -> Outcome:
    """Draw a volume in bricks by a cluster, whose workers are killed at times: the picture of this process."""
    client = _cluster()
    rng = np.random.default_rng([15, case["seed"]])
    values = _volume(rng)
    options: dict[str, Any] = {
        "mode": str(rng.choice(["composite", "composite", "isosurface", "xray", "mip", "minimum", "average"])),
        "size": tuple(int(n) for n in rng.integers(8, 60, 2)),
        "backend": "cpu",
        "azimuth": float(rng.uniform(0, 360)),
        "elevation": float(rng.uniform(-80, 80)),
        "projection": str(rng.choice(["orthographic", "perspective"])),
    }
    brick = int(rng.integers(4, 30))
    whole = ss.render(ss.open_bricks(values, brick=brick), **options)
    sizes = []
    for _ in range(_ROUNDS):
        if case["kills"] and rng.random() < 0.2:
            worker = list(client.run(os.getpid).values())[0]
            timer = threading.Timer(float(rng.uniform(0, 0.3)), os.kill, (worker, signal.SIGKILL))
            timer.start()
        image = ss.render(ss.open_bricks(values, brick=brick), client=client, **options)
        off = float(np.sqrt(np.mean((image.pixels.astype(np.float64) - whole.pixels) ** 2)))
        if not off <= _ROUNDING * max(1.0, float(np.abs(whole.pixels).max())):
            return Outcome(
                "wrong", "bricks: another picture", f"RMSE {off:g}, {options}, bricks of {brick}, {values.shape}"
            )
        sizes.append(resident())
    grown = _grown(sizes)
    return Outcome("wrong", "bricks: memory grows", grown) if grown else RIGHT


_RUNS: dict[str, Callable[[Case, Path], Outcome]] = {
    "frames": frames,
    "gl": frames,
    "viewer": viewer,
    "bricks": bricks,
}


class LongRuns(Part):
    """Frames, viewers and clusters."""

    name = "soak"
    share = 0.3
    batch = 4
    seconds = 300.0
    patience = 1200.0
    memory = 3 << 30
    kinds: Mapping[str, float] = {"frames": 6.0, "gl": 1.0, "viewer": 6.0, "bricks": 2.0}

    def case(self, kind: str, seed: int) -> Case:
        """Return which scenes are drawn, which messages are sent, or which volume is cut."""
        rng = Random(f"{kind} {seed}")
        case: Case = {"run": kind, "seed": seed}
        if kind in ("frames", "gl"):
            count = 30 if kind == "frames" else 8
            numbers = [sweep_scenes.DRAWN_ENDS + rng.randrange(100_000) for _ in range(count)]
            return case | {"backend": "gl" if kind == "gl" else "cpu", "threads": rng.randint(1, 3), "numbers": numbers}
        if kind == "viewer":
            return case | {"messages": [_message(rng) for _ in range(60)], "patience": 120.0}
        return case | {"kills": rng.random() < 0.3}

    def run(self, case: Case, folder: Path) -> Outcome:
        """Go round and round."""
        warnings.simplefilter("ignore")
        return _RUNS[case["run"]](case, folder)

    def shrunk(self, case: Case, wrong: Callable[[Case], bool]) -> Case:
        """Leave out scenes or messages."""
        name = next((one for one in ("numbers", "messages") if one in case), None)
        if name is None:
            return case
        return {**case, name: fewest(case[name], lambda items: wrong({**case, name: items}))}

"""What must hold beside single pictures: repetition, order, threads, resources."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from image_checks import FLOAT32_HARD, off_by, within
from numpy.typing import NDArray
from scene_parts import Parts, build

import sheetsplat as ss

from .cases import WITHIN
from .outcomes import expected_of, renderer_of, scene_of


@dataclass(frozen=True)
class Property:
    """What must hold beside single pictures. `check` returns the figure, and what is wrong or an empty text."""

    name: str
    words: str
    outcome: str
    check: Callable[[str], tuple[str, str]]


PROPERTIES: dict[str, Property] = {}


def promised(
    words: str, outcome: str
) -> Callable[[Callable[[str], tuple[str, str]]], Callable[[str], tuple[str, str]]]:
    """List a property."""

    def listed(check: Callable[[str], tuple[str, str]]) -> Callable[[str], tuple[str, str]]:
        PROPERTIES[check.__name__] = Property(check.__name__, words, outcome, check)
        return check

    return listed


# Of each kind one: both fields and all of them together, both cameras, both samplings, quotients, slender kernels.
DIVERSE = (
    "needles_10_crossing",
    "far_perspective",
    "world_1e+06_lattice_perspective",
    "thin_slab",
    "half_nan",
    "weights_12_orders",
    "spot_10000_unlit",
    "opaque_preintegrated_ellipsoids",
    "axis_bcc_9_off",
)


def picture(name: str, renderer: ss.Renderer) -> NDArray[np.float32]:
    """Return the pixels of a case."""
    scene, camera, size = build(ss, scene_of(name))
    return np.array(renderer.render(scene, camera, size=size).pixels)


@promised(
    "the same picture again, by the same renderer after other pictures, and by another renderer", "identical to the bit"
)
def repeated_frames(backend: str) -> tuple[str, str]:
    one, other = ss.Renderer(backend), ss.Renderer(backend)  # type: ignore[arg-type]
    first = {name: picture(name, one) for name in DIVERSE}
    changed = 0
    for name in reversed(DIVERSE):
        changed += not np.array_equal(first[name], picture(name, one))
        changed += not np.array_equal(first[name], picture(name, other))
    return f"{changed} of {2 * len(DIVERSE)} pictures changed", "" if changed == 0 else "some changed"


def worst_of(backend: str, change: Callable[[Parts, int], Parts], turns: int = 1) -> tuple[str, str]:
    """Draw the diverse cases of ellipsoids as `change(field, turn)` makes them; return the worst RMSE and any fault."""
    worst, wrong = 0.0, ""
    for name in DIVERSE:
        made = scene_of(name)
        if "centers" not in made["fields"][0]:
            continue
        for turn in range(turns):
            fields = [change(made["fields"][0], turn), *made["fields"][1:]]
            scene, camera, size = build(ss, made | {"fields": fields})
            found = off_by(renderer_of(backend).render(scene, camera, size=size), expected_of(name))
            worst = max(worst, found["rmse"])
            if not within(found, FLOAT32_HARD):
                wrong = f"{name}: {found}"
    return f"{worst:.1e}", wrong


def of_each_kernel(one: Parts, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Parts:
    """Return a field with all arrays that have a row for each kernel changed."""
    count = len(one["centers"])
    return {
        key: change(value) if isinstance(value, np.ndarray) and len(value) == count else value
        for key, value in one.items()
    }


@promised("the kernels in another order", WITHIN)
def any_order(backend: str) -> tuple[str, str]:
    def turned(one: Parts, turn: int) -> Parts:
        count = len(one["centers"])
        order = np.random.default_rng(turn).permutation(count) if turn else np.arange(count)[::-1]
        return of_each_kernel(one, lambda value: value[order])

    return worst_of(backend, turned, 2)


@promised("each kernel split into two of half its weight", WITHIN)
def halves(backend: str) -> tuple[str, str]:
    def halved(one: Parts, _: int) -> Parts:
        weights = 0.5 * np.asarray(one.get("weights", np.ones(len(one["centers"]))))
        return of_each_kernel(one | {"weights": weights}, lambda value: np.concatenate([value, value]))

    return worst_of(backend, halved)


def open_files() -> int:
    """Return how many files and sockets this process holds."""
    return len(list(Path("/proc/self/fd").iterdir())) if Path("/proc/self/fd").exists() else 0


def made_and_dropped(backend: str, count: int) -> tuple[str, str]:
    """Draw with many renderers, one after another, and look at what is left of them."""
    name = "one_kernel"
    first = picture(name, ss.Renderer(backend))  # type: ignore[arg-type]
    picture(name, ss.Renderer(backend))  # type: ignore[arg-type]
    files = open_files()
    changed = sum(
        not np.array_equal(first, picture(name, ss.Renderer(backend)))  # type: ignore[arg-type]
        for _ in range(count)
    )
    more = open_files() - files
    text = f"{changed} pictures changed, {more} files left open"
    return text, "" if changed == 0 and more <= 0 else text


@promised(
    "40 renderers made and destroyed, each with its own context (1,000 in `test_lifetime`)",
    "the same pictures, and no file stays open",
)
def contexts(backend: str) -> tuple[str, str]:
    return made_and_dropped(backend, 40)


@promised("8 threads, with one shared renderer and with one renderer each", "identical to the bit")
def eight_threads(backend: str) -> tuple[str, str]:
    names = ("needles_10_crossing", "half_nan", "thin_slab")
    shared = ss.Renderer(backend)  # type: ignore[arg-type]
    expected = {name: picture(name, shared) for name in names}
    wrong: list[str] = []

    def work(number: int) -> None:
        renderer = shared if number % 2 else ss.Renderer(backend)  # type: ignore[arg-type]
        for turn in range(3):
            name = names[(number + turn) % 3]
            try:
                if not np.array_equal(picture(name, renderer), expected[name]):
                    wrong.append(name)
            except Exception as error:  # a thread's error is a fault of the case
                wrong.append(repr(error))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return f"{len(wrong)} of 24 pictures changed", "; ".join(wrong)

"""What a hard case is, the table of them, and what several scenes are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scene_parts import Parts, parallel

import sheetsplat as ss

SIZE = (44, 36)


@dataclass(frozen=True)
class Refused:
    """An error of this kind, whose message matches."""

    kind: type[ss.Error]
    match: str

    def __str__(self) -> str:
        return f"{self.kind.__name__}: {self.match}"


WITHIN = "within section 9"
TRANSPARENT = "transparent, exactly"
Outcome = str | Refused


@dataclass(frozen=True)
class Case:
    """A scene that is hard to draw. `like`: the scene whose reference it must equal, its own unless given."""

    name: str
    group: str
    words: str
    make: Callable[[], Parts]
    outcome: Outcome = WITHIN
    like: Callable[[], Parts] | None = None
    # Backends that cannot draw it within its bound and refuse it.
    but: dict[str, Refused] = field(default_factory=dict)
    slow: bool = False

    def outcome_on(self, backend: str) -> Outcome:
        """Return the outcome that a backend must have."""
        return self.but.get(backend, self.outcome)


CASES: dict[str, Case] = {}


def add(name: str, group: str, words: str, make: Callable[[], Parts], **options: Any) -> None:
    """Add a case to the table."""
    assert name not in CASES, name
    CASES[name] = Case(name, group, words, make, **options)


def case(group: str, words: str, **options: Any) -> Callable[[Callable[[], Parts]], Callable[[], Parts]]:
    """Add a function's scene to the table, under the function's name."""

    def added(make: Callable[[], Parts]) -> Callable[[], Parts]:
        add(make.__name__, group, words, make, **options)
        return make

    return added


def chance(name: str) -> np.random.Generator:
    """Return a generator with a seed of its own for each name."""
    return np.random.default_rng([2005, *name.encode()])


def upright(height: float = 3.0, at: Any = (0.0, 0.0, 0.0)) -> Parts:
    """Return an orthographic camera that looks along -z."""
    return parallel((0, 0, -1), height, at, (0, 1, 0))


def shifted(points: Any, offset: float = 0.0, scale: float = 1.0) -> list[tuple[float, ...]]:
    """Return a transfer function over offset … offset + scale."""
    return [(offset + scale * point[0], *point[1:]) for point in points]


def lattice(name: str, shape: tuple[int, int, int] = (7, 8, 9), **options: Any) -> Parts:
    """Return smooth noise on a lattice about 0, of edge 2 at most; values fade to 0 at its borders."""
    values = chance(name).random(shape)
    for axis in range(3):
        values = (np.roll(values, 1, axis) + values + np.roll(values, -1, axis)) / 3
        window = np.sin(np.pi * (np.arange(shape[axis]) + 0.5) / shape[axis])
        values = values * window.reshape([-1 if a == axis else 1 for a in range(3)])
    step = 2.0 / max(shape)
    origin = tuple(-0.5 * step * (count - 1) for count in shape[::-1])
    return {"values": values / values.max(), "spacing": (step, step, step), "origin": origin} | options

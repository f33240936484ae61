"""What effects cost on two small fields, beside stored ratios: so small that every test run can measure it."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import sheetsplat as ss
from bench.effect_costs import EFFECTS, VIEWS, Conditions, Subject, surface, timed
from bench.report import Row
from bench.scenes import ellipsoids
from sheetsplat import datasets
from sheetsplat.choose.look import compose_scene
from sheetsplat.fields import Field

#: Where the ratios are stored: {field: {row: [ratio, ratio of the first frame]}}.
STORED = Path(__file__).with_suffix(".json")
#: A ratio above so many times the stored one is a cliff.
MOST = 3.0
# Times that a row is measured before it counts as too slow: other load can only add to a time.
_TRIES = 4
# A ratio below this is not told from it: a plain frame takes few milliseconds.
_LEAST = 1.0
_EDGE, _COUNT = 24, 60
# Least semi-axis of the ellipsoids, so that slices are few.
_THICK = 3.0
# The light volumes of the others take longer than all the rest.
_PAIRED = [name for name in EFFECTS if name not in ("shadows", "occlusion")]
#: Size of the pictures.
SIZE = (40, 40)
# One thread: which of several does the work changes what a frame costs. Kernels as small as in these pictures would
# call for float64.
_SETTINGS = {"threads": 1, "precision": "float32", "allow_inexact": True}
_CONDITIONS = Conditions("cpu", SIZE, seconds=(0.15, 0.05), settings=_SETTINGS)

Ratios = dict[str, list[float]]

#: The fields by their names.
FIELDS: Mapping[str, Callable[[], Field]] = {
    "ball": lambda: datasets.noisy_ball(_EDGE).field(),
    "ellipsoids": lambda: _thick(ellipsoids(_COUNT, _EDGE)),
}


def _thick(field: ss.EllipsoidField) -> ss.EllipsoidField:
    return ss.EllipsoidField(field.centers, np.maximum(field.scales, _THICK), field.rotations, field.values)


def subject_of(name: str) -> Subject:
    """Return a field with its look."""
    return Subject(name, name, compose_scene([FIELDS[name]()]))


def ratios(found: Sequence[Row]) -> Ratios:
    """Return the ratios of what could be drawn, by the rows' names."""
    return {row["row"]: [row["ratio"], row["first_ratio"]] for row in found if "ratio" in row}


def medians(several: Sequence[Ratios]) -> Ratios:
    """Return the median of each ratio over several passes."""
    names = [name for name in several[0] if all(name in one for one in several)]
    found = {name: zip(*(one[name] for one in several), strict=True) for name in names}
    return {name: [statistics.median(those) for those in both] for name, both in found.items()}


def measured(subject: Subject, tell: Callable[[str], object] = lambda text: None) -> list[Row]:
    """Return the rows of all effects and pairs."""
    return surface(subject, list(EFFECTS), replace(_CONDITIONS, tell=tell), _PAIRED)


def above(found: Sequence[float], stored: Sequence[float]) -> float:
    """Return how many times the stored ratios the found ones are, the larger of the frame's and the first frame's."""
    return max(max(_LEAST, one) / max(_LEAST, other) for one, other in zip(found, stored, strict=True))


def rows(subject: Subject, names: Iterable[str]) -> list[Row]:
    """Return the rows of some names, as "perspective" or "perspective + ewa"."""
    plain = _CONDITIONS.renderer()
    plain.render(subject.base, subject.camera(VIEWS), size=_CONDITIONS.size)
    return [timed(subject, name.split(" + "), _CONDITIONS, plain, {}) for name in names]


def cliffs(subject: Subject, found: Ratios, stored: Ratios) -> list[str]:
    """Return, in words, the rows over `MOST` times as slow as stored; each is measured again before it counts."""
    wrong = []
    for name, known in stored.items():
        if name not in found:
            wrong.append(f"{name}: could not be drawn")
            continue
        least = found[name]
        for _ in range(_TRIES - 1):
            if above(least, known) <= MOST:
                break
            again = ratios(rows(subject, [name]))[name]
            least = [min(pair) for pair in zip(least, again, strict=True)]
        if above(least, known) > MOST:
            now, before = (" and ".join(f"{ratio:.2f}" for ratio in both) for both in (least, known))
            wrong.append(f"{name}: {now} plain frames (the second: the first frame), stored {before}")
    return wrong


def stored_ratios() -> dict[str, Ratios]:
    """Return the stored ratios by field; none where nothing was stored yet."""
    if not STORED.is_file():
        return {}
    read: dict[str, Ratios] = json.loads(STORED.read_text(encoding="utf-8"))
    return read


def store(found: Mapping[str, Ratios]) -> None:
    """Write the ratios that later runs are compared with."""
    lines = [
        f'"{name}": {{\n'
        + ",\n".join(f"  {json.dumps(row)}: [{ratio:.2f}, {first:.2f}]" for row, (ratio, first) in rows.items())
        + "\n}"
        for name, rows in found.items()
    ]
    STORED.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

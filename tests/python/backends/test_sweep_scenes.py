"""Some of the numbered scenes of sweep_scenes.py, and its own control."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sweep_scenes
from image_checks import handed_over
from scene_parts import Parts
from sweep_scenes import DRAWN_ENDS, KINDS, PLATEAUS, fault, scene_of, shrunk

import sheetsplat as ss
from fuzz.scenes import RandomScenes

EACH = 8
# Groups that end in different places: coverage was counted beyond their ends, and an interval that the near plane opens
# showed one that has ended.
ENDED = (4000176, 4000321, 4000381, 4006096)
# Scenes that once were wrong: they stated too small an error of light.
# In the last one the reference did not count slabs that meet the tails of kernels alone.
KEPT = (
    160,
    328,
    360,
    621,
    944,
    4041,
    4825,
    4872,
    5076,
    5432,
    5869,
    6060,
    6061,
    22284,
    40560,
    4002646,
    4002811,
    4005162,
)
# A scene of many kernels of one group, whose opacities are above 0 and below 1.
DENSE = 135
MOST_TRIES = 12


@pytest.mark.parametrize(
    "number",
    [*range(EACH * len(KINDS)), *KEPT, *range(DRAWN_ENDS, DRAWN_ENDS + EACH * (len(KINDS) + 1)), *ENDED],
)
def test_numbered_scenes_are_right_or_refused(number: int) -> None:
    kind, parts = scene_of(number)
    try:
        wrong = fault(parts, "cpu")
    except (ss.Unsupported, ss.InvalidInput) as error:
        pytest.skip(f"refused: {error}")
    assert not wrong, f"{kind}: {wrong}"


@pytest.mark.gl
@pytest.mark.parametrize("number", range(DRAWN_ENDS, DRAWN_ENDS + EACH))
def test_opengl_draws_ends_right(number: int) -> None:
    assert not fault(scene_of(number)[1], "gl")


def test_ends_are_drawn() -> None:
    """Each boundary, bases and offsets, from the number on that runs begin with."""
    assert RandomScenes().first == DRAWN_ENDS
    seen = {"zero": 0, "edge": 0, "by itself": 0, "base": 0, "offset": 0}
    for number in range(DRAWN_ENDS, DRAWN_ENDS + 200):
        for field in scene_of(number)[1]["fields"]:
            if "centers" not in field:
                seen[field.get("boundary", "by itself")] += 1
            seen["base"] += "base" in field
            seen["offset"] += abs(np.nanmean(field["values"])) > 100
    assert min(seen.values()) >= 10, seen


# Plateaus that OpenGL once lit by rounding, up to 8 times the bound, or refused, as what is lit of them is rounding.
LIT = (
    2301250,
    2302929,
    2331429,
    2332416,
    2000512,
    2001352,
    2301278,
    2302296,
    2302713,
    2302956,
    2303240,
    2311197,
    2320372,
    2331107,
    2331913,
)
# An x-ray by slabs that rays go through nearly sideways.
SIDEWAYS = 1100866


@pytest.mark.parametrize("number", range(PLATEAUS, PLATEAUS + 3 * EACH))
def test_plateaus_are_right(number: int) -> None:
    assert not fault(scene_of(number)[1], "cpu")


@pytest.mark.gl
@pytest.mark.parametrize("number", [*range(PLATEAUS, PLATEAUS + EACH), 2000200, 2000519, 2000578, 2000662])
def test_opengl_draws_plateaus_right(number: int) -> None:
    assert not fault(scene_of(number)[1], "gl")


@pytest.mark.gl
@pytest.mark.parametrize("number", [*LIT, SIDEWAYS])
def test_what_opengl_may_draw_wrong_is_drawn_by_the_processor(number: int) -> None:
    """The tiles whose light would show rounding, or the whole picture."""
    parts = scene_of(number)[1]
    image = sweep_scenes.draw(parts, "gl", ())
    assert image.plan.backend == ("cpu" if number == SIDEWAYS else "gl")
    assert number != SIDEWAYS or "rays that go through a slab" in handed_over(image)
    assert image.stats["tiles_in_float64"] > 0
    assert not fault(parts, "gl")
    assert not fault(parts, "cpu")


@pytest.mark.slow
def test_a_wrong_picture_is_seen_and_made_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: an opacity that is a thousandth too high."""
    draw = sweep_scenes.draw

    def denser(parts: Parts, backend: str, outputs: Any) -> ss.Image:
        if backend == "cpu":
            parts = parts | {"transfer": [(*point[:4], 1.001 * point[4]) for point in parts["transfer"]]}
        return draw(parts, backend, outputs)

    _, parts = scene_of(DENSE)
    assert not fault(parts, "cpu")
    monkeypatch.setattr(sweep_scenes, "draw", denser)
    assert fault(parts, "cpu")
    tries = iter(range(MOST_TRIES))
    less = shrunk(parts, lambda one: next(tries, None) is not None and bool(fault(one, "cpu")))
    assert fault(less, "cpu")
    assert len(less["fields"][0]["centers"]) < len(parts["fields"][0]["centers"])

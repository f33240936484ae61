"""Each hard case has the outcome that hard_cases states, on every backend."""

from __future__ import annotations

import os
import re
from dataclasses import replace

import hard_cases as hard
import numpy as np
import pytest
from hard_cases.page import PAGE
from image_checks import FLOAT32_HARD, log, off_by, within
from scene_parts import build

import sheetsplat as ss

BACKENDS = [pytest.param("gl", marks=pytest.mark.gl), "cpu"]
# Software OpenGL takes a minute for these.
ALL = bool(os.environ.get("SHEETSPLAT_ALL_HARD_CASES"))


def skip_slow(name: str, backend: str) -> None:
    if hard.CASES[name].slow and backend == "gl" and not ALL:
        pytest.skip("a minute of software OpenGL; SHEETSPLAT_ALL_HARD_CASES=1 draws it")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", hard.CASES)
def test_the_stated_outcome(name: str, backend: str) -> None:
    skip_slow(name, backend)
    found = hard.measure(name, backend)
    log.info(f"hard {name} {backend}: {found}")
    outcome = hard.CASES[name].outcome_on(backend)
    wrong = hard.fault(outcome, found)
    assert not wrong, wrong
    if outcome == hard.WITHIN:
        expected = hard.expected_of(name).pixels
        # An empty picture would prove nothing; only cases of cancelling kernels are empty.
        assert name.startswith("cancelled") or np.abs(expected).max() > (1e-6 if "faint" in name else 1e-3)
        # Negative control: against a reference that is off by 3e-4 the case fails.
        off = off_by(expected + np.float32(3e-4), expected)
        shifted = replace(hard.Measured(bounds=FLOAT32_HARD), rmse=off["rmse"], p99_9=off["p99_9"], ambiguous=0)
        assert hard.fault(hard.WITHIN, shifted)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", hard.PROPERTIES)
def test_the_stated_property(name: str, backend: str) -> None:
    figure, wrong = hard.PROPERTIES[name].check(backend)
    log.info(f"hard {name} {backend}: {figure}")
    assert not wrong, wrong


@pytest.mark.gl
@pytest.mark.parametrize("name", ["spot_100000_unlit", "window_1e+09_unlit"])
def test_what_opengl_cannot_draw_the_processor_draws(name: str) -> None:
    """And the plan says why."""
    scene, camera, size = build(ss, hard.scene_of(name))
    image = ss.Renderer("gl").render(scene, camera, size=size)
    assert image.plan.backend == "cpu" and "for backend gl: " in image.plan.device
    found = off_by(image, hard.expected_of(name))
    assert within(found, FLOAT32_HARD), found


@pytest.mark.gl
@pytest.mark.parametrize("name", ["spot_10000_unlit", "window_300_unlit", "signs_10000"])
def test_half_floats_beyond_their_bound_are_an_error_with_a_figure(name: str) -> None:
    scene, camera, size = build(ss, hard.scene_of(name))
    with pytest.raises(ss.Unsupported, match=r"error of [0-9.e+]+.*; wanted at most 0\.00196"):
        ss.Renderer("gl", precision="float16").render(scene, camera, size=size)
    inexact = ss.Renderer("gl", precision="float16", allow_inexact=True).render(scene, camera, size=size)
    # The refusal was right: the error is above the bound.
    assert inexact.plan.precision == "float16"
    assert off_by(inexact, hard.expected_of(name))["rmse"] > FLOAT32_HARD[0]


def test_faults_are_seen() -> None:
    good = hard.Measured(pixels=10_000)
    refused = hard.Measured(refusal=ss.Unsupported("it failed", "this", "that", "do something"))
    assert not hard.fault(hard.WITHIN, good)
    assert hard.fault(hard.WITHIN, replace(good, rmse=1.01e-4)) and hard.fault(
        hard.WITHIN, replace(good, p99_9=1.01e-3)
    )
    assert hard.fault(hard.WITHIN, replace(good, ambiguous=51)) and hard.fault(hard.WITHIN, replace(good, finite=False))
    assert hard.fault(hard.WITHIN, refused) and hard.fault(hard.TRANSPARENT, good)
    assert not hard.fault(hard.Refused(ss.Unsupported, "found this"), refused)
    assert hard.fault(hard.Refused(ss.Unsupported, "found that"), refused)
    assert hard.fault(hard.Refused(ss.InvalidInput, "found this"), refused)
    assert hard.fault(hard.Refused(ss.Unsupported, "found this"), good)


def test_the_page_lists_every_case() -> None:
    """Made by `python -m hard_cases.page --table`."""
    page = PAGE.read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w[^`]*)` \|", page, re.M)) == {*hard.CASES, *hard.PROPERTIES}
    # Bold figures violate the stated outcome.
    bold = set(re.findall(r"^\| `(\w[^`]*)` \|.*\*\*", page, re.M))
    assert not bold

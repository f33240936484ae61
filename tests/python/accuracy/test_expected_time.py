"""How long a picture is said to take before it is drawn: by what it sums, and a warning where that is long."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import expected_time as module
from sheetsplat._time_left import about
from sheetsplat.expected_time import expected_time, may_be_long

FUNCTION = ss.TransferFunction([(0.2, 0.1, 0.4, 0.9, 0.0), (1.0, 1.0, 0.6, 0.2, 0.3)])


def _values(count: int = 32) -> np.ndarray:
    return np.random.default_rng(4).random((count,) * 3, dtype=np.float32)


def _seconds(field: ss.Field, size: tuple[int, int] = (200, 200), backend: str = "cpu", **options: Any) -> float:
    scene = ss.Scene(field, FUNCTION, **options)
    camera = ss.Camera.fit(field)
    slices = round(100.0 / scene.slice_spacing)
    device = "llvmpipe" if backend == "gl" else "AVX2, 2 threads"
    found = expected_time(scene, camera, size, backend, device, slices=slices, spacing=scene.slice_spacing)
    assert found is not None
    # What is certain before anything is looked at is never less than what is expected of one core.
    if found.seconds > module.LONG:
        assert may_be_long(scene, camera, size, backend)
    return found.seconds


def test_a_picture_takes_longer_the_more_it_sums() -> None:
    plain = _seconds(ss.RegularField(_values()))
    assert 5 < _seconds(ss.RegularField(_values(64)), (400, 400)) / plain < 12
    assert _seconds(ss.RegularField(_values(), radius=8)) > 20 * plain
    assert _seconds(ss.RegularField(_values(), radius=30)) > 300 * plain
    assert _seconds(ss.RegularField(_values()), (800, 800)) > 8 * plain
    assert _seconds(ss.RegularField(_values()), slice_spacing=0.01) > 20 * plain
    assert _seconds(ss.RegularField(_values()), backend="reference") > 10 * plain


@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_what_does_not_show_takes_no_time(mode: str) -> None:
    values = np.zeros((64, 64, 64), np.float32)
    values[:16] = _values(64)[:16]
    options: dict[str, Any] = {"mode": mode, "iso_value": 0.5} if mode == "isosurface" else {}
    # Sums lie between values and the base, which must not show either.
    some, all_of_it = (_seconds(ss.RegularField(one, base=0.0), (400, 400), **options) for one in (values, _values(64)))
    assert some < 0.6 * all_of_it


def test_light_along_a_million_slices_takes_minutes_and_a_million_kernels_seconds() -> None:
    shadows = _seconds(
        ss.RegularField(_values(8)), (32, 32), shadows=True, lights=[ss.Light((1, 1, 1))], slice_spacing=1e-4
    )
    assert _seconds(ss.RegularField(_values(8)), (32, 32), slice_spacing=1e-4) < shadows
    lit = {"lights": [ss.Light((1, 1, 1))], "shadows": True, "ambient_occlusion": 1.0}
    assert _seconds(ss.RegularField(_values(8)), (200, 200), slice_spacing=1e-5, **lit) > module.LONG
    centers = np.random.default_rng(2).normal(size=(100_000, 3))
    many = ss.EllipsoidField(centers, np.full(len(centers), 0.02), values=np.ones(len(centers)))
    assert 0.05 < _seconds(many) < 5.0


def test_nothing_is_said_of_a_graphics_processor_and_of_nothing() -> None:
    field = ss.RegularField(_values())
    scene, camera = ss.Scene(field, FUNCTION), ss.Camera.fit(field)
    assert expected_time(scene, camera, (64, 64), "gl", "NVIDIA H200", slices=100, spacing=1.0) is None
    empty = ss.Scene(ss.EllipsoidField(np.zeros((0, 3)), np.zeros(0), values=np.zeros(0)), FUNCTION)
    assert expected_time(empty, camera, (64, 64), "cpu", "2 threads", slices=0, spacing=1.0) is None
    assert not may_be_long(empty, camera, (64, 64), "cpu")


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_only_what_lies_in_the_picture_counts(kind: str) -> None:
    field = ss.RegularField(_values(64))
    scene = ss.Scene(field, FUNCTION)
    ends = {"eye": (31.5, 31.5, 400.0), "target": (31.5, 31.5, 31.5), "up": (0, 1, 0)}
    wide, narrow = (
        ss.Camera.orthographic(**ends, height=high)
        if kind == "orthographic"
        else ss.Camera.perspective(**ends, fov_y=float(np.degrees(2 * np.arctan(0.5 * high / 368.5))))
        for high in (128.0, 16.0)
    )
    # Pixels on the volume are 64 times as many, and a sixteenth of it is seen.
    found = [
        expected_time(scene, camera, (100, 100), "cpu", "1 threads", slices=128, spacing=0.5)
        for camera in (wide, narrow)
    ]
    assert found[0] is not None and found[1] is not None
    assert found[1].seconds < 8 * found[0].seconds


def test_the_plan_says_it_and_a_long_picture_is_told_of_before_it_begins() -> None:
    field = ss.RegularField(_values(), radius=30)
    scene, camera = ss.Scene(field, FUNCTION), ss.Camera.fit(field)
    plan = ss.Renderer("cpu", threads=1).plan(scene, camera, size=(800, 800))
    assert plan.expected_seconds is not None and plan.expected_seconds > module.LONG
    assert f"time       about {about(plan.expected_seconds)}" in str(plan)
    assert plan.to_dict()["expected_seconds"] == plan.expected_seconds
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        with pytest.raises(ss.Cancelled):
            # Stopped before anything is drawn.
            ss.Renderer("cpu", threads=1).render(scene, camera, (800, 800), progress=lambda share: False)
    said = [str(one.message) for one in found if "takes about" in str(one.message)]
    assert len(said) == 1 and "times a slice cuts a kernel" in said[0] and "radius" in said[0] and "minutes" in said[0]


def test_nothing_is_said_of_a_short_picture_nor_where_a_goal_bounds_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    field = ss.RegularField(_values())
    with warnings.catch_warnings():
        warnings.simplefilter("error", ss.PictureWarning)
        ss.render(field, size=(64, 64), backend="cpu")
    monkeypatch.setattr(module, "LONG", 0.0)
    with pytest.warns(ss.PictureWarning, match="takes about"):
        ss.render(field, size=(64, 64), backend="cpu")
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        ss.render(field, size=(64, 64), backend="cpu", max_seconds=5.0)
    assert not [one for one in found if "takes about" in str(one.message)]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.0, "0.001 s"), (0.013, "0.01 s"), (0.96, "1.0 s"), (41.0, "40 s"), (200.0, "3 minutes"), (9000.0, "2 hours")],
)
def test_times_in_words(seconds: float, words: str) -> None:
    assert about(seconds) == words

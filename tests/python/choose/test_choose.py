"""What a picture leaves open is chosen once: each thing by one module, with its value, a reason, and who decided."""

from __future__ import annotations

import ast
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.api import prepare
from sheetsplat.options.core import definitions
from sheetsplat.options.scene import SceneOptions

SMALL: dict[str, Any] = {"size": (24, 20), "backend": "cpu", "threads": 1}
AXES = np.mgrid[-1:1:14j, -1:1:15j, -1:1:16j]
BALL = np.exp(-3.0 * (AXES**2).sum(axis=0))
PARTS = np.random.default_rng(7)
GRAINS = ss.EllipsoidField(PARTS.random((60, 3)), np.full(60, 0.004), None, PARTS.random(60), normalization="none")
CLOUD = ss.EllipsoidField(PARTS.random((60, 3)), 0.1 + 0.1 * PARTS.random(60), None, PARTS.random(60))

PICTURES = {
    "lit volume": (BALL, {"quality": "best"}),
    "surface": (BALL, {"mode": "isosurface", "depth_cue": "auto"}),
    "block": (np.full((6, 6, 6), 2.0), {"mode": "xray", "direction": "x"}),
    "decades": (10.0 ** (-6.0 * np.sqrt((AXES**2).sum(axis=0))), {"ambient_occlusion": True}),
    "cloud": (CLOUD, {}),
    "sum of grains": (GRAINS, {"mode": "xray"}),
    "two": ([ss.RegularField(BALL), CLOUD], {"quality": "draft"}),
    "goal": (BALL, {"max_error": 2e-2}),
}


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_makes_its_scene_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    data, options = PICTURES[name]
    made, native = [], _sheetsplat.Scene

    def counted(*args: Any, **keywords: Any) -> Any:
        made.append(keywords)
        return native(*args, **keywords)

    monkeypatch.setattr(_sheetsplat, "Scene", counted)
    image = ss.render(data, **SMALL, **options)
    assert len(made) == 1
    # The count sees others too.
    _ = image.plan, ss.Scene(CLOUD, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)]).replace(opacity_stop=1)
    assert len(made) == 3


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize("name", PICTURES)
def test_each_decision_has_its_value_and_a_reason(name: str) -> None:
    data, options = PICTURES[name]
    picture = prepare(data, **SMALL, **options)
    decisions, scene = picture.decisions, picture.scene
    assert decisions is not None and decisions.scene is scene and decisions.of("camera").value is picture.camera
    assert decisions.of("transfer_function").value == scene.transfer_function
    for option in definitions(SceneOptions):
        found = decisions.of(option)
        value = {"slice_spacing": scene.slice_spacing, "filter": scene.filter or "off"}.get(option)
        assert found.value == (scene.options[option] if value is None else value), option
        goal = "max_error" in options and option == "slice_spacing"
        assert (found.by == "caller") == (option in options or goal), option
    assert all(one.reason and one.by in ("caller", "data", "quality", "default") for one in decisions.made)
    assert len({one.option for one in decisions.made if one.option not in ("prefilter", "radius", "falloff")}) == len(
        [one for one in decisions.made if one.option not in ("prefilter", "radius", "falloff")]
    )
    # What a quality set is said by plans, in the same order for every picture.
    assert scene.quality is not None
    told = [one for one in scene.quality.settings if one.option not in ("prefilter", "radius", "falloff")]
    stop = ["opacity_stop"] if scene.mode == "composite" else []
    assert [one.option for one in told] == ["slice_spacing", *stop, "supersampling", "filter"]
    assert all(one.given == (decisions.of(one.option).by == "caller") for one in told)


def test_who_decides() -> None:
    def by(option: str, data: Any = BALL, **options: Any) -> str:
        picture = prepare(data, **SMALL, **options)
        assert picture.decisions is not None
        return picture.decisions.of(option).by

    assert by("slice_spacing") == "quality"
    assert by("slice_spacing", slice_spacing=0.5) == "caller"
    assert by("slice_spacing", max_error=1e-2) == "caller"
    assert by("slice_spacing", quality="draft") == "default"
    assert by("iso_value", mode="isosurface") == "data"
    assert by("iso_value", mode="isosurface", iso_value=0.5) == "caller"
    assert by("transfer_function") == "data" and by("transfer_function", transfer_function="ct_bone") == "caller"
    assert by("prefilter") == "quality" and by("prefilter", prefilter=False) == "caller"
    assert by("prefilter", ss.RegularField(BALL, prefilter=True)) == "caller"
    scene = ss.Scene(CLOUD, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
    assert by("filter", scene) == by("slice_spacing", scene) == "caller"


def test_decisions_stay() -> None:
    decisions = prepare(BALL, **SMALL).decisions
    assert decisions is not None
    with pytest.raises(dataclasses.FrozenInstanceError):
        decisions.made = ()  # type: ignore[misc]
    with pytest.raises(KeyError):
        decisions.of("nothing")


def test_what_is_wrong_with_the_scene_comes_first() -> None:
    with pytest.raises(ss.InvalidInput, match="slice_spacing"):
        ss.render(BALL, **SMALL, slice_spacing=-1.0, zoom=-1.0)
    with pytest.raises(ss.InvalidInput, match="zoom"):
        ss.render(BALL, **SMALL, zoom=-1.0)


def test_one_module_decides_on_each_option() -> None:
    deciders: dict[str, set[str]] = {}
    for path in Path(ss.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Decision":
                if isinstance(node.args[0], ast.Constant):
                    deciders.setdefault(str(node.args[0].value), set()).add(path.name)
    assert {option: sorted(where) for option, where in deciders.items()} == {
        "labels": ["kernels.py"],
        "normalization": ["kernels.py"],
        "prefilter": ["kernels.py"],
        "radius": ["kernels.py"],
        "falloff": ["kernels.py"],
        "slice_spacing": ["slices.py"],
        "opacity_stop": ["pixels.py"],
        "supersampling": ["pixels.py"],
        "filter": ["pixels.py"],
    }


def test_the_engine_has_the_same_lengths() -> None:
    empty = ss.EllipsoidField(np.empty((0, 3)), np.empty(0), None, np.empty(0))
    volume = ss.RegularField(BALL, spacing=(0.5, 1.0, 2.0))
    bcc = ss.RegularField(BALL, lattice="bcc")
    for fields in ([volume], [CLOUD], [volume, CLOUD, empty], [bcc, GRAINS], [empty]):
        for lengths in ({}, {"slice_spacing": 0.25}, {"reference_length": 3.0}):
            scene = ss.Scene(fields, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], **lengths)
            found = scene.native.slice_distance, scene.native.reference_distance
            assert found == (scene.slice_spacing, scene.reference_length)

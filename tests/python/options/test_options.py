"""One definition of each option: what is made of it, and that nothing is left out."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

import sheetsplat as ss
from sheetsplat.cli.accuracy import command as accuracy_command
from sheetsplat.cli.help import FIRST, GroupedOption, titles
from sheetsplat.cli.plan import command as plan_command
from sheetsplat.cli.render import command as render_command
from sheetsplat.options.core import MODES, SCALAR, choices_of, definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.film import AnimateOptions, TurntableOptions
from sheetsplat.options.page import GROUPS, page
from sheetsplat.options.picture import LookOptions, RenderOptions, unused
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.options.spelling import flag_of, flags, spellings
from sheetsplat.options.workers import WorkerOptions

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "python" / "docs"
TAKERS = [
    (ss.render, RenderOptions),
    (ss.open, OpenOptions),
    (ss.Scene, SceneOptions),
    (ss.Renderer, RendererClassOptions),
    (ss.turntable, TurntableOptions),
    (ss.animate, AnimateOptions),
]


def test_the_page_is_current():
    assert (DOCS / "options.md").read_text(encoding="utf-8") == page(), (
        "python -m sheetsplat.options.page > python/docs/options.md"
    )


@pytest.mark.parametrize(("taker", "group"), TAKERS)
def test_signatures_and_docstrings_have_every_option(taker, group):
    names = list(definitions(group))
    parameters = inspect.signature(taker).parameters
    own, more = ["backend"] if taker is ss.Renderer else [], ["color_by"] if taker is ss.Scene else []
    keywords = [name for name, one in parameters.items() if one.kind is inspect.Parameter.KEYWORD_ONLY]
    assert own + keywords == more + names
    assert [name for name in names if not re.search(rf"^    {name} : ", taker.__doc__, re.MULTILINE)] == []
    assert "{" not in taker.__doc__ and "**options" not in taker.__doc__
    assert max(map(len, taker.__doc__.splitlines())) <= 120


@pytest.mark.parametrize("command", [render_command, plan_command, accuracy_command])
def test_commands_have_every_option(command):
    by_parameter = {one.name: one for one in command.params if isinstance(one, click.Option)}
    for name, defined in definitions(RenderOptions).items():
        # No workers are asked for a plan.
        if name in definitions(WorkerOptions) and command is not render_command:
            continue
        for spelling in defined.spellings:
            option = by_parameter[spelling.parameter or name]
            assert flags(name, spelling).partition("/")[0] in option.opts
            assert option.help and "{" not in option.help
            if defined.modes != MODES:
                assert f"[{', '.join(defined.modes)}" in option.help
            if name == (spelling.parameter or name) and choices_of(defined.type) and spelling.value is None:
                if not spelling.switch and "/" not in flags(name, spelling):
                    assert tuple(option.type.choices) == choices_of(defined.type)


def test_defaults_are_of_the_types_and_pass_the_checks():
    for group in (SceneOptions, RendererClassOptions):
        for name, defined in definitions(group).items():
            choices = choices_of(defined.type)
            if choices and isinstance(defined.default, str):
                assert defined.default in choices
            assert defined.check is not None, name
            defined.check(name, defined.default)


def cpp_defaults(header: str, start: str) -> dict[str, object]:
    """Return the defaults that a C++ header states between `start` and the end of its block: numbers, names, flags."""
    text = (ROOT / "cpp" / "include" / "sheetsplat" / header).read_text(encoding="utf-8")
    block = text.partition(start)[2].partition(");" if start.endswith("(") else "\n}")[0]
    if start.startswith("#define"):
        # A row of a table for each: X(type, name, value, ...).
        block = re.sub(r"X\(\S+, (\w+), ([\w.:{}]+), .*", r"\1 = \2", block.partition("// clang-format on")[0])
    assert block, start
    constants = dict(re.findall(r"^constexpr double (\w+) = ([\d.]+);", text, re.MULTILINE))
    found: dict[str, object] = {}
    for name, value in re.findall(r"(\w+) = ([\w.:]+)", re.sub("//.*", "", block)):
        word = value.rpartition("::")[2]
        word = constants.get(word, word)
        found[name] = {"true": True, "false": False, "automatic": "auto"}.get(word, word)
        if re.fullmatch(r"[\d.]+", word):
            found[name] = float(word)
    return found


@pytest.mark.parametrize(
    ("header", "start", "taker", "others"),
    [
        ("field.hpp", "struct RegularFieldOptions {", ss.RegularField, {}),
        ("field.hpp", "struct EllipsoidFieldOptions {", ss.EllipsoidField, {}),
        ("camera.hpp", "Camera fit(", ss.Camera.fit, {"projection": "kind"}),
        ("scene.hpp", "struct Material {", ss.Material, {}),
        ("scene.hpp", "#define SHEETSPLAT_SCENE_OPTIONS", ss.Scene, {}),
        ("renderer.hpp", "struct RendererOptions {", ss.Renderer, {}),
    ],
)
def test_defaults_are_those_of_cpp(header, start, taker, others):
    python = {name: one.default for name, one in inspect.signature(taker).parameters.items()}
    cpp = {others.get(name, name): value for name, value in cpp_defaults(header, start).items()}
    # Python has it as a value of preintegration.
    cpp.pop("second_order", None)
    # Of parts of larger fields.
    cpp.pop("least_weight", None)
    assert len(cpp) >= 3
    # What Python leaves out with None is 0, false or a name in C++.
    unset = {
        "filter": "none",
        "prefilter": False,
        "cut_faces": False,
        "tile_size": 0.0,
        "tags_per_clear": 0.0,
        "threads": 0.0,
    }
    assert cpp == {name: unset[name] if python[name] is None else python[name] for name in cpp}


def test_spellings():
    assert flag_of("iso_value") == "--iso" and flag_of("fov_y") == "--fov" and flag_of("clip_planes") == "--clip-plane"
    assert flag_of("max_error") == "--max-error" and flag_of("depth") == "--depth"
    assert "scalar_colors" not in spellings() and "camera" not in spellings()


def test_modes_and_their_options():
    assert unused("composite", definitions(LookOptions)) == ["log_scale", "iso_value", "scalar_colors"]
    assert unused("isosurface", ["opacity", "cmap", "depth", "second_order"]) == ["opacity", "second_order"]
    assert unused("mip", ["depth_cue_color", "depth", "coverage", "slice_spacing"]) == ["depth_cue_color", "depth"]
    assert definitions(LookOptions)["clim"].modes == MODES and definitions(LookOptions)["log_scale"].modes == SCALAR


@pytest.mark.parametrize(
    ("call", "near"),
    [
        (lambda field: ss.render(field, colormap="gray", cmpa="gray"), None),
        (lambda field: ss.render(field, cmpa="gray"), "cmap"),
        (lambda field: ss.open("nothing.npy", spacings=(1, 1, 1)), "spacing"),
        (lambda field: ss.Scene(field, [(0, 1, 1, 1, 1)], slice_spacings=1), "slice_spacing"),
        (lambda field: ss.Scene(field, [(0, 1, 1, 1, 1)]).replace(lighst=()), "lights"),
        (lambda field: ss.Renderer("reference", thread=1), "threads"),
    ],
)
def test_wrong_names_are_answered_with_the_nearest_ones(call, near):
    """Such an error is the package's own and, as Python has it, a TypeError."""
    with pytest.raises(
        ss.InvalidInput, match="no option of this name" if near is None else f"did you mean {near}"
    ) as e:
        call(ss.RegularField(np.zeros((2, 2, 2))))
    assert isinstance(e.value, TypeError)


def test_the_short_way_is_short():
    lines, _ = inspect.getsourcelines(ss.render)
    assert len(lines) <= 40


def test_effects_of_options_are_effects_of_the_plan():
    scene = ss.Scene(ss.RegularField(np.ones((3, 3, 3))), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)])
    known = {effect.name for effect in ss.Renderer("cpu").plan(scene, ss.Camera.fit(scene), size=(8, 8)).effects}
    assert {one.effect for one in definitions(SceneOptions).values() if one.effect} <= known


def test_errors_name_their_option():
    field = ss.RegularField(np.zeros((2, 2, 2)))
    for call, option in (
        (lambda: ss.Scene(field, [(0, 1, 1, 1, 1)], opacity_stop="much"), "opacity_stop"),
        (lambda: ss.Renderer("cpu", threads=0), "threads"),
        (lambda: ss.render(field, cmpa="gray"), "cmpa"),
    ):
        with pytest.raises(ss.InvalidInput) as caught:
            call()
        assert caught.value.option == option


@pytest.mark.parametrize("command", [render_command, plan_command, accuracy_command])
def test_help_is_one_screen_or_all_in_groups(command):
    first, every = (CliRunner().invoke(command, [flag], prog_name="x") for flag in ("--help", "--help-all"))
    assert first.exit_code == every.exit_code == 0
    assert set(FIRST) <= set(titles())
    placed = {one.name: one.group for one in command.params if isinstance(one, GroupedOption)}
    for title, groups in GROUPS:
        known = [one for group in groups for one in definitions(group).items()]
        names = [spelling.parameter or name for name, defined in known for spelling in defined.spellings]
        shown = any(one.name in names and placed.get(one.name, title) == title for one in command.params)
        assert (f"\n{title}:\n" in every.output) == shown
        assert f"\n{title}:\n" not in first.output
    flags_there = {flag for one in command.params if isinstance(one, click.Option) for flag in one.opts}
    assert [flag for flag in flags_there if flag not in every.output] == []
    assert "\n  --falloff" not in first.output and "\n  --cmap" in first.output
    assert len(first.output) < 0.5 * len(every.output)

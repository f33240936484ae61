"""Time and error against the reference with and without each of the papers' techniques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import sheetsplat as ss
from bench.generators import flows
from bench.lab import lab_renderer
from bench.measure import Judge, attempt, device_of, difference, frames_and_error, need_gl, orbit, renderer_for, require
from bench.report import Options, Report, Row, columns, environment
from sheetsplat import datasets
from sheetsplat.bcc import resample_to_bcc


@dataclass(frozen=True)
class _Setting:
    """One way to draw a scene."""

    group: str
    name: str
    scene: str
    renderer: dict[str, Any] = field(default_factory=dict)
    paper: str = ""
    comparators: tuple[str, ...] = ()


def _off(effect: str) -> dict[str, Any]:
    return {"effects": {effect: False}, "allow_inexact": True}


def _on(*effects: str) -> dict[str, Any]:
    return {"effects": dict.fromkeys(effects, True), "allow_inexact": True}


# Within a group the others are compared with the first setting. The paper's remarks: sections 4.1 to 4.4 and 5.
_SETTINGS = (
    _Setting("points", "points", "ball"),
    _Setting("points", "quads", "ball", {}, "1.2 to 1.3 times slower", ("quads",)),
    _Setting("vertex arrays", "arrays a slab", "tubes"),
    _Setting("vertex arrays", "a call a kernel", "tubes", comparators=("single_calls",)),
    _Setting("channels", "four slabs at a time", "ball", {"packing": "paper"}),
    _Setting("channels", "one slab at a time", "ball", {"packing": "paper"}, "3 times slower", ("one_slab",)),
    _Setting("packing", "paper", "ball", {"packing": "paper"}),
    _Setting("packing", "wide", "ball", {"packing": "wide"}),
    *(
        _Setting("skipping", name, scene, {"tagging": name}, paper)
        for scene in ("tubes", "ball")
        for name, paper in (("off", ""), ("depth_bounds", "1.2 times faster"), ("depth_equal", ""), ("tiles", ""))
    ),
    *(
        _Setting("elimination", name, scene, settings)
        for scene in ("opaque ball", "ball surface")
        for name, settings in (("off", _off("elimination")), ("on", _on("elimination")))
    ),
    *(
        _Setting("opacity buffer", name, scene, settings, comparators=comparators)
        for scene in ("opaque ball", "ball surface")
        for name, settings, comparators in (
            ("off", _off("opacity_buffer"), ()),
            ("minimum", _on("opacity_buffer"), ()),
            ("average", _on("opacity_buffer"), ("average_opacity",)),
        )
    ),
    _Setting("buffers", "32 bits", "ball", {"precision": "float32"}),
    _Setting("buffers", "16 bits", "ball", {"precision": "float16", "allow_inexact": True}, "16 bits are adequate"),
    _Setting("buffers", "8 bits", "ball", {"precision": "uint8", "allow_inexact": True}),
    _Setting("lattice", "Cartesian", "vortex"),
    _Setting("lattice", "BCC", "vortex BCC", paper="up to 30 % fewer kernels, more slices, slower as a rule"),
    _Setting("lattice", "Cartesian", "signal"),
    _Setting("lattice", "BCC", "signal BCC"),
    _Setting("shading", "after splatting", "tubes near"),
    _Setting("shading", "before splatting", "tubes near", {}, "blurs zoomed views", ("preshaded",)),
)

#: Names of the techniques, which are what can be run alone.
ROWS = tuple(dict.fromkeys(setting.group for setting in _SETTINGS))


@dataclass(frozen=True)
class _Stage:
    """A scene with its cameras; made once, so that all settings share one reference picture."""

    scene: ss.Scene
    cameras: list[ss.Camera]
    # Name of the scene on the Cartesian lattice, where this is its BCC resampling.
    cartesian: str = ""


def _stages(options: Options) -> dict[str, Callable[[], _Stage]]:
    edge = options.edge(128)

    def around(scene: ss.Scene, cartesian: str = "", zoom: float = 1.0) -> _Stage:
        cameras = [
            ss.Camera.orthographic(camera.eye, camera.target, camera.up, height=camera.height / zoom)
            for camera in orbit(scene.fields[0], options.views)
        ]
        return _Stage(scene, cameras, cartesian)

    def opaque() -> _Stage:
        points = [(0.0, 0.2, 0.3, 0.6, 0.0), (60.0, 0.2, 0.3, 0.6, 0.0), (150.0, 1.0, 0.85, 0.6, 0.6)]
        return around(datasets.noisy_ball(edge).scene(transfer_function=ss.TransferFunction(points)))

    def surface() -> _Stage:
        return around(datasets.noisy_ball(edge).scene(mode="isosurface", iso_value=80.0))

    def bcc(made: datasets.Dataset, name: str) -> _Stage:
        field = resample_to_bcc(made.values, made.spacing, made.origin).field()
        # Opacity stays per the Cartesian distance: the default would be the BCC lattice's shorter one.
        return around(made.scene(field=field, reference_length=min(made.spacing)), name)

    vortex = partial(flows.vortex, edge)
    signal = partial(datasets.marschner_lobb, options.edge(64), 3.0)
    return {
        "ball": lambda: around(datasets.noisy_ball(edge).scene()),
        "ball surface": surface,
        "opaque ball": opaque,
        "tubes": lambda: around(datasets.tubes(edge).scene()),
        "tubes near": lambda: around(datasets.tubes(edge).scene(), zoom=4.0),
        "vortex": lambda: around(vortex().scene()),
        "vortex BCC": lambda: bcc(vortex(), "vortex"),
        "signal": lambda: around(signal().scene()),
        "signal BCC": lambda: bcc(signal(), "signal"),
    }


def _row(setting: _Setting, stages: dict[str, _Stage], options: Options, judge: Judge) -> Row:
    stage = stages[setting.scene]
    renderer = lab_renderer(options, *setting.comparators, **setting.renderer)
    plan = renderer.plan(stage.scene, stage.cameras[0], size=options.size)
    require(plan, setting.renderer)
    if any(other.comparators for other in _SETTINGS if other.group == setting.group):
        need_gl(plan, setting.group)
    names = (setting.group, setting.scene, setting.name)
    row, _, _ = frames_and_error(options, judge, renderer, stage.scene, stage.cameras, *names)
    if stage.cartesian:
        # Both through the Cartesian view's camera; the other lattice's box would give another one.
        other = stages[stage.cartesian]
        expected = judge.reference(other.scene, other.cameras[0])
        picture = renderer.render(stage.scene, other.cameras[0], size=expected.size)
        row["cartesian_rmse"] = difference(picture, expected)["rmse"]
    return row


def run(options: Options) -> Report:
    """Run every setting; ``options.rows`` choose techniques."""
    options = options.preferring("gl")
    makers = _stages(options)
    stages: dict[str, _Stage] = {}
    judge = Judge(options.size, options.reference_seconds)
    rows: list[Row] = []
    first: dict[tuple[str, str], float] = {}
    for setting in _SETTINGS:
        if not options.wants(setting.group):
            continue
        options.say(f"{setting.group}: {setting.name}, {setting.scene}")
        base = setting.scene.removesuffix(" BCC")
        for name in (setting.scene, base):
            if name not in stages:
                stages[name] = makers[name]()
        row: Row = {"group": setting.group, "row": setting.name, "scene": setting.scene}
        row |= attempt(partial(_row, setting, stages, options, judge))
        if setting.paper:
            row["paper"] = setting.paper
        if "cpu_ms" in row:
            row["ratio"] = row["cpu_ms"] / first.setdefault((setting.group, base), row["cpu_ms"])
        rows.append(row)
    return Report(
        name="ablation",
        title=f"Time and error with and without each technique, at {options.size[0]}x{options.size[1]}, shaded",
        columns=columns(
            "group=technique, row=setting, scene, kernels_drawn, splats, slices, wall_ms, cpu_ms, "
            "ratio=cpu over first, rmse, p99_9, maximum, "
            "cartesian_rmse=rmse to Cartesian, error_size, paper=the paper says, remark"
        ),
        rows=rows,
        notes=[
            options.views_note,
            "cpu over first: cpu time over that of the first setting of the technique on that scene.",
            options.error_note,
            "rmse to Cartesian: distance of the BCC lattice's picture from the Cartesian lattice's reference picture.",
        ],
        environment=environment(device_of(renderer_for(options))),
    )

"""What each effect of a plan costs: the same picture, drawn with it and without."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Any

from sheetsplat.errors import Error
from sheetsplat.plan import Effect, RenderPlan
from sheetsplat.scene import Scene

# Draws one picture of a scene with these outputs and with these effects forced, over those that the renderer forces.
# Returns its plan.
Draw = Callable[[Scene, tuple[str, ...], dict[str, bool]], RenderPlan]

# Effects that the scene asks for by an option of their own, and how it does without.
_WITHOUT: dict[str, dict[str, Any]] = {
    "ewa_filter": {"filter": None},
    "slab_sampling": {"sampling": "point"},
    "preintegration": {"preintegration": False},
    "background": {"background": None},
    "clip": {"clip": None},
    "analytic_gradient": {"gradient": "sheets"},
    "gradient_opacity": {"gradient_opacity": None},
    "depth_cue": {"depth_cue": None},
    "second_order": {"preintegration": True},
    "shadows": {"shadows": False},
    "ambient_occlusion": {"ambient_occlusion": None},
}
# Effects that are the point of the picture, or of the machine: without them it would be another one.
_FIXED = frozenset(
    {
        "classification",
        "isosurface",
        "normalization",
        "several_fields",
        "separate_normalization",
        "scattered_kernels",
        "perspective",
        "sums",
        "float64",
        "ambient_only",
        "eye_lights",
        "world_lights",
        "tagging",
    }
)
# Ways of drawing for comparison alone, or figures of benchmarks: not what a picture pays for.
_FOR_COMPARISON = frozenset({"paper_slicing", "gather", "preshaded", "bare_fill", "count_fragments"})
_OUTPUTS = ("coverage", "depth")


class _Way:
    """A picture with one effect the other way."""

    def __init__(self, scene: Scene, outputs: tuple[str, ...], effects: dict[str, bool]) -> None:
        self.scene = scene
        self.outputs = outputs
        self.effects = effects


def _other_way(effect: Effect, scene: Scene, outputs: tuple[str, ...]) -> _Way | None:
    """Return how to draw the picture with the effect turned the other way, or None where it cannot be."""
    if effect.name in _FIXED or effect.name in _FOR_COMPARISON:
        return None
    if effect.name in _OUTPUTS:
        if effect.on:
            return _Way(scene, tuple(name for name in outputs if name != effect.name), {})
        return _Way(scene, (*outputs, effect.name), {})
    if effect.name in _WITHOUT and effect.on:
        return _Way(scene.replace(**_WITHOUT[effect.name]), outputs, {})
    return _Way(scene, outputs, {effect.name: not effect.on})


def _milliseconds(draw: Draw, way: _Way) -> float:
    began = time.perf_counter()
    draw(way.scene, way.outputs, way.effects)
    return 1e3 * (time.perf_counter() - began)


def _turns(draw: Draw, way: _Way, effect: Effect) -> bool:
    """Draw a first picture the other way. Returns False where that cannot be had, or changes nothing."""
    try:
        plan = draw(way.scene, way.outputs, way.effects)
    except Error:
        # Not every effect of a list can be had together with the others.
        return False
    return plan.has(effect.name) != effect.on


def measured_plan(plan: RenderPlan, scene: Scene, outputs: tuple[str, ...], draw: Draw, repeats: int) -> RenderPlan:
    """Return the plan with the cost of each effect that can be turned the other way.

    Pictures with and without an effect take turns, so that a machine that gets slower does so for both; each is drawn
    once before anything is timed, which makes what is kept between pictures. Costs are medians of differences
    between neighbours: noise of a few per cent of the picture is in them, more on a busy machine, and they do not add
    up, since effects share work.

    Parameters
    ----------
    plan
        Of the picture as it is.
    scene, outputs
        The picture.
    draw
        Draws it; for forced effects it may keep renderers of its own.
    repeats
        Pictures of each kind that are timed.
    """
    base = _Way(scene, outputs, {})
    draw(base.scene, base.outputs, base.effects)
    all_times = [_milliseconds(draw, base)]
    effects: list[Effect] = []
    for effect in plan.effects:
        way = _other_way(effect, scene, outputs)
        cost = None
        if way is not None and _turns(draw, way, effect):
            pairs = [(_milliseconds(draw, base), _milliseconds(draw, way)) for _ in range(repeats)]
            longer = median(first - second for first, second in pairs)
            cost = longer if effect.on else -longer
            all_times += [first for first, _ in pairs]
        effects.append(replace(effect, cost_ms=cost))
    return replace(plan, effects=tuple(effects), picture_ms=median(all_times))

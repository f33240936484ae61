"""The time that each effect of a plan costs: the same picture is drawn with it and without."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Any, NamedTuple

from sheetsplat.effect_names import FORCED_BY
from sheetsplat.errors import Cancelled, Error
from sheetsplat.options.core import definitions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.plan import Effect, RenderPlan
from sheetsplat.scene import Scene

# Draws one picture of a scene with these outputs and with these effects forced, over those that the renderer forces.
# Returns its plan.
Draw = Callable[[Scene, tuple[str, ...], dict[str, bool]], RenderPlan]

# Effects that an option of the scene switches on, and the option that switches them off.
_WITHOUT: dict[str, dict[str, Any]] = {
    **{one.effect: {name: one.default} for name, one in definitions(SceneOptions).items() if one.effect},
    "second_order": {"preintegration": True},
}
# For comparisons only: no plan switches it on by itself.
_FOR_COMPARISON = frozenset({"paper_slicing"})
_OUTPUTS = ("coverage", "depth")


class _Way(NamedTuple):
    """A picture with one effect switched."""

    scene: Scene
    outputs: tuple[str, ...]
    effects: dict[str, bool]


def _other_way(effect: Effect, scene: Scene, outputs: tuple[str, ...]) -> _Way | None:
    """Return how to draw the picture with an effect switched, or None where it cannot be switched."""
    if effect.name in _OUTPUTS:
        if effect.on:
            return _Way(scene, tuple(name for name in outputs if name != effect.name), {})
        return _Way(scene, (*outputs, effect.name), {})
    if effect.name in _WITHOUT and effect.on:
        return _Way(scene.replace(**_WITHOUT[effect.name]), outputs, {})
    if effect.name not in FORCED_BY.keys() - _FOR_COMPARISON:
        return None
    return _Way(scene, outputs, {effect.name: not effect.on})


def _milliseconds(draw: Draw, way: _Way) -> float:
    began = time.perf_counter()
    draw(*way)
    return 1e3 * (time.perf_counter() - began)


def _turns(draw: Draw, way: _Way, effect: Effect) -> bool:
    """Draw a first picture with an effect switched. Return False where that fails or does not switch it."""
    try:
        plan = draw(*way)
    except Cancelled:
        raise
    except Error:
        # Some combinations of effects are refused.
        return False
    return plan.has(effect.name) != effect.on


def measured_plan(plan: RenderPlan, scene: Scene, outputs: tuple[str, ...], draw: Draw, repeats: int) -> RenderPlan:
    """Return the plan with the cost of each effect that can be switched, as `Renderer.measure_effects` describes it.

    Pictures with and without an effect alternate, so that changes in the speed of the machine affect both. Each is
    drawn once before it is timed, to fill the caches.

    Parameters
    ----------
    plan
        Of the unchanged picture.
    scene, outputs
        The picture.
    draw
        Draws it; may keep renderers for forced effects.
    repeats
        Number of timed pictures of each kind.
    """
    base = _Way(scene, outputs, {})
    draw(*base)
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

"""What a page is told of a picture: its colour bars, its plan, and what lies under the pointer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.color_bar import color_bars
from sheetsplat.errors import Unsupported
from sheetsplat.image import Image
from sheetsplat.plan import RenderPlan
from sheetsplat.viewer.compose import hexadecimal
from sheetsplat.viewer.state import State, camera_parts


def bars_of(image: Image) -> list[dict[str, Any]]:
    """Return the colour bars of a picture as the page draws them."""
    return [
        {
            "label": bar.label,
            "low": bar.low,
            "high": bar.high,
            "log": bar.log,
            "marks": bar.marks,
            "names": bar.names,
            # Of labels one each.
            "colors": [hexadecimal(row) for row in bar.colors[_places(int(bar.high) if bar.names else 32)]],
        }
        for bar in color_bars(image)
    ]


def frame_message(image: Image, state: State, milliseconds: float, *, preview: bool) -> dict[str, Any]:
    """Return what a page is told of a frame but for its number and its bytes; `preview`: of coarse copies."""
    stats = image.stats
    return {
        "type": "frame",
        "size": image.size,
        "stage": 0 if preview else int(stats.get("stage", 1)),
        "stages": int(stats.get("stages", 1)),
        "last": not preview and stats.get("stage") == stats.get("stages"),
        "milliseconds": milliseconds,
        "error": None if preview else stats.get("estimated_rmse"),
        "camera": camera_parts(state.camera),
        "choice": state.choice,
        "time": state.time,
        "bars": bars_of(image),
    }


def _places(count: int) -> NDArray[np.int64]:
    """Return so many places in a table of 256 colours, each in the middle of its part."""
    return np.asarray((np.arange(count) + 0.5) * 256 / count, dtype=np.int64)


def about(image: Image, costs: Mapping[str, float | None]) -> dict[str, Any]:
    """Return the message with what the panels show of a complete picture; `costs`: milliseconds of effects."""
    return {"type": "about", "plan": _plan(image.plan, costs), "notes": image.plan.notes}


def _plan(plan: RenderPlan, costs: Mapping[str, float | None]) -> dict[str, Any]:
    effects = [
        {
            "name": one.name,
            "on": one.on,
            "why": one.reason,
            "forced": one.forced,
            "error": one.error,
            "milliseconds": costs.get(one.name),
        }
        for one in plan.effects
    ]
    settings = () if plan.quality is None else plan.quality.settings
    return {
        "rows": [
            ["backend", plan.backend + (f", {plan.device}" if plan.device else "")],
            ["precision", plan.precision],
            ["slices", f"{plan.slices}, {plan.slice_spacing:.4g} apart"],
            ["memory", f"{plan.memory / 1e6:.1f} MB beside the data"],
        ],
        "quality": [[one.option, _short(one.value), one.reason] for one in settings],
        "effects": effects,
        "budget": plan.error_budget,
        "expected": plan.expected_error,
    }


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def picked(image: Image | None, x: float, y: float, purpose: str) -> dict[str, Any]:
    """Return the message with what a picture shows at (x, y), shares of its width and height from the top left."""
    told: dict[str, Any] = {"type": "picked", "x": x, "y": y, "purpose": purpose, "value": None}
    if image is None or not (0 <= x < 1 and 0 <= y < 1):
        return told
    width, height = image.size
    try:
        found = image.pick(x * width, y * height)
    except Unsupported:
        # Kernels in bricks, which are not here.
        return told
    if found is None:
        return told
    field = image.recipe.fields[found.field]
    return {
        **told,
        "value": field.quantity.scalar(found.value),
        "label": field.quantity.label,
        "position": found.position,
        "length_unit": field.quantity.length_unit,
        "opacity": found.opacity,
        "gradient": found.gradient,
        "kernel": found.kernel,
        "sample": found.sample,
    }

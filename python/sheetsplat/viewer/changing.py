"""What a page asks to be changed, and the state after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sheetsplat.opacity_words import PRESETS
from sheetsplat.options.core import MODES
from sheetsplat.viewer import compose
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.state import OF_PAGES, State

# What a page knows less of than the session once it has asked for it.
_TOLD = (
    *(*OF_PAGES, "look", "choice", "time", "automatic", "mode", "quality", "surfaces", "effects", "background"),
    "color_by",
)


def state_after(shown: Shown, first: State, state: State, changes: Mapping[str, Any]) -> tuple[State, bool]:
    """Return the state after changes, and whether the page that asked must be told more than it knows.

    Parameters
    ----------
    shown
        The data.
    first
        The state before anything was changed.
    state
        What is shown.
    changes
        Values by name, as a page sends them. InvalidInput where one has no meaning.
    """
    told = not changes.keys().isdisjoint(_TOLD)
    for name, value in changes.items():
        if name in ("choice", "time"):
            state = state.numbered(name, value, len(shown.names if name == "choice" else shown.times))
        elif name == "look":
            given = value if isinstance(value, dict) else {}
            group = _group_of(shown, state, given)
            if group is None:
                continue
            if given.get("automatic"):
                state = state.with_curves(group, None)
            else:
                state = state.with_curves(group, compose.curves_of(shown, state, group).changed(given))
        elif name == "automatic":
            kept = {name: one for name, one in state.changes.items() if name in OF_PAGES}
            state = replace(state, changes={**kept, **first.changes}, curves={}, settings={})
        else:
            state = state.changed(name, value)
    return state, told


def _group_of(shown: Shown, state: State, look: Mapping[str, Any]) -> int | None:
    """Return the number of the group whose look a page changes; None where there is none."""
    group = look.get("group", 0)
    groups = len(shown.base(state.choice, 0, MODES[0]).scene.groups)
    return group if isinstance(group, int) and 0 <= group < groups else None


def unit_note(shown: Shown, state: State, look: object) -> str:
    """Return what is to be said of a preset that a page chose for data that are no Hounsfield units, or ""."""
    given = look if isinstance(look, dict) else {}
    preset = given.get("preset")
    if not isinstance(preset, str) or preset not in PRESETS or (group := _group_of(shown, state, given)) is None:
        return ""
    field = shown.base(state.choice, 0).scene.groups[group][0]
    unit = field.quantity.unit
    if unit == "HU":
        return ""
    low, high = field.value_range
    stated = f"have the unit {unit}" if unit else "state no unit"
    return (
        f"The preset {preset} is for CT in Hounsfield units. These data {stated} and reach from {low:.4g} to "
        f"{high:.4g}: what it shows is right only where these are Hounsfield units."
    )

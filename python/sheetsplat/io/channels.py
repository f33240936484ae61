"""Channels, colours and labels that files state: which channels are taken, what they are called, and their colours."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sheetsplat import notices
from sheetsplat._checks import Triple
from sheetsplat.errors import Error, option_ref
from sheetsplat.io.checks import Where, listed, printable, unreadable
from sheetsplat.io.records import Channel, Volume
from sheetsplat.labels import LabelColors

# Channels that are opened together.
_MOST = 64
# Labels whose colours a file may state: more than any picture tells apart.
_MOST_LABELS = 4096
# Of channels without a colour, in the order of ImageJ; those after them have colours of labels.
_SHADES: tuple[Triple, ...] = (
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.4, 1.0),
    (1.0, 1.0, 1.0),
    (0.0, 1.0, 1.0),
    (1.0, 0.0, 1.0),
    (1.0, 1.0, 0.0),
)
_HEX = re.compile(r"#?([0-9A-Fa-f]{6})")


def chosen_channels(path: Where, count: int, told: Sequence[Channel], name: str | None) -> dict[int, Channel]:
    """Return the channels that are asked for by label or number, else all, by their numbers.

    Parameters
    ----------
    path
        For messages.
    count
        How many channels there are; where there is one, it has no colour and no name.
    told
        What is stated of them, from the first one on.
    name
        A label or a number.

    Raises
    ------
    InvalidInput
        For a channel that there is not, and for more than are opened together.
    """
    if count == 1 and name is None:
        return {0: Channel()}
    if count == 1 and not told:
        what = option_ref("name") + " for a file of one volume"
        raise unreadable(path, what, "it for files with several", "leave it out", option="name")
    given = [told[at] if at < len(told) else Channel() for at in range(min(count, 1000))]
    labels = [printable(one.name) or f"channel {at}" for at, one in enumerate(given)]
    names = [label if labels.count(label) == 1 else f"{label} {at}" for at, label in enumerate(labels)]
    shades = _shades([one.color for one in given])
    known = {at: replace(one, name=names[at], color=shades[at], number=at) for at, one in enumerate(given)}
    if name is None and count <= _MOST:
        return known
    number = -1
    if name in names:
        number = names.index(name)
    elif name is not None and name.isascii() and name.isdigit() and len(name) < 9:
        number = int(name)
    if not 0 <= number < count:
        raise several_channels(path, count, names)
    chosen = known.get(number, Channel(f"channel {number}", number=number))
    return {number: chosen if count > 1 else Channel()}


def several_channels(path: Where, count: int, names: Sequence[str]) -> Error:
    """Return the InvalidInput for channels of which one is wanted."""
    advice = "pass " + option_ref("name", "...") + ", its label or its number"
    return unreadable(path, f"{count} channels: {listed(names)}", "one of them", advice, option="name")


def _shades(stated: Sequence[Triple | None]) -> list[Triple]:
    """Return a colour for each channel: those that are stated, unless two are the same, else distinct ones."""
    known = [one for one in stated if one is not None]
    if len(set(known)) < len(known):
        stated = [None] * len(stated)
    further = LabelColors.distinct(range(1, len(stated) + 1)).colors.values()
    free = (one for one in itertools.chain(_SHADES, (rgba[:3] for rgba in further)) if one not in stated)
    return [next(free) if one is None else one for one in stated]


def only(path: Where, volumes: Sequence[Volume]) -> Volume:
    """Return the only volume of a file; InvalidInput for several channels."""
    if len(volumes) != 1:
        raise several_channels(path, len(volumes), [one.channel.name for one in volumes])
    return volumes[0]


def split(
    path: Where, volume: Volume, axis: int | None, told: Sequence[Channel] = (), name: str | None = None
) -> list[Volume]:
    """Return a volume for each channel, or the one that is asked for.

    Parameters
    ----------
    path
        For messages.
    volume
        Its values have a fourth axis, that of channels, or, where `axis` is None, none: it is the only channel.
    axis
        Which of its axes that is.
    told, name
        As for `chosen_channels`, which raises.
    """
    parts: Any = [volume.values] if axis is None else np.moveaxis(volume.values, axis, 0)
    known = chosen_channels(path, len(parts), told, name)
    return [replace(volume, values=parts[at], channel=channel) for at, channel in known.items()]


def color_of(told: object) -> Triple | None:
    """Return the colour that a file states as six hexadecimal digits or three numbers in [0, 1]; None for any other.

    Black is none: nothing would be seen of its channel.
    """
    found = _HEX.fullmatch(told) if isinstance(told, str) else None
    try:
        rgb = [byte / 255.0 for byte in bytes.fromhex(found[1])] if found else [float(one) for one in told]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return None
    usable = len(rgb) == 3 and all(0.0 <= one <= 1.0 for one in rgb) and any(rgb)
    return (rgb[0], rgb[1], rgb[2]) if usable else None


def window_of(low: object, high: object) -> tuple[float, float] | None:
    """Return the limits that a file states of a channel; None for what are none."""
    try:
        found = float(low), float(high)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return found if np.isfinite(found).all() and found[0] < found[1] else None


def label_colors(
    path: Where, colors: Iterable[tuple[int, Sequence[float]]], names: Mapping[int, str]
) -> LabelColors | None:
    """Return the names and colours that a file states of its labels; None where it states none.

    Parameters
    ----------
    path
        For messages.
    colors
        Labels with red, green and blue, and if wanted opacity; what is no colour is left out, and the background, 0.
    names
        What they are called.
    """
    known: dict[int, tuple[float, ...]] = {}
    for label, told in colors:
        rgba = [float(one) for one in told]
        if label and len(rgba) in (3, 4) and all(0.0 <= one <= 1.0 for one in rgba):
            known[label] = tuple(rgba)
    told_names = {label: text for label, name in names.items() if (text := printable(name))}
    if (most := max(len(known), len(told_names))) > _MOST_LABELS:
        notices.warn(f"{path}: names and colours of {most} labels are not used; pictures tell far fewer apart")
        return None
    return LabelColors(known, told_names) if known or told_names else None

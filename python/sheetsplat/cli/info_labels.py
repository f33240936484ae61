"""What `sheetsplat info` says of labels: that samples are labels, which there are, their names, colours and sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.cli.wording import spelled
from sheetsplat.errors import OptionRef

if TYPE_CHECKING:
    from sheetsplat.io.records import Volume

# Labels that are listed in a table; JSON has all.
_MOST_ROWS = 64
# How a table tells who said that samples are labels.
_BY = {"caller": "as given", "file": "as the file states", "samples": "few whole numbers between which nothing lies"}


def labels_of(volumes: Sequence[Volume], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is known of the labels of the volumes of a file.

    Parameters
    ----------
    volumes
        Its channels.
    options
        Those of `sheetsplat.open` that were given.

    Returns
    -------
    dict
        "labels": a dict for each label, with its channel where there are several, its number, name, red, green, blue
        and opacity (None: it is not shown), how many samples it has, and whether it is the background; "labels_by":
        "caller", "file" or "samples".
        Without labels nothing, or "whole_numbers": the few numbers of regions that might be labels.
    """
    from sheetsplat.fields.labelled import counts_of_labels, looks_of
    from sheetsplat.io.opening import labelled_options
    from sheetsplat.labels import LabelColors

    given = {name: one for name, one in options.items() if name == "labels"}
    listed: list[dict[str, Any]] = []
    for volume in volumes:
        if not labelled_options(volume, given).get("labels"):
            continue
        counts = counts_of_labels(volume.values)
        stated = None if isinstance(volume.labels, bool) else volume.labels
        known = LabelColors.completed(stated, counts)
        of_channel = {"channel": volume.channel.name} if len(volumes) > 1 else {}
        for label, count in counts.items():
            own = {"label": label, "name": known.names.get(label, ""), "color": known.colors.get(label)}
            listed.append({**of_channel, **own, "samples": count, "background": label == known.background})
    if listed:
        by_file = any(one.labels is not False for one in volumes)
        return {"labels": listed, "labels_by": "caller" if given else "file" if by_file else "samples"}
    first = volumes[0]
    if given or len(volumes) > 1 or first.values.ndim > 3 or not first.values.size:
        return {}
    looks = looks_of(first.values)
    return {"whole_numbers": list(looks.numbers)} if looks.regions else {}


def row_of_labels(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the row of a table that says whether samples are labels, or might be; none where neither."""
    from sheetsplat.fields.labelled import MOST_LABELS

    command = click.get_current_context().command
    as_values, as_labels = (spelled(OptionRef("labels", word), command) for word in ("false", "true"))
    if "labels" in report:
        by, count = report["labels_by"], sum(not one["background"] for one in report["labels"])
        told = f"{count}{' beside the background' * (count < len(report['labels']))}, {_BY[by]}"
        if by != "caller":
            told += f"; {as_values} shows them as values"
        if count > MOST_LABELS:
            told += f"; a picture tells at most {MOST_LABELS} apart: merge labels, or cut out a part"
        return [("labels", told)]
    if "whole_numbers" in report:
        numbers = report["whole_numbers"]
        shown = ", ".join(map(str, numbers[:8])) + (" ..." if len(numbers) > 8 else "")
        return [("values", f"{shown}, each in regions of its own; where they name things, {as_labels} shows these")]
    return []


def lines_of_labels(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a list of labels: number, name, colour with opacity, samples."""
    listed = report["labels"]
    rows = [
        (
            str(one["label"]),
            ": ".join(filter(None, (one.get("channel"), one["name"] or "background" * one["background"]))),
            _color(one["color"]),
            f"{one['samples']}",
        )
        for one in listed[:_MOST_ROWS]
    ]
    rows = [("label", "name", "colour", "samples"), *rows]
    numbers, names, colors, counts = (max(map(len, column)) for column in zip(*rows, strict=True))
    for number, name, color, count in rows:
        yield f"{number:>{numbers}}  {name:<{names}}  {color:<{colors}}  {count:>{counts}}"
    if len(listed) > _MOST_ROWS:
        yield f"... and {len(listed) - _MOST_ROWS} more; --json lists all"


def _color(rgba: Sequence[float] | None) -> str:
    if rgba is None:
        return "not shown"
    told = "#" + "".join(f"{int(one * 255 + 0.5):02x}" for one in rgba[:3])
    return told if rgba[3] == 1.0 else f"{told}, opacity {rgba[3]:g}"

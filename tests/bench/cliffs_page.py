"""The page of what effects cost, from the figures of ``./run bench cliffs interactive --output FOLDER``.

PYTHONPATH=tests .venv/bin/python -m bench.cliffs_page FOLDER > python/docs/costs.md
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.cliffs import steepest
from bench.effect_costs import EFFECTS

# Pairs that take so many times what their parts give are listed.
_STEEP = 1.5
_HEAD = """# What effects cost

Times of frames on backend `cpu` with an effect, divided by those of the plain frame: the lit composite of the same
field with the same slices. `./run bench cliffs interactive --output FOLDER` measures them, and
`python -m bench.cliffs_page FOLDER` (with `tests` on the path) writes this page.
[effects.md](effects.md) says what the effects are."""
_WHY = """[measurements.md](measurements.md) has the profiles of perspective, pre-integration, second order, analytic
gradients and shadows, and what was tried."""
_READING = """A figure is the least processor time of up to five frames, each from another direction, over that of the
plain frame; the two are drawn in turn, so that other load on the machine slows both. In brackets: the first frame with
the effect by a renderer that has drawn the plain scene, where it takes over 1.5 times as long as later ones. The
default lights move with the camera, so that their shadows are computed for every view. What is compared for `boundary`
is a volume that ends at its samples, as by default, with one that falls to its base there (`boundary="zero"`, the same
base), in mode composite or the mode that is named; for `cut faces` a clipped scene whose faces are lit by their own
direction with the same one lit by gradients alone."""


def _cell(row: dict[str, Any] | None) -> str:
    if row is None:
        return ""
    if "ratio" not in row:
        return "–"
    first = f" ({row['first_ratio']:.3g})" if row["first_ratio"] > 1.5 * row["ratio"] else ""
    return f"{row['ratio']:.3g}{first}"


def _aim(name: str) -> str:
    effect = EFFECTS[name]
    parts = [f"{one:g}" for one in (effect.wanted, effect.wanted_first) if one is not None]
    return parts[0] + (f" ({parts[1]})" if parts[1:] else "") if parts else ""


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)


def _effects(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of single effects: a line an effect, a column a field."""
    fields = list(dict.fromkeys(row["field"] for row in rows if "effects" in row))
    by_name = {(row["field"], row["row"]): row for row in rows}
    lines = [
        [name, _aim(name), *(_cell(by_name.get((field, name))) for field in fields)]
        for name in EFFECTS
        if any((field, name) in by_name for field in fields)
    ]
    return _table(["effect", "aim", *fields], lines)


def _above(rows: Sequence[dict[str, Any]]) -> str:
    """Return which single effects take longer than is aimed at, with the pages that say why."""
    found: dict[str, list[str]] = {}
    for row in rows:
        effect = EFFECTS.get(row.get("row", ""))
        if effect is None or "ratio" not in row:
            continue
        for time, aim, what in (
            (row["ratio"], effect.wanted, ""),
            (row["first_ratio"], effect.wanted_first, "first frame "),
        ):
            if aim is not None and time > aim:
                found.setdefault(effect.name, []).append(f"{row['field']} {what}{time:.3g}")
    lines = [f"- {name} ({_aim(name)}): {', '.join(found[name])}" for name in EFFECTS if name in found]
    return "\n".join([*lines, "", _WHY] if lines else ["None."])


def _plain(rows: Sequence[dict[str, Any]]) -> str:
    """Return the plain frames' times in words."""
    least: dict[str, float] = {}
    for row in rows:
        if "plain_ms" in row and all(EFFECTS[name].beside is None for name in row["effects"]):
            least[row["field"]] = min(least.get(row["field"], row["plain_ms"]), row["plain_ms"])
    return ", ".join(f"{field} {time:.3g}" for field, time in least.items())


def page(cliffs: dict[str, Any], interactive: dict[str, Any] | None = None) -> str:
    """Return the page of the benchmarks' figures, as their JSON files have them."""
    rows = cliffs["rows"]
    titles = [note for note in cliffs["notes"] if any(note.startswith(f"{row['field']}: ") for row in rows)]
    facts = "; ".join(f"{name}: {value}" for name, value in cliffs["environment"].items())
    pairs = [row for row in rows if len(row.get("effects", ())) == 2 and row.get("over", 0.0) > _STEEP]
    pairs.sort(key=lambda row: -float(row["over"]))
    measured = sum("ratio" in row for row in rows)
    parts = [
        _HEAD,
        _READING,
        f"{cliffs['title']}. {facts}. A load above 1 means that other work ran.",
        "\n".join(f"- {title}" for title in titles),
        f"Processor time of the plain frame, ms: {_plain(rows)}.",
        "## Each effect",
        _effects(rows),
        "### Above their aims",
        _above(rows),
        "## Pairs of effects",
        f"Of {measured} rows, these pairs take over {_STEEP:g} times the product of what their parts take alone, at "
        "least 1 each.",
        _table(
            ["field", "pair", "over the plain frame", "over the product"],
            [[row["field"], row["row"], f"{row['ratio']:.3g}", f"{row['over']:.3g}"] for row in pairs],
        )
        if pairs
        else "None.",
        "## The ten steepest",
        "\n".join(f"{n}. {text}" for n, text in enumerate(steepest(rows), 1)),
    ]
    if interactive is not None:
        parts += ["## Following the camera", *_interactive(interactive)]
    return "\n\n".join(parts) + "\n"


def _interactive(found: dict[str, Any]) -> list[str]:
    names = {
        "first_median": "first stage, median",
        "first_most": "95 %",
        "first_worst": "worst",
        "whole_median": "whole picture, median",
        "whole_most": "95 %",
        "whole_worst": "worst",
    }
    lines = [[row["row"], *(f"{row[name]:.3g}" if name in row else "–" for name in names)] for row in found["rows"]]
    facts = f"{found['title']}; load {found['environment']['load']}."
    return [
        f"{facts} Elapsed ms after a move of the camera. Aims: first stage 50 ms, whole picture 600 ms.",
        _table(["field", *names.values()], lines),
    ]


def main(arguments: Sequence[str]) -> None:
    """Print the page of a folder of figures."""
    (folder,) = map(Path, arguments)
    found = {name: folder / f"{name}.json" for name in ("cliffs", "interactive")}
    read = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in found.items() if path.is_file()}
    sys.stdout.write(page(read["cliffs"], read.get("interactive")))


if __name__ == "__main__":
    main(sys.argv[1:])

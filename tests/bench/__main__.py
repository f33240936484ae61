"""Command line of the benchmarks: ``./run bench NAME...``, which is ``python -m bench`` with ``tests`` on the path."""

from __future__ import annotations

import argparse
import json
import os
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import sheetsplat as ss
from bench import BENCHES, Options
from sheetsplat.options.renderer import BACKENDS

# Scenes that benchmarks share with tests.
sys.path.append(str(Path(__file__).resolve().parents[1] / "python"))


def _size(text: str) -> tuple[int, int]:
    """Return WxH, or N for NxN, as (width, height)."""
    width, _, height = text.partition("x")
    return int(width), int(height or width)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="./run bench", description="Run benchmarks and print their tables.", allow_abbrev=False
    )
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="benchmarks to run, or all; without a name: list what there is")
    add("--list", action="store_true", help="list the benchmarks and their rows")
    add("--size", type=_size, default=(400, 400), metavar="WxH", help="pixels of the timed pictures (400x400)")
    add("--views", type=int, default=5, help="views that are timed; for cpu: rounds of its six views (5)")
    add("--backend", choices=BACKENDS, default="auto", help="backend that is measured")
    add("--data", type=Path, help="folder of the measured volumes (SHEETSPLAT_DATA, else ../shared/data)")
    add("--row", dest="rows", action="append", default=[], help="run this row only; may be repeated")
    add("--scale", type=float, default=1.0, help="share of the usual edge of generated volumes (1)")
    add("--reference-seconds", type=float, default=10.0, help="approximate time allowed for a reference picture (10)")
    add("--pictures", type=Path, help="folder for the pictures")
    add("--output", "--out", type=Path, help="folder for NAME.txt, NAME.md and NAME.json")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON instead of tables")
    form.add_argument("--markdown", action="store_true", help="print tables as Markdown")
    add(
        "--columns",
        type=lambda text: text.split(","),
        metavar="NAME,...",
        help="columns of the table, by their JSON names",
    )
    add("--check", action="store_true", help="exit code 1 where a goal was missed")
    add("-q", "--quiet", action="store_true", help="do not print what is done next")
    return parser


def _print_list(as_json: bool) -> None:
    if as_json:
        found = {name: {"summary": bench.summary, "rows": list(bench.rows)} for name, bench in BENCHES.items()}
        print(json.dumps(found, indent=2))
        return
    width = max(map(len, BENCHES))
    for name, bench in BENCHES.items():
        print(f"{name:<{width}}  {bench.summary}")
        if bench.rows:
            indent = " " * (width + 2)
            rows = "rows: " + ", ".join(bench.rows)
            print(textwrap.fill(rows, 100, initial_indent=indent, subsequent_indent=indent + " " * 6))


def _write(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text + "\n", encoding="utf-8")
    os.replace(temporary, path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments name and return the exit code."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.list or not given.names:
        _print_list(given.json)
        return 0
    names = list(BENCHES) if given.names == ["all"] else given.names
    for name in names:
        if name not in BENCHES:
            parser.error(f"NAME: {name!r}: wanted one of: all, {', '.join(BENCHES)}")
        known = BENCHES[name].rows
        if strange := [row for row in given.rows if row not in known]:
            wanted = f"wanted one of: {', '.join(known)}" if known else f"{name} has no rows to choose from"
            parser.error(f"--row: {', '.join(map(repr, strange))}: {wanted}")
    try:
        options = Options(
            size=given.size,
            views=given.views,
            backend=given.backend,
            data=given.data,
            reference_seconds=given.reference_seconds,
            rows=tuple(given.rows),
            pictures=given.pictures,
            scale=given.scale,
            tell=None if given.quiet else lambda text: print(f"... {text}", file=sys.stderr, flush=True),
        )
    except ss.InvalidInput as error:
        parser.error(str(error))
    reached = True
    for name in names:
        report = BENCHES[name].run(options)
        if given.columns:
            shown = {column: report.columns.get(column, column) for column in given.columns}
            report = replace(report, columns=shown)
        print(report.to_json() if given.json else report.markdown() if given.markdown else report.table(), flush=True)
        if len(names) > 1:
            print()
        if not report.reached:
            reached = False
            print(f"{name}: a goal was missed", file=sys.stderr)
        if given.output is not None:
            given.output.mkdir(parents=True, exist_ok=True)
            _write(given.output / f"{name}.txt", report.table())
            _write(given.output / f"{name}.md", report.markdown())
            _write(given.output / f"{name}.json", report.to_json())
    return 1 if given.check and not reached else 0


if __name__ == "__main__":
    sys.exit(main())

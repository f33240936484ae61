#!/usr/bin/env python3
"""Run benchmarks and write what they say.

    python tests/bench/run_bench.py frame table2005 --output out/bench

Prints each table; with --output also writes NAME.txt and NAME.json there. With --check it ends with code 1 where a
figure that is to be reached was missed.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from sheetsplat.bench import BENCHES, Options


def _write(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text + "\n", encoding="utf-8")
    os.replace(temporary, path)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height or width)


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Run benchmarks.", epilog="; ".join(f"{b.name}: {b.summary}" for b in BENCHES.values())
    )
    parser.add_argument("names", nargs="*", default=list(BENCHES), help="benchmarks; all unless given")
    parser.add_argument("--size", type=_size, default=(400, 400), help="WxH of the timed pictures")
    parser.add_argument(
        "--views", type=int, default=5, help="views of an orbit that are timed; cpu: rounds of its six views"
    )
    parser.add_argument("--backend", default="auto", help="auto, cpu, gl or reference")
    parser.add_argument("--data", type=Path, help="folder of the measured volumes")
    parser.add_argument(
        "--reference-seconds", type=float, default=10.0, help="about how long one reference picture may take"
    )
    parser.add_argument(
        "--rows", nargs="+", default=(), help="rows or techniques to run, as sheetsplat bench --list has them"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="share of the usual edge of generated volumes")
    parser.add_argument("--output", type=Path, help="folder for NAME.txt and NAME.json")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures of table2005, ablation and cpu")
    parser.add_argument("--check", action="store_true", help="end with code 1 where a figure was missed")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in BENCHES]
    if unknown:
        parser.error(f"unknown benchmark {', '.join(unknown)}; there are {', '.join(BENCHES)}")
    options = Options(
        size=arguments.size,
        views=arguments.views,
        backend=arguments.backend,
        data=arguments.data,
        reference_seconds=arguments.reference_seconds,
        rows=tuple(arguments.rows),
        pictures=arguments.pictures,
        scale=arguments.scale,
        tell=lambda text: print(f"... {text}", file=sys.stderr, flush=True),
    )
    reached = True
    for name in arguments.names:
        report = BENCHES[name].run(options)
        print(report.table(), end="\n\n", flush=True)
        reached = reached and report.reached
        if arguments.output is not None:
            arguments.output.mkdir(parents=True, exist_ok=True)
            _write(arguments.output / f"{name}.txt", report.table())
            _write(arguments.output / f"{name}.json", report.to_json())
    return 1 if arguments.check and not reached else 0


if __name__ == "__main__":
    sys.exit(main())

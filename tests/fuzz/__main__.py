"""Command line: ``./run fuzz [files] [scenes] [soak]``, which is ``python -m fuzz`` with ``tests`` on the path."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import sheetsplat as ss
from fuzz import cases
from fuzz.book import Book
from fuzz.cases import Case
from fuzz.files import SpoiledFiles
from fuzz.limits import Clock
from fuzz.part import Part
from fuzz.scenes import RandomScenes
from fuzz.soak import LongRuns
from fuzz.tables import table
from fuzz.watch import Judge, Result, Stopped, batch

PARTS = {part.name: part for part in (SpoiledFiles, RandomScenes, LongRuns)}
#: Seconds in which one failure is made smaller.
_SHRINKING = 90.0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="./run fuzz",
        description="Attack by random files, scenes and long runs; failures are made smaller and kept.",
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}; without one: all")
    add("--minutes", type=float, default=10.0, help="end after this time, in which the process was not stopped (10)")
    add(
        "--output",
        "--out",
        type=Path,
        default=Path("out/fuzz"),
        help="folder, from whose state a run goes on (out/fuzz)",
    )
    add("--jobs", type=int, default=os.cpu_count() or 1, help="processes at once (as many as there are processors)")
    add(
        "--first",
        type=int,
        help="seed of the first case of each kind, in a new folder "
        f"({', '.join(f'{part.name}: {part.first}' for part in PARTS.values())})",
    )
    add("--cases", type=int, help="end after this many cases of each part, of all runs in the folder")
    add("--kind", dest="kinds", action="append", default=[], help="kind of files; may be repeated")
    add(
        "--shrinking",
        type=float,
        default=_SHRINKING,
        help=f"seconds in which a failure is made smaller ({_SHRINKING:g})",
    )
    add("--again", type=Path, metavar="FILE", help="judge the failure that a file keeps again, and nothing else")
    add("--list", action="store_true", help="list the parts and their kinds")
    return parser


def _without_folders(text: str) -> str:
    """Return a text with files named from the folder that they were installed in: failures are read elsewhere too."""
    folders = {str(Path(__file__).parents[2]), str(Path(ss.__file__).parents[1]), sys.prefix, sys.base_prefix}
    for folder in sorted(folders, key=len, reverse=True):
        text = text.replace(folder + os.sep, "")
    return text


class Attack:
    """A run of some parts: batches in child processes, failures made smaller, everything entered into the book.

    Parameters
    ----------
    parts
        What is run.
    book
        Where it is noted.
    shrinking
        Seconds in which a failure is made smaller.
    """

    def __init__(self, parts: Sequence[Part], book: Book, *, shrinking: float = _SHRINKING) -> None:
        self.parts = {part.name: part for part in parts}
        self.book, self.shrinking = book, shrinking
        self.stop = threading.Event()
        (book.folder / "failures").mkdir(exist_ok=True)

    def run(self, jobs: int) -> None:
        """Run batches, that many at once, until the book has no more."""
        threads = [threading.Thread(target=self._work) for _ in range(jobs)]
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():
                thread.join(0.5)

    def _work(self) -> None:
        try:
            while not self.stop.is_set() and (taken := self.book.take()) is not None:
                part = self.parts[taken.part]
                results = batch(part, taken.kind, taken.seeds, self.stop)
                kept = {one.seed: self._keep(part, taken.kind, one) for one in self.book.wanted(taken, results)}
                self.book.enter(taken, results, kept)
        except Stopped:
            pass
        except BaseException:
            self.stop.set()
            raise

    def _keep(self, part: Part, kind: str, result: Result) -> str:
        """Write a failure, as small as it is found, and return the name of its file."""
        outcome, clock = result.outcome, Clock(self.shrinking)
        case = part.case(kind, result.seed)

        with Judge(part, kind, self.stop) as judge:

            def wrong(less: Case) -> bool:
                nonlocal outcome
                if clock.is_over():
                    return False
                found = judge(less)
                if found.what != result.outcome.what:
                    return False
                outcome = found
                return True

            case = part.shrunk(case, wrong)
        name = re.sub(r"[^a-z0-9]+", "-", f"{part.name} {kind} {result.seed}".lower()) + ".json"
        content = {
            "part": part.name,
            "kind": kind,
            "seed": result.seed,
            "what": outcome.what,
            "text": _without_folders(outcome.text).splitlines(),
            "case": case,
        }
        cases.save(self.book.folder / "failures" / name, content)
        print(f"{part.name} {kind} {result.seed}: {outcome.what}", file=sys.stderr, flush=True)
        return name


def _again(path: Path, parser: argparse.ArgumentParser) -> int:
    """Judge a kept failure."""
    try:
        found = cases.load(path)
        found["case"], PARTS[found["part"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        parser.error(f"--again: {path} is no file of a failure: {type(error).__name__}: {error}")
    with Judge(PARTS[found["part"]](), "", threading.Event()) as judge:
        outcome = judge(found["case"])
    print(" ".join(filter(None, (outcome.verdict, outcome.what))))
    print(outcome.text, end="")
    return int(outcome.is_wrong)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments name; return 1 where something failed, in this run or an earlier one."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.again is not None:
        return _again(given.again, parser)
    if not given.minutes > 0:
        parser.error(f"--minutes: {given.minutes}: wanted more than 0")
    if strange := set(given.kinds) - set(SpoiledFiles().kinds):
        parser.error(f"--kind: {', '.join(sorted(strange))}: --list names the kinds of files")
    names = given.parts or list(PARTS)
    if strange := set(names) - set(PARTS):
        parser.error(f"PART: {', '.join(strange)}: wanted any of {', '.join(PARTS)}")
    parts = [SpoiledFiles(given.kinds) if name == SpoiledFiles.name else PARTS[name]() for name in names]
    if given.list:
        print(*(f"{part.name}: {', '.join(part.kinds)}" for part in parts), sep="\n")
        return 0
    given.output.mkdir(parents=True, exist_ok=True)
    for part in parts:
        part.prepare(given.output)
    book = Book(given.output, parts, first=given.first, clock=Clock(60 * given.minutes), most=given.cases)
    attack = Attack(parts, book, shrinking=given.shrinking)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: attack.stop.set())
    attack.run(given.jobs)
    print(table(book.entries))
    return int(any(entry.failures for entry in book.entries.values()))


if __name__ == "__main__":
    sys.exit(main())

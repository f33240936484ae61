"""The summary of an output folder: what was done, what is next, and what failed. A run goes on from it."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fuzz.limits import Clock
from fuzz.part import Part
from fuzz.watch import Result

#: Slowest cases of a part that are listed.
_SLOWEST = 10


@dataclass(frozen=True)
class Batch:
    """Cases that one process runs: `count` of them from a seed on."""

    part: str
    kind: str
    first: int
    count: int

    @property
    def seeds(self) -> range:
        """The seeds of its cases."""
        return range(self.first, self.first + self.count)


@dataclass
class Kind:
    """What is known of one kind of cases.

    Attributes
    ----------
    next
        The seed of the next batch.
    cases
        How many were judged.
    verdicts
        "right", "wrong" or an error's class, with how many.
    seconds
        Processor time of all.
    """

    next: int
    cases: int = 0
    verdicts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass
class Entry:
    """What is known of a part.

    Attributes
    ----------
    kinds
        By name.
    begun
        Batches that were given out and have no results yet; another run does them first.
    failures
        By what failed: how many, and the files that keep some of them.
    slowest
        (seconds, kind, seed), the slowest first.
    """

    kinds: dict[str, Kind] = field(default_factory=dict)
    begun: list[Batch] = field(default_factory=list)
    failures: dict[str, dict[str, Any]] = field(default_factory=dict)
    slowest: list[tuple[float, str, int]] = field(default_factory=list)

    @property
    def cases(self) -> int:
        """How many cases were judged."""
        return sum(kind.cases for kind in self.kinds.values())

    @property
    def verdicts(self) -> Counter[str]:
        """The verdicts of all kinds."""
        return sum((Counter(kind.verdicts) for kind in self.kinds.values()), Counter())


class Book:
    """The summary of a folder, read when it is made and written after each batch.

    Parameters
    ----------
    folder
        Of the output; the summary is its ``summary.json``.
    parts
        That this run has.
    first
        Seed of the first case of each kind that the summary does not know; None: the part's own.
    clock
        Time of this run; from its end on no batch is given out.
    most
        Cases of each part in all runs, after which no batch is given out; None: any number.
    """

    def __init__(
        self, folder: Path, parts: Sequence[Part], *, first: int | None = None, clock: Clock, most: int | None = None
    ) -> None:
        self.folder, self.clock, self.most = folder, clock, most
        self._parts = {part.name: part for part in parts}
        self._lock = threading.Lock()
        self.entries = _read(folder / "summary.json")
        self._left: list[Batch] = []
        for part in parts:
            entry = self.entries.setdefault(part.name, Entry())
            for kind in part.kinds:
                entry.kinds.setdefault(kind, Kind(part.first if first is None else first))
            self._left += [batch for batch in entry.begun if batch.kind in part.kinds]

    def take(self) -> Batch | None:
        """Return the next batch, first those that an earlier run left; None where time or cases are used up."""
        with self._lock:
            if self.clock.is_over():
                return None
            if self._left:
                return self._left.pop(0)
            batch = self._new()
            if batch is not None:
                entry = self.entries[batch.part]
                entry.kinds[batch.kind].next += batch.count
                entry.begun.append(batch)
                self._write()
            return batch

    def _new(self) -> Batch | None:
        """Return a batch of the part and the kind that are farthest behind their shares of time and of cases."""
        open_: dict[str, int] = {}
        for name in self._parts:
            entry = self.entries[name]
            room = self.most - entry.cases - sum(one.count for one in entry.begun) if self.most is not None else 1 << 60
            if room > 0:
                open_[name] = room
        if not open_:
            return None

        def time_of(name: str) -> float:
            entry, part = self.entries[name], self._parts[name]
            # A batch that is under way takes as long as the others of its part.
            done = sum(kind.seconds for kind in entry.kinds.values())
            mean = done / entry.cases if entry.cases else part.seconds / part.batch
            return (done + mean * sum(one.count for one in entry.begun)) / part.share

        name = min(open_, key=time_of)
        part, entry = self._parts[name], self.entries[name]

        def share_of(kind: str) -> float:
            under_way = sum(one.count for one in entry.begun if one.kind == kind)
            return (entry.kinds[kind].cases + under_way) / part.kinds[kind]

        kind = min(part.kinds, key=share_of)
        return Batch(name, kind, entry.kinds[kind].next, min(part.batch, open_[name]))

    def wanted(self, batch: Batch, results: Sequence[Result]) -> list[Result]:
        """Return the failures of a batch that are to be kept: a few of each kind of failure."""
        with self._lock:
            failures, part = self.entries[batch.part].failures, self._parts[batch.part]
            seen = Counter({what: len(failure["seeds"]) for what, failure in failures.items()})
            found = []
            for one in results:
                if one.outcome.is_wrong and seen[one.outcome.what] < part.most_kept:
                    seen[one.outcome.what] += 1
                    found.append(one)
            return found

    def enter(self, batch: Batch, results: Sequence[Result], files: Mapping[int, str]) -> None:
        """Count the results of a batch, which is done; `files` keep the failures of some seeds."""
        with self._lock:
            entry = self.entries[batch.part]
            kind = entry.kinds[batch.kind]
            verdicts = Counter(kind.verdicts)
            for one in results:
                verdicts[one.outcome.verdict] += 1
                kind.seconds += one.seconds
                entry.slowest.append((round(one.seconds, 3), batch.kind, one.seed))
                if one.outcome.is_wrong:
                    failure = entry.failures.setdefault(one.outcome.what, {"count": 0, "seeds": [], "files": []})
                    failure["count"] += 1
                    if one.seed in files:
                        failure["seeds"].append([batch.kind, one.seed])
                        failure["files"].append(files[one.seed])
            kind.verdicts = dict(sorted(verdicts.items()))
            kind.cases += len(results)
            entry.slowest = sorted(entry.slowest, reverse=True)[:_SLOWEST]
            entry.begun.remove(batch)
            self._write()

    def _write(self) -> None:
        path = self.folder / "summary.json"
        temporary = path.with_name(path.name + ".part")
        text = json.dumps({name: asdict(entry) for name, entry in self.entries.items()}, indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")
        temporary.replace(path)


def _read(path: Path) -> dict[str, Entry]:
    """Return what a summary says; nothing where there is none."""
    if not path.exists():
        return {}
    found = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: Entry(
            {kind: Kind(**one) for kind, one in entry["kinds"].items()},
            [Batch(**one) for one in entry["begun"]],
            entry["failures"],
            [tuple(one) for one in entry["slowest"]],
        )
        for name, entry in found.items()
    }

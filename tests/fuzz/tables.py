"""A summary as text: what was done of each part, and what failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from bench.report import Report, columns
from fuzz.book import Entry


def table(entries: Mapping[str, Entry]) -> str:
    """Return the counts of each format or backend, the failures and the slowest cases."""
    rows = []
    for name, entry in entries.items():
        grouped: dict[str, list[str]] = {}
        for kind in entry.kinds:
            grouped.setdefault(kind.partition(" ")[0], []).append(kind)
        for group, kinds in [*grouped.items(), ("all", list(entry.kinds))]:
            known = [entry.kinds[kind] for kind in kinds]
            verdicts: Counter[str] = sum((Counter(one.verdicts) for one in known), Counter())
            refused = {what: count for what, count in verdicts.items() if what not in ("right", "wrong")}
            cases = sum(one.cases for one in known)
            seconds = sum(one.seconds for one in known)
            rows.append(
                {
                    "part": name,
                    "kind": group,
                    "cases": cases,
                    "right": verdicts["right"],
                    "refused": ", ".join(f"{what} {count:,}" for what, count in sorted(refused.items())),
                    "wrong": verdicts["wrong"],
                    "cpu_ms": 1000 * seconds / cases if cases else 0.0,
                }
            )
    notes = [
        f"{name}: {what}: {failure['count']:,} times, {', '.join(failure['files'])}"
        for name, entry in entries.items()
        for what, failure in entry.failures.items()
    ]
    notes += [
        f"{name}, slowest: " + ", ".join(f"{kind} {seed} {seconds:.1f} s" for seconds, kind, seed in entry.slowest[:5])
        for name, entry in entries.items()
        if entry.slowest
    ]
    return Report("fuzz", "fuzz", columns("part, kind, cases, right, refused, wrong, cpu_ms"), rows, notes).table()

"""Count the tests that passed, failed and were skipped, with the reasons, from the reports of ctest and pytest.

Usage: summary.py ctest=JUNIT_XML[,FOLDER] pytest=JUNIT_XML

FOLDER has the reports NAME.xml of the GoogleTest programs that ctest ran under the name NAME: their tests are counted
in place of the one that ctest saw. The last line counts all tests. Exit code 1 where a report is missing, unreadable
or empty, or has a failure.
"""

import re
import sys
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Test:
    """One test; `skipped`: why it was, or an empty text."""

    name: str
    failed: bool = False
    skipped: str = ""


def one_line(text: str) -> str:
    """Return the text on one line."""
    return " ".join(text.split()) or "no reason given"


def tests_in(report: Path) -> Iterator[Test]:
    """Yield the tests of a JUnit report; ctest, GoogleTest and pytest differ in how they say that one was skipped."""
    for case in ElementTree.parse(report).getroot().iter("testcase"):
        name = "::".join(filter(None, (case.get("classname"), case.get("name"))))
        skip = case.find("skipped")
        if case.find("failure") is not None or case.find("error") is not None:
            yield Test(name, failed=True)
        elif skip is not None or case.get("status") in {"notrun", "disabled"}:
            message = (skip.get("message") if skip is not None else None) or case.get("status", "")
            # GoogleTest puts the place in the source before the reason.
            yield Test(name, skipped=one_line(re.sub(r"^\S+:\d+\n", "", message)))
        else:
            yield Test(name)


def tests_of(runner: str, report: Path, folder: Path | None) -> Iterator[Test]:
    """Yield the tests of a runner; those of each GoogleTest program in place of the program's name."""
    for test in tests_in(report):
        name = test.name.rsplit("::", 1)[-1] if runner == "ctest" else test.name
        inner = folder / f"{name}.xml" if folder else None
        try:
            found = list(tests_in(inner)) if inner and inner.exists() else []
        except ElementTree.ParseError:
            found = []
        yield from (Test(f"{name}: {one.name}", one.failed, one.skipped) for one in found)
        # A program that was ended leaves no report of its failure.
        if not found or (test.failed and not any(one.failed for one in found)):
            yield Test(name, test.failed, test.skipped)


def main(arguments: list[str]) -> int:
    """Print the summary; return the exit code."""
    passed = failed = skipped = 0
    complete = True
    for argument in arguments:
        runner, _, paths = argument.partition("=")
        report, _, folder = paths.partition(",")
        try:
            tests = list(tests_of(runner, Path(report), Path(folder) if folder else None))
        except (OSError, ElementTree.ParseError) as error:
            print(f"{runner}: no report, so its tests did not run to their end ({error})")
            complete = False
            continue
        failures = [test.name for test in tests if test.failed]
        reasons = Counter(test.skipped for test in tests if test.skipped)
        for name in failures:
            print(f"{runner}: FAILED {name}")
        for reason, count in reasons.most_common():
            print(f"{runner}: skipped {count}: {reason}")
        print(f"{runner}: {len(tests)} tests, of which {len(failures)} failed and {reasons.total()} were skipped")
        complete = complete and bool(tests)
        passed += len(tests) - len(failures) - reasons.total()
        failed, skipped = failed + len(failures), skipped + reasons.total()
    print(f"{passed} passed, {failed} failed, {skipped} skipped")
    return 0 if complete and failed == 0 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

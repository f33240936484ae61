"""Say how many tests passed, failed and were skipped, and why, from the reports that ctest and pytest leave.

Usage: summary.py RUNNER=JUNIT_XML ...

The last line counts all of them. Exit code 1 where a report is missing or unreadable, empty, or names a failure.
"""

import re
import sys
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path


def reason_of(case: ElementTree.Element, skipped: ElementTree.Element) -> str:
    """Why a test was skipped: GoogleTest prints it, pytest gives it as the message."""
    printed = case.findtext("system-out") or ""
    found = re.search(r": Skipped\n(.*?)\n*(?:\[\s|$)", printed, re.DOTALL)
    text = found.group(1) if found else skipped.get("message") or case.get("status", "")
    return " ".join(text.split()) or "no reason given"


def main(arguments: list[str]) -> int:
    """Print the summary; return the exit code."""
    passed = failed = skipped = 0
    complete = True
    for argument in arguments:
        runner, _, path = argument.partition("=")
        try:
            cases = list(ElementTree.parse(Path(path)).getroot().iter("testcase"))
        except (OSError, ElementTree.ParseError) as error:
            print(f"{runner}: no report, so its tests did not run to their end ({error})")
            complete = False
            continue
        failures: list[str] = []
        reasons: Counter[str] = Counter()
        for case in cases:
            name = (
                f"{case.get('classname', '')}::{case.get('name', '')}" if runner == "pytest" else case.get("name", "")
            )
            skip = case.find("skipped")
            if case.find("failure") is not None or case.find("error") is not None:
                failures.append(name)
            elif skip is not None or case.get("status") in {"notrun", "disabled"}:
                reasons[reason_of(case, skip if skip is not None else case)] += 1
        well = len(cases) - len(failures) - reasons.total()
        for name in failures:
            print(f"{runner}: FAILED {name}")
        for reason, count in reasons.most_common():
            print(f"{runner}: skipped {count}: {reason}")
        print(f"{runner}: {len(cases)} tests, of which {len(failures)} failed and {reasons.total()} were skipped")
        complete = complete and bool(cases)
        passed, failed, skipped = passed + well, failed + len(failures), skipped + reasons.total()
    print(f"{passed} passed, {failed} failed, {skipped} skipped")
    return 0 if complete and failed == 0 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

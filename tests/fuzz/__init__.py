"""Attacks by random input, budgeted by minutes and resumable: files, scenes, and processes that go on for long.

Each part (`fuzz.part.Part`) numbers its cases, so that a seed makes the same case again. Cases run in child processes,
a batch each, so that a crash, a hang and memory without end are failures of one case (`fuzz.watch`). A failure is made
smaller and kept as a file that tests take (`fuzz.cases`). What was done stands in the summary of the output folder,
from which the next run goes on (`fuzz.book`). Command line: :mod:`fuzz.__main__`.
"""

from __future__ import annotations

import sys
from pathlib import Path

# Scenes and files that tests share with the command.
_TESTS = Path(__file__).resolve().parents[1] / "python"
sys.path += [str(one) for one in (_TESTS, *sorted(_TESTS.iterdir())) if one.is_dir() and str(one) not in sys.path]

"""Ctrl-C before the command line is ready for it: a word in place of a traceback."""

from __future__ import annotations

import sys
from types import TracebackType


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        print("Aborted!", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def watch() -> None:
    """Print "Aborted!" where a KeyboardInterrupt ends the process, whose exit code stays that of the signal."""
    sys.excepthook = _tell

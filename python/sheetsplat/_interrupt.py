"""Ctrl-C before the command line is ready for it: a word in place of a traceback."""

from __future__ import annotations

import sys
from types import TracebackType


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        print("Aborted!", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _is_command_line() -> bool:
    # While a package is read for -m the program has no name of its own yet.
    started = (*getattr(sys, "argv", ()), "")[0].replace("\\", "/").rsplit("/", 1)[-1]
    return started in ("sheetsplat", "sheetsplat.exe") or (started == "-m" and "sheetsplat" in sys.orig_argv)


# The exit code stays that of the signal.
if _is_command_line():
    sys.excepthook = _tell

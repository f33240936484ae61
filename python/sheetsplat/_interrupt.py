"""Ctrl-C while the command line reads the package: one word in place of a traceback.

The hook is set in a process of the command line alone, and only until the package is read; from then on click answers.
"""

from __future__ import annotations

import sys
from types import TracebackType


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        print("Aborted!", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _is_command_line() -> bool:
    started = (*getattr(sys, "argv", ()), "")[0].replace("\\", "/").rsplit("/", 1)[-1]
    if started == "-m":  # until the module that -m names is found
        words = sys.orig_argv
        return "-m" in words and words[words.index("-m") + 1 :][:1] == ["sheetsplat"]
    return started in ("sheetsplat", "sheetsplat.exe")


def restore() -> None:
    """Restore Python's own hook."""
    if sys.excepthook is _tell:
        sys.excepthook = sys.__excepthook__


# The exit code stays that of the signal.
if _is_command_line():
    sys.excepthook = _tell

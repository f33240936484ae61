"""What the command line needs before it reads the package: an answer to Ctrl-C, and no code of the current folder.

Python reads `sheetsplat` before any module of the command line, so the package itself sets the hook: only where the
program is the installed command or ``python -m sheetsplat``. `sheetsplat.cli` restores Python's hook when everything is
read; from then on click answers.

``python -m`` would look for every further module in the current folder first, where the data may be those of others.
"""

from __future__ import annotations

import os
import sys
from types import TracebackType


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        print("Aborted!", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _is_command_line() -> bool:
    program = (*getattr(sys, "argv", ()), "")[0]
    if program == "-m":  # until the module that -m names is found
        words = sys.orig_argv
        return "-m" in words and words[words.index("-m") + 1 :][:1] == ["sheetsplat"]
    folder, name = os.path.split(os.path.abspath(program))
    if name not in ("sheetsplat", "sheetsplat.exe"):
        return False
    import sysconfig

    schemes = (sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user"))
    return any(os.path.realpath(sysconfig.get_path("scripts", one)) == os.path.realpath(folder) for one in schemes)


def _leave_folder() -> None:
    """Take the folder that ``python -m`` puts first off the path, unless the package itself is there."""
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if sys.argv[0] == "-m" and not sys.flags.safe_path and os.path.realpath(sys.path[0]) != os.path.realpath(package):
        del sys.path[0]


def restore() -> None:
    """Restore Python's own hook."""
    if sys.excepthook is _tell:
        sys.excepthook = sys.__excepthook__


# The exit code stays that of the signal.
if _is_command_line():
    sys.excepthook = _tell
    _leave_folder()

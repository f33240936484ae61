"""The command line. Results go to stdout, everything else to stderr; exit codes: 0 done, 1 failed, 2 wrong usage."""

from sheetsplat import _interrupt
from sheetsplat.cli.main import main

_interrupt.restore()

__all__ = ["main"]

"""The command line. Results go to stdout, everything else to stderr; exit codes: 0 done, 1 failed, 2 wrong usage."""

from sheetsplat.cli.main import main

__all__ = ["main"]

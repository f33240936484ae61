"""The command line. Results go to stdout, everything else to stderr; exit codes: 0 done, 1 failed, 2 wrong usage."""

import sys

try:
    from sheetsplat.cli.main import main
except KeyboardInterrupt:
    print("Aborted!", file=sys.stderr)
    sys.exit(130)

__all__ = ["main"]

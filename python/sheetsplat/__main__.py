"""The command line, as ``python -m sheetsplat``."""

from sheetsplat.cli import main

if __name__ == "__main__":
    main(prog_name="sheetsplat")

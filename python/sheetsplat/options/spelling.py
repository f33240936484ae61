"""How the command line spells the options of Python."""

from __future__ import annotations

from functools import cache

from sheetsplat.options.core import REFERENCE, CommandLine, definitions
from sheetsplat.options.picture import RenderOptions


def flags(name: str, spelling: CommandLine) -> str:
    """Return the spelling of one option of the command line, both of a switch: "--log/--no-log"."""
    return spelling.flag or "--" + name.replace("_", "-")


@cache
def spellings() -> dict[str, str]:
    """Return the flag of each option that the command line has, by its name in Python and by its parameter's."""
    found: dict[str, str] = {}
    for name, defined in definitions(RenderOptions).items():
        for spelling in defined.spellings:
            flag = flags(name, spelling).partition("/")[0]
            found.setdefault(name, flag)
            found[spelling.parameter or name] = flag
    return found


def flag_of(name: str) -> str:
    """Return the flag of an option by its name, for example "--iso" of iso_value."""
    return spellings().get(name, "--" + name.replace("_", "-"))


def on_command_line(text: str) -> str:
    """Return a help text with references to options as the command line spells them."""
    return REFERENCE.sub(lambda found: flag_of(found[1]), text)

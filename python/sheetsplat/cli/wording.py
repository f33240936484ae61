"""Messages of errors with options spelled as the command line has them."""

from __future__ import annotations

import click

from sheetsplat.errors import Error, OptionRef, spelled_in_python

# Options of commands that stand for a value of an argument.
_BY_VALUE = {
    ("log", "..."): "log_floor",
    ("preintegration", "second_order"): "second_order",
    ("clip", ""): "clip_planes",
}


def message(error: Error, command: click.Command | None) -> str:
    """Return the message of an error that a command met."""
    return error.complaint.text(lambda option: spelled(option, command))


def spelled(option: OptionRef, command: click.Command | None) -> str:
    """Return a reference as the option of a command: ``--allow-inexact``, ``--nan skip``, ``--name TEXT``.

    What the command has no option for is spelled as Python's keyword argument.
    """
    wanted = _BY_VALUE.get((option.name, option.value), option.name)
    for parameter in command.params if command is not None else ():
        if isinstance(parameter, click.Option) and parameter.name == wanted:
            name, opposite = parameter.opts[-1], parameter.secondary_opts[-1:]
            if parameter.is_flag:
                return opposite[0] if option.value == "false" and opposite else name
            value = parameter.metavar or parameter.type.name.upper() if option.value == "..." else option.value
            return f"{name} {value}" if value else name
    return spelled_in_python(option)

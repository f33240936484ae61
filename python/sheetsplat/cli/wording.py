"""Messages of errors and warnings with options spelled as the command line has them."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from typing import Any

import click

from sheetsplat.cli.output import tell
from sheetsplat.errors import Error, InvalidInput, OptionRef, spelled_in_python
from sheetsplat.notices import PictureWarning

# Options of commands that stand for a value of an argument.
_BY_VALUE = {
    ("log", "..."): "log_floor",
    ("preintegration", "second_order"): "second_order",
    ("clip", ""): "clip_planes",
}


def message(error: Error, command: click.Command | None) -> str:
    """Return the message of an error that a command met."""
    return error.complaint.text(lambda option: spelled(option, command))


@contextlib.contextmanager
def usage_errors(*, reading: bool = False) -> Iterator[None]:
    """Turn InvalidInput about options, which contradict each other or have no meaning, into wrong usage.

    While files are read (`reading`) an option may be wrong for a file alone, which is no wrong usage: there an error
    has to be about one option and to have found another.
    """
    try:
        yield
    except InvalidInput as error:
        told = error.complaint
        about, found = (any(isinstance(one, OptionRef) for one in part.pieces) for part in (told.what, told.found))
        if not (about and found if reading else about or found or error.option is not None):
            raise
        context = click.get_current_context()
        raise click.UsageError(message(error, context.command), context) from None


@contextlib.contextmanager
def warnings_on_stderr(*, quiet: bool) -> Iterator[None]:
    """Print each PictureWarning as one line on stderr, or none of them where `quiet`."""
    command = click.get_current_context().command
    seen: set[str] = set()

    def show(warning: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if not isinstance(warning, PictureWarning):
            others(warning, category, *where, **more)
            return
        line = " ".join(warning.words.text(lambda option: spelled(option, command)).split())
        if line not in seen:
            seen.add(line)
            tell(f"warning: {line}")

    with warnings.catch_warnings():
        others = warnings.showwarning
        warnings.simplefilter("ignore" if quiet else "always", PictureWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        yield


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

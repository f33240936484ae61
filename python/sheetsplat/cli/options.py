"""Options that several commands share, made from the definitions in `sheetsplat.options`."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from sheetsplat._escaping import escaped
from sheetsplat.cli.help import help_all
from sheetsplat.cli.optional_values import OptionalValue
from sheetsplat.cli.types import Word, param_type
from sheetsplat.cli.wording import warnings_on_stderr
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import MODES, CommandLine, Option, choices_of, definitions
from sheetsplat.options.data import FileOptions, KernelOptions, PlacementOptions
from sheetsplat.options.picture import LookOptions, PictureOptions, unused
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererOptions
from sheetsplat.options.spelling import flag_of, flags, on_command_line

Function = TypeVar("Function", bound=Callable[..., Any])


def apply(options: list[Callable[[Function], Function]]) -> Callable[[Function], Function]:
    """Return one decorator that adds several options, in their order."""

    def decorate(function: Function) -> Function:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


class _LogHandler(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes the log to stderr; a class of its own, so that the next command of the process finds and replaces it."""


class _Lines(logging.Formatter):
    """Makes each message one line, but those that are written in several."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  # The name is logging's.
        """Return the message."""
        return escaped(super().formatMessage(record), kept="\n" if "\n" in str(record.msg) else "")


def _set_log(quiet: bool, verbose: int) -> None:
    logger = logging.getLogger("sheetsplat")
    for old in [handler for handler in logger.handlers if isinstance(handler, _LogHandler)]:
        logger.removeHandler(old)
    handler = _LogHandler()
    handler.setFormatter(_Lines("%(message)s"))
    logger.addHandler(handler)
    logger.setLevel(logging.ERROR if quiet else (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)])


def common(function: Function) -> Function:
    """Add -q and -v. The command gets `quiet`."""

    @click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
    @click.option("-v", "--verbose", count=True, help="Print more on stderr; -vv prints everything.")
    @functools.wraps(function)
    def wrapped(*args: Any, quiet: bool, verbose: int, **kwargs: Any) -> Any:
        _set_log(quiet, verbose)
        with warnings_on_stderr(quiet=quiet):
            return function(*args, quiet=quiet, **kwargs)

    return wrapped  # type: ignore[return-value]


as_json = click.option("--json", "as_json", is_flag=True, help="Report as JSON on stdout.")


def _help(option: Option, spelling: CommandLine, *, default: str) -> str:
    """Return the help text, with the modes and the default value in brackets."""
    words = on_command_line(spelling.help or option.help)
    brackets = [", ".join(option.modes)] if option.modes != MODES else []
    if default:
        brackets.append(f"default: {on_command_line(default)}")
    return f"{words}  [{'; '.join(brackets)}]" if brackets else words


def _option(option: Option, spelling: CommandLine) -> Callable[[Function], Function]:
    """Return the decorator that adds one option to a command."""
    default = option.default
    parameter = spelling.parameter or option.name
    is_own = parameter == option.name
    words = spelling.default or (option.default_text(chooses=True).replace('"', "") if is_own else "")
    settings: dict[str, Any] = {"multiple": spelling.multiple}
    flag = flags(option.name, spelling)
    if spelling.switch or "/" in flag:
        on, _, off = flag.partition("/")
        # A switch of two spellings without a default is neither on nor off.
        unset = default is None and bool(off)
        settings |= {"is_flag": True, "default": None if unset else bool(default) if is_own else False}
        words = words if unset else (on if default else off) if off else ""
    else:
        names = choices_of(option.type)
        if spelling.value is not None:
            settings["type"] = param_type(spelling.value)
        elif names:
            settings["type"] = Word(names)
        # What is chosen by other options must be seen not to have been given.
        if is_own and isinstance(default, str | int | float | tuple) and not spelling.multiple and not option.chosen:
            settings["default"] = default
    if spelling.bare:
        settings |= {"cls": OptionalValue, "is_flag": False, "flag_value": spelling.bare}
    if spelling.metavar:
        settings["metavar"] = spelling.metavar
    return click.option(flag, parameter, help=_help(option, spelling, default=words), **settings)


def options_of(*groups: type) -> list[Callable[[Any], Any]]:
    """Return the decorators that add the options of some groups to a command."""
    return [
        _option(option, spelling)
        for group in groups
        for option in definitions(group).values()
        for spelling in option.spellings
    ]


def single(group: type, *names: str) -> list[Callable[[Any], Any]]:
    """Return the decorators of some options of a group."""
    known = definitions(group)
    return [_option(known[name], spelling) for name in names for spelling in known[name].spellings]


def scene_options(function: Function) -> Function:
    """Add every option that `sheetsplat.cli.scene.prepare` takes."""
    groups = (QualityOptions, FileOptions, PlacementOptions, KernelOptions, LookOptions, PictureOptions, CameraOptions)
    decorated: Function = apply([*options_of(*groups, RendererOptions), help_all])(function)
    return decorated


def check_mode(options: dict[str, Any], outputs: tuple[str, ...] = ()) -> None:
    """Refuse options that the mode does not use; harmless ones cause a warning only."""
    context = click.get_current_context()
    look = definitions(LookOptions)
    parameters = [spelling.parameter or name for name, one in look.items() for spelling in one.spellings]
    given = [
        name
        for name in parameters
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        # Off is its default.
        and not (name == "preintegration" and not options[name])
    ]
    mode = options["mode"]
    ignored = unused(mode, [*given, *outputs])
    refused = [flag_of(name) for name in ignored if name not in look or not look[name].harmless]
    if refused:
        raise click.UsageError(f"--mode {mode} does not use {', '.join(refused)}; leave out one or the other")
    if ignored:
        names = ", ".join(flag_of(name) for name in ignored)
        logging.getLogger("sheetsplat").warning("--mode %s does not use %s", mode, names)
    if context.get_parameter_source("fov_y") is ParameterSource.COMMANDLINE and options["projection"] == "orthographic":
        raise click.UsageError("--fov is of --projection perspective, which is missing")

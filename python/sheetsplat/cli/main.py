"""The command group, and what is common to all commands: errors, exit codes, the log."""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from types import FrameType
from typing import Any

import click

from sheetsplat._escaping import escaped
from sheetsplat.cli.output import guarded, report, tell
from sheetsplat.cli.wording import message
from sheetsplat.errors import Error, InvalidInput

_COMMANDS = {
    "render": "Render a volume into a picture.",
    "view": "Show a volume in a page of the browser, to look at from all sides.",
    "turntable": "Write a film in which the eye turns about a volume.",
    "animate": "Write a film of a time series, or of a moving camera.",
    "encode": "Write a volume as few kernels, with a bound of the error.",
    "plan": "Show what the scene calls for, effect by effect, with the reason.",
    "accuracy": "Measure what accuracy costs in time: table, JSON and plot.",
    "info": "Show sizes, ranges, histogram and memory of a volume.",
    "devices": "Show backends and OpenGL contexts, and whether they are available.",
    "compare": "Compare two pictures: RMSE, P99.9, maximum and FLIP.",
    "demo": "Render a generated data set.",
}
# Characters of the reason of an error that is not of the package.
_REASON = 500


def _open_streams() -> None:
    """Open the null device in place of closed standard streams, whose numbers files would get otherwise."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


@contextlib.contextmanager
def _terminated_by_exit() -> Iterator[None]:
    """Make SIGTERM and SIGHUP an exit, so that unfinished files are removed, where nobody else handles them."""
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    numbers = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]

    def leave(number: int, _frame: FrameType | None) -> None:
        sys.exit(128 + number)

    for number in numbers:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


class _Group(click.Group):
    """Reads a command's module when it is asked for, and turns errors into messages and exit codes."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the program, with all three standard streams open, and its files removed where it is terminated."""
        _open_streams()
        try:
            with _terminated_by_exit(), guarded():
                return super().main(*args, **kwargs)
        except OSError as error:
            # Readers turn theirs into errors of the package, and click answers a closed pipe: this is stdout's.
            tell(f"sheetsplat: stdout cannot be written: {error.strerror or error}")
            # What is left in the buffer must not fail again when Python ends.
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115
            sys.exit(1)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in their order in the help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command, or None."""
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"sheetsplat.cli.{cmd_name}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that arguments name; a message about another name has the nearest."""
        if args[0] not in _COMMANDS and not ctx.resilient_parsing:
            # Only here: help needs no NumPy.
            from sheetsplat._checks import nearest_names

            if near := nearest_names(args[0], _COMMANDS):
                ctx.fail(f"No such command {args[0]!r}; {near}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without reading their modules."""
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; errors of the package become one message on stderr and exit code 1."""
        try:
            return super().invoke(ctx)
        except Error as error:
            text = message(error, self.get_command(ctx, ctx.invoked_subcommand or ""))
            # Names of effects are checked by the plan; an unknown name is wrong usage too.
            if isinstance(error, InvalidInput) and error.option == "effects":
                raise click.UsageError(text, ctx) from None
            tell(f"sheetsplat: {text}")
        except click.ClickException as error:
            error.message = escaped(error.message)  # type: ignore[misc]  # It is final for others only.
            raise
        except (click.exceptions.Exit, click.Abort):
            raise
        except MemoryError:
            tell("sheetsplat: there is not enough memory; use a smaller volume or picture")
        except OSError:
            raise
        except Exception as error:
            if logging.getLogger("sheetsplat").isEnabledFor(logging.DEBUG):
                traceback.print_exc()
            tell(f"sheetsplat: internal error, {type(error).__name__}: {str(error)[:_REASON]}")
        sys.exit(1)


def _tell_version(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value and not context.resilient_parsing:
        # Only here: help needs no native module.
        from sheetsplat import __version__

        report(f"sheetsplat, version {__version__}")
        context.exit()


# Nothing is styled. Without "color" click would remove some escape sequences from names, which the guard shows.
@click.command(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "color": True})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_tell_version,
    help="Show the version and exit.",
)
def main() -> None:
    """Image-aligned sheet-buffer splatting of volumes.

    Exit codes: 0 done, 1 failed, 2 wrong usage.
    """

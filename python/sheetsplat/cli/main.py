"""The command group, and what is common to all commands: errors, exit codes, the log."""

from __future__ import annotations

import errno
import importlib
import logging
import sys
import traceback
from typing import Any

import click

from sheetsplat import __version__
from sheetsplat.cli.wording import message
from sheetsplat.errors import Error, InvalidInput

_COMMANDS = {
    "render": "Render a volume into a picture.",
    "plan": "Show what the scene calls for, effect by effect, with the reason.",
    "accuracy": "Measure what accuracy costs in time: table, JSON and plot.",
    "info": "Show sizes, ranges, histogram and memory of a volume.",
    "devices": "Show backends and OpenGL contexts, and whether they are available.",
    "compare": "Compare two pictures: RMSE, P99.9, maximum and FLIP.",
    "demo": "Render a generated data set.",
}
# Characters of the reason of an error that is not of the package.
_REASON = 500


class _Group(click.Group):
    """Reads a command's module when it is asked for, and turns errors into messages and exit codes."""

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
            click.echo(f"sheetsplat: {text}", err=True)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except MemoryError:
            click.echo("sheetsplat: there is not enough memory; use a smaller volume or picture", err=True)
        except Exception as error:
            # The reader of stdout has closed it; click then exits without a message.
            if isinstance(error, OSError) and error.errno == errno.EPIPE:
                raise
            if logging.getLogger("sheetsplat").isEnabledFor(logging.DEBUG):
                traceback.print_exc()
            reason = " ".join(str(error).split())[:_REASON]
            click.echo(f"sheetsplat: internal error, {type(error).__name__}: {reason}", err=True)
        sys.exit(1)


@click.command(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sheetsplat")
def main() -> None:
    """Image-aligned sheet-buffer splatting of volumes.

    Exit codes: 0 done, 1 failed, 2 wrong usage.
    """

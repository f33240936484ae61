"""Help of commands with the options of pictures: one screen by --help, all options in groups by --help-all."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import click

from sheetsplat.cli.optional_values import with_values
from sheetsplat.options.core import definitions
from sheetsplat.options.page import GROUPS

#: Options of pictures on the first screen.
FIRST = (
    *(
        "frames",
        "axis",
        "fps",
        "workers",
        "quality",
        "size",
        "scalar",
        "spacing",
        "mode",
        "cmap",
        "opacity",
        "clim",
        "iso_value",
        "background",
        "shadows",
    ),
    *("direction", "up", "azimuth", "elevation", "zoom", "projection", "backend"),
)
_ALL = "sheetsplat.help_all"
_DETAILS = re.compile(r"(?<=[.;]) |  \[")


@cache
def titles() -> dict[str, str]:
    """Return the title of the group of each parameter that stands for an option of pictures or films."""
    return {
        spelling.parameter or name: title
        for title, groups in GROUPS
        for group in groups
        for name, defined in definitions(group).items()
        for spelling in defined.spellings
    }


def _show_all(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value and not context.resilient_parsing:
        context.meta[_ALL] = True
        click.echo(context.get_help(), color=context.color)
        context.exit()


help_all = click.option(
    "--help-all",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_all,
    help="Show all options, in groups, and exit.",
)


class GroupedOption(click.Option):
    """An option of the command line alone, whose help stands with a group of options of pictures.

    Parameters
    ----------
    group
        Title of the group, one of `GROUPS`.
    """

    def __init__(self, *arguments: Any, group: str, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.group = group


class GroupedCommand(click.Command):
    """A command whose help has groups, and whose options may have values that can be left out."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read arguments and options."""
        return super().parse_args(ctx, list(with_values(self.get_params(ctx), args)))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write its own options, then those of pictures: the most used ones, or all of them in groups."""
        own: list[tuple[str, str]] = []
        groups: dict[str, list[tuple[str, str]]] = {title: [] for title, _ in GROUPS}
        first: dict[str, tuple[str, str]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            # Arguments stand in the usage, and in the text before.
            if record is None or not isinstance(parameter, click.Option):
                continue
            title = parameter.group if isinstance(parameter, GroupedOption) else titles().get(parameter.name or "")
            (own if title is None else groups[title]).append(record)
            if parameter.name in FIRST and title is not None:
                # What it does, without the details.
                first[parameter.name] = (record[0], _DETAILS.split(record[1])[0].rstrip(".;:"))
        with formatter.section("Options"):
            formatter.write_dl(own)
        if ctx.meta.get(_ALL):
            for title, records in groups.items():
                if records:
                    with formatter.section(title):
                        formatter.write_dl(records)
            return
        count = sum(map(len, groups.values()))
        with formatter.section(f"The most used of {count} options of pictures; --help-all shows all"):
            formatter.write_dl([first[name] for name in FIRST if name in first])

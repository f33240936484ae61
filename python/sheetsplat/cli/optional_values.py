"""Options whose value may be left out: `--ambient-occlusion`, or `--ambient-occlusion 5`."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence

import click

# What no such value has, and most paths and addresses do.
_OF_PATHS = re.compile(r"[/\\:]|\.[A-Za-z]")


class OptionalValue(click.Option):
    """An option that stands for a value, `flag_value`, where none follows it."""

    def takes(self, text: str) -> bool:
        """Return whether a text that follows the option is its value, and no argument of the command."""
        try:
            self.type.convert(text, None, None)
        except click.BadParameter:
            return not (_OF_PATHS.search(text) or os.path.exists(text))
        return True


def with_values(parameters: Sequence[click.Parameter], arguments: Sequence[str]) -> Iterator[str]:
    """Yield the arguments of a command line, with the values that were left out before an argument of the command."""
    optional = {flag: one for one in parameters if isinstance(one, OptionalValue) for flag in one.opts}
    for place, text in enumerate(arguments):
        if text == "--":
            yield from arguments[place:]
            return
        one, following = optional.get(text), arguments[place + 1 : place + 2]
        # click itself sees where nothing follows, or another option.
        if one is not None and following and following[0][:1] != "-" and not one.takes(following[0]):
            yield f"{text}={one.flag_value}"
        else:
            yield text

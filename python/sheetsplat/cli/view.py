"""sheetsplat view."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.cluster import brick_options, in_bricks, is_cut, without_bricks
from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import check_mode, common, scene_options
from sheetsplat.cli.output import report, say, tell
from sheetsplat.cli.scene import given_keywords
from sheetsplat.cli.wording import usage_errors
from sheetsplat.io.formats import LISTED_REGULAR, LISTED_SCATTERED

_HELP = f"""Show FILES in a page of the browser: turn, enlarge, change colours, clip, measure, save.

Each is a volume: {LISTED_REGULAR} (these with --shape and --dtype). Or it is scattered data: {LISTED_SCATTERED}
(--grid). Each may be gzipped. A single FILE may be a scene file (.toml), as the page saves it.

Several files, or one file with several time steps, are a time series, with one look for all and a slider; with --choose
files are shown one by one, each with its own look.

The link of the page is printed on stdout. It works as long as the command runs; Ctrl-C ends it. All options say what
the page shows first.
"""
_ANYWHERE = (
    "warning: the page is served at {host}: everybody who can reach this machine and knows the link sees the data and "
    "can change the picture; the link goes through the network unencrypted"
)


@click.command("view", help=_HELP, cls=GroupedCommand)
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--choose", is_flag=True, help="Several files are no time series: the page lets choose among them.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page; any free one unless given.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address at which the page is served: that of this machine alone. With 0.0.0.0, everybody who can reach this "
    "machine and knows the link sees the data, and the link goes through the network unencrypted.",
)
@click.option("--browser/--no-browser", default=True, help="Open the page in the browser.  [default: --browser]")
@brick_options
@scene_options
@common
def command(
    files: tuple[Path, ...],
    choose: bool,
    port: int,
    host: str,
    browser: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Run the command; `_HELP` describes it."""
    from sheetsplat.viewer import view
    from sheetsplat.viewer.server import is_loopback

    paths = [str(path) for path in files]
    if len(paths) > 1 and not choose and is_cut(options, by_workers=True):
        raise click.UsageError("--brick, --workers and --scheduler: a time series cannot be drawn in bricks")
    with contextlib.ExitStack() as ends:
        bricks = ends.enter_context(in_bricks(options))
        options = without_bricks(options)
        check_mode(options)
        given = given_keywords(options)
        shown: list[Any] = [*paths]
        if bricks is not None:
            opened = [bricks.opened(path, given) for path in files]
            shown, given = [data for data, _ in opened], {**opened[0][1], "client": bricks.client}
        page: dict[str, Any] = {"browser": False, "host": host, "port": port}
        with usage_errors():
            if len(paths) == 1:
                viewer = view(shown[0], **page, **given)
            elif choose:
                choices = paths if bricks is None else dict(zip(paths, shown, strict=True))
                viewer = view(choices=choices, **page, **given)
            else:
                viewer = view(times=shown, **page, **given)
        ends.enter_context(viewer)
        link = viewer.url
        # From the link on, Ctrl-C is how the viewer ends.
        with contextlib.suppress(KeyboardInterrupt):
            report(link)
            if not is_loopback(host):
                tell(_ANYWHERE.format(host=host))
            if browser and not viewer.open_browser():
                say("no browser could be opened; open the link in one", quiet=quiet)
            say("Ctrl-C ends the viewer", quiet=quiet)
            viewer.wait()

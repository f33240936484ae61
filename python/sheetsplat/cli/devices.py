"""sheetsplat devices."""

from __future__ import annotations

import click

from sheetsplat.cli.options import as_json, common
from sheetsplat.cli.output import report_json
from sheetsplat.device import devices


@click.command("devices")
@as_json
@common
def command(as_json: bool, quiet: bool) -> None:
    """Show every backend and context that could be made here, and why the others could not."""
    found = devices()
    if as_json:
        report_json([device.to_dict() for device in found])
        return
    for device in found:
        name = device.backend + (f" ({device.platform})" if device.platform else "")
        click.echo(f"{name:<18}{'yes' if device.available else 'no':<5}{device.description}")
        for title, names in (("extensions", device.extensions), ("work-arounds", device.workarounds)):
            if names:
                click.echo(f"{'':<23}{title}: {', '.join(names)}")

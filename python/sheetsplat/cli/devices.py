"""sheetsplat devices."""

from __future__ import annotations

import logging
import os

import click

from sheetsplat.cli.options import as_json, common
from sheetsplat.cli.output import report, report_json
from sheetsplat.device import Device, devices
from sheetsplat.options.renderer import BACKENDS


def _about_environment(found: list[Device]) -> str:
    """Return a warning about the environment variable SHEETSPLAT_BACKEND, or an empty text."""
    wanted = os.environ.get("SHEETSPLAT_BACKEND", "")
    if wanted in ("", "auto"):
        return ""
    if wanted not in BACKENDS:
        return f"SHEETSPLAT_BACKEND is {wanted!r}, which is not a backend; wanted one of {', '.join(BACKENDS)}"
    if not any(device.backend == wanted and device.available for device in found):
        return f"SHEETSPLAT_BACKEND is {wanted!r}, which is not available here"
    return ""


@click.command("devices")
@as_json
@common
def command(as_json: bool, quiet: bool) -> None:
    """Show every backend and kind of OpenGL context, and whether it is available here."""
    found = devices()
    if wrong := _about_environment(found):
        logging.getLogger("sheetsplat").warning(wrong)
    if as_json:
        report_json([device.to_dict() for device in found])
        return
    for device in found:
        name = device.backend + (f" ({device.platform})" if device.platform else "")
        report(f"{name:<18}{'yes' if device.available else 'no':<5}{device.description}")
        for title, names in (("extensions", device.extensions), ("work-arounds", device.workarounds)):
            if names:
                report(f"{'':<23}{title}: {', '.join(names)}")

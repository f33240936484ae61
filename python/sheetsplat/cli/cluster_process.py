"""What a process of the command line's own cluster does as it begins; Dask's setting `preload` names this module."""

from __future__ import annotations

from typing import Any

from sheetsplat._processes import ignore_interrupts


def dask_setup(node: Any) -> None:
    """Close the web server of a scheduler or a worker, which answers every user of the machine; dask calls this."""
    # One that replaces a worker which ended begins while the command listens to Ctrl-C. The scheduler is a thread.
    ignore_interrupts()
    node.http_server.stop()

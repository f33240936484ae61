"""The backends and devices of this machine."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from sheetsplat import _sheetsplat
from sheetsplat._json import plain


@dataclass(frozen=True)
class Device:
    """One backend, or one kind of OpenGL context, and whether it is available here.

    Attributes
    ----------
    backend
        Its name.
    platform
        "egl", "surfaceless" or "osmesa" for OpenGL, else empty.
    available
        Whether it can render.
    description
        Renderer and version where available, else the reason and what to do.
    extensions
        The OpenGL extensions that are used.
    workarounds
        Names of the work-arounds in use.

    Examples
    --------
    >>> [device.available for device in ss.devices() if device.backend == "reference"]
    [True]
    """

    backend: str
    platform: str
    available: bool
    description: str
    extensions: tuple[str, ...]
    workarounds: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as dicts, lists and strings, for JSON."""
        report: dict[str, Any] = plain(asdict(self))
        return report


def devices() -> list[Device]:
    """Return every backend and kind of context with its availability. Tries each of them.

    Examples
    --------
    >>> sorted({device.backend for device in ss.devices()})
    ['cpu', 'gl', 'reference']
    """
    found = []
    for report in _sheetsplat.devices():
        values: dict[str, Any] = {one.name: getattr(report, one.name) for one in fields(Device)}
        lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
        found.append(Device(**{**values, **lists}))
    return found

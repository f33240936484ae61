"""The machines that pictures can be made on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from sheetsplat import _sheetsplat


@dataclass(frozen=True)
class Device:
    """One backend, or one way to an OpenGL context, as it was tried here.

    Attributes
    ----------
    backend
        "gl", "cpu" or "reference".
    platform
        "egl", "surfaceless" or "osmesa" for OpenGL, else empty.
    available
        Whether a picture can be made on it.
    description
        Renderer and version where available, else why not and what to do.
    extensions
        Those that are used.
    workarounds
        Names of those in force.
    """

    backend: str
    platform: str
    available: bool
    description: str
    extensions: tuple[str, ...]
    workarounds: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain dicts, lists and texts, ready for JSON."""
        plain = asdict(self)
        plain["extensions"], plain["workarounds"] = list(self.extensions), list(self.workarounds)
        return plain


def devices() -> list[Device]:
    """Return every backend and context that could be made here, and why the others could not. Tries each of them."""
    return [
        Device(
            backend=report.backend,
            platform=report.platform,
            available=report.available,
            description=report.description,
            extensions=tuple(report.extensions),
            workarounds=tuple(report.workarounds),
        )
        for report in _sheetsplat.devices()
    ]

"""matplotlib, which is optional."""

from __future__ import annotations

import importlib
from typing import Any

from sheetsplat.errors import Unsupported, complain


def require_matplotlib(otherwise: str = "") -> None:
    """Raise Unsupported where matplotlib is missing; `otherwise`: what else the reader can do."""
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        advice = 'pip install "sheetsplat[plot]"' + (f", or {otherwise}" if otherwise else "")
        raise complain(
            "the figure cannot be drawn", "no package matplotlib", "matplotlib 3.8 or newer", advice, kind=Unsupported
        ) from None


def module_of(name: str) -> Any:
    """Return a module of matplotlib, without a static import."""
    return importlib.import_module(f"matplotlib.{name}")

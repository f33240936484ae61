"""matplotlib, which is optional."""

from __future__ import annotations

import importlib
import re
from typing import Any

from sheetsplat.errors import Unsupported, complain

# Words, in which TeX between dollar signs counts as one letter.
_WORDS = re.compile(r"(?:\\\$|\$(?:\\.|[^$\\])*\$|\S)+")


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


def is_mathematics(text: str) -> bool:
    """Return whether matplotlib can draw a text, whose parts between pairs of dollar signs it takes for TeX."""
    if not module_of("cbook").is_math_text(text):
        return True
    try:
        module_of("mathtext").MathTextParser("path").parse(text)
    except ValueError:
        return False
    return True


def fonts() -> dict[str, str]:
    """Return the names of fonts that matplotlib finds, families of CSS among them, by their small letters."""
    manager = module_of("font_manager")
    names = {*manager.fontManager.get_font_names(), *(one for one in manager.font_family_aliases if one)}
    return {name.lower(): name for name in names}


def wrapped(text: str, most: float, font: Any, *, math: bool) -> str:
    """Return a text in lines of at most so many points; words that are longer are broken.

    With `math`, parts between dollar signs are TeX, and stay whole.
    """
    measure = module_of("textpath").text_to_path.get_text_width_height_descent
    has_math = math and bool(module_of("cbook").is_math_text(text))

    def width(part: str) -> float:
        found: float = measure(part, font, has_math)[0]
        return found

    lines: list[str] = []
    for given in text.split("\n"):
        line = ""
        for word in _WORDS.findall(given) if has_math else given.split():
            longer = f"{line} {word}" if line else word
            if width(longer) <= most:
                line = longer
                continue
            lines += [line] if line else []
            rest = word
            while not has_math and len(rest) > 1 and (wide := width(rest)) > most:
                count = min(max(int(len(rest) * most / wide), 1), len(rest) - 1)
                while count > 1 and width(rest[:count]) > most:
                    count -= 1
                lines.append(rest[:count])
                rest = rest[count:]
            line = rest
        lines.append(line)
    return "\n".join(lines)

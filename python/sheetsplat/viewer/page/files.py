"""The files of the page. Its script is one, in parts that are joined as they are; a widget has another last part."""

from __future__ import annotations

from functools import cache
from importlib import resources

# In their order: each may use what those before it define.
_PARTS = (
    *("camera.js", "parts.js", "saving.js", "editor.js", "measures.js", "overlay.js", "presets.js"),
    *("labels.js", "channels.js", "panels.js", "planes.js", "keys.js", "hands.js", "viewer.js"),
)
_HTML, _JAVASCRIPT, _CSS = (f"text/{kind}; charset=utf-8" for kind in ("html", "javascript", "css"))


def _read(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _script(last: str) -> str:
    return "\n".join(map(_read, (*_PARTS, last)))


@cache
def served(name: str) -> tuple[str, bytes] | None:
    """Return the content type and the content of a file of the page, or None where there is no such file."""
    if name == "":
        return _HTML, _read("index.html").encode()
    if name == "viewer.js":
        return _JAVASCRIPT, _script("page.js").encode()
    if name == "viewer.css":
        return _CSS, _read("viewer.css").encode()
    return None


def widget_script() -> str:
    """Return the script of a widget, a module of JavaScript that anywidget runs."""
    return _script("widget.js")


def style() -> str:
    """Return the style, all of it for elements within the viewer."""
    return _read("viewer.css")

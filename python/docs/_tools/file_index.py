"""The part of architecture.md that says where what is: made from the first sentences of files.

``python python/docs/_tools/file_index.py`` writes that part again. With folders or files of the clone as arguments it
prints a line for each file instead, those of C++ and GLSL too: ``file_index.py cpp/src/plan glsl``.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

CLONE = Path(__file__).resolve().parents[3]
PAGE = CLONE / "python/docs/architecture.md"
BEGIN, END = "<!-- made by _tools/file_index.py -->\n", "<!-- end of what is made -->\n"
SUFFIXES = (".cpp", ".hpp", ".h", ".frag", ".vert", ".glsl", ".py")
#: Folders whose own line says enough, beside those of the package.
FOLDERS = ("glsl", "cpp/apps", "cpp/lab", "python/bindings", "tests/bench", "tests/fuzz", "tests/attacks")
#: A first sentence that is longer ends at its first colon or semicolon.
_LONG = 150


def files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that must say what they are; a file is its own folder."""
    found = sorted(folder.rglob("*")) if folder.is_dir() else [folder]
    for path in found:
        if path.suffix in SUFFIXES and "node_modules" not in path.parts:
            yield path


def _header(path: Path) -> Path | None:
    """Return the header that a source file implements."""
    folder = path.parents[len(path.parts) - len(CLONE.parts) - 3] if "src" in path.parts else path.parent
    places = (*folder.rglob(f"{path.stem}.hpp"), CLONE / "cpp/include/sheetsplat" / f"{path.stem}.hpp")
    return next((place for place in places if place.is_file()), None) if path.suffix == ".cpp" else None


def _leading(path: Path) -> str:
    """Return the docstring or comment that a file begins with, as one line."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return " ".join((ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0].split())
    if path.suffix == ".md":
        return " ".join(text.split("\n\n")[1].split())
    mark = "#" if path.suffix == ".txt" else "//"
    return " ".join(line.lstrip("/# ") for line in takewhile(lambda line: line.startswith(mark), text.splitlines()))


def about(path: Path) -> str:
    """Return the first sentence of a file, or of the header that it implements, without its full stop."""
    text = _leading(path)
    if not text and (header := _header(path)):
        text = _leading(header)
    sentence = re.split(r"(?<=[^A-Z])\.(?:\s|$)", text, maxsplit=1)[0]
    return re.split(r"[:;]\s", sentence, maxsplit=1)[0] if len(sentence) > _LONG else sentence


def about_folder(folder: Path) -> str:
    """Return what a folder is, by its ``__init__.py``, its README or its CMakeLists.txt."""
    named = (folder / name for name in ("__init__.py", "README.md", "CMakeLists.txt"))
    return next((about(path) for path in named if path.is_file()), "")


def layers() -> list[tuple[str, str, str]]:
    """Return (layer, layers that it may include, what is in it), from CMakeLists.txt."""
    text = (CLONE / "CMakeLists.txt").read_text(encoding="utf-8")
    said = dict(re.findall(r"^#   (\w+): (.*)$", text, re.MULTILINE))
    found = []
    for name, rest in re.findall(r"^sheetsplat_layer\(\s*(\w+)(.*?)\)", text, re.MULTILINE | re.DOTALL):
        used = [word for part in re.split(r"(?:PRIVATE_)?USES", rest)[1:] for word in part.split()]
        found.append((name, ", ".join(used), said.get(name, "")))
    return found


def _table(*rows: tuple[str, ...]) -> list[str]:
    cells = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    cells.insert(1, ["---"] * len(rows[0]))
    return [f"| {' | '.join(row)} |" for row in cells] + [""]


def part() -> str:
    """Return the part of the page that is made."""
    package = CLONE / "python/sheetsplat"
    modules = [(f"`{path.name}`", about(path)) for path in sorted(package.glob("[!_]*.py"))]
    inner = sorted(path.parent for path in package.glob("*/__init__.py"))
    packages = [(f"`{folder.name}/`", about_folder(folder)) for folder in inner]
    rest = [(f"`{name}`", about_folder(CLONE / name)) for name in FOLDERS]
    lines = ["### C++ layers", "", *_table(("`cpp/src/...`", "may include", "what is in it"), *layers())]
    lines += ["### The Python package", "", *_table(("`python/sheetsplat/...`", "what it is"), *packages, *modules)]
    lines += ["### Other folders", "", *_table(("folder", "what it is"), *rest)]
    return "\n".join(lines)


def page() -> str:
    """Return architecture.md with the part that is made as files say it now."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = text[: text.index(BEGIN) + len(BEGIN)], text[text.index(END) :]
    return before + part() + after


def main(names: list[str]) -> None:
    """Write the page again, or print a line for each file of the named folders."""
    if not names:
        PAGE.write_text(page(), encoding="utf-8")
    for name in names:
        for path in files(CLONE / name):
            print(f"{path.relative_to(CLONE)}: {about(path)}")


if __name__ == "__main__":
    main(sys.argv[1:])

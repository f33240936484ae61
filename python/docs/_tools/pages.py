"""Sphinx: pages of the examples, and what plain Markdown needs to become pages.

Pages in python/docs are Markdown that is read on its own. Here the gallery's links to programs become links to pages
that show code, picture and output; links to other files of the repository become code; links that
show the name of a file of these pages lose its suffix. Tables get what Markdown cannot say.

Why not sphinx-gallery: it makes its gallery in Sphinx only, expects figures of matplotlib, and runs programs at one
size. Here the tests run the same programs at a small size, and gallery.md shows the same pictures in the repository.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from docutils import nodes
from example_programs import DOCS, Example, all_examples, run
from PIL import Image
from sphinx.application import Sphinx
from sphinx.util import logging

import sheetsplat

_log = logging.getLogger(__name__)
# Made anew by each build; ignored by git.
MADE = DOCS / "made"
_LINK = re.compile(r"\[([^\]\[]*)\]\((\.\./[^)\s]*)\)")
_NAMED_AS_FILE = re.compile(r"\[([a-z-]+)\.md\]\(")


def _run_cached(example: Example, cache: Path, factor: float) -> tuple[Path, str]:
    """Return picture and output of a program, from the cache where neither it nor the package's version changed."""
    key = hashlib.sha256(
        f"{sheetsplat.__version__} {factor} {example.path.read_text(encoding='utf-8')}".encode()
    ).hexdigest()
    folder = cache / f"{example.name}-{key[:16]}"
    picture, printed = folder / "picture.png", folder / "printed.txt"
    if not printed.is_file():
        _log.info("running %s", example.name)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as place:
            try:
                text = run(example, Path(place), factor)
            except SystemExit as reason:
                # A program that needs what is not built here says so and ends.
                _log.info("%s: the stored picture is shown: %s", example.name, reason)
                with Image.open(example.picture) as stored:
                    stored.save(picture)
                return picture, ""
            shutil.copy(Path(place) / f"{example.name}.png", picture)
        printed.write_text(text, encoding="utf-8")
    return picture, printed.read_text(encoding="utf-8")


def write_pages(app: Sphinx) -> None:
    """Write a page for each example, with its picture, its code and what it prints."""
    cache = Path(app.doctreedir).parent / "examples"
    shutil.rmtree(MADE / "examples", ignore_errors=True)
    pages = MADE / "examples"
    pages.mkdir(parents=True)
    for _, example in all_examples():
        picture, printed = _run_cached(example, cache, float(app.config.example_factor))
        shutil.copy(picture, pages / f"{example.name}.png")
        lines = ["---", "orphan: true", "---", f"# {example.title}", "", example.text, ""]
        lines += [f"![{example.title}]({example.name}.png)", "", "```python", example.source.rstrip(), "```", ""]
        if printed:
            lines += ["It prints", "", "```text", printed.rstrip(), "```", ""]
        lines += [f"The program: `python/examples/{example.name}.py`. [All examples](../../gallery.md)", ""]
        (pages / f"{example.name}.md").write_text("\n".join(lines), encoding="utf-8")


def adapt_links(app: Sphinx, docname: str, source: list[str]) -> None:
    """Point links to programs at their pages, and show other files of the repository as code."""

    def adapted(match: re.Match[str]) -> str:
        text, target = match.groups()
        path = (DOCS / docname).parent.joinpath(target.partition("#")[0]).resolve()
        if path.parent.name == "examples" and path.suffix == ".py":
            return f"[{text}](made/examples/{path.stem}.md)"
        if path.is_relative_to(DOCS):
            return match.group(0)
        if not path.exists():
            _log.warning("%s: the link to %s leads nowhere", docname, target)
        return f"{text} (`{path.relative_to(DOCS.parents[1])}`)" if text != str(path.name) else f"`{text}`"

    source[0] = _NAMED_AS_FILE.sub(r"[\1](", _LINK.sub(adapted, source[0]))


def adapt_tables(app: Sphinx, doctree: nodes.document) -> None:
    """Leave out headers that are empty, and tell style sheets which tables are of options."""
    for table in doctree.findall(nodes.table):
        if app.env.docname == "options":
            table["classes"].append("options")
        for head in list(table.findall(nodes.thead)):
            if not head.astext().strip():
                head.parent.remove(head)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect all of them."""
    # Factor of the sizes of pictures: ./run docs -D example_factor=0.25 is quicker.
    app.add_config_value("example_factor", "1", "env", types=str)
    app.connect("builder-inited", write_pages)
    app.connect("source-read", adapt_links)
    app.connect("doctree-read", adapt_tables)
    return {"parallel_read_safe": True}

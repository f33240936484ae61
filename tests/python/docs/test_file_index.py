"""architecture.md: what it says of files is what they say, each says what it is, and the page stays short."""

from __future__ import annotations

import file_index
import pytest

FOLDERS = ("cpp", "glsl", "python/bindings", "python/sheetsplat", "python/docs/_tools", "tests/bench", "tests/fuzz")


def test_the_page_says_what_the_files_say() -> None:
    found = file_index.PAGE.read_text(encoding="utf-8")
    assert found == file_index.page(), "make it again: python python/docs/_tools/file_index.py"


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_says_what_it_is(folder: str) -> None:
    paths = list(file_index.files(file_index.CLONE / folder))
    assert len(paths) > 2
    assert [path for path in paths if not 8 <= len(file_index.about(path)) <= 200] == []


def test_every_layer_says_what_is_in_it() -> None:
    layers = file_index.layers()
    folders = sorted(path.name for path in (file_index.CLONE / "cpp/src").iterdir() if path.is_dir())
    assert sorted(name for name, _, _ in layers) == folders
    assert all(said for _, _, said in layers)
    assert dict((name, used) for name, used, _ in layers)["reference"] == "base, image, field, scene"


def test_first_sentences(tmp_path) -> None:
    def about(name: str, text: str) -> str:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return file_index.about(tmp_path / name)

    assert about("a.hpp", "// How rays\n// run. More.\n#pragma once\n// Not this.\n") == "How rays run"
    assert about("b.py", '"""Rays.\n\nMore."""\n') == "Rays"
    assert about("c.hpp", "// Rays: " + "of light " * 20 + ".\n") == "Rays"
    assert about("d.hpp", "#pragma once\n// Rays.\n") == ""


def test_the_page_stays_short() -> None:
    lines = file_index.PAGE.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 250
    assert [line for line in lines for cell in line.split(" | ") if line.startswith("|") and len(cell) > 300] == []

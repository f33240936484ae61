"""Every public name has a docstring with an example, and the examples run."""

from __future__ import annotations

import doctest
import inspect
import pkgutil
import textwrap
import types
import warnings
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
import sheetsplat.compare
import sheetsplat.tiles

# Constants, and modules, whose names have examples of their own; classes that only readers of formats meet.
WITHOUT = {"DATASETS", "SPH_KERNELS", "__version__", "Folder", "Format", "Source", "Scattered", "field_of"}
MODULES = {"": ss, "fit.": ss.fit, "datasets.": ss.datasets, "io.": ss.io}
NAMES = {
    prefix + name: getattr(module, name)
    for prefix, module in MODULES.items()
    for name in module.__all__
    if name not in WITHOUT and not isinstance(getattr(module, name), types.ModuleType)
}
NAMES["tiles.render_tiles"] = sheetsplat.tiles.render_tiles
NAMES["compare.compare"] = sheetsplat.compare.compare
OF_PYVISTA = {
    "Camera.from_pyvista": "sheetsplat.camera:Camera.from_pyvista",
    "composite": "sheetsplat.integrations.pyvista:composite",
}


def names_of_examples():
    """Return what stands before every example: a cube of values, a scene of it and a camera."""
    values = np.zeros((8, 8, 8))
    values[2:6, 2:6, 2:6] = 1.0
    scene = ss.Scene(ss.RegularField(values), [(0, 0, 0, 0, 0), (1, 1, 0.8, 0.6, 0.5)])
    return {"ss": ss, "np": np, "values": values, "scene": scene, "camera": ss.Camera.fit(scene)}


def check_examples(target, name):
    """Run the examples of a docstring in the current folder."""
    text = inspect.getdoc(target) or ""
    assert ">>> " in text, "this public name has no example"
    assert max(map(len, textwrap.dedent(text).splitlines())) <= 120
    found = doctest.DocTestParser().get_doctest(text, names_of_examples(), name, None, 0)
    told: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ss.PictureWarning)
        failed = runner.run(found, out=told.append).failed
    assert failed == 0, "".join(told)


@pytest.mark.parametrize("name", NAMES)
def test_examples_of_docstrings(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_examples(NAMES[name], name)


def test_every_public_name_is_on_the_page():
    page = Path(__file__).parents[3] / "python/docs/api.md"
    if not page.is_file():
        pytest.skip("no pages beside the tests")
    listed = {line.strip().removeprefix("sheetsplat.") for line in page.read_text(encoding="utf-8").splitlines()}
    assert {name for name in NAMES if name not in listed} == set()


def test_properties_have_docstrings_of_their_own():
    without = [
        f"{name}.{attribute}"
        for name, target in NAMES.items()
        if isinstance(target, type)
        for attribute, member in vars(target).items()
        if isinstance(member, property) and not attribute.startswith("_")
        if not member.__doc__ or member.__doc__ == type(member).__doc__
    ]
    assert without == []


@pytest.mark.parametrize("name", OF_PYVISTA)
def test_examples_with_pyvista(name):
    pytest.importorskip("pyvista", reason="pyvista is not installed")
    check_examples(pkgutil.resolve_name(OF_PYVISTA[name]), name)

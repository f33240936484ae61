"""What importing the package does and does not do."""

from __future__ import annotations

import ast
import logging
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.errors import _EXTRAS

HEAVY = ("scipy", "click", "rich", "nrrd", "OpenEXR", "PIL", "cmap", "flip_evaluator", "matplotlib", "zipfile", "h5py")
HEAVY += (
    "xarray",
    "dask",
    "pandas",
    "zarr",
    "vtkmodules",
    "pyvista",
    "nibabel",
    "pydicom",
    "aiohttp",
    "anywidget",
    "IPython",
)


def python(code: str) -> str:
    """Return what a new interpreter prints."""
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


def test_import_reads_nothing_heavy():
    loaded = python("import sys, sheetsplat; print(*sorted(sys.modules))").split()
    numpys_own = set(python("import sys, numpy; print(*sorted(sys.modules))").split())
    assert [name for name in HEAVY if name in loaded and name not in numpys_own] == []
    # The check can fail: what reads a file does read its library.
    assert "nrrd" in python("import sys, sheetsplat.io.nrrd_files, nrrd; print(*sys.modules)").split()


def test_help_reads_nothing_of_other_libraries():
    """`sheetsplat --help` must be quick whatever is installed."""
    code = "import runpy, sys; sys.argv = ['sheetsplat', '--help']\n"
    code += "try: runpy.run_module('sheetsplat', run_name='__main__')\n"
    loaded = (
        python(code + "except SystemExit: pass\nprint('modules:', *sorted(sys.modules))").split("modules:")[1].split()
    )
    numpys_own = set(python("import sys, numpy; print(*sorted(sys.modules))").split())
    wanted = {"click", "rich"}
    assert "click" in loaded
    assert [name for name in HEAVY if name in loaded and name not in numpys_own | wanted] == []


def test_extras_of_messages_are_those_of_the_package():
    root = Path(__file__).parents[2]
    extras = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    # These are not for what a message may miss: a library that is no Python package, all of them, work on the package.
    others = {"osmesa", "all", "test", "docs", "bench", "dev"}
    assert set(_EXTRAS) == set(extras) - others
    for name, modules in _EXTRAS.items():
        required = {re.split(r"[\[<>=]", one)[0].lower() for one in extras[name]}
        assert required & {one.lower().replace("_", "-") for one in modules}, name
    page = (root / "python" / "docs" / "installation.md").read_text(encoding="utf-8")
    assert [name for name in extras if f"`{name}`" not in page] == []


def test_import_needs_no_opengl():
    code = "import sheetsplat; print([d.available for d in sheetsplat.devices() if d.backend == 'reference'])"
    environment = {"SHEETSPLAT_GL": "egl", "SHEETSPLAT_EGL_DEVICE": "9999", "PATH": "/usr/bin"}
    import os

    result = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert result.stdout.strip() == "[True]"


def test_all_names_are_there():
    for name in ss.__all__:
        assert getattr(ss, name) is not None, name
    assert ss.datasets.__name__ == "sheetsplat.datasets"
    missing = "no_such_name"
    with pytest.raises(AttributeError, match=missing):
        getattr(ss, missing)


def test_version_is_a_version():
    assert ss.__version__.count(".") == 2


def test_error_classes():
    for kind in (ss.InvalidInput, ss.DeviceUnavailable, ss.OutOfMemory, ss.Unsupported, ss.Cancelled):
        assert issubclass(kind, ss.Error)
    assert issubclass(ss.InvalidInput, ValueError)
    for kind in (ss.DeviceUnavailable, ss.OutOfMemory, ss.Unsupported):
        assert issubclass(kind, RuntimeError) and not issubclass(kind, ValueError)
    assert not issubclass(ss.InvalidInput, RuntimeError)
    assert ss.Error.__module__ == "sheetsplat"


def test_errors_can_be_pickled():
    import pickle

    error = pickle.loads(pickle.dumps(ss.InvalidInput("text")))
    assert type(error) is ss.InvalidInput and str(error) == "text"


def test_nothing_prints(capfd, ball):
    ss.render(ball, size=(16, 16), backend="reference")
    ss.devices()
    assert capfd.readouterr() == ("", "")


def test_log_has_a_line_a_picture(caplog, ball):
    with caplog.at_level(logging.DEBUG, "sheetsplat"):
        ss.render(ball, size=(16, 12), backend="reference")
    texts = [record.getMessage() for record in caplog.records if record.name == "sheetsplat"]
    assert any(text.startswith("rendered 16 x 12 on reference") for text in texts)
    assert any(text.startswith("plan\n") for text in texts)


def test_written_types_name_what_is_there():
    """The hand-written types and the module have the same classes, functions and members."""
    tree = ast.parse((Path(ss.__file__).parent / "_sheetsplat.pyi").read_text())
    told: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            told[node.name] = {part.name for part in node.body if isinstance(part, ast.FunctionDef)} - {"__init__"}
        elif isinstance(node, ast.FunctionDef):
            told[node.name] = set()
    there = {name for name in vars(_sheetsplat) if not name.startswith("_")}
    assert set(told) == there
    for name, members in told.items():
        if isinstance(getattr(_sheetsplat, name), type) and not issubclass(getattr(_sheetsplat, name), Exception):
            public = {member for member in vars(getattr(_sheetsplat, name)) if not member.startswith("_")}
            assert members == public, name


def test_arrays_of_pictures_outlive_them(ball):
    image = ss.render(ball, size=(20, 10), backend="reference", outputs=("depth", "coverage"))
    rgba, depth = image.rgba, image.depth
    before = rgba.copy(), depth.copy()
    del image
    np.full((2000, 2000), 7.0)
    assert np.array_equal(rgba, before[0]) and np.array_equal(depth, before[1])
    assert rgba.flags.writeable and rgba.dtype == np.float32 and rgba.flags.c_contiguous

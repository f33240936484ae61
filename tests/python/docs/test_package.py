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


def python(code: str) -> str:
    """Return what a new interpreter prints."""
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


# Modules of other packages, and of Python's own library those that take long to import.
SLOW = (
    "asyncio",
    "dataclasses",
    "inspect",
    "json",
    "multiprocessing",
    "typing_extensions",
    "unittest",
    "urllib.request",
)


def loaded_by(code: str) -> set[str]:
    """Return the modules that code loads in a new interpreter; what it prints must not be seen."""
    before = "import sys\nbefore = set(sys.modules)\n"
    after = "\nimport sys\nsys.__stderr__.write(' '.join(sorted(set(sys.modules) - before)))"
    done = subprocess.run([sys.executable, "-c", before + code + after], check=True, capture_output=True, text=True)
    return set(done.stderr.split())


def of_others(modules: set[str]) -> set[str]:
    """Return the packages among modules that are neither Python's nor this one."""
    found = {name.partition(".")[0] for name in modules} - sys.stdlib_module_names - {"sheetsplat"}
    return {name for name in found if not name.startswith("_sysconfigdata")}


def test_import_reads_nothing_else():
    """Importing takes no time: neither NumPy, nor the native module, nor anything slow of Python's own library."""
    loaded = loaded_by("import sheetsplat")
    assert of_others(loaded) == set()
    assert "sheetsplat._sheetsplat" not in loaded and loaded.isdisjoint(SLOW)
    assert {name for name in loaded if name.startswith("sheetsplat")} == {
        "sheetsplat",
        "sheetsplat._interrupt",
        "sheetsplat.accuracy",
    }
    # The check can fail, and names are there when they are asked for.
    assert "numpy" in loaded_by("import sheetsplat; sheetsplat.Camera")


def test_names_read_what_they_need():
    heavy = {"click", "rich", "nrrd", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "h5py", "xarray", "aiohttp"}
    loaded = of_others(loaded_by("import sheetsplat; sheetsplat.render; sheetsplat.Renderer"))
    assert "numpy" in loaded and loaded.isdisjoint(heavy)


def test_help_reads_nothing_of_other_libraries():
    """`sheetsplat --help` must be quick whatever is installed."""
    code = "import runpy\nsys.argv = ['sheetsplat', '--help']\n"
    code += "try: runpy.run_module('sheetsplat', run_name='__main__')\nexcept SystemExit: pass"
    loaded = loaded_by(code)
    assert of_others(loaded) == {"click"}
    assert "sheetsplat._sheetsplat" not in loaded
    assert not any(name.startswith(("sheetsplat.options", "sheetsplat.io")) for name in loaded)


@pytest.mark.parametrize("command", ["plan", "compare"])
def test_commands_read_their_own_modules(command):
    code = "import click\nfrom sheetsplat.cli import main\n"
    code += f"main.get_command(click.Context(main), {command!r})"
    own = {name for name in loaded_by(code) if name.startswith("sheetsplat.cli.")}
    assert f"sheetsplat.cli.{command}" in own
    assert own.isdisjoint({"sheetsplat.cli.view", "sheetsplat.cli.info", "sheetsplat.cli.demo"})


def test_import_is_silent():
    command = [
        sys.executable,
        "-W",
        "error",
        "-c",
        "import sheetsplat; [getattr(sheetsplat, n) for n in dir(sheetsplat)]",
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_type_checkers_see_the_names_that_are_there():
    """The imports for type checkers, the table of modules, and `__all__` name the same."""
    tree = ast.parse(Path(ss.__file__).read_text(encoding="utf-8"))
    told: dict[str, str] = {}
    for block in tree.body:
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name):
            for node in block.body:
                assert isinstance(node, ast.ImportFrom) and node.module is not None
                told |= {one.name: node.module for one in node.names}
    modules = {name for name, home in told.items() if home == "sheetsplat"}
    homes = {name: f"sheetsplat.{home}" for name, home in ss._HOME_OF.items()}
    assert homes == {name: home for name, home in told.items() if name not in modules}
    assert set(ss._MODULES) == modules
    assert set(ss.__all__) == {*told, "accuracy"} == set(dir(ss))
    assert len(ss.__all__) == len(set(ss.__all__))


@pytest.mark.parametrize("first", ["sheetsplat.accuracy.knobs", "sheetsplat.cli.accuracy", "sheetsplat.fit"])
def test_names_stay_what_they_are_whatever_is_imported_first(first):
    code = f"import {first}, sheetsplat as ss; print(callable(ss.accuracy), ss.fit.__name__, ss.open.__module__)"
    assert python(code).split() == ["True", "sheetsplat.fit", "sheetsplat.api"]


def test_every_page_of_the_documentation_is_in_its_contents():
    docs = Path(__file__).parents[3] / "python" / "docs"
    trees = re.findall(r"```{toctree}(.*?)```", (docs / "index.md").read_text(encoding="utf-8"), re.S)
    contents = re.findall(r"[\w-]+", " ".join(trees))
    assert [page.stem for page in docs.glob("*.md") if page.stem not in (*contents, "index")] == []


def test_extras_of_messages_are_those_of_the_package():
    root = Path(__file__).parents[3]
    extras = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    # These are not for what a message may miss: a library that is no Python package, all of them, work on the package.
    others = {"osmesa", "all", "test", "docs", "bench", "dev"}
    assert set(_EXTRAS) == set(extras) - others
    for name, modules in _EXTRAS.items():
        required = {re.split(r"[\[<>=]", one)[0].lower() for one in extras[name]}
        assert required & {one.lower().replace("_", "-") for one in modules}, name
    page = (root / "python" / "docs" / "installation.md").read_text(encoding="utf-8")
    assert [name for name in extras if f"`{name}`" not in page] == []


def test_the_recipe_for_conda_has_the_requirements_of_the_package():
    root = Path(__file__).parents[3]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    recipe = (root / "packaging" / "conda" / "meta.yaml").read_text(encoding="utf-8")

    def listed(part: str) -> set[str]:
        lines = re.search(rf"\n  {part}:\n((?:    - .*\n)+)", recipe)
        assert lines is not None, part
        return set(re.findall(r"- ([\w-]+ >=[\d.]+)", lines[1]))

    def required(names: list[str]) -> set[str]:
        return {one.lower().replace(">=", " >=").replace("openexr ", "openexr-python ") for one in names}

    assert listed("run") == required(project["project"]["dependencies"])
    assert listed("host") == required(project["build-system"]["requires"])
    assert set(re.findall(r"third_party/licences/\S+", recipe)) == {
        f"third_party/licences/{one.name}"
        for one in (root / "third_party" / "licences").iterdir()
        if one.name != "libpng.txt"  # which conda brings as a package of its own
    }


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
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id[0] != "_":
            told[node.target.id] = set()
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

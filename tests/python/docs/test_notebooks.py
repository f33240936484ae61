"""The notebooks of the documentation run from top to bottom."""

from __future__ import annotations

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="needs the packages nbclient and ipykernel")
nbclient = pytest.importorskip("nbclient", reason="needs the packages nbclient and ipykernel")
pytest.importorskip("ipykernel", reason="needs the packages nbclient and ipykernel")

NOTEBOOKS = Path(__file__).parents[3] / "python" / "docs" / "notebooks"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["first_steps", "galaxy"])
def test_notebook(name, tmp_path):
    pytest.importorskip("pandas", reason="needs the package pandas")
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "the repository holds notebooks without results"
    done = nbclient.NotebookClient(
        notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    pictures = [one for cell in done.cells for one in cell.get("outputs", ()) if "image/png" in one.get("data", {})]
    assert len(pictures) >= 3


def test_every_notebook_is_run():
    assert sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")) == ["first_steps", "galaxy"]

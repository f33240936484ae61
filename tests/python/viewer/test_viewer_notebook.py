"""The viewer's widget in JupyterLab, in a real browser."""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import subprocess
import sys
import time
import urllib.request

import pytest
from chromium import Chromium, missing

PACKAGES = ("jupyterlab", "ipykernel", "anywidget")


def absent() -> str:
    """Return why no notebook can be opened here, or an empty text."""
    lacking = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    return missing() or (f"no package {', '.join(lacking)}" if lacking else "")


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(absent()), reason=absent() or "-"),
]

CODE = """
import numpy as np
import sheetsplat as ss
z, y, x = np.mgrid[-1:1:16j, -1:1:16j, -1:1:16j]
viewer = ss.view(100 * np.exp(-2 * (x**2 + y**2 + z**2)), backend="cpu")
viewer
"""
AFTER = "viewer.save('saved.png', size=(20, 10)); print(viewer.scene.mode)"


def cell(text):
    return {"cell_type": "code", "source": text, "metadata": {}, "outputs": [], "execution_count": None, "id": text[:3]}


@pytest.fixture
def lab(tmp_path):
    """Yield the address of JupyterLab in an empty folder with a notebook."""
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = {"cells": [cell(CODE), cell(AFTER)], "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "x.ipynb").write_text(json.dumps(notebook))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    environment = {**os.environ, "JUPYTER_CONFIG_DIR": str(tmp_path / "c"), "JUPYTER_RUNTIME_DIR": str(tmp_path / "r")}
    flags = ["--no-browser", f"--port={port}", "--IdentityProvider.token=t", "--LabApp.expose_app_in_browser=True"]
    command = [sys.executable, "-m", "jupyterlab", *flags, "--allow-root", f"--ServerApp.root_dir={tmp_path}"]
    with open(tmp_path / "log", "w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=tmp_path)
    address = f"http://127.0.0.1:{port}"
    try:
        end = time.monotonic() + 90.0
        while True:
            try:
                urllib.request.urlopen(f"{address}/api?token=t", timeout=5).close()
                break
            except OSError:
                assert time.monotonic() < end and process.poll() is None, (tmp_path / "log").read_text()
                time.sleep(0.2)
        yield address
    finally:
        process.terminate()
        process.wait(30)


def test_the_widget_in_jupyterlab(lab, tmp_path):
    browser = Chromium()
    try:
        page = browser.page(f"{lab}/lab/tree/x.ipynb?token=t", (1100, 900))
        page.wait("!!window.jupyterapp && !!document.querySelector('.jp-Notebook .jp-Cell')", 120)
        page.wait("window.jupyterapp.shell.currentWidget.sessionContext.session.kernel.status === 'idle'", 120)
        page.evaluate("window.jupyterapp.commands.execute('notebook:run-cell').then(() => 0)")
        page.wait("window.sheetsplat && window.sheetsplat.view.drawn.last", 120)
        page.screenshot(os.environ.get("SHEETSPLAT_NOTEBOOK_PICTURE", tmp_path / "notebook.png"))
        box = page.evaluate(
            "(b => [b.left + b.width / 2, b.top + b.height / 2])"
            "(document.querySelector('.sheetsplat-viewer .stage').getBoundingClientRect())"
        )
        before = page.evaluate("window.sheetsplat.view.camera.eye")
        number = page.evaluate("window.sheetsplat.view.drawn.number")
        page.drag(box, (box[0] + 60, box[1] + 20))
        page.wait(f"window.sheetsplat.view.drawn.number > {number} && window.sheetsplat.view.drawn.last")
        assert page.evaluate("window.sheetsplat.view.camera.eye") != before
        page.evaluate("window.sheetsplat.set({mode: 'mip'})")
        page.wait("window.sheetsplat.view.state.mode === 'mip' && window.sheetsplat.view.drawn.last")
        # The kernel answers cells as well, and knows what the widget shows.
        page.evaluate(
            "window.jupyterapp.commands.execute('notebook:move-cursor-down')"
            ".then(() => window.jupyterapp.commands.execute('notebook:run-all-below')).then(() => 0)"
        )
        page.wait(
            "[...document.querySelectorAll('.jp-OutputArea-output')].some(o => o.textContent.trim() === 'mip')", 60
        )
        assert (tmp_path / "saved.png").exists()
    finally:
        browser.close()

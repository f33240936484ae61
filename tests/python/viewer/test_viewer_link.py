"""Who gets the link of the viewer's page: the browser by a file that its owner alone can read, and nobody else."""

from __future__ import annotations

import os
import re
import signal
import stat
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

import sheetsplat as ss

pytest.importorskip("aiohttp", reason="aiohttp is not installed")
pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="the browser of these tests is a script of a shell"),
    pytest.mark.usefixtures("ctrl_c"),
]

VALUES = np.linspace(0, 1, 64, dtype=np.float32).reshape(4, 4, 4)
BROWSER = """#!/bin/sh
# Whole when it is there.
printf '%s\\n' "$@" > "$0.tmp" && mv "$0.tmp" "$0.arguments"
"""


@pytest.fixture
def browser(tmp_path, monkeypatch):
    """Return where a browser that does nothing else writes its arguments."""
    program = tmp_path / "browser"
    program.write_text(BROWSER)
    program.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(program))
    return tmp_path / "browser.arguments"


def given(arguments: Path) -> Path:
    """Return the file that the browser was given, as its only argument."""
    end = time.monotonic() + 60
    while not arguments.exists():
        assert time.monotonic() < end
        time.sleep(0.01)
    (line,) = arguments.read_text().splitlines()
    address = urlsplit(line)
    assert address.scheme == "file" and not address.netloc
    return Path(urllib.request.url2pathname(address.path))


def program(tmp_path, *command):
    np.save(tmp_path / "a.npy", VALUES)
    return subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_browser_is_given_a_file_of_its_owner_that_leads_to_the_page(browser, tmp_path):
    command = program(tmp_path, "-m", "sheetsplat", "view", str(tmp_path / "a.npy"), "--backend", "cpu")
    try:
        link = command.stdout.readline().strip()
        token = urlsplit(link).path.strip("/")
        path = given(browser)
        assert len(token) == 22 and token not in browser.read_text()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
        (led,) = re.findall(r'http-equiv="refresh" content="0;url=([^"]*)"', path.read_text())
        assert led == link and 'content="no-referrer"' in path.read_text()
        with urllib.request.urlopen(led, timeout=20) as answer:
            assert b"viewer.js" in answer.read() and answer.headers["Referrer-Policy"] == "no-referrer"
            assert answer.headers["Set-Cookie"] is None
    finally:
        command.send_signal(signal.SIGINT)
        _, told = command.communicate(timeout=60)
    assert command.returncode == 0 and not path.parent.exists()
    assert token not in told


@pytest.mark.parametrize("end", ["viewer.close()", "sys.exit()", "1 / 0"])
def test_the_file_goes_with_the_viewer_or_the_process(browser, tmp_path, end):
    code = f"""
import sys, os, sheetsplat as ss, numpy as np
viewer = ss.view(np.load(sys.argv[1]), browser=True, backend="cpu")
while not os.path.exists(sys.argv[2]): pass
assert viewer.open_browser()
{end}
"""
    done = program(tmp_path, "-c", code, str(tmp_path / "a.npy"), str(browser))
    done.communicate(timeout=60)
    path = given(browser)
    assert path.name == "viewer.html" and not path.parent.exists()


def test_a_viewer_that_opens_no_browser_writes_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with ss.view(VALUES, browser=False, backend="cpu") as viewer:
        assert viewer.url and not list(tmp_path.iterdir())


def test_without_a_place_for_the_file_no_browser_is_opened(browser, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with ss.view(VALUES, browser=False, backend="cpu") as viewer:
        assert not viewer.open_browser()
    assert not browser.exists()

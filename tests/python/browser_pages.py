"""The viewer's page in a browser: what tests of it do and see."""

from __future__ import annotations

import base64
import io
import shutil
import subprocess
import time
from contextlib import contextmanager

import numpy as np
import pytest
from chromium import missing
from PIL import Image as Pillow

import sheetsplat as ss

LAST = "window.sheetsplat.view.drawn.last"
# A browser may lay out its page anew after the first picture.
FITS = """(([width, height], stage, ratio) => width === Math.round(stage.clientWidth * ratio) &&
height === Math.round(stage.clientHeight * ratio))(window.sheetsplat.view.drawn.size,
document.querySelector('.stage'), Math.min(window.devicePixelRatio || 1, 1.5))"""
# The panels stand beside the picture from 760 pixels on; the picture is small, so that it is drawn soon.
SIZE = (780, 480)
NARROW = (390, 760)
#: Marks of tests in a browser.
IN_BROWSER = [pytest.mark.slow, pytest.mark.skipif(bool(missing()), reason=missing() or "-")]


def values(n=16, shift=0.0):
    z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, n)], indexing="ij")
    return (100.0 * np.exp(-2.0 * ((x - shift) ** 2 + y**2 + (1.5 * z) ** 2))).astype(np.float32)


def shown(page):
    """Return the number of the last frame."""
    return page.evaluate("window.sheetsplat.view.drawn.number")


def complete_after(page, number):
    """Wait for a complete picture that is newer than a frame, and until no newer one comes.

    The first one may be the finer one of what was done before.
    """
    page.wait(f"window.sheetsplat.view.drawn.number > {number} && {LAST}")
    before, end = number, time.monotonic() + 10
    while (now := shown(page)) != before and time.monotonic() < end:
        before = now
        time.sleep(0.3)
        page.wait(LAST)


def pixels(page):
    """Return what the picture's canvas shows."""
    text = page.evaluate("document.querySelector('canvas.picture').toDataURL()")
    return np.asarray(Pillow.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))).convert("RGB"))


def middle_of(page, selector):
    return page.evaluate(
        f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
        " return [b.left + b.width / 2, b.top + b.height / 2] })()"
    )


def press(page, text):
    page.evaluate(f"[...document.querySelectorAll('button')].find(b => b.textContent === {text!r}).click()")


def tick(page, text):
    page.evaluate(
        f"[...document.querySelectorAll('label.check')].find(b => b.textContent === {text!r}).firstChild.click()"
    )


def camera_of(page):
    return page.evaluate("window.sheetsplat.view.camera")


def saved(path, seconds=240):
    """Wait until the browser has saved a file, and return its bytes."""
    end = time.monotonic() + seconds
    while not path.exists() or not path.stat().st_size:
        assert time.monotonic() < end
        time.sleep(0.05)
    return path.read_bytes()


def fetched_rules(folder):
    """Return the script of axe-core, which npm fetches."""
    if not shutil.which("npm"):
        pytest.skip("no npm, which fetches axe-core")
    packed = ["npm", "pack", "axe-core@4", "--silent", "--pack-destination", str(folder)]
    fetched = subprocess.run(packed, cwd=folder, capture_output=True, timeout=60, check=False)
    if fetched.returncode:
        pytest.skip("npm cannot fetch axe-core")
    shutil.unpack_archive(next(folder.glob("*.tgz")), folder)
    return (folder / "package" / "axe.min.js").read_text()


def serious(page, rules):
    """Return what accessibility rules find that is serious or critical."""
    page.evaluate(rules + ";0")
    return page.evaluate(
        "axe.run(document, {resultTypes: ['violations']}).then((found) => found.violations"
        ".filter((one) => ['serious', 'critical'].includes(one.impact))"
        ".map((one) => [one.id, one.nodes.map((node) => node.html.slice(0, 120)).slice(0, 3)]))"
    )


def open_all(page):
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true })")


@contextmanager
def viewed(browser):
    """Give a function that views data and opens the page; all are closed, and no page must have complained."""
    viewers, pages = [], []

    def make(data=None, *, viewer=None, size=SIZE, **options):
        if viewer is None:
            viewer = ss.view(data, browser=False, backend="cpu", **options)
            viewers.append(viewer)
        page = browser.page(viewer.url, size)
        pages.append(page)
        page.wait(f"{LAST} && {FITS}")
        return viewer, page

    yield make
    faults = [fault for page in pages for fault in page.faults()]
    for page in pages:
        page.close()
    for viewer in viewers:
        viewer.close()
    assert faults == []

"""What the page does without a click, without a second movement and without a pointer; what it keeps and saves."""

from __future__ import annotations

import io
import time

import numpy as np
import pytest
from browser_pages import (
    IN_BROWSER,
    LAST,
    NARROW,
    camera_of,
    complete_after,
    middle_of,
    open_all,
    press,
    saved,
    serious,
    shown,
    tick,
    values,
)
from PIL import Image as Pillow

import sheetsplat as ss
from sheetsplat.viewer.page import files

pytestmark = IN_BROWSER
CONTROL, SHIFT = 2, 8


def test_keys_work_without_a_click_and_leave_fields_alone(paged):
    viewer, page = paged(values())
    number = shown(page)
    page.key("2")
    complete_after(page, number)
    assert viewer.scene.mode == "isosurface"
    before = camera_of(page)
    page.evaluate("[...document.querySelectorAll('aside input.number')].find((one) => one.offsetParent).focus()")
    page.key("1")
    page.key("ArrowLeft")
    time.sleep(0.3)
    assert page.evaluate("window.sheetsplat.view.state.mode") == "isosurface" and camera_of(page) == before


def test_keys_that_are_held_turn_on_from_where_they_are(paged):
    _, page = paged(values(40))
    before = camera_of(page)
    for _ in range(12):
        page.key("ArrowLeft")
    page.wait(LAST)
    turned = np.subtract(camera_of(page)["eye"], camera_of(page)["target"])
    start, up = np.subtract(before["eye"], before["target"]), np.asarray(before["up"])
    start, turned = (one / np.linalg.norm(one) for one in (start, turned))
    angle = np.degrees(np.arctan2(np.dot(np.cross(turned, start), up), np.dot(start, turned)))
    assert angle == pytest.approx(12 * 7.5, abs=0.01)


def test_undo_and_redo_by_keys_and_buttons(paged):
    viewer, page = paged(values())
    at = middle_of(page, ".stage")
    first, number = camera_of(page), shown(page)
    page.drag(at, (at[0] + 80, at[1]))
    complete_after(page, number)
    turned = viewer.camera
    time.sleep(0.7)
    page.key("b")
    page.wait("window.sheetsplat.view.state.shows.box && !document.querySelector('[title^=Undo]').disabled")
    page.key("z", CONTROL)
    page.wait("!window.sheetsplat.view.state.shows.box")
    page.key("z", CONTROL)
    page.wait(f"Math.abs(window.sheetsplat.view.camera.eye[0] - {first['eye'][0]}) < 1e-9")
    page.wait("document.querySelector('[title^=Undo]').disabled")
    page.evaluate("document.querySelector('[title^=Redo]').click()")
    page.wait(f"Math.abs(window.sheetsplat.view.camera.eye[0] - {turned.eye[0]}) < 1e-9")
    page.key("Z", CONTROL | SHIFT)
    page.wait("window.sheetsplat.view.state.shows.box")


def test_the_value_under_a_pointer_that_rests_comes_with_the_picture(paged):
    _, page = paged(values(48))
    at = middle_of(page, ".stage")
    page.mouse("mouseMoved", (at[0] + 9, at[1]))
    page.evaluate("window.sheetsplat.set({quality: 'best'})")
    page.mouse("mouseMoved", at)
    page.wait("document.querySelector('.hover').textContent.includes('opacity')")
    before = page.evaluate("document.querySelector('.hover').textContent")
    page.evaluate("window.sheetsplat.set({mode: 'mip'})")
    page.wait(f"document.querySelector('.hover').textContent !== {before!r} && {LAST}")


def test_a_picture_is_saved_as_it_is_shown(paged, tmp_path):
    viewer, page = paged(values())
    page.command("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    open_all(page)
    page.evaluate("window.sheetsplat.set({backdrop: '#ffffff', shows: {box: true, scale: true}})")
    page.wait("window.sheetsplat.view.state.shows.scale")
    page.evaluate("window.sheetsplat.set({measures: [[[0, 0, 0], [3, 4, 0]]]})")
    time.sleep(0.5)
    page.wait(LAST)
    page.key("s")
    found = np.asarray(Pillow.open(io.BytesIO(saved(tmp_path / "ndarray.png"))).convert("RGB"), float)
    x, y, width, height = page.evaluate(
        "(b => [b.left, b.top, b.width, b.height])(document.querySelector('canvas.overlay').getBoundingClientRect())"
    )
    page.evaluate("document.querySelectorAll('.notice').forEach(one => one.remove())")
    page.screenshot(tmp_path / "seen.png")
    seen = Pillow.open(tmp_path / "seen.png").convert("RGB").crop((x, y, x + width, y + height))
    assert seen.size == found.shape[1::-1]
    assert np.abs(np.asarray(seen, float) - found).mean() < 0.5
    bare = np.asarray(viewer.render(found.shape[1::-1]).to_pil().convert("RGB"), float)
    assert np.abs(bare - found).mean() > 5
    assert ss.Recipe.read(tmp_path / "ndarray.png").camera == viewer.camera


def test_distances_and_angles_are_measured_with_pointer_and_keys(paged):
    _, page = paged(values())
    x, y = middle_of(page, ".stage")
    page.key("d")
    page.click((x - 30, y))
    page.wait("document.querySelector('.hint[role=status]').textContent.startsWith('Point 2')")
    page.click((x + 30, y + 20))
    page.wait("window.sheetsplat.view.state.measures.length === 1")
    (points,) = page.evaluate("window.sheetsplat.view.state.measures")
    told = page.evaluate("document.querySelector('.value').textContent")
    assert float(told) == pytest.approx(np.linalg.norm(np.subtract(*points)), rel=1e-3)
    page.key("a")
    for count, key in enumerate(("ArrowLeft", "ArrowUp", "ArrowRight"), 1):
        number = shown(page)
        page.key(key)
        complete_after(page, number)
        page.key("Enter")
        if count < 3:
            page.wait(f"document.querySelector('.hint[role=status]').textContent.startsWith('Point {count + 1}')")
    page.wait("window.sheetsplat.view.state.measures.length === 2")
    assert page.evaluate("[...document.querySelectorAll('.value')].at(-1).textContent").endswith("°")
    press(page, "Remove")
    page.wait("window.sheetsplat.view.state.measures.length === 1")


def test_own_presets_are_kept_in_the_browser(paged):
    viewer, page = paged(values())
    number = shown(page)
    page.evaluate("window.sheetsplat.set({look: {group: 0, cmap: 'magma', range: [20, 70]}})")
    complete_after(page, number)
    page.go(viewer.url)
    page.wait(LAST)
    wanted = viewer.scene.transfer_function
    page.evaluate("document.querySelector('input.text').value = 'mine'")
    press(page, "Keep")
    page.go(viewer.url)
    page.wait(LAST)
    number = shown(page)
    press(page, "Automatic")
    complete_after(page, number)
    assert viewer.scene.transfer_function != wanted
    number = shown(page)
    page.evaluate(
        "(s => { s.value = 'mine'; s.dispatchEvent(new Event('change')) })"
        "(document.querySelector('select[title=\"Own preset\"]'))"
    )
    complete_after(page, number)
    at = np.linspace(0.0, 100.0, 21)
    assert np.allclose(viewer.scene.transfer_function.at(at), wanted.at(at), atol=0.02)
    press(page, "Forget")
    assert page.evaluate("localStorage.getItem('sheetsplat-presets')") == "{}"


def test_rules_of_accessibility_find_nothing_serious(paged, rules):
    _, page = paged(values())
    assert serious(page, rules) == []
    open_all(page)
    for name in ("Ambient occlusion", "Fade with depth", "Box"):
        tick(page, name)
    press(page, "Plane across x")
    page.evaluate("window.sheetsplat.set({measures: [[[0, 0, 0], [3, 4, 0]]]})")
    page.wait(f"document.querySelector('.value') && {LAST}")
    assert serious(page, rules) == []
    page.evaluate("document.querySelector('[title=\"Light or dark\"]').click()")
    page.resize(NARROW)
    page.key("?")
    page.wait("document.querySelector('dialog[open]') !== null")
    assert serious(page, rules) == []
    page.evaluate("document.querySelector('dialog[open]').close()")
    for mode in ("isosurface", "mip"):
        number = shown(page)
        page.evaluate(f"window.sheetsplat.set({{mode: '{mode}'}})")
        complete_after(page, number)
        assert serious(page, rules) == []


def test_a_narrow_page_has_everything_within_its_width(paged):
    _, page = paged(values(), size=NARROW)
    open_all(page)
    beyond = page.evaluate(
        "[...document.querySelectorAll('.sheetsplat-viewer *')].filter((one) => one.offsetParent"
        " && one.getBoundingClientRect().right > innerWidth + 0.5).map((one) => one.outerHTML.slice(0, 90))"
    )
    assert beyond == []
    assert page.evaluate("document.querySelector('.stage').clientHeight") > 200


def test_all_can_be_reached_and_left_by_the_tab_key(paged):
    _, page = paged(values())
    open_all(page)
    wanted = page.evaluate(
        "[...document.querySelectorAll('.sheetsplat-viewer :is(button, select, input, summary, canvas, .stage)')]"
        ".filter((one) => one.offsetParent && !one.disabled && one.tabIndex >= 0).length"
    )
    page.evaluate("window.met = new Set(); document.addEventListener('focusin', (event) => met.add(event.target))")
    for _ in range(wanted + 5):
        page.command("Input.dispatchKeyEvent", type="keyDown", key="Tab", windowsVirtualKeyCode=9)
        page.command("Input.dispatchKeyEvent", type="keyUp", key="Tab", windowsVirtualKeyCode=9)
    assert page.evaluate("met.size") == wanted


def test_curves_and_lights_are_changed_by_keys(paged):
    viewer, page = paged(values())
    open_all(page)
    before = viewer.scene
    for where, keys in ((".editor", ("PageDown", "ArrowUp", "ArrowUp")), (".pad", ("ArrowLeft",))):
        number = shown(page)
        page.evaluate(f"document.querySelector('{where}').focus({{focusVisible: true}})")
        for key in keys:
            page.key(key)
        complete_after(page, number)
    assert viewer.scene.transfer_function != before.transfer_function
    assert viewer.scene.options["lights"] != before.options["lights"]


def test_the_page_says_that_it_draws(paged):
    _, page = paged(values())
    script = files.widget_script().rpartition("// The widget")[0]
    page.evaluate(
        f"(() => {{ {script}"
        """
        const root = document.createElement("div");
        root.style.height = "400px";
        document.body.replaceChildren(root);
        mount(root, (handlers) => { window.line = handlers; return { send() {}, close() {} }; }); })()"""
    )
    page.evaluate("line.open()")
    visible = "!document.querySelector('.sign').hidden"
    assert page.evaluate(visible)
    assert page.evaluate("document.querySelector('.stage').ariaBusy") == "true"
    frame = (
        "(async (last, number) => { const canvas = document.createElement('canvas');"
        " const blob = await new Promise((take) => canvas.toBlob(take));"
        " const camera = {kind: 'orthographic', eye: [0, 0, 9], target: [0, 0, 0], up: [0, 1, 0], height: 4};"
        " await line.message({type: 'frame', number, last, kind: 'png', size: [300, 150], stage: 1, stages: 1,"
        " error: null, milliseconds: 1, bars: [], camera}, new Uint8Array(await blob.arrayBuffer())); })"
    )
    page.evaluate(f"{frame}(true, 1)")
    page.wait(f"!({visible})")
    assert page.evaluate("document.querySelector('.stage').ariaBusy") == "false"
    page.evaluate("line.message({type: 'drawing'})")
    assert not page.evaluate(visible)
    page.wait(visible, 5)
    page.evaluate(f"{frame}(false, 2)")
    page.wait(f"!({visible})", 0.3)
    page.wait(visible, 5)

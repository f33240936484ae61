"""Panels of labels, channels, colours by another array and slice planes, in a browser: keys alone, on a narrow page."""

from __future__ import annotations

import numpy as np
import pytest
from browser_pages import (
    IN_BROWSER,
    NARROW,
    complete_after,
    open_all,
    pixels,
    serious,
    shown,
    tick,
    values,
)

import sheetsplat as ss

pytestmark = IN_BROWSER
RED = (1.0, 0.0, 0.0)


def labels(count):
    """Return a field of so many cubes beside each other along x."""
    made = np.zeros((8, 8, 4 * count), np.uint8)
    for label in range(1, count + 1):
        made[2:6, 2:6, 4 * label - 4 : 4 * label - 1] = label
    names = {label: f"part {label}" for label in range(1, count + 1)}
    return ss.RegularField(made, labels=True).with_label_colors(ss.LabelColors.distinct(names, names))


def focus(page, label):
    """Give the focus to the control with a name for screen readers; Tab reaches all of them."""
    assert page.evaluate(
        "(() => { const named = (one) => one.ariaLabel || (one.labels && one.labels.length ? one.labels[0].textContent"
        f" : one.textContent); const found = [...document.querySelectorAll('aside :is(button, input, select)')]"
        f".find((one) => one.offsetParent && named(one) === {label!r}); if (!found) return false;"
        " found.focus({focusVisible: true}); return document.activeElement === found && found.tabIndex >= 0; })()"
    ), label


def pressed(page, label, *keys):
    """Press keys on a control; return the pixels before and after."""
    before, number = pixels(page), shown(page)
    focus(page, label)
    for key in keys:
        page.key(key)
    complete_after(page, number)
    return before, pixels(page)


def chosen(page, label, value, *, drawn=True):
    """Choose in a list, which the browser's own keys do; `drawn`: another picture follows."""
    number = shown(page)
    focus(page, label)
    page.evaluate(
        f"(() => {{ const one = document.activeElement; one.value = {value!r};"
        " one.dispatchEvent(new Event('change')); })()"
    )
    if drawn:
        complete_after(page, number)


def within_its_width(page):
    return page.evaluate(
        "[...document.querySelectorAll('.sheetsplat-viewer aside *')].filter((one) => one.offsetParent"
        " && one.getBoundingClientRect().right > innerWidth + 0.5).map((one) => one.outerHTML.slice(0, 90))"
    )


def test_labels_are_switched_and_made_opaque_by_keys(paged, rules):
    viewer, page = paged(labels(14), size=NARROW)
    open_all(page)
    assert serious(page, rules) == [] and within_its_width(page) == []
    before, after = pressed(page, "part 3", " ")
    assert not np.array_equal(before, after) and 3 not in viewer.scene.transfer_function.colors
    _, after = pressed(page, "part 3", " ")
    assert np.array_equal(before, after)
    pressed(page, "Opacity of part 2", "ArrowDown", "ArrowDown")
    assert viewer.scene.transfer_function.colors[2][3] == pytest.approx(0.9)
    # What does not fit the text is neither listed nor switched.
    focus(page, "Labels to list")
    for key in "part 14":
        page.key(key)
    listed = "[...document.querySelectorAll('.label-row')].filter((one) => one.offsetParent).length"
    assert page.evaluate(listed) == 1
    pressed(page, "All off", " ")
    assert set(viewer.scene.transfer_function.colors) == set(range(1, 14))
    focus(page, "Labels to list")
    page.evaluate("document.activeElement.value = ''; document.activeElement.dispatchEvent(new Event('input'))")
    pressed(page, "Only part 5", " ")
    assert set(viewer.scene.transfer_function.colors) == {5}
    pressed(page, "All on", " ")
    assert len(viewer.scene.transfer_function.colors) == 14
    number = shown(page)
    focus(page, "Colour of part 1")
    page.evaluate("document.activeElement.value = '#ff0000'; document.activeElement.dispatchEvent(new Event('input'))")
    complete_after(page, number)
    assert viewer.scene.transfer_function.colors[1][:3] == RED
    number = shown(page)
    page.key("z", modifiers=2)
    complete_after(page, number)
    assert viewer.scene.transfer_function.colors[1][:3] != RED
    assert viewer.scene.transfer_function.names[1] == "part 1"


def test_channels_are_switched_and_colored(paged, rules):
    fields = [ss.RegularField(values(shift=shift)).with_color(color) for shift, color in ((0.4, "cyan"), (-0.4, "red"))]
    viewer, page = paged(fields, size=NARROW)
    open_all(page)
    assert serious(page, rules) == [] and within_its_width(page) == []
    names = page.evaluate("[...document.querySelectorAll('.label-row .check')].map((one) => one.textContent)")
    before, after = pressed(page, names[1], " ")
    assert before[..., 0].sum() > 2 * after[..., 0].sum()
    assert not viewer.scene.transfer_functions[1].points[:, 4].any()
    number = shown(page)
    page.evaluate("window.sheetsplat.set({mode: 'mip'})")
    complete_after(page, number)
    alone = pixels(page)
    assert alone[..., 0].max() == 0 < alone[..., 1].max()
    _, both = pressed(page, names[1], " ")
    assert both[..., 0].max() > 200
    number = shown(page)
    focus(page, f"Colour of {names[1]}")
    page.evaluate("document.activeElement.value = '#00ff00'; document.activeElement.dispatchEvent(new Event('input'))")
    complete_after(page, number)
    assert pixels(page)[..., 0].max() == 0
    # The editor has the chosen channel.
    chosen(page, "Data whose transfer function is shown", "1", drawn=False)
    pressed(page, "Automatic", " ")
    assert pixels(page)[..., 0].max() > 200


def test_another_array_gives_the_colors(paged, rules, tmp_path):
    path = tmp_path / "two.npz"
    np.savez(path, density=values(), heat=np.ascontiguousarray(values(shift=0.7).T))
    viewer, page = paged(path, size=NARROW)
    open_all(page)
    before = pixels(page)
    chosen(page, "Array that gives the colours", "heat")
    assert any(viewer.scene.color_by) and not np.array_equal(before, pixels(page))
    chosen(page, "Colours of that array", "magma")
    assert "color_map='magma'" in viewer.code()
    assert serious(page, rules) == [] and within_its_width(page) == []
    chosen(page, "Array that gives the colours", "")
    assert np.array_equal(before, pixels(page))


def test_slice_planes_are_moved_by_keys(paged, rules):
    viewer, page = paged(values(), size=NARROW)
    open_all(page)
    before, after = pressed(page, "Across x", " ")
    assert not np.array_equal(before, after)
    first = viewer.scene.options["slice_planes"]
    assert [one.normal for one in first] == [(1.0, 0.0, 0.0)] and first[0].offset == 7.5
    pressed(page, "x =", "PageUp")
    assert viewer.scene.options["slice_planes"][0].offset > 8.0
    pressed(page, "Of any direction", " ")
    across, free = viewer.scene.options["slice_planes"]
    for name in ("Azimuth [°]", "Elevation [°]", "Distance"):
        known = viewer.scene.options["slice_planes"]
        pressed(page, name, "PageDown")
        assert viewer.scene.options["slice_planes"][0] == across and viewer.scene.options["slice_planes"] != known
    # The axes have planes of their own, which a free one never becomes.
    for name, value in (("Azimuth [°]", "90"), ("Elevation [°]", "0")):
        focus(page, name)
        page.evaluate(
            "(() => { const one = document.activeElement.parentElement.querySelector('.number');"
            f" one.value = {value}; one.dispatchEvent(new Event('change')); }})()"
        )
    page.wait("window.sheetsplat.view.drawn.last")
    assert page.evaluate("[...document.querySelectorAll('label.check')].filter((one) => one.firstChild.checked"
                         " && /^Across|^Of any/.test(one.textContent)).length") == 2  # fmt: skip
    chosen(page, "Colours of the planes", "viridis")
    assert {one.cmap for one in viewer.scene.options["slice_planes"]} == {"viridis"}
    assert serious(page, rules) == [] and within_its_width(page) == []
    pressed(page, "Across x", " ")
    assert len(viewer.scene.options["slice_planes"]) == 1
    _, after = pressed(page, "Remove the planes", " ")
    assert np.array_equal(before, after)


def test_labels_beside_a_surface_are_listed_and_faces_are_switched(paged, rules):
    fields = [ss.RegularField(values(n=8)), labels(2)]
    viewer, page = paged(fields, size=NARROW, mode="isosurface", shading=True)
    open_all(page)
    assert serious(page, rules) == [] and within_its_width(page) == []
    before, after = pressed(page, "part 1", " ")
    assert not np.array_equal(before, after) and 1 not in viewer.scene.transfer_functions[1].colors
    # The surfaces are edited beside them.
    assert viewer.scene.surfaces and page.evaluate(
        "[...document.querySelectorAll('button')].some(one => one.textContent === 'Add a surface' && one.offsetParent)"
    )
    number = shown(page)
    page.evaluate("window.sheetsplat.set({mode: 'composite'})")
    complete_after(page, number)
    before, after = pressed(page, "Light the faces of cuts", " ")
    assert not np.array_equal(before, after) and viewer.scene.options["cut_faces"] is False
    _, after = pressed(page, "Light the faces of cuts", " ")
    assert np.array_equal(before, after)


def test_a_first_cut_lights_its_faces_on_the_page_too(paged):
    centres = np.random.default_rng(2).uniform(0, 9, (30, 3))
    viewer, page = paged(ss.EllipsoidField(centres, np.full(30, 3.0), values=np.arange(30.0)), size=NARROW)
    open_all(page)
    ticked = (
        "[...document.querySelectorAll('label.check')].find((one) => /^Light the faces/.test(one.textContent))"
        ".firstChild.checked"
    )
    assert not page.evaluate(ticked)
    pressed(page, "Plane across x", " ")
    assert page.evaluate(ticked) and viewer.scene.options["cut_faces"] is True
    pressed(page, "Light the faces of cuts", " ")
    assert not page.evaluate(ticked) and viewer.scene.options["cut_faces"] is False
    pressed(page, "Plane across y", " ")
    assert not page.evaluate(ticked) and viewer.scene.options["cut_faces"] is False


def test_names_beside_the_bar_of_labels_have_room(paged):
    field = labels(60)
    named = field.with_label_colors(ss.LabelColors(field.label_colors.colors, {1: "part " + 300 * "a"}))
    _, page = paged(named)
    page.evaluate(
        "(() => { window.told = []; const of = CanvasRenderingContext2D.prototype, draw = of.fillText;"
        " of.fillText = function (text, x, y) { window.told.push([text, y]); draw.call(this, text, x, y); }; })()"
    )
    tick(page, "Directions")
    page.wait("window.told.length > 0")
    told = page.evaluate("window.told.splice(0)")
    names = {text: y for text, y in told if text.startswith(("part", "label "))}
    heights = sorted(names.values())
    assert 5 < len(names) < 40 and min(np.diff(heights)) >= 12 and max(map(len, names)) <= 25

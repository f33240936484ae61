"""Arguments of a wrong kind: each is an error of the package that comes at once, whatever NumPy would have said."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import bcc, tiles

BIG = 10**400
SAMPLES = np.random.default_rng(0).random((8, 8, 8))
FIELD = ss.RegularField(SAMPLES)
TF = ss.TransferFunction([(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)])
CAMERA = ss.Camera.fit(FIELD)
CORNERS, FACES = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)
ENDLESS_LIST: list[Any] = []
ENDLESS_LIST.append(ENDLESS_LIST)


def endless() -> Iterator[float]:
    while True:
        yield 1.0


def renderer() -> ss.Renderer:
    return ss.Renderer("cpu")


def scene(**options: Any) -> ss.Scene:
    return ss.Scene(FIELD, TF, **options)


def render(**options: Any) -> ss.Image:
    return ss.render(FIELD, **{"size": 8, "backend": "cpu", **options})


WRONG: dict[str, Callable[[], object]] = {
    "render: a word for the renderer": lambda: render(renderer="cpu"),
    "render: a size of 400 digits": lambda: render(size=BIG),
    "render: a mode that is an array": lambda: render(mode=np.array([])),
    "render: an angle of 400 digits": lambda: render(azimuth=BIG),
    "render: limits of 400 digits": lambda: render(clim=(0, BIG)),
    "render: limits without an end": lambda: render(clim=endless()),
    "render: a long range as limits": lambda: render(clim=range(10**18)),
    "render: a long range as opacity": lambda: render(opacity=range(10**18)),
    "render: opacities without an end": lambda: render(opacity=endless()),
    "render: a list in itself as opacity": lambda: render(opacity=ENDLESS_LIST),
    "render: colours without an end": lambda: render(cmap=endless()),
    "render: no data": lambda: ss.render(None),
    "Renderer.render: a width of 400 digits": lambda: renderer().render(scene(), CAMERA, size=(BIG, 3)),
    "Renderer.render: an array of no axes as outputs": lambda: renderer().render(
        scene(), CAMERA, size=(8, 8), outputs=np.array(1.0)
    ),
    "Renderer.render: a number as progress": lambda: renderer().render(scene(), CAMERA, size=(8, 8), progress=3),
    "Renderer: a number as effects": lambda: ss.Renderer("cpu", effects=3),
    "Renderer: a number as the name of an effect": lambda: ss.Renderer("cpu", effects={3: True}),
    "Scene: a distance of 400 digits": lambda: scene(slice_spacing=BIG),
    "Scene: an array of no axes as lights": lambda: scene(lights=np.array(1.0)),
    "Scene: a mode that is an array": lambda: scene(mode=np.array([])),
    "Scene: iso values without an end": lambda: scene(mode="isosurface", iso_value=endless()),
    "Scene: iso values of three numbers": lambda: scene(mode="isosurface", iso_value=[(1, 2, 3)]),
    "Scene: fields without an end": lambda: ss.Scene(endless(), TF),
    "Scene: a number as a field": lambda: ss.Scene([FIELD, 3], TF),
    "TransferFunction: a value of 400 digits": lambda: ss.TransferFunction([(BIG, 1, 1, 1, 1)]),
    "TransferFunction: a list in itself": lambda: ss.TransferFunction(ENDLESS_LIST),
    "TransferFunction.at: a word": lambda: TF.at("x"),
    "from_colormap: limits without an end": lambda: ss.TransferFunction.from_colormap("viridis", 1, endless()),
    "from_colormap: opacities without an end": lambda: ss.TransferFunction.from_colormap("viridis", endless()),
    "RegularField: a list in itself": lambda: ss.RegularField(ENDLESS_LIST),
    "RegularField: a long range": lambda: ss.RegularField(range(10**18)),
    "RegularField: complex samples": lambda: ss.RegularField(SAMPLES.astype(complex)),
    "RegularField: objects": lambda: ss.RegularField(np.array([[[object()]]])),
    "RegularField: a radius of 400 digits": lambda: ss.RegularField(SAMPLES, radius=BIG),
    "RegularField: a spacing without an end": lambda: ss.RegularField(SAMPLES, spacing=endless()),
    "RegularField: a lattice that is an array": lambda: ss.RegularField(SAMPLES, lattice=np.array([1, 2])),
    "EllipsoidField: complex centres": lambda: ss.EllipsoidField(np.ones((4, 3), complex), np.ones(4), values=1),
    "Light: a component of 400 digits": lambda: ss.Light((BIG, 0, 0)),
    "Camera: a coordinate of 400 digits": lambda: ss.Camera.orthographic((0, 0, BIG), (0, 0, 0), height=1),
    "Clip: planes without an end": lambda: ss.Clip(planes=endless()),
    "Clip: a list in itself as box": lambda: ss.Clip(box=ENDLESS_LIST),
    "open: nothing": lambda: ss.open(None),
    "open: a number": lambda: ss.open(3),
    "fit.solid: values of another length": lambda: ss.fit.solid(CORNERS, FACES, values=np.zeros(9)),
    "fit.nearest: a word as values": lambda: ss.fit.nearest(np.zeros((3, 3)), "x"),
    "resample_to_bcc: a word as spacing": lambda: bcc.resample_to_bcc(SAMPLES, spacing="abc"),
    "tiles.window: no camera": lambda: tiles.window(3, (10, 10), (0, 0), (3, 3)),
    "tiles.window: a row of 400 digits": lambda: tiles.window(CAMERA, (10, 10), (0, BIG), (3, 3)),
    "tiles.window: no size": lambda: tiles.window(CAMERA, (10, 10), (0, 0), "x"),
    "datasets: a number of 400 digits": lambda: ss.datasets.noisy_ball(BIG),
    "datasets: a word": lambda: ss.datasets.noisy_ball("x"),
    "pick: a column of 400 digits": lambda: render().pick(BIG, 0),
    "evaluate: a word": lambda: FIELD.evaluate("x"),
    "save: a number": lambda: render().save(3),
}


# Endless input would take for ever, and ranges hours.
@pytest.mark.timeout(60)
@pytest.mark.parametrize("call", WRONG.values(), ids=list(WRONG))
def test_wrong_kinds_are_errors_of_the_package(call: Callable[[], object]) -> None:
    with pytest.raises(ss.Error) as caught:
        call()
    assert str(caught.value).strip()


@pytest.mark.parametrize(
    ("options", "text"),
    [({"name": 1}, 'found 1; wanted a text; pass name="1"'), ({"scalar": ["a"]}, "wanted a text")],
)
def test_names_are_texts(options: dict[str, Any], text: str) -> None:
    for call in (ss.open, ss.render, ss.animate, ss.open_bricks):
        with pytest.raises(ss.InvalidInput, match=text) as caught:
            call("none.tif", **options)
        assert caught.value.option == next(iter(options))


def test_lists_without_data_say_so() -> None:
    for call in (ss.render, ss.animate):
        with pytest.raises(ss.InvalidInput, match="an empty list; wanted .*; check the pattern"):
            call([])


def test_open_with_a_word_as_logarithm(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", SAMPLES)
    with pytest.raises(ss.InvalidInput, match="log"):
        ss.open(tmp_path / "v.npy", log="x")

"""A small turn of the view changes the picture by little: nothing pops.

The promise (A_stop = 1, a continuous transfer function whose opacity at 0 is 0, no near plane among kernels): from one
view to another 0.01 degrees on, no pixel changes by more than the angle times the largest analytic derivative on the
way between them, once, plus NOISE. The picture of the definition has that derivative; so a backend's change may differ
from the reference's, between the same two views, by NOISE and no more.
"""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import hard_cases as hard
import numpy as np
import pytest
import scene_parts
from image_checks import log
from numpy.typing import NDArray
from scene_parts import Parts

import sheetsplat as ss

Pixels = NDArray[np.float64]
# Of premultiplied colours: what section 9 lets all pixels but one of 1,000 of a gentle scene be off by; here of all.
NOISE = 2e-4
DEGREES = 0.01
# Of that: turns so small that what is smooth is straight, beside kernels as slender as these.
STRAIGHT = {"needles": 1 / 100}
SIZE = (40, 36)
BACKENDS = [pytest.param("gl", marks=pytest.mark.gl), "cpu"]

# Along an axis, a face's diagonal and the body's diagonal, where samples are level with one another and change their
# order; half a frame off them; and anywhere.
ANGLES = (0.0, 0.5 * DEGREES, 45.0, 90.0, 35.264389682754654, 12.3, 77.777)


def _unequal() -> Parts:
    return hard.lattice("turn", (8, 7, 6), spacing=(0.3, 0.2, 0.25), origin=(-0.75, -0.6, -0.875))


FIELDS: dict[str, Any] = {
    "cartesian": lambda: hard.lattice("turn", (8, 8, 8)),
    "unequal": _unequal,
    "bcc": lambda: hard.lattice("turn", (14, 7, 7), lattice="bcc", spacing=(0.28,) * 3, origin=(-0.9, -0.9, -0.9)),
    "divided lattice": lambda: hard.lattice("turn", (8, 8, 8), normalization="threshold", w0=0.5),
    "ellipsoids": lambda: scene_parts.cloud(np.random.default_rng(4), 150, 4.0, 5.0, w0=0.5),
    "needles": lambda: scene_parts.cloud(np.random.default_rng(5), 60, 1.0, 200.0, w0=0.5),
    "sums": lambda: scene_parts.cloud(np.random.default_rng(6), 100, 3.0, normalization="none"),
}
WAYS: dict[str, Parts] = {
    "point": {},
    "slab": {"sampling": "slab"},
    "preintegration": {"preintegration": True},
    "unlit": {"lit": False},
    "central": {"central": True},
    "ewa": {"filter": "ewa"},
}
# Every field in some ways, and every way.
SCENES = [
    *[(name, "point") for name in FIELDS],
    ("cartesian", "slab"),
    ("bcc", "slab"),
    ("ellipsoids", "slab"),
    ("unequal", "central"),
    ("ellipsoids", "central"),
    ("needles", "preintegration"),
    ("cartesian", "unlit"),
    ("ellipsoids", "ewa"),
]


def turned(field: str, way: str, degrees: float, **change: Any) -> Parts:
    """Return a scene that is seen from a camera turned by an angle about the field's middle, round a fixed axis."""
    options = copy.deepcopy(WAYS[way]) | change
    central, spacing = options.pop("central", False), options.pop("spacing", 0.21)
    axis = np.array([0.0, 1.0, 0.0])
    about = np.radians(degrees)
    back = np.array([np.sin(about), 0.0, np.cos(about)])
    # The body's diagonal: the same turn, from 45 degrees to the side.
    if abs(degrees - ANGLES[4]) < 1:
        back = np.array([np.cos(about) / np.sqrt(2), np.sin(about), np.cos(about) / np.sqrt(2)])
    camera: Parts = {"eye": tuple(4 * back), "target": (0.0, 0.0, 0.0), "up": tuple(axis)}
    camera |= {"fov_y": 40.0} if central else {"height": 2.6}
    return scene_parts.parts([FIELDS[field]()], camera, size=SIZE, slice_spacing=spacing, **options)


def picture(backend: str, field: str, way: str, degrees: float, **change: Any) -> Pixels:
    """Return the pixels of a view."""
    scene, camera, size = scene_parts.build(ss, turned(field, way, degrees, **change))
    return np.asarray(hard.renderer_of(backend).render(scene, camera, size=size).pixels, dtype=np.float64)


@cache
def by_reference(field: str, way: str, degrees: float) -> Pixels:
    """Return the reference's pixels of a view."""
    return picture("reference", field, way, degrees)


def around(values: Pixels) -> Pixels:
    """Return the largest of each pixel and its eight neighbours."""
    padded = np.pad(values, 1)
    height, width = values.shape
    shifts = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.max(shifts, axis=0))


def beyond(backend: str, field: str, way: str, **change: Any) -> float:
    """Return by how much a pixel changes more, or less, than the reference's from view to view, at most."""
    most = 0.0
    for degrees in ANGLES:
        views = [degrees + step * DEGREES for step in (-1, 0, 1)]
        own = [picture(backend, field, way, view, **change) for view in views]
        definition = [by_reference(field, way, view) for view in views]
        for n in (0, 1):
            most = max(most, float(np.abs((own[n + 1] - own[n]) - (definition[n + 1] - definition[n])).max()))
    return most


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("field", "way"), SCENES, ids=lambda part: str(part))
def test_nothing_pops(field: str, way: str, backend: str) -> None:
    found = beyond(backend, field, way)
    log.info(f"frame to frame {field} {way} {backend}: {found:.1e} beyond the derivative")
    assert found <= NOISE


@pytest.mark.parametrize(("field", "way"), SCENES, ids=lambda part: str(part))
def test_the_definition_itself_does_not_pop(field: str, way: str) -> None:
    """A continuous change shrinks with the angle; a jump would not."""
    for degrees in ANGLES:
        whole = DEGREES * STRAIGHT.get(field, 1.0)
        part = whole / 20
        far = by_reference(field, way, degrees + whole) - by_reference(field, way, degrees - whole)
        near = picture("reference", field, way, degrees + part) - picture("reference", field, way, degrees - part)
        # A kink may lie on one side; pictures are float32.
        assert (np.abs(near).max(-1) <= 2 * around(np.abs(far).max(-1)) / 20 + 3e-7).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_pops_is_seen(backend: str) -> None:
    """Negative controls: slices at other depths in every second view, a step, and an opacity stop."""
    degrees = ANGLES[5]
    views = [picture(backend, "cartesian", "unlit", degrees + n * DEGREES, spacing=0.21 + n * 1e-3) for n in (0, 1)]
    definition = [by_reference("cartesian", "unlit", degrees + n * DEGREES) for n in (0, 1)]
    assert np.abs((views[1] - views[0]) - (definition[1] - definition[0])).max() > NOISE
    step = [
        picture("reference", "ellipsoids", "unlit", degrees + n * 1e-3, transfer=scene_parts.STEP) for n in range(40)
    ]
    smooth = [picture("reference", "ellipsoids", "unlit", degrees + n * 1e-3) for n in range(40)]
    largest = [max(np.abs(b - a).max() for a, b in zip(s, s[1:], strict=False)) for s in (step, smooth)]
    assert largest[0] > 30 * largest[1]

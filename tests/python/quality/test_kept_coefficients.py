"""Coefficients of a volume are computed once as long as it is there, and their memory is given back with it."""

from __future__ import annotations

import gc
import weakref
from types import SimpleNamespace

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.quality import samples

z, y, x = np.mgrid[-1:1:20j, -1:1:22j, -1:1:24j]
VALUES = (np.exp(-3 * (x * x + y * y + z * z)) + 0.2 * np.sin(4 * x + y)).astype(np.float32)
SMALL = {"size": (24, 20), "backend": "cpu"}


@pytest.fixture
def computed(monkeypatch):
    """Return a list that grows by one each time that coefficients are computed."""
    calls = []
    own = ss.RegularField._made

    def counted(self, values, *, prefilter=False, **options):
        calls.extend([values.shape] if prefilter else [])
        return own(self, values, prefilter=prefilter, **options)

    monkeypatch.setattr(ss.RegularField, "_made", counted)
    return calls


def test_a_field_is_prefiltered_once(computed):
    field = ss.RegularField(VALUES)
    first = ss.render(field, **SMALL)
    assert first.plan.quality.of("prefilter").value is True and len(computed) == 1
    again = ss.render(field, camera=first.camera, **SMALL)
    assert len(computed) == 1
    np.testing.assert_array_equal(first.rgba, again.rgba)
    # What is told of a field does not change its samples.
    named = field.with_quantity(name="density", unit="kg")
    told = ss.render(named, mode="isosurface", iso_value=0.3, **SMALL)
    assert len(computed) == 1 and told.recipe.fields[0].quantity.name == "density"
    # Other kernels, and other samples or options, have other coefficients.
    ss.render(field, quality="best", **SMALL)
    assert len(computed) == 2
    ss.render(field.replace(boundary="zero"), **SMALL)
    ss.render(ss.RegularField(VALUES), **SMALL)
    assert len(computed) == 4


def test_a_field_that_gives_colours_is_prefiltered_once(computed):
    field, other = ss.RegularField(VALUES), ss.RegularField(VALUES[::-1].copy())
    pictures = [ss.render(field, color_by=other, **SMALL).rgba for _ in range(3)]
    assert len(computed) == 2
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_volumes_of_colors_are_prefiltered_once(computed):
    field = ss.RegularField(np.stack([VALUES, VALUES[::-1], VALUES**2], axis=3).clip(0, 1))
    pictures = [ss.render(field, **SMALL).rgba for _ in range(2)]
    # Of the opacity, and of red, green and blue.
    assert len(computed) == 4
    np.testing.assert_array_equal(*pictures)


def test_what_is_kept_does_not_depend_on_the_memory_that_it_took(monkeypatch):
    field = ss.RegularField(VALUES)
    ss.render(field, **SMALL)
    monkeypatch.setattr(samples, "_memory", SimpleNamespace(available=lambda: 10 * VALUES.size))
    assert ss.render(field, **SMALL).plan.quality.of("prefilter").value is True
    fresh = ss.render(ss.RegularField(VALUES), **SMALL).plan.quality.of("prefilter")
    assert fresh.value is False and "coefficients would take" in fresh.reason


def test_volumes_that_are_shown_by_logarithms_or_within_limits_are_prefiltered_once(computed):
    field = ss.RegularField((10.0 ** (8 * VALUES)).astype(np.float32))
    shown = [ss.render(field, **SMALL) for _ in range(2)]
    assert len(computed) == 1 and shown[0].recipe.fields[0].quantity.floor is not None
    np.testing.assert_array_equal(shown[0].rgba, shown[1].rgba)
    far = VALUES.copy()
    far[3, 4, 5] = 1e12
    field = ss.RegularField(far)
    computed.clear()
    with pytest.warns(ss.PictureWarning, match="lies so far beyond all others"):
        shown = [ss.render(field, **SMALL) for _ in range(2)]
    assert len(computed) <= 1
    np.testing.assert_array_equal(shown[0].rgba, shown[1].rgba)


def test_memory_is_given_back(computed):
    field = ss.RegularField(VALUES, base=0.0)
    image = ss.render(field, **SMALL)
    made = weakref.ref(samples.prefiltered(field, 2.0, 5.0).native)
    assert len(computed) == 1
    gc.collect()
    assert made() is not None
    # One kernel at a time.
    samples.prefiltered(field, 2.5, 7.0)
    del image
    gc.collect()
    assert made() is None
    made = weakref.ref(samples.prefiltered(field, 2.5, 7.0).native)
    assert len(computed) == 2
    del field
    gc.collect()
    assert made() is None

"""Pictures as FITS: numbers, unit, and where each pixel lies."""

import sys

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io.fits_picture import cards_of, unit_text

SIZE = (30, 20)


def cloud():
    """Return a volume of a constant, 10 x 6 x 4 samples, in units of length, with one denser sample."""
    values = np.full((4, 6, 10), 2.0, np.float32)
    field = ss.RegularField(values, spacing=(0.5, 0.5, 0.5), origin=(100.0, 40.0, 0.0), boundary="edge")
    return field.with_quantity(name="density", unit="g cm⁻³", length_unit="kpc")


def column(**options):
    camera = ss.Camera.orthographic((102, 42, 50), (102, 42, 0), (0, 1, 0), height=4)
    return ss.render(cloud(), mode="xray", camera=camera, size=SIZE, backend="cpu", **options)


def test_units_in_the_letters_of_fits():
    for unit, text in {
        "10¹⁰ M☉": "10**10 Msun",
        "g cm⁻³": "g cm-3",
        "g/cm³": "g/cm3",
        "6.77e-22 g cm⁻³ h² a⁻³": "6.77e-22 g cm-3 h2 a-3",
        "µm": "um",
    }.items():
        assert unit_text(unit) == text


def test_the_header_places_every_pixel():
    image = column()
    cards = {name: value for name, (value, _) in cards_of(image).items()}
    assert cards["BUNIT"] == "g cm-3 kpc" and cards["BTYPE"] == "integral of density"
    # 4 kpc high, 20 pixels: the middle of the lower left one.
    first = [cards[f"CRVAL{n}"] + (1 - cards[f"CRPIX{n}"]) * cards[f"CDELT{n}"] for n in (1, 2)]
    assert np.allclose(first, (102 - 14.5 * 0.2, 42 - 9.5 * 0.2))
    assert (cards["CTYPE1"], cards["CUNIT2"]) == ("X", "kpc")
    # The column of a constant: its value times the 2 kpc between the ends of the volume.
    assert image.scalar[10, 5] == pytest.approx(2.0 * 2.0, rel=1e-3)
    aside = ss.render(cloud(), mode="mip", size=SIZE, backend="cpu", quality="draft")
    told = {name: value for name, (value, _) in cards_of(aside).items()}
    assert told["BUNIT"] == "g cm-3" and "DISTANCE" in told["CTYPE1"] and "-" not in told["CTYPE1"]


def test_colours_and_missing_packages(tmp_path, monkeypatch):
    colored = ss.render(cloud(), size=SIZE, backend="cpu", quality="draft", clim=(0, 4))
    with pytest.raises(ss.InvalidInput, match="one number a pixel"):
        colored.save(tmp_path / "a.fits")
    monkeypatch.setitem(sys.modules, "astropy.io", None)
    monkeypatch.setitem(sys.modules, "astropy", None)
    with pytest.raises(ss.Unsupported, match=r"sheetsplat\[astro\]"):
        column().save(tmp_path / "a.fits")
    assert not list(tmp_path.iterdir())


def test_astropy_reads_it(tmp_path):
    fits = pytest.importorskip("astropy.io.fits", reason="astropy is not installed")
    from astropy.wcs import WCS

    image = column()
    image.save(tmp_path / "a.fits")
    with fits.open(tmp_path / "a.fits") as opened:
        table = opened[0]
        # Row 0 is the bottom.
        assert table.data.dtype == ">f4" and np.array_equal(table.data[::-1], image.scalar)
        places = WCS(table.header).pixel_to_world_values([0, 29], [0, 19])
    assert np.allclose(places, [[99.1, 104.9], [40.1, 43.9]])

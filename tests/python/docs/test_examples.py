"""The programs of the gallery run in empty folders, at half their size, and make the pictures that are stored."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import example_programs
import pytest
from example_programs import SECTIONS, TIMED, Example, difference, small_picture
from PIL import Image, ImageChops, ImageEnhance

NAMES = [name for names in SECTIONS.values() for name in names]
NEEDED = {
    "xarray_climate": "xarray",
    "dask_volume": "dask",
    "pyvista_grids": "pyvista",
    "beside_pyvista": "pyvista",
    "pyvista_composite": "pyvista",
    "particle_table": "pandas",
}
# Of the stored picture's contrast. Compression of the stored pictures is up to 0.08 of it.
LIMIT = 0.13
SAMPLE_PROGRAM = Path(__file__).parents[3] / "build" / "cpp" / "apps" / "sheetsplat_render"


def stored(name: str) -> Image.Image:
    with Image.open(Example.read(name).picture) as picture:
        return picture.convert("RGB")


def test_every_program_is_in_the_gallery_once():
    assert sorted(path.stem for path in example_programs.FOLDER.glob("*.py")) == sorted(NAMES)
    assert sorted(path.stem for path in example_programs.STORED.iterdir()) == sorted(NAMES)


def test_the_page_is_that_of_the_programs():
    found = (example_programs.DOCS / "gallery.md").read_text(encoding="utf-8")
    assert found == example_programs.page(), "make it again: python python/docs/_tools/example_programs.py --page"


@pytest.mark.parametrize("name", NAMES)
def test_example(name, tmp_path):
    if name in NEEDED and importlib.util.find_spec(NEEDED[name]) is None:
        pytest.skip(f"needs the package {NEEDED[name]}")
    if name == "cpp_program" and not SAMPLE_PROGRAM.is_file():
        pytest.skip("needs the sample program: ./run build")
    picture = small_picture(Example.read(name), tmp_path)
    found = difference(picture, stored(name))
    print(f"{name}: {found:.3f} of the contrast; limit {LIMIT}")
    if name in TIMED:
        # The picture shows measured times; only its size is known.
        assert picture.size == stored(name).size and picture.convert("L").getextrema()[0] < 128
    else:
        assert found < LIMIT


@pytest.mark.parametrize("name", NAMES)
def test_wrong_pictures_are_told_apart(name):
    right = stored(name)
    # Five pixels to the side, a fifth darker, and mirrored.
    wrong = (
        ImageChops.offset(right, 5, 0),
        ImageEnhance.Brightness(right).enhance(0.8),
        right.transpose(Image.Transpose.FLIP_LEFT_RIGHT),
    )
    for picture in wrong:
        assert difference(picture, right) > LIMIT

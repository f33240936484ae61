"""What takes a bounded time and memory, whatever the shape of the data: counted, or bounded far above what it takes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.describe.toml import depth

MIB = 1 << 20


@contextmanager
def at_most(size: int) -> Iterator[None]:
    """Fail where arrays and objects that are made take more bytes at a time."""
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < size, f"{peak / MIB:.0f} MiB"


def _random(shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(9).random(shape, dtype=np.float32)


# Long volumes: arrays of rays and samples, and of new and old samples, were 4.9 GB and 56 GB.


@pytest.mark.filterwarnings("ignore:nothing can be seen")
@pytest.mark.parametrize("shape", [(2, 2, 300_000), (300_000, 2, 2)])
def test_a_long_volume_is_drawn_in_little_memory(shape: tuple[int, int, int]) -> None:
    volume = _random(shape)
    with at_most(160 * MIB):
        ss.render(volume, size=(64, 64), backend="cpu")


@pytest.mark.parametrize("shape", [(1, 1, 100_000), (100_000, 1, 1)])
@pytest.mark.parametrize("method", ["quintic", "linear"])
def test_a_long_volume_is_resampled_in_little_memory(shape: tuple[int, int, int], method: str) -> None:
    volume = _random(shape)
    with at_most(160 * MIB):
        found = ss.resample_to_bcc(volume, method=method)
    assert found.values.mean() == pytest.approx(volume.mean(), abs=0.002)


def test_waves_of_a_long_volume_are_refused_before_memory_is_taken() -> None:
    with at_most(16 * MIB), pytest.raises(ss.OutOfMemory, match="waves along an axis of 600000 samples"):
        ss.resample_to_bcc(_random((1, 1, 600_000)), method="fourier")


def test_the_error_of_slices_is_that_of_all_samples_at_once() -> None:
    """Slices of a ray are looked at in blocks: where one ends makes no difference."""
    from sheetsplat.quality import slicing

    volume = np.kron(_random((6, 6, 30)), np.ones((4, 4, 4), np.float32))
    function = ss.TransferFunction([(0.3, 0.1, 0.4, 0.9, 0.0), (1.0, 1.0, 0.6, 0.2, 0.02)])
    fields = [ss.RegularField(volume), ss.RegularField(volume, origin=(40.0, 3.0, 700.0))]
    scene = ss.Scene(fields, function, lights=[ss.Light((1, 1, 1))])
    camera = ss.render(scene, size=(48, 48), direction="z", backend="cpu").camera
    whole = slicing.slicing_error(scene, camera, (48, 48))
    for block in (3, 64):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(slicing, "_BLOCK", block)
            assert slicing.slicing_error(scene, camera, (48, 48)) == pytest.approx(whole, rel=1e-12)
    assert whole > 0.0


# Many kernels at one place: each looked at all others.


@pytest.mark.timeout(60)
@pytest.mark.parametrize("spread", [0.0, 1e-3])
@pytest.mark.parametrize("sizes", [(0.5, 0.5), (0.1, 1.0)])
def test_ghost_points_of_kernels_at_one_place(spread: float, sizes: tuple[float, float]) -> None:
    random = np.random.default_rng(3)
    centers = spread * random.normal(size=(50_000, 3))
    field = ss.EllipsoidField(centers, values=random.random(50_000), scales=random.uniform(*sizes, 50_000))
    ghosts = field.with_ghost_points()
    if spread:
        assert ghosts.ghosts <= 40
    else:
        np.testing.assert_allclose(np.linalg.norm(ghosts.centers[50_000:], axis=1), field.scales.max(), rtol=1e-9)
        assert ghosts.ghosts == 14


# Scene files: parsers take memory as the square of the parts of a key, and recurse into arrays and tables.


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 12_000) + " = 1",
        "picture = " + "[" * 329 + "]" * 329,
        "picture = " + "{a = " * 5_000 + "1" + "}" * 5_000,
        "[" + ".".join(['"a"'] * 12_000) + "]",
    ],
)
def test_scene_files_that_nest_deeply_are_refused_before_they_are_parsed(text: str) -> None:
    with at_most(4 * MIB), pytest.raises(ss.InvalidInput, match=r"nested \d+ deep; wanted at most 32"):
        ss.SceneFile.parse(text)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "text", ['"\\' * 100_000, '"""\\' * 100_000, "''" * 100_000 + "'", '"a' * 100_001, '"""a' * 100_001]
)
def test_texts_of_quotes_that_never_end_are_looked_at_once(text: str) -> None:
    """Each quote was followed to the end of the text: a minute and a half for 200 KB."""
    assert depth(text) <= 100_001
    for read in (ss.SceneFile.parse, ss.Recipe.from_json):
        with pytest.raises(ss.InvalidInput):
            read(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("a.b.c = 1.5 # [[[[ it's", 3),
        ('a = "[[[["\nb = \'[[\'\nc = """\\"""[[["""', 1),
        ("a = [[1, 2.5], [3, 4]]\n[b.c]", 2),
        ("x = '''[[\n[['''\ny = {a.b = {c = 1}}", 2),
        ('"a.b".c."d" = 1', 3),
    ],
)
def test_how_deep_a_document_nests_is_told_without_its_strings(text: str, expected: int) -> None:
    assert depth(text) == expected

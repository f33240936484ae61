"""Coarser levels of volumes in bricks: their samples, which bricks have them, and the error of their pictures."""

from __future__ import annotations

import gc

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.bricks.levels import means
from sheetsplat.bricks.resident import residents

SIZE = (72, 60)
# What `quality` allows, as documented in bricks.md.
ALLOWED = {"draft": 2e-2, "good": 5e-3, "best": 1.7e-3}


def smooth(shape=(48, 40, 56), kind=np.float32):
    """Return a ball that needs few samples."""
    k, j, i = (np.linspace(-1, 1, size) for size in shape)
    values = np.exp(-2 * (k[:, None, None] ** 2 + 1.3 * j[None, :, None] ** 2 + i[None, None, :] ** 2))
    return (200 * values).astype(kind)


def half_rough(shape=(48, 40, 56)):
    """Return a volume that is smooth on one side, and noise on the other."""
    values = smooth(shape)
    rough = np.random.default_rng(4).random(shape).astype(np.float32) * 150
    values[:, :, shape[2] // 2 :] = rough[:, :, shape[2] // 2 :]
    return values


def rmse(one, other):
    assert (np.isnan(one.pixels) == np.isnan(other.pixels)).all()
    return float(np.sqrt(np.nanmean((one.pixels.astype(np.float64) - other.pixels) ** 2)))


@pytest.mark.parametrize("shape", [(8, 8, 8), (7, 5, 9), (1, 2, 3)])
def test_levels_are_means_of_what_is_there(shape, rng):
    values = rng.random(shape).astype(np.float32)
    values[rng.random(shape) < 0.2] = np.nan
    found = means(values, np.dtype(np.float32))
    for place in np.ndindex(*found.shape):
        block = values[tuple(slice(2 * n, 2 * n + 2) for n in place)]
        wanted = np.nanmean(block) if np.isfinite(block).any() else np.nan
        np.testing.assert_allclose(found[place], wanted, rtol=1e-6)


def test_levels_of_bricks_are_those_of_the_volume(rng):
    values = rng.integers(0, 255, (37, 24, 43)).astype(np.uint8)
    source = ss.open_bricks(values, brick=16, levels=3, quality="draft").source
    wanted = values
    for level, one in enumerate(source.coarser, 1):
        wanted = means(wanted, np.dtype(np.float32))
        assert one.source.shape == wanted.shape and one.steps == (2.0**level,) * 3
        whole = tuple((0, size) for size in wanted.shape)
        np.testing.assert_allclose(one.source.read(whole), wanted, rtol=1e-6)
        inner = tuple((size // 3, size - size // 4) for size in wanted.shape)
        cut = tuple(slice(*ends) for ends in inner)
        np.testing.assert_array_equal(one.source.read(inner), one.source.read(whole)[cut])


@pytest.mark.parametrize("quality", ["draft", "good", "best"])
@pytest.mark.parametrize("mode", ["composite", "isosurface", "mip", "xray"])
def test_pictures_of_levels_are_as_right_as_the_quality_allows(mode, quality):
    options = {"size": SIZE, "mode": mode, "quality": quality, "azimuth": 30, "elevation": 20}
    fine = ss.render(ss.open_bricks(smooth(), brick=16, quality=quality), **options)
    coarse = ss.render(ss.open_bricks(smooth(), brick=16, levels=2, quality=quality), **options)
    scale = max(1.0, float(np.nanmax(np.abs(fine.pixels))))
    assert rmse(fine, coarse) <= ALLOWED[quality] * scale
    assert coarse.stats["bricks_coarse"] <= coarse.stats["bricks_drawn"]
    if quality == "draft" and mode == "composite":
        assert coarse.stats["bricks_coarse"] > 0.5 * coarse.stats["bricks_drawn"]
        assert rmse(fine, coarse) > 1e-7


def test_the_error_of_a_picture_holds_that_of_its_levels():
    options = {"size": (36, 30), "quality": "draft"}
    fine = ss.render(ss.open_bricks(smooth(), brick=16, quality="draft"), **options)
    coarse = ss.render(ss.open_bricks(smooth(), brick=16, levels=2, quality="draft"), **options)
    assert coarse.error.budget["coarser levels"] == pytest.approx(rmse(fine, coarse), rel=1e-2)
    assert coarse.error.rmse > fine.error.rmse and "coarser levels" not in fine.error.budget


def test_rough_bricks_keep_their_samples():
    bricked = ss.open_bricks(half_rough(), brick=8, levels=1, prefilter=False)
    drawn = ss.render(bricked, size=SIZE, quality="draft", clim=(0, 255))
    fine = ss.render(ss.open_bricks(half_rough(), brick=8, prefilter=False), size=SIZE, quality="draft", clim=(0, 255))
    assert 0 < drawn.stats["bricks_coarse"] < drawn.stats["bricks_drawn"]
    assert rmse(fine, drawn) <= ALLOWED["draft"]
    # In noise alone no level is right.
    noise = np.random.default_rng(5).random((32, 32, 32)).astype(np.float32)
    assert ss.render(ss.open_bricks(noise, brick=8, levels=1), size=SIZE).stats["bricks_coarse"] == 0


def test_bricks_of_levels_read_less(tmp_path):
    np.save(tmp_path / "v.npy", smooth(kind=np.uint8))
    bricked = ss.open_bricks(tmp_path / "v.npy", brick=16, levels=2, quality="draft")
    first = ss.render(bricked, size=SIZE, quality="draft")
    residents().clear()
    again = ss.render(bricked, size=SIZE, quality="draft")
    np.testing.assert_array_equal(first.pixels, again.pixels)
    fine = ss.open_bricks(tmp_path / "v.npy", brick=16, quality="draft")
    residents().clear()
    assert again.stats["bytes_read"] < ss.render(fine, size=SIZE, quality="draft").stats["bytes_read"]


def test_ome_zarr_has_its_own_levels(tmp_path):
    zarr = pytest.importorskip("zarr")
    values = smooth(kind=np.uint8)
    group = zarr.create_group(tmp_path / "v.zarr", zarr_format=2)
    datasets = []
    for level in range(3):
        array = group.create_array(str(level), shape=values.shape, chunks=(16, 16, 16), dtype=values.dtype)
        array[:] = values
        width = 2.0**level
        scale = {"type": "scale", "scale": [2 * width, width, 0.5 * width]}
        moved = {"type": "translation", "translation": [(width - 1), 0.5 * (width - 1), 0.25 * (width - 1)]}
        datasets.append({"path": str(level), "coordinateTransformations": [scale, moved]})
        values = means(values, np.dtype(np.float32)).round().astype(np.uint8)
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]
    bricked = ss.open_bricks(tmp_path / "v.zarr", brick=16, levels=2, quality="draft")
    assert [one.steps for one in bricked.source.coarser] == [(2.0, 2.0, 2.0), (4.0, 4.0, 4.0)]
    np.testing.assert_allclose([one.start for one in bricked.source.coarser], [[0.5] * 3, [1.5] * 3])
    assert not ss.open_bricks(tmp_path / "v.zarr", brick=16, quality="draft").source.coarser
    drawn = ss.render(bricked, size=SIZE, quality="draft")
    fine = ss.render(ss.open_bricks(tmp_path / "v.zarr", brick=16, quality="draft"), size=SIZE, quality="draft")
    assert drawn.stats["bricks_coarse"] > 0 and 0 < rmse(fine, drawn) <= ALLOWED["draft"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"levels": -1}, "levels"),
        ({"levels": 9}, "from 0 to 8"),
        ({"levels": 4, "brick": 24}, "at most 3"),
        ({"levels": 1, "brick": 5}, "at most 0"),
        ({"levels": 1, "lattice": "bcc"}, "cartesian"),
    ],
)
def test_levels_that_cannot_be_are_refused(options, words):
    with pytest.raises(ss.InvalidInput, match=words):
        ss.open_bricks(smooth((16, 16, 16)), **options)


def test_kernels_have_no_levels():
    with pytest.raises(ss.InvalidInput, match="levels"):
        ss.open_bricks({"x": [0, 1], "y": [0, 0], "z": [0, 0], "radius": [1, 1], "value": [1, 2]}, levels=1)


@pytest.mark.slow
def test_a_cluster_makes_and_draws_levels(tmp_path, cluster):
    options = {"brick": 16, "levels": 2, "quality": "draft"}
    bricked = ss.open_bricks(smooth(), client=cluster, scratch=tmp_path, **options)
    drawn = ss.render(bricked, size=SIZE, quality="draft", client=cluster)
    alone = ss.render(ss.open_bricks(smooth(), **options), size=SIZE, quality="draft")
    assert drawn.stats["bricks_coarse"] == alone.stats["bricks_coarse"] > 0
    assert rmse(drawn, alone) <= 1e-6
    assert list(tmp_path.iterdir())
    del bricked, drawn
    # The graph that distributed was given, with the volume in it, is left in a cycle now and then.
    gc.collect()
    assert not list(tmp_path.iterdir())

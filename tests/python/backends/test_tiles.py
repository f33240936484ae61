"""Pictures in tiles, written to a file piece by piece, are the pictures that are drawn at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hard_cases as hard
import numpy as np
import pytest
import scene_parts
from image_checks import FLOAT32, assert_close, distance

import sheetsplat as ss
from sheetsplat.tiles import pieces, render_tiles, window

BACKENDS = [pytest.param("gl", marks=pytest.mark.gl), "cpu", "reference"]
SIZE = (61, 45)
CAMERAS = {"orthographic": scene_parts.parallel, "perspective": scene_parts.central}


def scene_of(name: str, **options: Any) -> tuple[ss.Scene, ss.Camera]:
    """Return a scene of a lattice beside ellipsoids, seen askew."""
    fields = [scene_parts.cloud(np.random.default_rng(3), 80, 3.0), hard.lattice("tiles")]
    made = scene_parts.parts(fields, size=SIZE, **options)
    scene, camera, _ = scene_parts.build(ss, made)
    if name == "far":
        far = np.array((1e6, -2e6, 3e6))
        for one, place in zip(made["fields"], ("centers", "origin"), strict=True):
            one[place] = np.asarray(one[place]) + far
        for end in ("eye", "target"):
            made["camera"][end] = tuple(np.asarray(made["camera"][end]) + far)
        scene, camera, _ = scene_parts.build(ss, made)
    return scene, camera


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("tile", [1, 16, 23, 45, 100])
@pytest.mark.parametrize("kind", CAMERAS)
def test_tiles_are_the_picture(kind: str, backend: Any, tile: int, tmp_path: Path) -> None:
    if tile == 1 and backend != "cpu":
        pytest.skip("thousands of pictures; the processor draws them")
    size = (9, 7) if tile == 1 else SIZE
    scene, camera = scene_of("here", camera=CAMERAS[kind]())
    renderer = ss.Renderer(backend)
    expected = renderer.render(scene, camera, size=size).pixels
    drawn = render_tiles(scene, camera, size, tmp_path / "p.npy", renderer=renderer, tile=tile)
    assert drawn.dtype == np.float32 and drawn.shape == (size[1], size[0], 4) and not drawn.flags.writeable
    assert [path.name for path in tmp_path.iterdir()] == ["p.npy"]
    found = distance(np.asarray(drawn), expected)
    # Rounding alone: a hundredth of what section 9 allows.
    assert found.rmse <= FLOAT32[0] / 100 and found.maximum <= 3e-6, found


def test_a_tile_that_is_moved_is_seen() -> None:
    """Negative control: by a fiftieth of a pixel."""
    scene, camera = scene_of("here")
    renderer = ss.Renderer("cpu")
    expected = renderer.render(scene, camera, size=SIZE).pixels[12:32, 20:40]
    for aside, wrong in ((0.0, False), (0.02, True)):
        part = window(camera, SIZE, (20, 12), (20, 20))
        by = aside * part.height / 20 * np.array((1.0, 0.0, 0.0))
        moved = ss.Camera.orthographic(part.eye + by, part.target + by, part.up, height=part.height)
        found = distance(renderer.render(scene, moved, size=(20, 20)).pixels, expected)
        assert (found.maximum > 3e-6) == wrong, found


@pytest.mark.parametrize("mode", ["xray", "mip"])
def test_scalar_pictures(mode: str, tmp_path: Path) -> None:
    scene, camera = scene_of("here", mode=mode)
    renderer = ss.Renderer("cpu")
    drawn = render_tiles(scene, camera, SIZE, tmp_path / "p.npy", renderer=renderer, tile=20)
    assert drawn.shape == SIZE[::-1]
    assert_close(np.asarray(drawn), renderer.render(scene, camera, size=SIZE).scalar, FLOAT32, f"tiles {mode}")


def test_far_from_the_origin_the_view_is_not_turned(tmp_path: Path) -> None:
    scene, camera = scene_of("far")
    renderer = ss.Renderer("cpu")
    drawn = render_tiles(scene, camera, SIZE, tmp_path / "p.npy", renderer=renderer, tile=20)
    assert_close(np.asarray(drawn), renderer.render(scene, camera, size=SIZE).pixels, FLOAT32, "tiles far off")


def test_pieces_cover_every_pixel_once() -> None:
    for size, tile in (((7, 5), 3), ((6, 6), 3), ((1, 9), 4), ((5, 5), 10)):
        count = np.zeros(size[::-1], int)
        for column, row, width, height in pieces(size, tile):
            assert 1 <= width <= tile and 1 <= height <= tile
            count[row : row + height, column : column + width] += 1
        assert (count == 1).all()


def test_what_cannot_be_drawn_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, camera = scene_of("here")
    with pytest.raises(ss.InvalidInput, match="tile cannot be used: found 0"):
        render_tiles(scene, camera, SIZE, tmp_path / "p.npy", tile=0)
    with pytest.raises(ss.InvalidInput, match="suffix '.png'; wanted .npy"):
        render_tiles(scene, camera, SIZE, tmp_path / "p.png")
    with pytest.raises(ss.Error, match="no folder"):
        render_tiles(scene, camera, SIZE, tmp_path / "none" / "p.npy")
    with pytest.raises(ss.Error, match=r"room for [0-9,]+ MB; wanted room for 16,000,000,000 MB; make"):
        render_tiles(scene, camera, (10**9, 10**6), tmp_path / "p.npy")
    for wrong in ({"path": 3}, {"path": "a\0.npy"}, {"renderer": "cpu"}, {"progress": "often"}, {"depth_limit": "far"}):
        given: dict[str, Any] = {"path": tmp_path / "p.npy", "renderer": ss.Renderer("cpu"), **wrong}
        with pytest.raises(ss.InvalidInput, match="cannot be (used|written)"):
            render_tiles(scene, camera, SIZE, **given)
    shares: list[float] = []

    def stop(share: float) -> bool:
        shares.append(share)
        return share < 0.5

    with pytest.raises(ss.Cancelled):
        render_tiles(scene, camera, SIZE, tmp_path / "p.npy", tile=8, progress=stop, renderer=ss.Renderer("cpu"))
    assert shares == sorted(shares) and shares[-1] >= 0.5
    assert list(tmp_path.iterdir()) == []


def test_progress_ends_at_one(tmp_path: Path) -> None:
    scene, camera = scene_of("here")
    shares: list[float] = []
    render_tiles(scene, camera, SIZE, tmp_path / "p.npy", tile=30, progress=shares.append, renderer=ss.Renderer("cpu"))
    assert shares == sorted(shares) and shares[-1] == 1.0


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "options", [{"mode": "mip"}, {"mode": "isosurface", "iso_value": 0.3}, {"sampling": "slab"}, {"filter": "ewa"}]
)
def test_a_part_of_a_picture_in_perspective(options: dict[str, Any], backend: Any) -> None:
    """Far from the middle, at an edge, and beyond the picture."""
    scene, camera = scene_of("here", camera=scene_parts.central(fov_y=70.0), **options)
    renderer = ss.Renderer(backend)
    whole = renderer.render(scene, camera, size=SIZE)
    for left, top, width, height in ((0, 0, 20, 15), (50, 30, 11, 15), (13, 7, 9, 31)):
        part = window(camera, SIZE, (left, top), (width, height))
        drawn = renderer.render(scene, part, size=(width, height))
        expected = whole.pixels[top : top + height, left : left + width]
        assert_close(drawn.pixels, expected, FLOAT32, f"part at {left}, {top}")
        again = window(part, (width, height), (2, 3), (4, 4))
        assert np.allclose(again.shift, window(camera, SIZE, (left + 2, top + 3), (4, 4)).shift, rtol=1e-12)
    outside = window(camera, SIZE, (-400, -400), (10, 10))
    # Beside the field there is nothing, and no number.
    assert not np.nan_to_num(renderer.render(scene, outside, size=(10, 10)).pixels).any()


def test_a_point_of_a_shifted_picture_is_picked() -> None:
    scene, camera = scene_of("here", camera=scene_parts.central())
    renderer = ss.Renderer("cpu")
    part = window(camera, SIZE, (20, 12), (20, 20))
    whole, shown = renderer.render(scene, camera, size=SIZE), renderer.render(scene, part, size=(20, 20))
    for column, row in ((3, 4), (10, 10), (15, 2)):
        expected, found = whole.pick(column + 20, row + 12), shown.pick(column, row)
        assert expected is not None and found is not None
        assert np.allclose(found.position, expected.position, atol=1e-9)

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
def test_tiles_are_the_picture(backend: Any, tile: int, tmp_path: Path) -> None:
    if tile == 1 and backend != "cpu":
        pytest.skip("thousands of pictures; the processor draws them")
    size = (9, 7) if tile == 1 else SIZE
    scene, camera = scene_of("here")
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
    perspective = ss.Camera.perspective((0, 0, 4), (0, 0, 0), fov_y=30)
    with pytest.raises(ss.Unsupported, match="a perspective camera; wanted an orthographic one.*backend cpu"):
        render_tiles(scene, perspective, SIZE, tmp_path / "p.npy")
    with pytest.raises(ss.InvalidInput, match="tile cannot be used: found 0"):
        render_tiles(scene, camera, SIZE, tmp_path / "p.npy", tile=0)
    with pytest.raises(ss.InvalidInput, match="suffix '.png'; wanted .npy"):
        render_tiles(scene, camera, SIZE, tmp_path / "p.png")
    with pytest.raises(ss.Error, match="no folder"):
        render_tiles(scene, camera, SIZE, tmp_path / "none" / "p.npy")
    with pytest.raises(ss.Error, match=r"room for [0-9,]+ MB; wanted room for 16,000,000,000 MB; make"):
        render_tiles(scene, camera, (10**9, 10**6), tmp_path / "p.npy")
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

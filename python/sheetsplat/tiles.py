"""Pictures larger than memory, rendered in tiles into a file."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Iterator

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import Triple, check_progress, file_path, image_size, instance, parts, shown, whole
from sheetsplat.camera import Camera
from sheetsplat.errors import Cancelled, Error, complain, unusable
from sheetsplat.io.pictures import check_folder, whole_file
from sheetsplat.limits import checked_depths
from sheetsplat.modes import TRAITS
from sheetsplat.notices import muted
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

Floats = NDArray[np.float32]
TILE = 2048
# Size of the header of a .npy file, rounded up.
_HEADER = 4096


def _moved(position: Triple, right: Triple, up: Triple, x: float, y: float) -> Triple:
    a, b, c = (p + x * r + y * u for p, r, u in zip(position, right, up, strict=True))
    return a, b, c


def _column_and_row(value: object) -> tuple[int, int]:
    found = parts("window: at", value, "column and row of a pixel", 2)
    if len(found) != 2:
        raise complain(unusable("window: at"), shown(value), "column and row of a pixel")
    return whole("window: at", found[0]), whole("window: at", found[1])


def window(camera: Camera, size: tuple[int, int], at: tuple[int, int], extent: tuple[int, int]) -> Camera:
    """Return the camera of a rectangle of pixels of a camera's picture; of a perspective one with a `Camera.shift`.

    The slices, and with them all sums, stay the same: the view direction and the field determine them.

    Parameters
    ----------
    camera
        The camera of the whole picture.
    size
        (width, height) of the whole picture in pixels.
    at
        Column and row of the first pixel of the rectangle; may lie outside the picture.
    extent
        (width, height) of the rectangle in pixels.

    Raises
    ------
    InvalidInput
        For anything but a camera, sizes and whole numbers.
    """
    instance("window: camera", camera, Camera)
    size, extent = image_size(size), image_size(extent)
    at = _column_and_row(at)
    # From the middle of the picture to that of the rectangle, pixels.
    x = at[0] + 0.5 * extent[0] - 0.5 * size[0]
    y = 0.5 * size[1] - at[1] - 0.5 * extent[1]
    if camera.kind == "perspective":
        half = math.tan(0.5 * math.radians(camera.fov_y)) * extent[1] / size[1]
        shift = (x + camera.shift[0] * size[1]) / extent[1], (y + camera.shift[1] * size[1]) / extent[1]
        angle = 2.0 * math.degrees(math.atan(half))
        return Camera.perspective(camera.eye, camera.target, camera.up, fov_y=angle, near=camera.near, shift=shift)
    pixel = camera.height / size[1]
    x, y = x * pixel, y * pixel
    right, up, back = camera.world_axes()
    eye = _moved(camera.eye, right, up, x, y)
    # Far enough that rounding the target does not turn the view.
    far = max(1.0, math.hypot(*eye), math.dist(camera.eye, camera.target))
    target = (eye[0] - far * back[0], eye[1] - far * back[1], eye[2] - far * back[2])
    return Camera.orthographic(eye, target, up, height=extent[1] * pixel)


def pieces(size: tuple[int, int], tile: int) -> Iterator[tuple[int, int, int, int]]:
    """Return column, row, width and height of every tile, row by row; tiles at the right and bottom may be smaller."""
    for row in range(0, size[1], tile):
        for column in range(0, size[0], tile):
            yield column, row, min(tile, size[0] - column), min(tile, size[1] - row)


def render_tiles(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    path: str | os.PathLike[str],
    *,
    renderer: Renderer | None = None,
    tile: int = TILE,
    progress: Callable[[float], object] | None = None,
    depth_limit: ArrayLike | None = None,
) -> Floats:
    """Render a picture of any size into an .npy file, tile by tile, and return the file as a memory map.

    The pixels are those of a single picture within the rounding of float32: all tiles have the same slices, and
    gradients use pixels beyond the edge of a tile, so that there are no seams.

    Parameters
    ----------
    scene
        The scene.
    camera
        The camera.
    size
        (width, height) in pixels.
    path
        The file, .npy: float32 (h, w, 4), premultiplied, or (h, w) in scalar modes; it appears whole or not at all.
    renderer
        The renderer; a new one unless given.
    tile
        Largest edge of a tile in pixels; with several samples a pixel in samples.
    progress
        Called with the finished share, 0 to 1, as often as `Renderer.render` calls it; False stops the rendering.
    depth_limit
        Depths (h, w) of a surface that hides what lies behind it, as for `Renderer.render`.

    Raises
    ------
    InvalidInput, DeviceUnavailable, OutOfMemory, Cancelled
        As `Renderer.render`.
    Unsupported
        As `Renderer.render`.
    Error
        Where the file cannot be written, or the disk is too full for it.

    Examples
    --------
    >>> from sheetsplat.tiles import render_tiles
    >>> picture = render_tiles(scene, camera, (64, 64), "large.npy", tile=32)
    >>> picture.shape
    (64, 64, 4)
    """
    instance("render_tiles: scene", scene, Scene)
    instance("render_tiles: camera", camera, Camera)
    width, height = image_size(size)
    edge = whole("render_tiles: tile", tile, "a whole number of at least 1")
    if edge < 1:
        raise complain(unusable("render_tiles: tile"), str(edge), "a whole number of at least 1")
    if renderer is not None:
        instance("render_tiles: renderer", renderer, Renderer)
    check_progress("render_tiles", progress)
    target = file_path("the picture cannot be written", path, "a path")
    if target.suffix.lower() != ".npy":
        raise complain(f"{target} cannot be written", f"the suffix {target.suffix!r}", ".npy")
    check_folder(target)
    scalar = TRAITS[scene.mode].is_scalar
    shape = (height, width) if scalar else (height, width, 4)
    needed = 4 * math.prod(shape) + _HEADER
    room = shutil.disk_usage(target.resolve().parent).free
    if needed > room:
        raise complain(
            f"{target} cannot be written",
            f"room for {room / 1e6:,.0f} MB",
            f"room for {needed / 1e6:,.0f} MB",
            "make the picture smaller, or choose another disk",
            kind=Error,
        )
    depths = checked_depths(depth_limit, camera, (width, height))
    drawing = Renderer() if renderer is None else renderer
    # Tiles with as many samples as they would have pixels.
    all_pieces = list(pieces((width, height), max(1, edge // scene.supersampling)))
    with whole_file(target) as made:
        open_memmap(made, mode="w+", dtype=np.float32, shape=shape).flush()
        for number, (column, row, across, down) in enumerate(all_pieces):

            def told(share: float, number: int = number) -> object:
                return progress is None or progress((number + share) / len(all_pieces))

            part = window(camera, (width, height), (column, row), (across, down))
            # Many a tile is empty.
            with muted():
                limit = None if depths is None else depths[row : row + down, column : column + across]
                image = drawing.render(scene, part, size=(across, down), progress=told, depth_limit=limit)
            # Mapped anew for each tile: written pages stay in memory as long as the file is mapped.
            open_memmap(made, mode="r+")[row : row + down, column : column + across] = image.pixels
    if progress is not None and progress(1.0) is False:
        raise Cancelled("the rendering was cancelled by its progress callback")
    finished: Floats = np.load(target, mmap_mode="r", allow_pickle=False)
    return finished

"""Axis-aligned sheets, as volumes were drawn before image-aligned ones: a means of comparison, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss

Floats = NDArray[np.float64]


def dominant_axis(direction: Floats) -> int:
    """Return the axis (0: x) along which a view looks most; of two alike the first."""
    return int(np.argmax(np.abs(direction)))


def axis_aligned(
    samples: NDArray[np.float32],
    table: ss.TransferFunction,
    camera: ss.Camera,
    *,
    size: tuple[int, int],
    corrected: bool,
) -> NDArray[np.float32]:
    """Return a picture (h, w, 4), premultiplied, of the volume's own layers across the axis nearest to the view.

    Each pixel's ray meets each layer once; the samples there are interpolated between four, classified and composited
    front to back. Where the dominant axis changes, so does everything at once: the popping.

    Parameters
    ----------
    samples
        [k, j, i], 1 world unit apart, the first one at the origin.
    table
        Opacity per unit.
    camera
        Orthographic.
    size
        (width, height) in pixels.
    corrected
        Opacity by the distance that the ray covers from layer to layer, instead of 1 in every view.
    """
    from scipy import ndimage  # type: ignore[import-untyped]

    width, height = size
    eye, target, above = (np.asarray(part, dtype=np.float64) for part in (camera.eye, camera.target, camera.up))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, above)
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * camera.height / 2.0 * width / height
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * camera.height / 2.0
    starts = eye + x[None, :, None] * right + y[:, None, None] * up
    axis = dominant_axis(ahead)
    length = 1.0 / abs(ahead[axis]) if corrected else 1.0
    # Of the array [k, j, i] the world's axis x is the last one.
    layers = np.moveaxis(samples, 2 - axis, 0)
    # What is left of the array's axes, in their order.
    across = [2 - n for n in range(3) if n != 2 - axis]
    order = range(len(layers)) if ahead[axis] > 0 else range(len(layers) - 1, -1, -1)
    picture = np.zeros((height, width, 4))
    for n in order:
        along = (n - starts[..., axis]) / ahead[axis]
        at = [starts[..., one] + along * ahead[one] for one in across]
        color = table.at(ndimage.map_coordinates(layers[n], at, np.float64, order=1, mode="constant"))
        opacity = -np.expm1(length * np.log1p(-np.minimum(color[..., 3], 1.0 - 1e-12)))
        # Beyond the volume there is nothing, whatever 0 may be classified as.
        for position, count in zip(at, layers.shape[1:], strict=True):
            opacity = np.where((position > -1.0) & (position < count), opacity, 0.0)
        through = (1.0 - picture[..., 3]) * opacity
        picture[..., :3] += through[..., None] * color[..., :3]
        picture[..., 3] += through
    return np.asarray(picture, dtype=np.float32)

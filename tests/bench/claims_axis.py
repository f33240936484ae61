"""Axis-aligned sheets, for comparison with image-aligned ones, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.measure import Floats, composited, rays


def dominant_axis(direction: Floats) -> int:
    """Return the axis (0: x) nearest to a view direction; of two equally near ones the first."""
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

    Each pixel's ray meets each layer once; there the scalar is interpolated between four samples, classified and
    composited front to back. Where the dominant axis changes, all layers change at once, which is seen as popping.

    Parameters
    ----------
    samples
        [k, j, i], 1 world unit apart, the first one at the origin.
    table
        Transfer function, opacity per unit of length.
    camera
        Orthographic camera.
    size
        (width, height) in pixels.
    corrected
        Correct opacities for the ray's length from layer to layer; else that length counts as 1 in every view.
    """
    from scipy import ndimage  # type: ignore[import-untyped]

    starts, ahead = rays(camera, size)
    axis = dominant_axis(ahead)
    length = 1.0 / abs(ahead[axis]) if corrected else 1.0
    # The world's axis x is the last axis of the array [k, j, i].
    layers = np.moveaxis(samples, 2 - axis, 0)
    across = [2 - n for n in range(3) if n != 2 - axis]
    order = range(len(layers)) if ahead[axis] > 0 else range(len(layers) - 1, -1, -1)

    def layer(n: int) -> Floats:
        along = (n - starts[..., axis]) / ahead[axis]
        at = [starts[..., one] + along * ahead[one] for one in across]
        color: Floats = table.at(ndimage.map_coordinates(layers[n], at, np.float64, order=1, mode="constant"))
        # Outside the volume opacity is 0, also where the table gives the value 0 an opacity.
        for position, count in zip(at, layers.shape[1:], strict=True):
            color[..., 3] = np.where((position > -1.0) & (position < count), color[..., 3], 0.0)
        return color

    picture = composited(((layer(n), length) for n in order), starts.shape[:2])
    return np.asarray(picture, dtype=np.float32)

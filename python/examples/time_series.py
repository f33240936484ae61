"""A time series.

An array (t, k, j, i), files, or the time axis of a DataArray become a film with one look: range, opacity and camera are
decided once, by steps from the first to the last.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (220, 200)

# Two blobs that move towards each other and merge while they spread.
z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 36)], indexing="ij")
series = np.stack([
    sum(np.exp(-((x - side * (0.6 - 0.12 * step)) ** 2 + y**2 + z**2) / (0.05 + 0.02 * step)) for side in (-1, 1))
    for step in range(6)
])  # fmt: skip

film = ss.animate(series, fps=6, cmap="inferno", opacity="linear", direction=(-0.3, 1, -0.4), up="z", size=SIZE)
print(film)

frames = [film[number].to_pil() for number in range(len(film))]
Image.fromarray(np.vstack([np.hstack(frames[:3]), np.hstack(frames[3:])])).save("time_series.png")

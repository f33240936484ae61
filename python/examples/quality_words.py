"""Draft, good and best.

One word chooses kernels, slices and the filter. The errors are measured against the closed form of the signal of
Marschner and Lobb, whose maximum along rays is known.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (300, 300)

values = ss.datasets.marschner_lobb(41).values
shown = {"spacing": (0.05, 0.05, 0.05), "origin": (-1, -1, -1)}
look = {
    "mode": "isosurface",
    "iso_value": 0.5,
    "cmap": "#e0b050",
    "direction": (0.5, 0.8, -0.7),
    "up": "z",
    "zoom": 1.4,
}
inner = ss.Clip(box=((-0.9, -0.9, -0.9), (0.9, 0.9, 0.9)))
renderer = ss.Renderer()
figure, axes = plt.subplots(1, 3, figsize=(9, 3.5), layout="constrained")
for ax, quality in zip(axes, ("draft", "good", "best"), strict=True):
    image = ss.render(values, quality=quality, clip=inner, renderer=renderer, size=SIZE, **shown, **look)
    start = time.perf_counter()
    ss.render(values, quality=quality, clip=inner, renderer=renderer, size=SIZE, azimuth=1, **shown, **look)
    seconds = time.perf_counter() - start
    # Places on the surface, and the exact signal there.
    rows, columns = np.mgrid[0.3:0.7:8j, 0.3:0.7:8j] * SIZE[0]
    picks = [image.pick(x, y) for x, y in zip(columns.flat, rows.flat, strict=True)]
    places = np.array([pick.position for pick in picks if pick is not None])
    error = np.abs(ss.datasets.marschner_lobb_value(*places.T) - 0.5).mean()
    ax.imshow(image)
    ax.set_title(f"{quality}: signal off by {error:.4f}", fontsize=10)
    ax.axis("off")
    print(f"{quality}: {1000 * seconds:.0f} ms; {', '.join(str(one) for one in image.plan.quality.settings)}")
figure.savefig("quality_words.png")

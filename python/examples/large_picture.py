"""A picture larger than memory.

`render_tiles` renders an orthographic picture tile by tile into a file, which it returns as a memory map. Here a
poster is rendered in tiles, and a detail of it is shown beside the whole.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss
from sheetsplat.tiles import render_tiles

SIZE = (800, 800)

scene = ss.datasets.tubes(96).scene()
camera = ss.Camera.fit(scene, direction=(0.6, 0.7, -0.4), up=(0, 0, 1), margin=0.6)
poster = render_tiles(scene, camera, SIZE, "poster.npy")
print(type(poster).__name__, poster.shape, poster.dtype)
whole = ss.Renderer().render(scene, camera, size=SIZE)
assert np.abs(poster - whole.rgba).max() < 1e-4

figure, axes = plt.subplots(1, 2, figsize=(8, 4.2), layout="constrained")
step = SIZE[0] // 200
middle = slice(SIZE[0] * 3 // 8, SIZE[0] * 5 // 8)
over_black = poster[..., :3]
axes[0].imshow(np.clip(over_black[::step, ::step], 0, 1))
axes[1].imshow(np.clip(over_black[middle, middle], 0, 1))
for ax, title in zip(axes, ("whole", "a sixteenth of it"), strict=True):
    ax.set_title(title, fontsize=10)
    ax.axis("off")
figure.savefig("large_picture.png")

"""Bricks: data that are larger than memory.

A file of raw samples, of which no more is in memory than the bricks that are drawn, and particles that are sorted into
bricks when they are opened. The pictures are those of the same data in memory. With `client=`, a client of
dask.distributed, all workers of a cluster draw them.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (360, 360)

# 72³ bytes, written layer by layer: shells that open to one side.
axis = np.linspace(-1, 1, 72, dtype="float32")
with open("shells.raw", "wb") as file:
    for z in axis:
        radius = np.sqrt(z * z + axis[:, None] ** 2 + axis**2)
        wave = np.cos(14 * radius + 2 * axis) * (axis[:, None] < 0.3)
        file.write(np.uint8(np.where(radius < 0.95, 120 + 100 * wave, 0)).tobytes())

bricked = ss.open_bricks("shells.raw", shape=(72, 72, 72), dtype="uint8", brick=24, quality="draft")
volume = ss.render(bricked, azimuth=30, elevation=-25, size=SIZE, quality="draft")
stats = volume.stats
print(f"{stats['bricks_drawn']:.0f} of {stats['bricks']:.0f} bricks drawn")

# 4,000 particles on a spiral, with smoothing lengths.
random = np.random.default_rng(5)
turn = np.sort(random.random(4000)) * 12
arm = 0.08 * turn + random.normal(0, 0.04, turn.size)
table = {
    "x": arm * np.cos(turn),
    "y": arm * np.sin(turn),
    "z": random.normal(0, 0.04, turn.size),
    "radius": 0.06 + 0.004 * turn,
    "value": 5 + np.sin(3 * turn),
}
particles = ss.open_bricks(table, brick_kernels=500)
print(particles)
spiral = ss.render(
    particles,
    cmap="plasma",
    clim=(3.5, 6),
    opacity=[(3.5, 0.2), (6, 0.7)],
    azimuth=20,
    elevation=35,
    size=SIZE,
    quality="draft",
)

figure, panels = plt.subplots(1, 2, figsize=(SIZE[0] / 50, SIZE[1] / 100), layout="constrained")
for panel, image, title in zip(panels, (volume, spiral), ("volume, 27 bricks", "particles, 8 bricks"), strict=True):
    panel.imshow(image)
    panel.set_title(title, fontsize="small")
    panel.axis("off")
figure.savefig("data_in_bricks.png")

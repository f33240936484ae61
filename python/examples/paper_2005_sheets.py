"""2005, figure 1: kernels, slabs and sheets.

Slabs parallel to the image cut each kernel into sections, and all sections of one slab are summed in its sheet. The
curves are the sections' weights by depth; the pictures are sheets of a volume, one by one, and the composite of all.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (180, 180)

# A knot of two rings.
z, y, x = np.meshgrid(*3 * [np.linspace(-1.2, 1.2, 48)], indexing="ij")
rings = np.minimum(np.hypot(np.hypot(x - 0.4, y) - 0.6, z), np.hypot(np.hypot(x + 0.4, z) - 0.6, y))
values = np.clip((0.3 - rings) / 0.15, 0, 1)
step = 2.4 / 47
field = ss.RegularField(values, spacing=(step,) * 3, origin=(-1.2,) * 3)
scene = ss.Scene(
    field, [(0, 0, 0, 0, 0), (0.3, 0.3, 0.5, 0.8, 0.02), (1, 1, 0.7, 0.3, 0.4)], lights=[ss.Light((0.3, 0.5, 1))]
)
camera = ss.Camera.orthographic(eye=(0, 0, 4), target=(0, 0, 0), height=2.5)
renderer = ss.Renderer()

figure = plt.figure(figsize=(9, 4.6), layout="constrained")
grid = figure.add_gridspec(2, 4)
ax = figure.add_subplot(grid[0, :3])
# The kernel of the paper: radius 2 slabs, exp(-5 t²) of t = distance over radius; a section weighs the mean of
# the Gaussian over its slab (section 3).
depth = np.linspace(-3, 3, 601)
for start in range(-2, 2):
    inside = (depth >= start) & (depth <= start + 1)
    part = np.exp(-5 * (depth / 2) ** 2)
    ax.fill_between(depth[inside], part[inside], alpha=0.5, label=f"slab {start + 3}: {part[inside].mean():.2f}")
ax.plot(depth, np.where(abs(depth) <= 2, np.exp(-5 * (depth / 2) ** 2), 0), "k")
ax.set(xlabel="depth in slabs", ylabel="kernel", title="four sections of one kernel")
ax.legend(fontsize=7, loc="upper right")

image = renderer.render(scene, camera, size=SIZE)
whole = figure.add_subplot(grid[0, 3])
whole.imshow(image)
whole.set_title("composite", fontsize=10)
for place, layer in enumerate((12, 20, 24, 28)):
    # The sheet at this depth: the sum of the sections that reach it.
    height = 1.2 - (47 - layer) * step
    ys, xs = np.meshgrid(np.linspace(1.25, -1.25, SIZE[1]), np.linspace(-1.25, 1.25, SIZE[0]), indexing="ij")
    sheet = field.at(np.stack([xs, ys, np.full_like(xs, height)], axis=-1).reshape(-1, 3)).reshape(SIZE[1], SIZE[0])
    below = figure.add_subplot(grid[1, place])
    below.imshow(sheet, cmap="gray", vmin=0, vmax=1)
    below.set_title(f"sheet at z = {height:.2f}", fontsize=10)
for one in figure.axes[1:]:
    one.axis("off")
figure.savefig("paper_2005_sheets.png")

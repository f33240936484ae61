"""What is seen at a pixel.

`image.pick(x, y)` returns the place in the world, the value, the gradient and the nearest sample of what a pixel
shows. Here three pixels are picked and marked in a figure.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# Two merging drops with a neck between them; the value is the signed distance in mm, positive inside.
z, y, x = np.meshgrid(np.linspace(-6, 6, 48), np.linspace(-6, 6, 48), np.linspace(-10, 10, 80), indexing="ij")
left, right = 4.5 - np.sqrt((x + 4) ** 2 + y**2 + z**2), 3 - np.sqrt((x - 4.2) ** 2 + y**2 + z**2)
values = np.log(np.exp(1.2 * left) + np.exp(1.2 * right)) / 1.2 + 6

# Kernels that interpolate the samples, so that the surface has no ripple; for arrays `ss.render` chooses them itself.
kernels = {"radius": 2.5, "falloff": 7, "prefilter": True}
field = ss.RegularField(values, spacing=(20 / 79, 12 / 47, 12 / 47), origin=(-10, -6, -6), **kernels)
field = field.with_quantity(name="distance + 6", unit="mm", length_unit="mm")
image = ss.render(field, mode="isosurface", iso_value=6, cmap="#9bc4e2", direction=(0, 1, -0.3), up="z", size=SIZE)

figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
ax.imshow(image)
ax.axis("off")
for share_x, share_y in ((0.30, 0.45), (0.53, 0.5), (0.75, 0.4)):
    column, row = share_x * SIZE[0], share_y * SIZE[1]
    found = image.pick(column, row)
    assert found is not None and abs(found.value - 6) < 1e-3  # on the surface
    normal = -np.array(found.gradient) / np.linalg.norm(found.gradient)
    print(f"pixel ({column:.0f}, {row:.0f}): {found}")
    place = ", ".join(f"{c:.1f}" for c in found.position)
    text = f"({place}) mm\nnormal ({', '.join(f'{c:.2f}' for c in normal)})\nsample {found.sample}"
    ax.annotate(
        text,
        (column, row),
        (column - 0.05 * SIZE[0], row + 0.36 * SIZE[1]),
        ha="center",
        fontsize=8,
        arrowprops={"arrowstyle": "-|>", "color": "black"},
        bbox={"facecolor": "white", "edgecolor": "grey"},
    )
figure.savefig("picking.png")

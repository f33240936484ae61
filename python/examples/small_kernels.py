"""Kernels smaller than a pixel.

Dust falls between pixels and slices: without a filter its brightness depends on where pixels happen to be. The EWA
filter widens each kernel to a pixel and keeps its mass.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (160, 120)

# A spiral of 30,000 grains, each a fifth of a pixel wide.
random = np.random.default_rng(8)
turn = random.uniform(0, 6 * np.pi, 30_000)
out = 0.03 * turn + random.normal(0, 0.03, 30_000)
places = np.stack([out * np.cos(turn), out * np.sin(turn), random.normal(0, 0.03, 30_000)], axis=1)
grains = ss.EllipsoidField(places, np.full(30_000, 0.0012), values=np.ones(30_000), normalization="none")
points = [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]
camera = ss.Camera.orthographic(eye=(0, 0, 2), target=(0, 0, 0), height=1.3)

mass = {}
figure, axes = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
for ax, filter in zip(axes, (None, "ewa"), strict=True):
    with warnings.catch_warnings():
        # Without the filter a PictureWarning says how many grains no slice meets.
        warnings.simplefilter("ignore", ss.PictureWarning)
        scene = ss.Scene(grains, points, mode="xray", slice_spacing=0.01, filter=filter)
        image = ss.Renderer().render(scene, camera, size=SIZE)
    mass[filter] = image.scalar.sum() * (1.3 / SIZE[1]) ** 2
    ax.imshow(image.scalar, cmap="gray", vmax=np.quantile(image.scalar, 0.995))
    ax.set_title(f"filter={filter!r}: mass {mass[filter]:.2e}", fontsize=10)
    ax.axis("off")
figure.savefig("small_kernels.png")

# The mass of a kernel is its integral over space; exp(-8 t²) of a semi-axis a has the mass (pi / 8)^1.5 a³, and the
# kernel, which is lowered to end at 0, 0.6 % less.
exact = 30_000 * 0.0012**3 * (np.pi / 8) ** 1.5
print(f"mass of all grains {exact:.2e}")
assert abs(mass["ewa"] / exact - 1) < 0.1

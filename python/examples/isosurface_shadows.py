"""An isosurface with shadows.

A surface of equal value with a light that casts shadows, and with ambient occlusion, which darkens crevices. Each of
the two is an option that costs nothing while it is off.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (320, 320)

# Twelve balls around a larger one, joined smoothly (a sum of inverse squared distances).
z, y, x = np.meshgrid(*3 * [np.linspace(-1.6, 1.6, 72)], indexing="ij")
golden = (1 + np.sqrt(5)) / 2
corners = [np.roll((0, a, b * golden), turn) for a in (-1, 1) for b in (-1, 1) for turn in range(3)]
values = 0.30 / (x**2 + y**2 + z**2 + 0.05)
for corner in corners:
    cx, cy, cz = corner / np.linalg.norm(corner)
    values += 0.055 / ((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2 + 0.01)

options = {
    "mode": "isosurface",
    "iso_value": 1.45,
    "cmap": "#f2f2f2",
    "lights": [ss.Light((-0.7, 1, 0.5))],
    "material": ss.Material(ambient=0.35, diffuse=0.7, specular=0.2),
    "elevation": 25,
    "size": SIZE,
}
effects = {
    "light alone": {},
    "shadows": {"shadows": True},
    "shadows and ambient occlusion": {"shadows": True, "ambient_occlusion": True},
}
figure, axes = plt.subplots(1, 3, figsize=(9, 3.3), layout="constrained")
for ax, (title, more) in zip(axes, effects.items(), strict=True):
    ax.imshow(ss.render(values, **options, **more))
    ax.set_title(title, fontsize=10)
    ax.axis("off")
figure.savefig("isosurface_shadows.png")

"""Several isosurfaces at once.

Pairs of value and opacity give translucent surfaces inside each other: here three levels of the electron density of
benzene, as a sum of Gaussians at its atoms and bonds.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

z, y, x = np.meshgrid(np.linspace(-2, 2, 48), np.linspace(-3.6, 3.6, 88), np.linspace(-3.6, 3.6, 88), indexing="ij")
values = np.zeros_like(x)
turn = np.arange(6) * np.pi / 3
for ring, weight, width in (
    (1.39, 3.0, 0.42),
    (2.48, 0.8, 0.45),
    (1.95, 0.5, 0.4),
):  # carbon, hydrogen, C-H; in ångström
    for angle in turn:
        squared = (x - ring * np.cos(angle)) ** 2 + (y - ring * np.sin(angle)) ** 2 + z**2
        values += weight * np.exp(-squared / (2 * width**2))
for angle in turn + np.pi / 6:  # C-C, in the middle between two carbons
    squared = (x - 1.2 * np.cos(angle)) ** 2 + (y - 1.2 * np.sin(angle)) ** 2 + z**2
    values += 0.9 * np.exp(-squared / (2 * 0.4**2))

image = ss.render(
    values,
    spacing=(7.2 / 87, 7.2 / 87, 4 / 47),
    mode="isosurface",
    iso_value=[(0.15, 0.25), (0.8, 0.4), (2.2, 1.0)],
    cmap="#5b8fd9,#f3c86b,#c0392b",
    clim=(0.15, 2.2),
    azimuth=20,
    elevation=40,
    size=SIZE,
)
image.save("nested_surfaces.png")

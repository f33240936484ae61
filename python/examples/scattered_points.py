"""Scattered points with values.

Measurements at irregular places become ellipsoids along their Delaunay neighbours, which cover the space between the
points without resampling to a grid. The value at each place is close to the one that was measured there.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# 4000 stations in a box, more of them near its middle; a warm plume rises and bends.
random = np.random.default_rng(4)
points = np.clip(random.normal(0, 0.45, (4000, 3)), -1, 1) * (2, 1, 1)
x, y, z = points.T
axis = 0.5 * (z + 1) ** 2 - 1.0
temperature = 15 + 40 * np.exp(-((x - axis) ** 2 + y**2) / (0.08 + 0.1 * (z + 1))) / (1.4 + z)

kernels = ss.fit.delaunay(points, temperature)
field = kernels.field().with_quantity(name="temperature", unit="°C", length_unit="m")
print(field)
error = np.abs(field.at(points) - temperature)
print(f"distance from the measurements: median {np.median(error):.2f} °C")

image = ss.render(field, cmap="inferno", clim=(15, 55), opacity=[(15, 0), (20, 0.02), (55, 0.5)], up="z", size=SIZE)
image.save("scattered_points.png")

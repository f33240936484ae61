"""A mesh of tetrahedra.

Values at the vertices of a mesh become ellipsoids along its edges. The elements tell which points are neighbours, so
that nothing is shown across a hole.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# A block of cubes with a round hole along z, each cube cut into six tetrahedra.
n, depth = 40, 16
k, j, i = np.meshgrid(np.arange(depth), np.arange(n), np.arange(n), indexing="ij")
x, y, z = 2 * i / (n - 1) - 1, 2 * j / (n - 1) - 1, 0.8 * k / (depth - 1)
points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
number = np.arange(points.shape[0]).reshape(depth, n, n)
corner = [
    number[a : depth - 1 + a, b : n - 1 + b, c : n - 1 + c].ravel() for a in (0, 1) for b in (0, 1) for c in (0, 1)
]
paths = [(0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7)]
cells = np.concatenate([np.stack([corner[c] for c in path], axis=1) for path in paths])
radius = np.hypot(points[:, 0], points[:, 1])
cells = cells[(radius[cells] > 0.3).all(axis=1)]

# Stress around a hole in a plate under tension along x (Kirsch 1898), the component along x over the applied one.
angle = np.arctan2(points[:, 1], points[:, 0])
a = (0.3 / np.maximum(radius, 0.3)) ** 2
stress = 1 - a * (1.5 * np.cos(2 * angle) + np.cos(4 * angle)) + 1.5 * a**2 * np.cos(4 * angle)

used = np.unique(cells)
cells = np.searchsorted(used, cells)
kernels = ss.fit.delaunay(points[used], stress[used], cells=cells)
print(kernels)
print(f"largest stress at a vertex: {stress[used].max():.2f} of the applied one; at the edge of the hole it is 3")
image = ss.render(
    kernels.field(w0=0.7),
    cmap="coolwarm",
    clim=(-1, 3),
    opacity=[(-1, 0.6), (0.7, 0.04), (1.3, 0.04), (3, 0.6)],
    azimuth=20,
    elevation=50,
    size=SIZE,
)
image.save("finite_elements.png")

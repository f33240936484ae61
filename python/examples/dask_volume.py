"""dask: a volume that is computed when it is drawn.

A dask array is read where it is known to fit into memory; a lazy computation before it costs nothing until then. Here
a large volume is smoothed and reduced by dask, and the result is rendered.
"""

import dask.array as da
import numpy as np

import sheetsplat as ss

SIZE = (480, 420)

# 96³ samples in blocks of 48³: foam, the distance to the two nearest of 30 seeds.
axis = da.linspace(0, 1, 96, chunks=48)
random = np.random.default_rng(12)
seeds = random.random((30, 3))
nearest = da.full((96, 96, 96), 9.0, chunks=48, dtype="float32")
second = nearest
for x, y, z in seeds.astype("float32"):
    one = da.sqrt((axis - z)[:, None, None] ** 2 + (axis - y)[:, None] ** 2 + (axis - x) ** 2).astype("float32")
    second = da.minimum(second, da.maximum(nearest, one))
    nearest = da.minimum(nearest, one)
walls = da.exp(-(((second - nearest) / 0.03) ** 2))
reduced = da.coarsen(np.mean, walls, {0: 2, 1: 2, 2: 2})
print(reduced)

image = ss.render(reduced, cmap="bone", clim=(0, 1), opacity=[(0, 0), (0.25, 0), (0.7, 0.5)], size=SIZE)
image.save("dask_volume.png")

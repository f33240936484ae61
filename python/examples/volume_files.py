"""Volumes in files.

A volume is written as NRRD, MetaImage, NumPy and raw samples, and each file is opened again. The format is found by
the content of the file; spacing, origin and units come from its header, and raw samples need a shape and a type.
"""

import nrrd
import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# A gyroid, which divides a ball into two channels; slices are twice as far apart as samples within them.
z, y, x = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 80), np.linspace(-1, 1, 80), indexing="ij")
u, v, w = 7 * x, 7 * y, 7 * z
wall = np.abs(np.sin(u) * np.cos(v) + np.sin(v) * np.cos(w) + np.sin(w) * np.cos(u))
inside = np.clip((0.95 - np.sqrt(x**2 + y**2 + z**2)) / 0.06, 0, 1)
values = (255 * np.clip(1.4 - 2 * wall, 0, 1) * inside).astype(np.uint8)

# NRRD stores x first, and states distances and their unit.
nrrd.write("gyroid.nrrd", values.T, {"spacings": [0.5, 0.5, 1.0], "units": ["mm", "mm", "mm"]})
with open("gyroid.mhd", "w") as header:
    header.write("ObjectType = Image\nNDims = 3\nDimSize = 80 80 40\nElementType = MET_UCHAR\n")
    header.write("ElementSpacing = 0.5 0.5 1\nElementDataFile = gyroid.raw\n")
values.tofile("gyroid.raw")
np.save("gyroid.npy", values)

fields = [
    ss.open("gyroid.nrrd"),
    ss.open("gyroid.mhd"),
    ss.open("gyroid.npy", spacing=(0.5, 0.5, 1)),
    ss.open("gyroid.raw", shape=(40, 80, 80), dtype="uint8", spacing=(0.5, 0.5, 1)),
]
for field in fields:
    assert np.array_equal(field.values, values) and field.spacing == (0.5, 0.5, 1.0)
    print(field)

ss.render("gyroid.nrrd", cmap="magma", azimuth=30, elevation=30, size=SIZE).save("volume_files.png")

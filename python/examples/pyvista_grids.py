"""PyVista: image data, a curvilinear and an unstructured grid.

Data sets of PyVista and VTK are rendered as they are. Images and rectilinear grids are volumes; structured and
unstructured grids become ellipsoids along their cells, without resampling.
"""

import numpy as np
import pyvista as pv
from PIL import Image

import sheetsplat as ss
import sheetsplat.integrations.pyvista  # noqa: F401  registers the accessor

SIZE = (300, 280)

image = pv.ImageData(dimensions=(48, 48, 48), spacing=(0.1, 0.1, 0.1), origin=(-2.35, -2.35, -2.35))
x, y, z = image.points.T
tangle = x**4 + y**4 + z**4 - 5 * (x**2 + y**2 + z**2) + 11.8  # 0 on the surface
image["tangle"] = np.exp(-tangle / 10)
first = image.sheetsplat.render(scalar="tangle", mode="isosurface", iso_value=1, cmap="#c0263a", size=SIZE)

r, turn, height = np.meshgrid(
    np.linspace(1, 2, 12), np.linspace(0, 1.5 * np.pi, 60), np.linspace(0, 1, 14), indexing="ij"
)
bend = pv.StructuredGrid(r * np.cos(turn), r * np.sin(turn), height)
bend["speed"] = ((2 - r) * (r - 1) * height * (1 - height) * 16).ravel(order="F")
second = bend.sheetsplat.render(scalar="speed", cmap="turbo", opacity=[(0, 0.02), (0.3, 0.02), (1, 0.6)], size=SIZE)

tetrahedra = image.extract_subset((0, 47, 0, 47, 0, 47), (2, 2, 2)).threshold((1, 3), scalars="tangle").triangulate()
look = {"cmap": "plasma", "clim": (1, 2), "opacity": [(0.8, 0), (1, 0.02), (2, 0.5)]}
third = ss.render(tetrahedra, scalar="tangle", size=SIZE, **look)
print(ss.open(tetrahedra, scalar="tangle"))

Image.fromarray(np.hstack([one.to_pil() for one in (first, second, third)])).save("pyvista_grids.png")

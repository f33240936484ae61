"""A volume among surfaces.

`composite` puts a volume into a scene of PyVista: surfaces hide what lies behind them, and the volume what is behind
it, pixel by pixel. Labels stay on top. The plotter brings camera, background and size.
"""

import numpy as np
import pyvista as pv

import sheetsplat as ss
from sheetsplat.integrations.pyvista import composite

SIZE = (420, 360)

grid = pv.ImageData(dimensions=(56, 56, 56), spacing=(2 / 55,) * 3, origin=(-1, -1, -1))
x, y, z = grid.points.T
radius = np.sqrt(x**2 + y**2 + z**2)
grid["density"] = 100 * np.clip(1 - radius, 0, None) * (1.2 + np.cos(9 * x) * np.cos(9 * y) * np.cos(9 * z))

plotter = pv.Plotter(off_screen=True, window_size=SIZE)
plotter.set_background("white")
plotter.add_mesh(grid.slice(normal="y"), scalars="density", cmap="gray_r", show_scalar_bar=False)
plotter.add_mesh(pv.Tube(pointa=(-1, -0.5, -0.5), pointb=(1, -0.5, 0.6), radius=0.06), color="seagreen")
plotter.add_mesh(grid.outline(), color="black", line_width=2)
plotter.add_point_labels([(0.0, 0.0, 1.0)], ["density"], shape=None, show_points=False, font_size=16)
plotter.camera_position = [(3.2, -4.2, 2.4), (0, 0, 0), (0, 0, 1)]

image = composite(plotter, grid, scalar="density", cmap="plasma", opacity=[(5, 0), (90, 0.4)], clim=(5, 90))
image.save("pyvista_composite.png")

# Both cameras are the same: what Camera.from_pyvista returns serves other pictures too.
camera = ss.Camera.from_pyvista(plotter)
print(camera, np.isfinite(image.depth_limit).mean().round(2))
plotter.close()

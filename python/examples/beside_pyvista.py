"""The same picture with PyVista.

The same data, colours, opacities and view, rendered by PyVista's ray caster and by sheetsplat. Names of colormaps and
words for opacity mean the same in both.
"""

import matplotlib.pyplot as plt
import numpy as np
import pyvista as pv

import sheetsplat as ss

SIZE = (320, 300)

grid = pv.ImageData(dimensions=(56, 56, 56), spacing=(2 / 55,) * 3, origin=(-1, -1, -1))
x, y, z = grid.points.T
r = np.sqrt(x**2 + y**2 + z**2)
grid["density"] = 100 * np.clip(1 - r, 0, None) * (1.2 + np.cos(9 * x) * np.cos(9 * y) * np.cos(9 * z))
look = {"cmap": "plasma", "opacity": "sigmoid_5", "clim": (5, 90)}

ours = ss.render(grid, scalar="density", background="white", size=SIZE, **look)

# The camera that sheetsplat fitted, for PyVista: the parallel scale is half the height.
plotter = pv.Plotter(off_screen=True, window_size=SIZE)
plotter.add_volume(grid, scalars="density", shade=True, show_scalar_bar=False, **look)
plotter.background_color = "white"
plotter.enable_parallel_projection()
plotter.camera_position = [ours.camera.eye, ours.camera.target, ours.camera.up]
plotter.camera.parallel_scale = ours.camera.height / 2
theirs = plotter.screenshot(return_img=True)
plotter.close()

figure, axes = plt.subplots(1, 2, figsize=(7, 3.5), layout="constrained")
for ax, image, title in ((axes[0], theirs, "PyVista"), (axes[1], ours, "sheetsplat")):
    ax.imshow(image)
    ax.set_title(title, fontsize=10)
    ax.axis("off")
figure.savefig("beside_pyvista.png")

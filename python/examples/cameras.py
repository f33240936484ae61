"""Cameras.

Without options the whole object is seen from (1, 1, 1) with z up. Azimuth and elevation turn that view, zoom and
target look closer, and a perspective camera shows what is near larger. A camera made by hand replaces all of these.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (280, 240)

# Three pairs of arms of different lengths along x (red end), y and z, of spheres.
step = np.linspace(0.15, 1, 60)
centres = np.concatenate([step[:, None] * length * axis for axis, length in zip(np.eye(3), (3, 2, 1), strict=True)])
field = ss.EllipsoidField(centres, np.full(180, 0.22), values=np.repeat([0.95, 0.55, 0.1], 60), w0=0.001)
look = {"cmap": "turbo", "clim": (0, 1), "opacity": [(0.05, 0), (0.08, 0.7), (1, 0.7)], "size": SIZE}
by_hand = ss.Camera.perspective(eye=(6, -3, 4), target=(1, 0.7, 0.2), up=(0, 0, 1), fov_y=30)
views = {
    "no options": {},
    "azimuth=0": {"azimuth": 0},
    "azimuth=-60, elevation=10": {"azimuth": -60, "elevation": 10},
    'direction="-z", up="y"': {"direction": "-z", "up": "y"},
    'projection="perspective", fov_y=70': {"projection": "perspective", "fov_y": 70},
    "Camera.perspective(...)": {"camera": by_hand},
}
figure, axes = plt.subplots(2, 3, figsize=(9, 5.6), layout="constrained")
for ax, (title, view) in zip(axes.flat, views.items(), strict=True):
    ax.imshow(ss.render(field, **look, **view))
    ax.set_title(title, fontsize=9)
    ax.set_xticks([])
    ax.set_yticks([])
figure.savefig("cameras.png")

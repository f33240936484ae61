"""A closed surface filled with kernels, and bent.

`ss.fit.solid` fills a closed mesh with spheres of several sizes; a free-form deformation moves, turns and stretches
them into ellipsoids.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (480, 360)

# A knot on a torus as a tube of triangles.
around, along = 24, 240
t = np.linspace(0, 2 * np.pi, along, endpoint=False)
line = np.stack([(2 + np.cos(3 * t)) * np.cos(2 * t), (2 + np.cos(3 * t)) * np.sin(2 * t), np.sin(3 * t)], axis=1)
forward = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
forward /= np.linalg.norm(forward, axis=1, keepdims=True)
side = np.cross(forward, (0, 0, 1))
side /= np.linalg.norm(side, axis=1, keepdims=True)
s = np.linspace(0, 2 * np.pi, around, endpoint=False)
circle = np.cos(s)[:, None] * side[:, None] + np.sin(s)[:, None] * np.cross(side, forward)[:, None]
vertices = (line[:, None] + 0.42 * circle).reshape(-1, 3)
number = np.arange(along * around).reshape(along, around)
right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
both = np.roll(up, -1, axis=0)
triangles = np.concatenate(
    [np.stack([number, up, both], -1).reshape(-1, 3), np.stack([number, both, right], -1).reshape(-1, 3)]
)

knot = ss.fit.solid(vertices, triangles, kernels=8000)
print(f"{len(knot.centers)} kernels")
box = knot.centers.min(axis=0), knot.centers.max(axis=0)
lattice = ss.fit.control_lattice(box, (3, 3, 3))
lattice[2, :, :, 2] += 2.5  # the side of largest x is lifted
bent = ss.fit.free_form_deformation(knot, lattice, box=box)

look = {"cmap": "#d9a066", "clim": (0, 1), "opacity": [(0.4, 0), (0.6, 1)], "direction": (-0.3, 1, -0.9), "up": "z"}
pictures = [ss.render(kernels, size=SIZE, **look).to_pil() for kernels in (knot, bent)]
Image.fromarray(np.hstack(pictures)).save("solid_mesh.png")

"""Cut open by planes and boxes.

Clipping keeps what lies inside a box and on one side of planes. With `cut_faces` the opened layers are lit as the
flat face that they are, in place of the gradients inside them.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# A planet: crust, mantle with slow convection, and a core; temperature in kelvins.
z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 88)], indexing="ij")
r = np.sqrt(x**2 + y**2 + z**2)
cells = np.sin(7 * np.arctan2(y, x)) * np.sin(6 * np.arccos(z / r))
temperature = np.interp(r, [0, 0.35, 0.42, 0.85, 0.95, 1.0], [6000, 5500, 3800, 2200, 600, 0])
temperature += np.where((r > 0.42) & (r < 0.9), 450 * cells * np.sin(np.pi * (r - 0.42) / 0.48), 0)

image = ss.render(
    ss.RegularField(temperature, spacing=(2 / 87,) * 3, origin=(-1, -1, -1)),
    cmap="#30343f,#5a3a2e,#a3311f,#e2711d,#ffd97d,#ffffff",
    clim=(0, 6000),
    opacity=[(0, 0), (300, 0), (400, 0.9), (6000, 0.9)],
    # What lies behind the plane x + y = 0.1, seen from the front.
    clip=ss.Clip(planes=[((-1, -1, 0), -0.1)]),
    # By itself where nobody gives light or material.
    cut_faces=True,
    material=ss.Material(ambient=0.75, diffuse=0.35, two_sided=True),
    azimuth=15,
    elevation=25,
    size=SIZE,
)
image.save("clipping.png")

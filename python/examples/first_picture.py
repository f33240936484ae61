"""A first picture.

`ss.render` makes a picture of an array in one line and chooses everything else from the values. The second picture
shows the same array with field, transfer function, light and camera made by hand.
"""

import numpy as np

import sheetsplat as ss

SIZE = (640, 480)

# A torus of radius 0.6, soft at its surface; values[k, j, i] with i along x.
z, y, x = np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 64)], indexing="ij")
distance = np.hypot(np.hypot(x, y) - 0.6, z)
values = np.clip((0.35 - distance) / 0.2, 0.0, 1.0).astype(np.float32)

ss.render(values, elevation=40, size=SIZE).save("first_picture.png")

field = ss.RegularField(values, spacing=(2 / 63, 2 / 63, 2 / 63), origin=(-1, -1, -1))
transfer = ss.TransferFunction([(0.05, 0.1, 0.3, 0.8, 0.0), (0.5, 0.9, 0.8, 0.5, 0.05), (1.0, 1.0, 0.4, 0.1, 0.6)])
scene = ss.Scene(field, transfer, lights=[ss.Light((0.3, 0.5, 1.0))], material=ss.Material(specular=0.3))
camera = ss.Camera.perspective(eye=(0, -3.2, 2.4), target=(0, 0, 0), up=(0, 0, 1), fov_y=35)
image = ss.Renderer().render(scene, camera, size=SIZE)
image.save("first_picture_by_hand.png")
print(image.plan)

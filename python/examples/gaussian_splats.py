"""A file of 3D Gaussian Splatting.

Programs that fit Gaussians to photographs write .ply files. They open as ellipsoids with their positions, sizes and
rotations; the scalar is the opacity or any other property of the file. This script writes such a file itself: a bowl
of flat Gaussians.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# Points spread evenly on the lower three quarters of a sphere (Fibonacci spiral); discs lie in its surface.
count = 4000
height = np.linspace(-1, 0.5, count)
turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
ring = np.sqrt(1 - height**2)
normal = np.stack([ring * np.cos(turn), height, ring * np.sin(turn)], axis=1)
half = np.stack([1 + normal[:, 2], -normal[:, 1], normal[:, 0], np.zeros(count)], axis=1)
quaternion = half / np.linalg.norm(half, axis=1, keepdims=True)  # turns z to the normal
sizes = np.log(np.tile([0.03, 0.03, 0.004], (count, 1)))  # the file holds logarithms of standard deviations
opacity = 2 + 2 * np.sin(8 * np.arctan2(normal[:, 2], normal[:, 0]) + 6 * height)  # and logits of opacities

names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
rows = np.column_stack([normal, np.zeros((count, 3)), opacity, sizes, quaternion]).astype("<f4")
header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
with open("bowl.ply", "wb") as file:
    file.write(header.encode() + rows.tobytes())

field = ss.open("bowl.ply", w0=0.05)
print(field)
look = {"cmap": "viridis", "clim": (0.4, 1), "opacity": [(0.4, 0), (1, 0.5)], "filter": "ewa"}
image = ss.render(field, up="y", elevation=35, quality="best", size=SIZE, **look)
image.save("gaussian_splats.png")

"""2006, figure 3: slices of an ellipsoid.

A plane parallel to the image cuts an ellipsoidal kernel in an ellipse. In the space where the ellipsoid is a unit
sphere the slices are discs, and one Gaussian serves all of them (section 3.3). The slices are drawn by equations 10
to 18, and the kernel's own values along them are checked.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import sheetsplat as ss

SIZE = (300, 300)

sizes = np.array([1.0, 0.45, 0.25])
rotation = Rotation.from_euler("xyz", (30, 50, 20), degrees=True).as_matrix()
matrix = rotation @ np.diag(sizes)  # M' = R S; the view is along z, so that R_V is the identity

# Equations 10 to 12: rows of M'^-1 ... the plane's normal in unit space is the third row of M', normalised.
normal = matrix[2]
half_depth = np.linalg.norm(normal)
n = normal / half_depth
u = np.cross(n, (0, 0, 1))
u /= np.linalg.norm(u)
v = np.cross(n, u)
figure = plt.figure(figsize=(9.5, 3.6), layout="constrained")
screen, unit = figure.add_subplot(1, 3, 1, projection="3d"), figure.add_subplot(1, 3, 2, projection="3d")
turn = np.linspace(0, 2 * np.pi, 90)
colors = plt.get_cmap("viridis")
field = ss.EllipsoidField([(0, 0, 0)], sizes[None], rotation[None], values=[1.0], normalization="none")
for height in np.linspace(-0.9, 0.9, 9):
    disc = height * n + np.sqrt(1 - height**2) * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
    ellipse = disc @ matrix.T
    # Each slice has one depth. Kernels are Gaussians, lowered and stretched to go from 1 to 0.
    assert np.ptp(ellipse[:, 2]) < 1e-12 and np.isclose(ellipse[0, 2], height * half_depth)
    assert np.allclose(field.at(0.8 * ellipse), (np.exp(-8 * 0.8**2) - np.exp(-8)) / (1 - np.exp(-8)), rtol=1e-9)
    for ax, ring in ((screen, ellipse), (unit, disc)):
        ax.plot(*ring.T, color=colors(0.5 + 0.5 * height))
screen.set_title("screen space", fontsize=10)
unit.set_title("unit sphere space", fontsize=10)
for ax in (screen, unit):
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_zticks([])
points = [(0, 1, 1, 1, 0), (0.1, 0.3, 0.5, 0.8, 0.05), (1, 1, 0.6, 0.1, 0.8)]
image = ss.render(
    field,
    transfer_function=points,
    slice_spacing=half_depth / 40,
    reference_length=0.1,
    direction="-z",
    up="y",
    size=SIZE,
)
last = figure.add_subplot(1, 3, 3)
last.imshow(image)
last.set_title("the kernel, rendered", fontsize=10)
last.axis("off")
figure.savefig("paper_2006_slicing.png")

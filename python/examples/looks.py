"""Looks of one volume.

The same data with the look that is chosen from the histogram, with other colormaps and words for opacity, with a
transfer function that shows two ranges of values, and without light.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (300, 260)

# The density of the hydrogen orbital 4f (m = 0) in arbitrary units, signed by its wave function.
z, y, x = np.meshgrid(*3 * [np.linspace(-24, 24, 56)], indexing="ij")
r = np.sqrt(x**2 + y**2 + z**2)
psi = r**3 * np.exp(-r / 4) * (5 * (z / r) ** 3 - 3 * z / r)
values = np.sign(psi) * psi**2
values /= np.abs(values).max()

looks = {
    "chosen from |density|": {"data": np.abs(values)},
    'cmap="magma", opacity="sigmoid_7"': {"data": np.abs(values), "cmap": "magma", "opacity": "sigmoid_7"},
    "sign: two ranges": {
        "data": values,
        "transfer_function": [
            (-0.5, 0.1, 0.3, 0.9, 0.3),
            (-0.03, 0.4, 0.6, 1, 0.04),
            (-0.02, 1, 1, 1, 0),
            (0.02, 1, 1, 1, 0),
            (0.03, 1, 0.7, 0.4, 0.04),
            (0.5, 0.9, 0.2, 0.1, 0.3),
        ],
    },
    "without light, black": {"data": np.abs(values), "cmap": "hot", "shading": False, "background": "black"},
}
figure, axes = plt.subplots(2, 2, figsize=(7, 6.4), layout="constrained")
for ax, (title, look) in zip(axes.flat, looks.items(), strict=True):
    ax.imshow(ss.render(look.pop("data"), spacing=3 * (48 / 55,), elevation=15, size=SIZE, **look))
    ax.set_title(title, fontsize=10)
    ax.axis("off")
figure.savefig("looks.png")

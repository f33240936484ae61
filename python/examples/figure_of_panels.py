"""Pictures beside other plots.

`to_axes` puts a picture into axes of matplotlib, in world units and with its colour bar, so that it stands beside any
other plot of the same data: here the axial profile of a jet beside two views of it.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (300, 200)

# A round jet (Schlichting 1933): axial velocity, with a wavy shear layer; lengths in diameters of the nozzle.
x = np.linspace(3, 15, 96)
y = z = np.linspace(-3, 3, 56)
Z, Y, X = np.meshgrid(z, y, x, indexing="ij")
spread = 0.085 * X
wavy = 1 + 0.25 * np.sin(2.2 * X + 2 * np.arctan2(Z, Y)) * np.exp(-((X - 6) ** 2) / 30)
velocity = 6.2 / X / (1 + 0.41 * (np.hypot(Y, Z) / (spread * wavy)) ** 2) ** 2

field = ss.RegularField(velocity, spacing=(12 / 95, 6 / 55, 6 / 55), origin=(3, -3, -3))
field = field.with_quantity(name="velocity", unit="$U_0$", length_unit="D")
look = {"cmap": "viridis", "clim": (0.05, 2), "opacity": [(0.05, 0), (0.3, 0.02), (2, 0.5)], "size": SIZE}

figure, axes = plt.subplots(3, 1, figsize=(6, 9.5), layout="constrained")
ss.render(field, direction=(0, 1, 0), up="z", **look).to_axes(axes[0], title="composite")
ss.render(field, direction=(0, 1, 0), up="z", mode="mip", cmap="viridis", clim=(0, 2), size=SIZE).to_axes(
    axes[1], title="maximum"
)
axes[2].plot(x, velocity[28, 28], label="on the axis")
axes[2].plot(x, field.at(np.stack([x, 0 * x + 0.5, 0 * x], axis=1)), "--", label="half a diameter beside it")
axes[2].set(xlabel="x (D)", ylabel="velocity ($U_0$)")
axes[2].legend()
figure.savefig("figure_of_panels.png")

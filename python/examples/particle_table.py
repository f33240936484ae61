"""Particles in a table.

A data frame, or a dict of columns, with positions, a value and a radius is rendered as it is; so is a .csv file with
the same names. Here 3000 bubbles rise in a column, coloured by their speed.
"""

import numpy as np
import pandas as pd

import sheetsplat as ss

SIZE = (420, 560)

random = np.random.default_rng(7)
count = 3000
height = random.uniform(0, 30, count)
turn = 0.5 * height + random.normal(0, 0.5, count)
out = 1 + 0.12 * height
radius = random.lognormal(-1.3, 0.35, count).clip(0.1, 0.8)
table = pd.DataFrame(
    {
        "x": out * np.cos(turn) + random.normal(0, 0.6, count),
        "y": out * np.sin(turn) + random.normal(0, 0.6, count),
        "z": height,
        "radius": radius,
        "speed": 0.2 * np.sqrt(9.81 * radius) + 0.01 * height,
    }
)
table.to_csv("bubbles.csv", index=False)

# Bubbles do not fade at their borders (a small w0), and what is slower than any of them is empty.
look = {"cmap": "turbo", "clim": (0.2, 0.8), "opacity": [(0.15, 0), (0.2, 0.8), (0.8, 0.8)], "elevation": 15}
image = ss.render(table, scalar="speed", w0=0.001, projection="perspective", size=SIZE, **look)
image.save("particle_table.png")
same = ss.render("bubbles.csv", scalar="speed", w0=0.001, projection="perspective", size=SIZE, **look)
print(f"largest difference between table and file: {np.abs(same.rgba - image.rgba).max():.1e}")

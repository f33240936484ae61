"""Values over many decades.

The density of a galaxy of gas spans six decades. Where nobody chose a range, a picture shows such values as
logarithms and says so on its colour bar; `log=False` shows them as they are.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

# A disk with two arms: 20,000 particles, and a sparse halo. Kernels end at a distance that holds a fixed mass.
random = np.random.default_rng(11)
radius = random.exponential(3.0, 20_000).clip(0.05, 25)
turn = random.normal(0, 0.5, 20_000) + np.pi * random.integers(0, 2, 20_000) + 2.2 * np.log(radius)
places = np.stack(
    [radius * np.cos(turn), radius * np.sin(turn), random.normal(0, 0.12, 20_000) * (1 + 0.1 * radius)], 1
)
places = np.concatenate([places, random.normal(0, 9, (1500, 3))])
density = 2e8 * np.exp(-radius / 2.2)
density = np.concatenate([density, 2e8 * np.exp(-np.linalg.norm(places[20_000:], axis=1) / 1.8)]).clip(20, None)
sizes = (0.12 * (density.max() / density) ** 0.16).clip(0.12, 4)

field = ss.EllipsoidField(places, sizes, values=density, w0=0.2)
field = field.with_quantity(name="gas density", unit="$M_⊙$/kpc³", length_unit="kpc")
image = ss.render(field, cmap="inferno", background="black", elevation=55, size=SIZE)
image.annotated(title="logarithmic by itself").save("decades.png")
print(image.plan)

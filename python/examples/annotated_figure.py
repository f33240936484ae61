"""A figure for a paper.

`annotated` adds a colour bar in units of the data, axes in world units, a scale bar and a title, without scaling a
pixel. Names and units come from the file, or from `with_quantity`.
"""

import numpy as np

import sheetsplat as ss

SIZE = (520, 420)

# Oxygen around a capillary bed: diffusion from three parallel vessels, in a block of 300 µm (Krogh's model in brief).
z, y, x = np.meshgrid(np.linspace(0, 300, 48), np.linspace(0, 300, 72), np.linspace(0, 300, 72), indexing="ij")
pressure = np.full_like(x, 8.0)
for cx, cy, lead in ((80, 90, 0.0), (210, 110, 0.7), (140, 220, 1.6)):
    distance = np.hypot(x - cx - 15 * np.sin(z / 50 + lead), y - cy - 15 * np.cos(z / 60 + lead))
    pressure += (78 - 0.08 * z) * np.exp(-((np.maximum(distance, 10) - 10) / 32))

field = ss.RegularField(pressure, spacing=(300 / 71, 300 / 71, 300 / 47), radius=2.5, falloff=7, prefilter=True)
field = field.with_quantity(name="oxygen partial pressure", unit="mmHg", length_unit="µm")
image = ss.render(
    field,
    cmap="RdBu_r",
    clim=(10, 90),
    opacity=[(10, 0), (25, 0.004), (60, 0.06), (90, 0.4)],
    direction=(0, 1, 0),
    up="z",
    size=SIZE,
)
image.annotated(title="Oxygen around capillaries", scale_bar=True).save("annotated_figure.png")

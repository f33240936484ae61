"""X-ray, maximum, minimum and average.

Four modes reduce each ray to one number. The numbers are in `image.scalar`; a colormap shows them. A field falls to 0
beyond its samples, so the minimum and the average are taken of a clipped volume.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (300, 300)

# Porous rock: a random field, smoothed twice, with bright grains.
random = np.random.default_rng(5)
wave = np.fft.rfftfreq(64)[None, None] ** 2 + np.fft.fftfreq(64)[:, None] ** 2 + np.fft.fftfreq(64)[:, None, None] ** 2
noise = np.fft.rfftn(random.normal(size=(64, 64, 64)))
rock = np.fft.irfftn(noise * np.exp(-wave * 400), s=(64, 64, 64), axes=(0, 1, 2))
rock = 1.5 + 0.3 * rock / rock.std()
grains = np.fft.irfftn(
    np.fft.rfftn(random.random((64, 64, 64)) < 1e-4) * np.exp(-wave * 60), s=(64, 64, 64), axes=(0, 1, 2)
)
density = rock + 2 * grains / grains.max()

field = ss.RegularField(density).with_quantity(name="density", unit="g/cm³", length_unit="mm")
inner = ss.Clip(box=((3, 3, 3), (60, 60, 60)))
camera = ss.Camera.fit(field, direction=(0, 1, 0), up=(0, 0, 1))
figure, axes = plt.subplots(2, 2, figsize=(8, 7), layout="constrained")
for ax, mode in zip(axes.flat, ("xray", "mip", "minimum", "average"), strict=True):
    image = ss.render(field, mode=mode, clip=inner, camera=camera, size=SIZE)
    image.to_axes(ax, title=mode)
    middle = image.scalar[SIZE[1] // 2, SIZE[0] // 2]
    print(f"{mode}: {middle:.3g} in the middle of the picture")
figure.savefig("projections.png")

# An x-ray is the line integral: through the middle it is the average times the length of the ray.
assert np.isclose(density[3:61, 3:61, 32].sum(0).mean(), 57 * density[3:61, 3:61, 32].mean(), rtol=0.05)

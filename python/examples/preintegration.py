"""Thin shells between slices.

A transfer function that picks a narrow range of values makes shells thinner than a slice distance. Points on slices
miss them; pre-integration classifies the intervals between slices.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (280, 280)

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 48)], indexing="ij")
values = x**2 + 0.7 * y**2 + 1.3 * z**2
shells = [(0.0, 1, 1, 1, 0)]
for value, color in ((0.3, (0.9, 0.3, 0.2)), (0.5, (0.9, 0.8, 0.3)), (0.7, (0.3, 0.6, 0.9))):
    shells += [(value - 0.008, *color, 0), (value, *color, 0.9), (value + 0.008, *color, 0)]
scene = ss.Scene(ss.RegularField(values), [*shells, (3, 1, 1, 1, 0)], lights=[ss.Light((0.3, 0.5, 1))])
camera = ss.Camera.fit(scene, direction=(0.5, 0.7, -0.4), up=(0, 0, 1), margin=0.6)
exact = ss.Renderer().render(scene.replace(slice_spacing=1 / 16, opacity_stop=1), camera, size=SIZE)
figure, axes = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
errors = []
for ax, preintegration in zip(axes, (False, True, "second_order"), strict=True):
    image = ss.Renderer().render(scene.replace(preintegration=preintegration), camera, size=SIZE)
    errors.append(np.sqrt(np.mean((image.rgba - exact.rgba) ** 2)))
    ax.imshow(image)
    ax.set_title(f"preintegration={preintegration!r}: RMSE {errors[-1]:.3f}", fontsize=9)
    ax.axis("off")
figure.savefig("preintegration.png")
assert errors[1] < 0.5 * errors[0]

"""A picture of a given error.

With `max_error` the renderer chooses the cheapest settings that keep the root mean square distance from the converged
picture below a bound. The picture says what was chosen, and the error is checked here against much closer slices.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (240, 240)

data = ss.datasets.noisy_ball(48)
points = [
    (60, 0.1, 0.2, 0.6, 0),
    (90, 0.2, 0.6, 0.9, 0.1),
    (100, 1, 1, 1, 0.0),
    (150, 1, 0.6, 0.1, 0.6),
    (255, 1, 0, 0, 0.8),
]
scene = ss.Scene(data.field(), points, lights=[ss.Light((0.3, 0.5, 1))])
camera = ss.Camera.fit(scene, direction=(0.5, 0.6, -0.5), up=(0, 0, 1), margin=0.75)
exact = ss.Renderer().render(scene.replace(slice_spacing=1 / 24, opacity_stop=1), camera, size=SIZE)
figure, axes = plt.subplots(1, 3, figsize=(9, 3.6), layout="constrained")
for ax, bound in zip(axes, (0.1, 0.03, 0.01), strict=True):
    image = ss.Renderer(max_error=bound).render(scene, camera, size=SIZE)
    true = np.sqrt(np.mean((image.rgba - exact.rgba) ** 2))
    chosen = image.settings
    print(f"bound {bound}: true error {true:.4f}, {chosen}")
    assert true < 1.5 * bound
    ax.imshow(image)
    ax.set_title(f"asked for {bound}, true {true:.4f}\n{chosen['slice_spacing']:.2g} voxels between slices", fontsize=9)
    ax.axis("off")
figure.savefig("given_error.png")

"""The error of one picture, pixel by pixel.

`image.error` estimates the distance from the converged picture without a reference: its root mean square, its causes
and a map. Beside the map stands the true difference from a picture with slices 16 times as close.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (280, 240)

data = ss.datasets.marschner_lobb(40)
scene = data.scene(mode="composite")
camera = ss.Camera.fit(scene, direction=(0.4, 0.8, -0.6), up=(0, 0, 1), margin=0.85)
renderer = ss.Renderer()
image = renderer.render(scene, camera, size=SIZE)
fine = scene.replace(slice_spacing=scene.slice_spacing / 16, opacity_stop=1)
converged = renderer.render(fine, camera, size=SIZE)
true = np.sqrt(np.mean((image.rgba - converged.rgba) ** 2, axis=-1))
print(f"estimated RMSE {image.error.rmse:.4f}, true {np.sqrt(np.mean(true**2)):.4f}")
print("causes:", {cause: f"{rmse:.1e}" for cause, rmse in image.error.budget.items()})

figure, axes = plt.subplots(1, 3, figsize=(9.5, 3), layout="constrained")
axes[0].imshow(image)
axes[0].set_title("picture", fontsize=10)
limit = np.quantile(true, 0.99)
for ax, title, errors in ((axes[1], "estimated error", image.error.map), (axes[2], "true error", true)):
    shown = ax.imshow(errors, cmap="magma", vmin=0, vmax=limit)
    ax.set_title(title, fontsize=10)
for ax in axes:
    ax.axis("off")
figure.colorbar(shown, ax=axes[1:], label="RMS over the channels of a pixel")
figure.savefig("error_map.png")

"""The distance from the float64 reference.

The backend `reference` computes the definition of the picture in float64, slowly. The difference of any other backend
from it is arithmetic alone: here it is shown a million times as large, as the root mean square over 20 x 15
parts of the picture. (That of single pixels is noise, another one on each kind of processor.)
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (160, 120)

scene = ss.datasets.marschner_lobb(32).scene()
camera = ss.Camera.fit(scene, direction=(0.4, -0.3, -1.0))
exact = ss.Renderer("reference").render(scene, camera, size=SIZE)
fast = ss.Renderer().render(scene, camera, size=SIZE)

difference = fast.rgba.astype(np.float64) - exact.rgba
largest = np.abs(difference).max(axis=-1)
rmse, high = np.sqrt(np.mean(difference**2)), np.quantile(largest, 0.999)
print(f"{fast.plan.backend}: RMSE {rmse:.2e}  P99.9 {high:.2e}  maximum {largest.max():.2e}")
for cause, estimate in fast.plan.error_budget.items():
    print(f"  the plan's estimate, no bound, of the noise of {cause}: {estimate:.1e}")

figure, axes = plt.subplots(1, 3, figsize=(9.5, 2.7), layout="constrained")
for ax, image, title in ((axes[0], exact, "reference"), (axes[1], fast, fast.plan.backend)):
    ax.imshow(image)
    ax.set_title(title, fontsize=10)
parts = np.square(difference).reshape(15, SIZE[1] // 15, 20, SIZE[0] // 20, 4).mean(axis=(1, 3, 4))
shown = axes[2].imshow(1e6 * np.sqrt(parts), cmap="magma", vmin=0, vmax=0.15)
axes[2].set_title(f"difference, RMSE {rmse:.1e}", fontsize=10)
figure.colorbar(shown, ax=axes[2], label="millionths")
for ax in axes:
    ax.axis("off")
figure.savefig("how_exact.png")

"""The distance of the OpenGL picture from the float64 reference."""

import numpy as np

import sheetsplat as ss

scene = ss.datasets.marschner_lobb(32).scene()
camera = ss.Camera.fit(scene, direction=(0.4, -0.3, -1.0))
exact = ss.Renderer("reference").render(scene, camera, size=(160, 120))
fast = ss.Renderer("gl").render(scene, camera, size=(160, 120))

difference = fast.rgba.astype(np.float64) - exact.rgba
largest = np.abs(difference).max(axis=-1)
print(
    f"RMSE {np.sqrt(np.mean(difference**2)):.2e}  P99.9 {np.quantile(largest, 0.999):.2e}  maximum {largest.max():.2e}"
)
for cause, rmse in fast.plan.error_budget.items():
    print(f"  the plan's estimate, no bound, of the noise of {cause}: {rmse:.1e}")

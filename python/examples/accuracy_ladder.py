"""Accuracy against time.

`ss.accuracy` measures every setting that trades error for time on your own scene, one at a time. The plot shows error
over time; settings on the line are those that no other one beats in both.
"""

import numpy as np

import sheetsplat as ss

SIZE = (120, 90)

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 40)], indexing="ij")
shells = np.exp(-(x**2 + y**2 + z**2)) * (1 + 0.5 * np.cos(12 * np.sqrt(x**2 + y**2 + 0.5 * z**2)))
field = ss.RegularField(shells)
transfer_function = ss.TransferFunction.from_colormap(
    "viridis", opacity=[(0.5, 0), (0.6, 0.2), (1.5, 0.8)], clim=(0.4, 1.4)
)
scene = ss.Scene(field, transfer_function, lights=[ss.Light((0.3, 0.5, 1))])
report = ss.accuracy(
    scene,
    ss.Camera.fit(field, direction=(0.3, 0.8, -0.5), up=(0, 0, 1)),
    size=SIZE,
    knobs=["slice_spacing", "classification", "opacity_stop"],
    repeats=1,
    reference_seconds=0,
)
print(report)
report.plot("accuracy_ladder.png")

# Half the distance of slices costs less than twice the time and lowers the error.
errors = [row.rmse for row in report.of("slice_spacing") if row.measured and not row.is_truth]
assert min(errors) < 0.5 * max(errors)

"""The plan of a picture.

Before anything is rendered, the plan lists every effect as on or off, with the reason and the error that it adds.
Here the picture shows the plan of a scene with shadows, and the scene.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (340, 340)

z, y, x = np.meshgrid(*3 * [np.linspace(-1.1, 1.1, 56)], indexing="ij")
values = np.maximum.reduce(
    [1 - np.hypot(np.hypot(a, b) - 0.7, c) / 0.25 for a, b, c in ((x, y, z), (y, z, x), (z, x, y))]
)
image = ss.render(values.clip(0, None), shadows=True, cmap="copper", opacity=[(0, 0), (0.2, 0.05), (1, 0.8)], size=SIZE)
print(image.plan)

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(1, 1.9), layout="constrained")
left.imshow(image)
right.axis("off")
left.axis("off")
on = [effect for effect in image.plan.effects if effect.on]
lines = [f"{effect.name}: {effect.reason}" for effect in on]
right.text(
    0,
    1,
    "\n".join(line if len(line) < 95 else line[:92] + "..." for line in lines),
    va="top",
    fontsize=7,
    family="monospace",
)
right.set_title(f"{len(on)} effects are on, {len(image.plan.effects) - len(on)} are off", fontsize=10, loc="left")
figure.savefig("plan.png")

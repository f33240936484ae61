"""A coarse picture first.

`Renderer.progressive` yields pictures of the full size, the first after a few hundredths of a second, each at least
twice as fine as the one before; the last is the picture of `render`. Every stage estimates its distance from the
last.
"""

import matplotlib.pyplot as plt

import sheetsplat as ss

SIZE = (360, 300)

data = ss.datasets.tubes(96)
scene = data.scene()
camera = ss.Camera.fit(scene, direction=(0.6, 0.7, -0.4), up=(0, 0, 1), margin=0.6)
renderer = ss.Renderer()
# A small share of the time of the whole picture, so that there are several stages at any size and on any machine.
whole = renderer.render(scene, camera, size=SIZE).stats["seconds_total"]
stages = list(renderer.progressive(scene, camera, size=SIZE, first_seconds=whole / 12))
shown = [stages[0], stages[len(stages) // 2], stages[-1]]
figure, axes = plt.subplots(1, 3, figsize=(9.5, 3), layout="constrained")
for ax, image in zip(axes, shown, strict=True):
    stats = image.stats
    ax.imshow(image)
    ax.set_title(
        f"stage {stats['stage']:.0f} of {stats['stages']:.0f}: RMSE {stats['estimated_rmse']:.3f}", fontsize=10
    )
    ax.axis("off")
figure.savefig("progressive.png")

"""Depth cue and gradient opacity.

A depth cue fades what is far away, which tells thin structures in front from those behind. Gradient opacity hides the
inside of homogeneous regions and leaves their boundaries.
"""

import matplotlib.pyplot as plt

import sheetsplat as ss

SIZE = (300, 300)

vessels = ss.datasets.tubes(96)
ball = ss.datasets.noisy_ball(64)
pictures = {
    "vessels": ss.render(vessels, background="black", size=SIZE),
    'depth_cue="auto"': ss.render(vessels, background="black", depth_cue="auto", size=SIZE),
    "noisy ball": ss.render(
        ball, opacity=[(0, 0), (40, 0), (60, 0.05), (255, 0.05)], cmap="plasma", clim=(0, 255), size=SIZE
    ),
    "gradient_opacity=60": ss.render(
        ball,
        opacity=[(0, 0), (40, 0), (60, 0.3), (255, 0.3)],
        cmap="plasma",
        clim=(0, 255),
        gradient_opacity=60,
        size=SIZE,
    ),
}
figure, axes = plt.subplots(2, 2, figsize=(6.4, 6.8), layout="constrained")
for ax, (title, image) in zip(axes.flat, pictures.items(), strict=True):
    ax.imshow(image)
    ax.set_title(title, fontsize=10)
    ax.axis("off")
figure.savefig("depth_and_boundaries.png")

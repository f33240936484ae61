"""2005, figure 6: isosurface and semi-transparent views.

The paper shows one scan as an isosurface and in two semi-transparent views (iv to vi), and states how many splats
each one draws. A foot is not at hand: the vessels of `ss.datasets` take its place.
"""

import matplotlib.pyplot as plt

import sheetsplat as ss

SIZE = (300, 300)

vessels = ss.datasets.tubes(96)
looks = {
    "isosurface": {"mode": "isosurface", "iso_value": 110, "cmap": "#e8d8c0"},
    "semi-transparent": {"opacity": [(0, 0), (40, 0), (120, 0.08), (255, 0.12)], "cmap": "YlOrRd_r", "clim": (0, 255)},
    "semi-transparent, core": {
        "opacity": [(0, 0), (40, 0), (60, 0.03), (150, 0.03), (210, 0.5), (255, 0.8)],
        "cmap": "#6fa8dc,#6fa8dc,#d03030",
        "clim": (0, 255),
    },
}
figure, axes = plt.subplots(1, 3, figsize=(9, 3.3), layout="constrained")
for ax, (title, look) in zip(axes, looks.items(), strict=True):
    image = ss.render(vessels, size=SIZE, **look)
    ax.imshow(image)
    ax.set_title(f"{title}: {image.stats['kernels_drawn'] / 1000:.1f}K splats", fontsize=10)
    ax.axis("off")
    ax.set_facecolor("black")
figure.savefig("paper_2005_transparency.png")

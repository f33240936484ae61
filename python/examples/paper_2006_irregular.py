"""2006, figure 4: flow on an irregular grid.

The paper renders the density around a blunt fin from ellipsoids along a curvilinear grid (figure 4 a, b). Here the
grid and the flow are made: supersonic flow around a fin of round nose on a plate, with a bow shock in front of it.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (340, 280)

# i away from the fin (finer near it), j around its nose and along its side, k up from the plate (finer near it).
out = 1 + 3 * np.linspace(0, 1, 26) ** 1.5
way = np.linspace(-1, 1, 61)
up = 3 * np.linspace(0, 1, 18) ** 1.3
z, s, r = np.meshgrid(up, way, out, indexing="ij")
turn = np.clip(s, -0.6, 0.6) / 0.6 * np.pi / 2
along = np.maximum(np.abs(s) - 0.6, 0)
x = -r * np.cos(turn) + 8 * along
y = r * np.sin(turn)

# The shock stands off by a distance that grows along the fin; behind it the density falls from its jump. Near the plate
# the boundary layer separates in front of the shock, with a weaker one of its own.
stand_off = 1.7 + 0.9 * turn**2 + 1.2 * along + 0.25 * np.exp(-z)
jump = 2.6 * np.cos(0.7 * turn) * np.exp(-0.6 * along)
behind = 1 / (1 + np.exp((r - stand_off) / 0.06))
density = 1 + jump * behind * (0.55 + 0.45 * (r - 1) / (stand_off - 1)).clip(0, 1)
density += 0.7 * np.exp(-4 * z) / (1 + np.exp((r - stand_off - 0.8) / 0.08)) * (1 - behind)

points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
fin = ss.fit.delaunay(points, density.ravel(), shape=x.shape).field().with_quantity(name="density", unit="$ρ_∞$")
print(fin)
look = {
    "cmap": "turbo",
    "clim": (0.9, 3.6),
    "opacity": [(1.2, 0), (1.4, 0.15), (1.6, 0.02), (2.7, 0.02), (3.1, 0.4), (3.6, 0.7)],
}
views = [{"direction": "-z", "up": "y"}, {"direction": (1, 0.6, -0.6), "up": "z"}]
images = [ss.render(fin, background="black", size=SIZE, **look, **view).to_pil() for view in views]
Image.fromarray(np.hstack(images)).save("paper_2006_irregular.png")

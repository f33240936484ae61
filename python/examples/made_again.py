"""A picture that says how it was made.

A PNG holds the recipe of its picture: look, camera, size, renderer and version, but no data and no paths. The recipe
makes the same picture again, and the same view and look of other data.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (400, 300)


def waves(phase):
    """Return a ball of interfering waves."""
    z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 64)], indexing="ij")
    r = np.sqrt(x**2 + y**2 + z**2)
    return np.clip(1 - r, 0, None) * (1 + np.sin(14 * x + phase) * np.sin(14 * y) * np.sin(14 * z + phase))


first = ss.RegularField(waves(0.0))
ss.render(first, cmap="plasma", opacity=[(0.2, 0), (1.2, 0.5)], azimuth=20, elevation=30, size=SIZE).save("first.png")

recipe = ss.Recipe.read("first.png")
again = ss.Renderer().render(recipe.scene([first]), recipe.camera, size=recipe.size)
other = ss.Renderer().render(recipe.scene([ss.RegularField(waves(1.5))]), recipe.camera, size=recipe.size)
same = np.array_equal(np.asarray(again.to_pil()), np.asarray(Image.open("first.png").convert("RGBA")))
print(f"the same pixels again: {same}")
assert same
Image.fromarray(np.hstack([again.to_pil(), other.to_pil()])).save("made_again.png")

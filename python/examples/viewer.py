"""The viewer.

`ss.view` opens a page in the browser, or a widget in a notebook. What hands change there, Python sees: the scene, the
camera, the picture, a scene file, and the code that makes the picture. Here nobody turns it but the program.
"""

import numpy as np

import sheetsplat as ss

SIZE = (420, 340)

z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 48)], indexing="ij")
values = np.exp(-6 * ((np.hypot(x, y) - 0.6) ** 2 + z**2)) + 0.6 * np.exp(-20 * (x**2 + y**2 + z**2))

look = {"cmap": "magma", "clim": (0.1, 1.0), "opacity": [(0.1, 0.0), (0.4, 0.05), (1.0, 0.8)]}
with ss.view(values, browser=False, **look) as viewer:  # without browser=False the page opens
    viewer.camera = ss.Camera.fit(viewer.scene, direction=(-0.4, 1, -0.7), up="z")
    viewer.save("viewer.png", size=SIZE)
    viewer.save("viewer.toml")  # sheetsplat render viewer.toml, sheetsplat view viewer.toml
    film = ss.turntable(viewer.scene, camera=viewer.camera, frames=12, size=SIZE)
    print(viewer.code())
print(film)

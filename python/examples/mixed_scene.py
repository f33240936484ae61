"""Lattices and ellipsoids in one scene.

A Cartesian volume, a BCC volume and scattered ellipsoids lie in one picture. Each is normalised by its own rule; then
their scalars add up, which an x-ray of the whole and of the parts confirms.
"""

import numpy as np

import sheetsplat as ss

SIZE = (480, 360)


def ball(x, y, z, centre):
    """Return 1 in a ball of radius 0.5 around a centre, falling to 0 within 0.3."""
    distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2)
    return np.clip((0.65 - distance) / 0.3, 0.0, 1.0)


# A ball on a Cartesian lattice, samples 0.05 apart.
step = 0.05
k, j, i = np.mgrid[0:32, 0:32, 0:32]
left = ss.RegularField(
    ball(i * step - 0.775, j * step - 0.775, k * step - 0.775, (0, 0, 0)),
    spacing=(step, step, step),
    origin=(-1.575, -0.775, -0.775),
)

# The same ball 0.8 further to the right on a BCC lattice: odd layers are shifted by half the edge.
edge = 0.07
k, j, i = np.mgrid[0:44, 0:22, 0:22]
x, y, z = (i + 0.5 * (k % 2)) * edge - 0.77, (j + 0.5 * (k % 2)) * edge - 0.77, 0.5 * k * edge - 0.77
right = ss.RegularField(
    ball(x, y, z, (0, 0, 0)), lattice="bcc", spacing=(edge, edge, edge), origin=(0.03, -0.77, -0.77)
)

# A belt of flat ellipsoids around both, whose own values are averaged, where the lattices' are summed.
turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
places = np.stack([1.7 * np.cos(turn), 0.3 * np.sin(2.0 * turn), 1.0 * np.sin(turn)], axis=1)
half = 0.5 * turn
quaternions = np.stack([np.cos(half), np.zeros(400), -np.sin(half), np.zeros(400)], axis=1)
belt = ss.EllipsoidField(places, np.tile((0.1, 0.2, 0.1), (400, 1)), quaternions, values=np.full(400, 0.7), w0=0.5)

# One transfer function serves the sum of all three; each is normalised by its own rule before they are added.
transfer = ss.TransferFunction(
    [(0.0, 0.2, 0.3, 0.8, 0.0), (0.4, 0.3, 0.6, 0.9, 0.02), (0.7, 1.0, 0.7, 0.2, 0.3), (1.0, 0.9, 0.2, 0.2, 0.5)]
)
fields = [left, right, belt]
options = {"slice_spacing": 0.02, "reference_length": 0.035}
scene = ss.Scene(fields, transfer, lights=[ss.Light((-0.3, 0.5, 1.0))], **options)
camera = ss.Camera.fit(scene, direction=(0.2, -0.5, -1.0), margin=0.75)
renderer = ss.Renderer()
image = renderer.render(scene, camera, size=SIZE)
image.save("mixed_scene.png")
print(next(effect.reason for effect in image.plan.effects if effect.name == "separate_normalization"))


# X-rays add up: that of the scene is the sum of those of its fields, but for where slices lie.
def xray(shown):
    """Return the x-ray of some of the fields."""
    one = ss.Scene(shown, transfer, mode="xray", **options)
    return renderer.render(one, camera, size=(120, 90)).scalar


together, apart = xray(fields), sum(xray(one) for one in fields)
difference = np.abs(together - apart).max() / together.max()
print(f"x-ray of all against the sum of the three: {difference:.1e} of the largest")
assert difference < 1e-3

"""Two fields, each with colours of its own.

An array of anatomy and an array of a tracer, as of a CT and a PET, lie on different lattices. Each is classified by
its own transfer function, and the two mix where they overlap, as light does in a mixture of matter.
"""

import numpy as np

import sheetsplat as ss

SIZE = (480, 480)


def ball(lattice, centre, radii, softness):
    """Return 1 inside an ellipsoid, falling to 0 over a softness in mm."""
    distance = np.sqrt(sum(((c - o) / r) ** 2 for c, o, r in zip(lattice, centre, radii, strict=True)))
    return np.clip((1 - distance) * min(radii) / softness + 0.5, 0, 1)


def lattice(count, step):
    """Return x, y, z of the samples of a cube around the origin."""
    z, y, x = np.meshgrid(*3 * [(np.arange(count) - (count - 1) / 2) * step], indexing="ij")
    return x, y, z


# A head: skull and brain, samples 3 mm apart; Hounsfield units above those of air.
mm = lattice(72, 3.0)
skull = ball(mm, (0, 0, 0), (75, 95, 85), 4) - ball(mm, (0, 0, 0), (68, 88, 78), 4)
brain = ball(mm, (0, 0, 0), (64, 84, 74), 5)
anatomy = 1000 * np.clip(2.0 * skull + 1.04 * brain, 0, None)
# The tracer, 6 mm apart: two foci in the brain.
coarse = lattice(36, 6.0)
tracer = 8 * ball(coarse, (25, 40, 20), (16, 16, 16), 20) + 5 * ball(coarse, (-30, -20, 0), (14, 20, 14), 20)

ct = ss.RegularField(anatomy, spacing=(3, 3, 3), origin=(-106.5,) * 3)
pet = ss.RegularField(tracer, spacing=(6, 6, 6), origin=(-105,) * 3)
ct = ct.with_quantity(name="CT number + 1000", unit="HU", length_unit="mm")
pet = pet.with_quantity(name="uptake", unit="SUV")
bone = ss.TransferFunction(
    [(800, 0.8, 0.5, 0.5, 0), (1040, 0.8, 0.6, 0.55, 0.01), (1300, 1, 1, 0.9, 0.02), (2000, 1, 1, 0.9, 0.04)]
)
hot = ss.TransferFunction.from_colormap("hot", opacity=[(1, 0), (3, 0.3), (8, 0.8)], clim=(0, 8))
image = ss.render([ct, pet], transfer_function=[bone, hot], azimuth=60, elevation=15, up="z", size=SIZE)
image.save("own_transfer_functions.png")

"""A volume of labels, with colours, a light and a camera."""

from __future__ import annotations

import numpy as np

import sheetsplat as ss

LIGHT = ss.Light((0.3, 0.5, 1.0))
COLORS = ss.LabelColors({1: (1, 0.2, 0.2, 0.4), 2: (0.2, 1, 0.2, 0.4), 3: (0.3, 0.4, 1, 0.4)}, names={2: "box"})
OPAQUE = ss.LabelColors({one: rgba[:3] for one, rgba in COLORS.colors.items()})


def things():
    """Return a sphere of two halves, 1 and 3, and a box, 2, that reaches the end of the volume."""
    k, j, i = np.mgrid[0:13, 0:15, 0:17]
    ball = (k - 5.3) ** 2 + (j - 6.6) ** 2 + (i - 8.2) ** 2 < 23
    labels = np.zeros(k.shape, np.uint8)
    labels[ball] = np.where(i[ball] > 8, 3, 1)
    labels[(k > 8) & (j < 6) & (i < 7)] = 2
    return labels


def view(**options):
    lattice = ss.RegularField(things().astype(np.float32))
    return ss.Camera.fit(lattice, direction=(1, 0.6, 0.4), up=(0, 0, 1), **options)

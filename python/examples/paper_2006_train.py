"""2006, figure 4 h: the toy train.

The paper renders solids made of kernels, semi-transparent, among them a toy train of 199,000. This train is a mesh of
prisms, filled by `ss.fit.solid` with as many kernels as are asked for, and bent by control points.
"""

import numpy as np

import sheetsplat as ss

SIZE = (560, 420)

parts = []


def prism(start, step, width, height, corners=4, taper=1.0):
    """Add a prism or cone from `start` along `step`, with an elliptic outline; a box has four corners."""
    angle = 2 * np.pi * (np.arange(corners) + 0.5) / corners
    axis = int(np.argmax(np.abs(step)))
    outline = np.zeros((corners, 3))
    outline[:, (axis + 1) % 3] = width * np.cos(angle) / np.cos(np.pi / corners)
    outline[:, (axis + 2) % 3] = height * np.sin(angle) / np.cos(np.pi / corners)
    ends = np.add(start, outline), np.add(start, step) + taper * outline
    here, following = np.arange(corners), np.roll(np.arange(corners), -1)
    low, high = np.full(corners, 2 * corners), np.full(corners, 2 * corners + 1)
    faces = [(here, following, corners + following), (here, corners + following, corners + here)]
    faces += [(low, following, here), (high, corners + here, corners + following)]
    points = np.concatenate([*ends, [end.mean(axis=0) for end in ends]])
    parts.append((points, np.concatenate([np.stack(face, axis=1) for face in faces])))


def wagon(x, length, radius):
    """Add a floor on four wheels."""
    prism((x, 0.85, 0), (length, 0, 0), 0.1, 0.85)
    for along in (x + 0.7, x + length - 0.7):
        for side in (-0.8, 0.64):
            prism((along, radius, side), (0, 0, 0.16), radius, radius, 24)
        prism((along, radius, -0.8), (0, 0, 1.6), 0.1, 0.1, 24)


# x runs along the track, y up and z across: boiler, chimney, dome, cab; then coal, a coach's frame, and a tank.
wagon(0, 6.5, 0.6)
prism((0.3, 1.85, 0), (4.4, 0, 0), 0.78, 0.78, 24)
prism((0.9, 2.5, 0), (0, 1.3, 0), 0.24, 0.24, 24, 1.6)
prism((2.7, 2.4, 0), (0, 0.6, 0), 0.42, 0.42, 24, 0.75)
prism((4.6, 2.0, 0), (0.2, 0, 0), 1.1, 0.9)
prism((4.4, 3.2, 0), (2.3, 0, 0), 0.12, 1.05)
for side in (-0.8, 0.8):
    prism((4.6, 1.5, side), (1.8, 0, 0), 0.6, 0.1)
    prism((6.3, 2.0, side), (0.2, 0, 0), 1.2, 0.1)
wagon(7, 2.9, 0.45)
prism((8.4, 0.9, 0), (0, 1.4, 0), 0.75, 1.3, 24, 0.2)
wagon(10.4, 5.2, 0.45)
prism((10.3, 3.0, 0), (5.4, 0, 0), 0.15, 1.05)
for side in (-0.85, 0.85):
    prism((10.4, 1.4, side), (5.2, 0, 0), 0.5, 0.1)
    for post in np.linspace(10.4, 15.4, 6):
        prism((post, 2.2, side), (0.2, 0, 0), 0.8, 0.1)
wagon(16, 3.6, 0.45)
prism((16.1, 1.75, 0), (3.4, 0, 0), 0.85, 0.85, 24)
prism((6.3, 0.87, 0), (9.9, 0, 0), 0.07, 0.12)

starts = np.cumsum([0, *(len(points) for points, _ in parts)])
triangles = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)])
train = ss.fit.solid(np.concatenate([points for points, _ in parts]), triangles, kernels=20_000)
box = train.centers.min(axis=0), train.centers.max(axis=0)
lattice = ss.fit.control_lattice(box, (5, 3, 3))
lattice[..., 2] += 4 * np.linspace(-1, 1, 5)[:, None, None] ** 2  # the ends move to one side
bent = ss.fit.free_form_deformation(train, lattice, box=box)

image = ss.render(
    bent,
    size=SIZE,
    cmap="#6699e6",
    clim=(0, 1),
    opacity=[(0.25, 0), (0.6, 0.25), (1, 0.5)],
    direction=(-0.55, -0.45, -1),
)
print(f"{image.stats['kernels_drawn']:.0f} of {len(bent.centers)} kernels are drawn")
image.save("paper_2006_train.png")

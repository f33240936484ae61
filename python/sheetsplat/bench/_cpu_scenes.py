"""The six scenes in which the processor's backend is measured beside VTK; scattered kernels put on a grid for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from sheetsplat import datasets
from sheetsplat.bench._report import Options
from sheetsplat.bench._vtk import Volume
from sheetsplat.bench.ellipsoids import ellipsoids
from sheetsplat.datasets._random import Stream

Point = tuple[float, float, float, float, float]

#: One white head light far away, shining on both sides of what it meets.
MATERIAL = ss.Material(ambient=0.3, diffuse=0.7, specular=0.2, shininess=10.0, two_sided=True)
#: Edge of the grid that scattered kernels are put on for VTK.
GRID = 256
#: Views of the orbit.
VIEWS = 6

# What is seen of the cube, in its edges: 128 samples come to 3 pixels each at 400 pixels.
_SEEN = 400.0 / (3.0 * 128.0)
_SCATTERED_POINTS: tuple[Point, ...] = (
    (0.1, 0.1, 0.2, 0.9, 0.0),
    (0.5, 0.2, 0.9, 0.3, 0.02),
    (1.0, 1.0, 0.8, 0.2, 0.1),
)


@dataclass(frozen=True)
class Case:
    """A scene to be measured.

    Attributes
    ----------
    name, title
        Short and long name.
    field
        What is drawn.
    volume
        What VTK draws; None where the field has to be put on a grid first.
    points
        Of the transfer function.
    distance
        Of slices and of VTK's samples, world units.
    unit
        World units to which opacities refer.
    lower, edge
        Corner and edge of the cube that is looked at.
    opacity_stop
        As the scene has it.
    peer
        The caster of VTK whose time counts.
    share
        Of that time, how much ours may take.
    """

    name: str
    title: str
    field: ss.Field
    volume: Volume | None
    points: tuple[Point, ...]
    distance: float
    unit: float
    lower: tuple[float, float, float]
    edge: float
    opacity_stop: float
    peer: Any
    share: float

    def scene(self, *, shaded: bool = True, **others: Any) -> ss.Scene:
        """Return the scene; `others` are options of :class:`sheetsplat.Scene` and win."""
        settings: dict[str, Any] = {
            "slice_spacing": self.distance,
            "reference_length": self.unit,
            "opacity_stop": self.opacity_stop,
            "lights": [ss.Light((0.0, 0.0, 1.0))] if shaded else [],
            "material": MATERIAL,
        }
        return ss.Scene(self.field, self.points, **{**settings, **others})

    def cameras(self, views: int = VIEWS, elevation: float = 20.0) -> list[ss.Camera]:
        """Return views of an orbit, from 20 degrees above and none along an axis; all see the same number of units."""
        centre = tuple(low + 0.5 * self.edge for low in self.lower)
        rise, found = math.radians(elevation), []
        for view in range(views):
            turn = 2.0 * math.pi * (view + 0.1) / views
            away = (math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise))
            eye = tuple(c + 2.0 * self.edge * a for c, a in zip(centre, away, strict=True))
            found.append(ss.Camera.orthographic(eye, centre, height=_SEEN * self.edge))
        return found


def _of_dataset(name: str, title: str, made: datasets.Dataset, points: tuple[Point, ...], share: float) -> Case:
    step = made.spacing[0]
    return Case(
        name=name,
        title=title,
        field=made.field(),
        volume=Volume(made.values, made.spacing, made.origin),
        points=points,
        distance=step,
        unit=step,
        lower=made.origin,
        edge=step * (made.shape[2] - 1),
        opacity_stop=0.98,
        peer="cpu",
        share=share,
    )


def _points_of(made: datasets.Dataset) -> tuple[Point, ...]:
    return tuple(made.suggested["points"])


def _ball(options: Options) -> Case:
    made = datasets.noisy_ball(options.edge(128))
    return _of_dataset("ball", f"noisy ball, {made.shape[0]}^3", made, _points_of(made), 0.6)


def _signal(options: Options, name: str, edge: int, share: float) -> Case:
    made = datasets.marschner_lobb(options.edge(edge))
    # From this value on, half of the samples can be seen or touch what can: 1.08 million of 128^3.
    points = ((0.0, 0.9, 0.55, 0.2, 0.0), (0.6, 0.9, 0.55, 0.2, 0.0), (1.0, 0.95, 0.9, 0.8, 0.3))
    return _of_dataset(name, f"Marschner-Lobb, {made.shape[0]}^3", made, points, share)


def _tubes(options: Options) -> Case:
    made = datasets.tubes(options.edge(128))
    return _of_dataset("tubes", f"thin tubes, {made.shape[0]}^3", made, _points_of(made), 0.3)


def spheres(count: int, edge: float, seed: int = 2006) -> ss.EllipsoidField:
    """Return round Gaussians of radius 2 to 4 whose supports all lie in the cube from (0, 0, 0) on; they add up."""
    random = Stream(seed)
    drawn = random.uniform(count, 5)
    centers = 4.0 + (edge - 8.0) * drawn[:, :3]
    return ss.EllipsoidField(centers, 2.0 + 2.0 * drawn[:, 3], None, 0.5 + 0.5 * drawn[:, 4], normalization="none")


def _scattered(name: str, title: str, field: ss.EllipsoidField, edge: float, distance: float) -> Case:
    return Case(
        name=name,
        title=title,
        field=field,
        volume=None,
        points=_SCATTERED_POINTS,
        distance=distance,
        unit=1.0,
        lower=(0.0, 0.0, 0.0),
        edge=edge,
        opacity_stop=1.0,
        peer="gpu",
        share=0.5,
    )


def _spheres(options: Options) -> Case:
    edge = options.edge(128)
    count = max(64, round(100_000 * (edge / 128) ** 3))
    # At a distance of 1 a flat picture comes to 45 dB of the converged one only.
    return _scattered("spheres", f"{count:,} Gaussians of radius 2-4 in {edge}", spheres(count, edge), edge, 0.75)


def _ellipsoids(options: Options) -> Case:
    edge = options.edge(128)
    count = max(64, round(35_000 * (edge / 128) ** 3))
    return _scattered("ellipsoids", f"{count:,} ellipsoids to 1:20 in {edge}", ellipsoids(count, edge), edge, 1.0)


#: How each scene is made, by its name.
CASES: dict[str, Callable[[Options], Case]] = {
    "ball": _ball,
    "ml128": lambda options: _signal(options, "ml128", 128, 0.8),
    "ml256": lambda options: _signal(options, "ml256", 256, 1.0),
    "tubes": _tubes,
    "spheres": _spheres,
    "ellipsoids": _ellipsoids,
}
SCATTERED = ("spheres", "ellipsoids")


def axes_of(field: ss.EllipsoidField) -> NDArray[np.float64]:
    """Return the matrices M = R S of a field's kernels, (N, 3, 3); their columns are the semi-axes."""
    scales = np.asarray(field.scales, dtype=np.float64)
    if scales.ndim == 1:
        scales = np.repeat(scales[:, None], 3, axis=1)
    if field.rotations is None:
        return np.eye(3) * scales[:, None, :]
    w, x, y, z = np.asarray(field.rotations, dtype=np.float64).T
    turned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.ascontiguousarray(np.moveaxis(turned, -1, 0)) * scales[:, None, :]


def sections(field: ss.EllipsoidField, camera: ss.Camera, distance: float) -> int:
    """Return how many pairs of a kernel and a slice meet in an orthographic view."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    lower, upper = (np.array(corner) for corner in field.centre_bounds)
    anchor = 0.5 * (lower + upper) @ ahead
    depth = (field.centers @ ahead - anchor) / distance
    reach = np.linalg.norm(np.einsum("nij,i->nj", axes_of(field), ahead), axis=1) / distance
    # Slices lie at n + 1/2.
    return int((np.floor(depth + reach - 0.5) - np.ceil(depth - reach - 0.5) + 1.0).sum())


def gridded(field: ss.EllipsoidField, edge: float, samples: int = GRID) -> Volume:
    """Return the field's scalar at the points of a grid over the cube from (0, 0, 0) on: every kernel adds itself.

    Parameters
    ----------
    field
        Normalised by "none" or "threshold".
    edge
        Of the cube; the grid's outermost points lie on its faces.
    samples
        Of the grid along each axis.

    Returns
    -------
    Volume
        float32, as exact as its sums.
    """
    step = edge / (samples - 1)
    axes = axes_of(field) / step
    centers = field.centers / step
    inverse = np.linalg.inv(axes)
    # |M^-1 (x - c)|^2 = (x - c)^T Q (x - c), times -k.
    forms = -field.falloff * np.einsum("nij,nik->njk", inverse, inverse)
    reach = np.linalg.norm(axes, axis=2)
    first = np.maximum(np.ceil(centers - reach), 0).astype(np.int64)
    last = np.minimum(np.floor(centers + reach), samples - 1).astype(np.int64) + 1
    weights = np.ones(field.size) if field.weights is None else field.weights
    floor = math.exp(-field.falloff)
    raised = 1.0 / (1.0 - floor)
    divides = field.normalization == "threshold"
    total = np.zeros((samples, samples, samples), np.float32)
    weight = np.zeros_like(total) if divides else total
    grid = np.arange(samples, dtype=np.float64)
    for c, q, (x0, y0, z0), (x1, y1, z1), amount, m in zip(
        centers, forms, first.tolist(), last.tolist(), (weights * field.values).tolist(), weights.tolist(), strict=True
    ):
        if x0 >= x1 or y0 >= y1 or z0 >= z1:
            continue
        x = (grid[x0:x1] - c[0]).astype(np.float32)
        y, z = grid[y0:y1, None] - c[1], grid[z0:z1, None, None] - c[2]
        slope = (2.0 * (q[0, 1] * y + q[0, 2] * z)).astype(np.float32)
        rest = (q[1, 1] * y * y + 2.0 * q[1, 2] * y * z + q[2, 2] * z * z).astype(np.float32)
        part = np.float32(q[0, 0]) * x + slope
        part *= x
        part += rest
        np.exp(part, out=part)
        part -= np.float32(floor)
        np.maximum(part, np.float32(0.0), out=part)
        if divides:
            weight[z0:z1, y0:y1, x0:x1] += np.float32(m * raised) * part
        part *= np.float32(amount * raised)
        total[z0:z1, y0:y1, x0:x1] += part
    if divides:
        total /= np.maximum(np.float32(field.w0), weight)
    return Volume(total, (step, step, step), (0.0, 0.0, 0.0))

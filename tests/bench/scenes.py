"""Scattered kernels, and the scenes that backend cpu and VTK both draw; scattered kernels on a grid for VTK."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

import sheetsplat as ss
from bench.measure import away, orbit_angles, orthographic
from bench.report import Options
from bench.vtk_casters import CASTERS, Caster, Volume
from sheetsplat import datasets
from sheetsplat.datasets.random_stream import Stream
from sheetsplat.fields import Field

Point = tuple[float, float, float, float, float]

#: One distant white head light, which shines on both sides.
MATERIAL = ss.Material(ambient=0.3, diffuse=0.7, specular=0.2, shininess=10.0, two_sided=True)
#: Edge of the grid that scattered kernels are put on for VTK.
GRID = 256
#: Views of the orbit.
VIEWS = 6
#: Semi-transparent transfer function of scattered kernels with values in [0, 1].
SCATTERED_POINTS: tuple[Point, ...] = (
    (0.1, 0.1, 0.2, 0.9, 0.0),
    (0.5, 0.2, 0.9, 0.3, 0.02),
    (1.0, 1.0, 0.8, 0.2, 0.1),
)
#: The ellipsoids: how many in a cube of which edge, supports over every point, and largest aspect.
COUNT, EDGE, OVERLAP, ASPECT = 35_000, 128, 23.0, 20.0

# Longest semi-axis of the ellipsoids, in slice distances.
_LONGEST = 24.0
# Height of the picture in edges of the cube: 128 samples are 3 pixels each at 400 pixels.
_SEEN = 400.0 / (3.0 * 128.0)


def spheres(count: int, edge: float, seed: int = 2006) -> ss.EllipsoidField:
    """Return round Gaussians of radius 2 to 4 whose supports lie in the cube from (0, 0, 0) on; they add up."""
    random = Stream(seed)
    drawn = random.uniform(count, 5)
    centers = 4.0 + (edge - 8.0) * drawn[:, :3]
    return ss.EllipsoidField(centers, 2.0 + 2.0 * drawn[:, 3], None, 0.5 + 0.5 * drawn[:, 4], normalization="none")


def ellipsoids(
    count: int = COUNT, edge: float = EDGE, *, seed: int = 2006, normalization: Any = "threshold", shrunk: float = 1.0
) -> ss.EllipsoidField:
    """Return rotated ellipsoids in a cube, whose supports together fill it 23 times.

    Parameters
    ----------
    count
        Number of ellipsoids.
    edge
        Edge of the cube from (0, 0, 0) on, world units; a slice distance is 1.
    seed
        Seed of the random numbers, which are the same on every machine.
    normalization
        Normalisation of the field.
    shrunk
        Factor of all semi-axes; the centres stay.

    Returns
    -------
    EllipsoidField
        Half of the ellipsoids are prolate, half oblate, with aspects from 1 to 20, uniform in their logarithm; volumes
        differ by a factor of about 30. No semi-axis is much longer than 24. Values fall from the cube's middle out.
    """
    random = Stream(seed)
    aspect = ASPECT ** random.uniform(count)
    axes = np.ones((count, 3))
    axes[:, 0] = aspect
    flat = random.uniform(count) < 0.5
    axes[flat, 1] = aspect[flat]
    axes *= np.exp(np.clip(0.3 * random.normal(count), -0.9, 0.45))[:, None]
    axes /= np.cbrt(np.where(flat, aspect**2, aspect))[:, None]
    ball = 4.0 / 3.0 * math.pi
    for longest in (_LONGEST, math.inf):
        axes *= np.cbrt(OVERLAP * edge**3 / (ball * axes.prod(axis=1).sum()))
        axes = np.minimum(axes, longest)
    turns = random.normal(count, 4)
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    centers = edge * random.uniform(count, 3)
    middle = 0.5 * edge
    outwards = np.linalg.norm(centers - middle, axis=1) / middle
    values = np.clip(1.0 - outwards, 0.0, 1.0) + 0.05 * random.uniform(count)
    return ss.EllipsoidField(centers, shrunk * axes, turns, values, normalization=normalization)


@dataclass(frozen=True)
class Case:
    """A scene to be measured.

    Attributes
    ----------
    name, title
        Short and long name.
    field
        Field that is drawn.
    volume
        Volume that VTK draws; None where the field has to be put on a grid first.
    points
        Points of the transfer function.
    distance
        Distance of slices and of VTK's samples, world units.
    edge
        Edge of the cube that is looked at, world units.
    share
        Goal: largest share of the time of VTK's caster.
    unit
        Reference length of opacities, world units.
    lower
        Corner of the cube.
    opacity_stop
        Accumulated opacity at which a pixel ends.
    peer
        VTK's caster whose time is compared.
    alone
        Whether VTK's other caster is left out.
    zoom
        Edge of the picture over that of the other scenes.
    """

    name: str
    title: str
    field: Field
    volume: Volume | None
    points: tuple[Point, ...]
    distance: float
    edge: float
    share: float
    unit: float = 1.0
    lower: tuple[float, float, float] = (0.0, 0.0, 0.0)
    opacity_stop: float = 1.0
    peer: Caster = "gpu"
    alone: bool = False
    zoom: float = 1.0

    @property
    def casters(self) -> tuple[Caster, ...]:
        """Casters of VTK that draw it."""
        return (self.peer,) if self.alone else tuple(CASTERS)

    def picture(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the size of its pictures where others have `size`."""
        return round(self.zoom * size[0]), round(self.zoom * size[1])

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
        """Return views of an orbit, 20 degrees above the equator; all see the same number of world units."""
        centre = [low + 0.5 * self.edge for low in self.lower]
        rise = math.radians(elevation)
        return [
            orthographic(centre, away(turn, rise), 2.0 * self.edge, _SEEN * self.edge) for turn in orbit_angles(views)
        ]


def _of_dataset(name: str, title: str, made: datasets.Dataset, points: tuple[Point, ...], share: float) -> Case:
    step, count = made.spacing[0], made.shape[2]
    volume = Volume(made.values, made.spacing, made.origin)
    edge = step * (count - 1)
    case = Case(name, f"{title}, {count}^3", made.field(), volume, points, step, edge, share, unit=step)
    return replace(case, lower=made.origin, opacity_stop=0.98, peer="cpu")


def _ball(options: Options) -> Case:
    made = datasets.noisy_ball(options.edge(128))
    return _of_dataset("ball", "noisy ball", made, tuple(made.suggested["points"]), 0.6)


def _large(options: Options, name: str, points: tuple[Point, ...]) -> Case:
    made = datasets.noisy_ball(options.edge(512))
    case = _of_dataset(name, f"noisy ball of bytes, {name}", made, points, 0.7)
    return replace(case, alone=True, zoom=2.0)


def _signal(options: Options, name: str, edge: int, share: float) -> Case:
    # From 0.6 on, half of the samples are visible or next to visible ones: 1.08 million of 128^3.
    points = ((0.0, 0.9, 0.55, 0.2, 0.0), (0.6, 0.9, 0.55, 0.2, 0.0), (1.0, 0.95, 0.9, 0.8, 0.3))
    return _of_dataset(name, "Marschner-Lobb", datasets.marschner_lobb(options.edge(edge)), points, share)


def _tubes(options: Options) -> Case:
    made = datasets.tubes(options.edge(128))
    return _of_dataset("tubes", "thin tubes", made, tuple(made.suggested["points"]), 0.3)


def _spheres(options: Options) -> Case:
    edge, count = options.edge(128), options.count(100_000)
    title = f"{count:,} Gaussians of radius 2-4 in {edge}"
    # At a distance of 1 a flat picture reaches only 45 dB of the converged one.
    return Case("spheres", title, spheres(count, edge), None, SCATTERED_POINTS, 0.75, edge, 0.5)


def _ellipsoids(options: Options) -> Case:
    edge, count = options.edge(EDGE), options.count(COUNT)
    title = f"{count:,} ellipsoids to 1:20 in {edge}"
    return Case("ellipsoids", title, ellipsoids(count, edge), None, SCATTERED_POINTS, 1.0, edge, 0.5)


#: How each scene is made, by its name.
CASES: dict[str, Callable[[Options], Case]] = {
    "ball": _ball,
    "ml128": lambda options: _signal(options, "ml128", 128, 0.8),
    "ml256": lambda options: _signal(options, "ml256", 256, 1.0),
    "tubes": _tubes,
    # The middle of the ball's range becomes opaque within about ten samples, and within one.
    "large": lambda options: _large(options, "large", ((40.0, 0.2, 0.3, 0.6, 0.0), (220.0, 1.0, 0.85, 0.6, 0.5))),
    "opaque": lambda options: _large(options, "opaque", ((90.0, 0.2, 0.3, 0.6, 0.0), (110.0, 1.0, 0.85, 0.6, 1.0))),
    "spheres": _spheres,
    "ellipsoids": _ellipsoids,
}
SCATTERED = ("spheres", "ellipsoids")
#: Those whose reference would take minutes.
LARGE = ("large", "opaque")


def axes_of(field: ss.EllipsoidField) -> NDArray[np.float64]:
    """Return the matrices M = R S of a field's kernels, (N, 3, 3); their columns are the semi-axes."""
    scales = np.asarray(field.scales, dtype=np.float64)
    if scales.ndim == 1:
        scales = np.repeat(scales[:, None], 3, axis=1)
    if field.rotations is None:
        return np.eye(3) * scales[:, None, :]
    turned = Rotation.from_quat(np.asarray(field.rotations)[:, [1, 2, 3, 0]]).as_matrix()
    return np.asarray(turned * scales[:, None, :])


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

"""An independent float64 renderer in NumPy: the image-formation page once more, for judging every backend.

The names and arguments are those of the package (RegularField, EllipsoidField, TransferFunction, Light, Material,
Scene, Camera), so that one function that takes a module builds the same scene for both. Nothing of the package is
imported. Section numbers are the page's. Vectorised over pixels and kernels; loops over slices and fields.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
# Of the numbers held at once for one slice, pixels times kernels.
CHUNK = 2_000_000

_erf = np.vectorize(math.erf, otypes=[float])


def erf(x: Array) -> Array:
    """Return the error function; SciPy's where it is there, since it is quicker."""
    try:
        from scipy.special import erf as quick
    except ImportError:
        return _erf(x)
    return np.asarray(quick(x))


# Section 2: fields


@dataclass
class RegularField:
    """Samples values[k, j, i] of a Cartesian or BCC lattice."""

    values: ArrayLike
    spacing: Sequence[float] = (1, 1, 1)
    origin: Sequence[float] = (0, 0, 0)
    lattice: str = "cartesian"
    radius: float = 2.0
    falloff: float = 5.0
    normalization: str = "lattice"
    w0: float = 1.0
    nan: str = "error"

    def kernels(self) -> tuple[Array, Array]:
        """Return the centres (N, 3) in world units without the origin, and the values (N,)."""
        values = np.asarray(self.values, float)
        k, j, i = np.meshgrid(*(np.arange(n, dtype=float) for n in values.shape), indexing="ij")
        if self.lattice == "bcc":
            half = (k % 2) / 2
            a = float(self.spacing[0])
            centres = np.stack([(i + half) * a, (j + half) * a, k * a / 2], -1)
        else:
            centres = np.stack([i, j, k], -1) * np.asarray(self.spacing, float)
        kept = ~np.isnan(values)
        return centres[kept], values[kept]

    def semi_axes(self) -> Array:
        """Return the semi-axes of the support, world units."""
        if self.lattice == "bcc":
            return np.full(3, self.radius * float(self.spacing[0]) / math.sqrt(2))
        return self.radius * np.asarray(self.spacing, float)

    def sample_volume(self) -> float:
        """Return the volume per sample."""
        if self.lattice == "bcc":
            return float(self.spacing[0]) ** 3 / 2
        return float(np.prod(np.asarray(self.spacing, float)))

    def default_slice_spacing(self) -> float:
        """Return the default distance of slices (section 3)."""
        return float(self.spacing[0]) / 2 if self.lattice == "bcc" else float(min(self.spacing))

    def mass(self) -> float:
        """Return C of normalisation lattice: a kernel's integral over the volume per sample."""
        return ball_integral(self.falloff) * float(np.prod(self.semi_axes())) / self.sample_volume()

    def placed(self, eye: Array, turn: Array) -> Kernels:
        """Return the kernels in eye space."""
        centres, values = self.kernels()
        # Relative to the eye from the start, so that far origins cost no digits.
        offset = centres + (np.asarray(self.origin, float) - eye)
        semi = self.semi_axes()
        return Kernels(offset, offset @ turn.T, (turn * semi)[None], turn.T[None] / semi[:, None], values, None)


@dataclass
class EllipsoidField:
    """Scattered kernels: centers (N, 3), semi-axes (N, 3) or (N,), rotations (N, 4) w, x, y, z or (N, 3, 3)."""

    centers: ArrayLike
    scales: ArrayLike
    rotations: ArrayLike | None = None
    values: ArrayLike = ()
    weights: ArrayLike | None = None
    normalization: str = "threshold"
    w0: float = 1.0
    falloff: float = 8.0
    min_scale: float | None = None
    cell_volume: float | None = None

    def semi_axes(self) -> Array:
        """Return the semi-axes of every kernel, (N, 3)."""
        scales = np.asarray(self.scales, float)
        if scales.ndim == 1:
            scales = np.repeat(scales[:, None], 3, 1)
        return scales if self.min_scale is None else np.maximum(scales, self.min_scale)

    def frames(self) -> Array:
        """Return the rotations from the kernels' own axes to the world's, (N, 3, 3)."""
        count = len(np.asarray(self.centers, float))
        if self.rotations is None:
            return np.tile(np.eye(3), (count, 1, 1))
        rotations = np.asarray(self.rotations, float)
        return rotations if rotations.ndim == 3 else turned(rotations)

    def default_slice_spacing(self) -> float:
        """Return the default distance of slices (section 3); without kernels there is none."""
        centres = np.asarray(self.centers, float).reshape(-1, 3)
        if len(centres) == 0:
            return math.inf
        diagonal = float(np.linalg.norm(centres.max(0) - centres.min(0)))
        return max(float(np.median(self.semi_axes().min(1))) / 2, diagonal / 2048)

    def mass(self) -> float:
        """Return C of normalisation lattice: a kernel's integral over the volume that it stands for."""
        volume = float(np.prod(self.semi_axes(), axis=1).max())
        return ball_integral(self.falloff) * volume / float(self.cell_volume or math.nan)

    def placed(self, eye: Array, turn: Array) -> Kernels:
        """Return the kernels in eye space."""
        world = np.asarray(self.centers, float).reshape(-1, 3) - eye
        semi, frames = self.semi_axes(), self.frames()
        weights = None if self.weights is None else np.asarray(self.weights, float)
        return Kernels(
            world,
            world @ turn.T,
            turn @ frames * semi[:, None, :],
            np.swapaxes(frames, 1, 2) @ turn.T / semi[:, :, None],
            np.asarray(self.values, float),
            weights,
        )


def turned(quaternions: Array) -> Array:
    """Return the rotation matrices of quaternions w, x, y, z, (N, 3, 3): the columns are the turned axes."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.stack([w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], -1),
        ],
        -2,
    )


@dataclass
class Kernels:
    """Kernels of one field relative to the eye. Shapes have a first axis of length N, or 1 where all are alike."""

    world: Array  # (N, 3) centres, world axes
    centres: Array  # (N, 3) eye axes
    factor: Array  # (N | 1, 3, 3) B: unit sphere to eye axes
    to_sphere: Array  # (N | 1, 3, 3) its inverse
    values: Array  # (N,)
    weights: Array | None  # (N,), 1 unless given

    def reach(self) -> Array:
        """Return how far the supports extend in depth, (N,)."""
        return np.broadcast_to(np.linalg.norm(self.factor[:, 2], axis=1), (len(self.centres),))

    def scaled(self, by: float) -> Kernels:
        """Return the kernels with supports larger by that factor."""
        return replace(self, factor=self.factor * by, to_sphere=self.to_sphere / by)

    def filtered(self, pixel: Array, spacing: float) -> Kernels:
        """Return the kernels after the EWA filter (section 10); pixel (N,) is its width at the centres' depths."""
        count = len(self.centres)
        factor = np.broadcast_to(self.factor, (count, 3, 3))
        widening = np.zeros((count, 3, 3))
        widening[:, 0, 0] = widening[:, 1, 1] = pixel
        widening[:, 2, 2] = spacing
        upper = np.linalg.qr(np.concatenate([np.swapaxes(factor, 1, 2), widening], 1), mode="r")
        share = np.abs(np.linalg.det(factor) / np.prod(np.diagonal(upper, axis1=1, axis2=2), axis=1))
        weights = share if self.weights is None else self.weights * share
        wider = np.swapaxes(upper, 1, 2)
        return replace(self, factor=wider, to_sphere=np.linalg.inv(wider), weights=weights)

    def picked(self, which: NDArray[np.bool_]) -> Kernels:
        """Return some of the kernels."""
        alike = len(self.factor) == 1
        return Kernels(
            self.world[which],
            self.centres[which],
            self.factor if alike else self.factor[which],
            self.to_sphere if alike else self.to_sphere[which],
            self.values[which],
            None if self.weights is None else self.weights[which],
        )

    def turned(self, vectors: Array) -> Array:
        """Return vectors (P, 3) or (P, N, 3) of eye space in the unit-sphere spaces, (P, N | 1, 3)."""
        m = self.to_sphere
        v = vectors[:, None, :] if vectors.ndim == 2 else vectors
        return np.stack([sum(m[:, a, b] * v[..., b] for b in range(3)) for a in range(3)], -1)


def ball_integral(k: float) -> float:
    """Return the integral of g over the unit ball."""
    edge = math.exp(-k)
    radial = math.sqrt(math.pi) * math.erf(math.sqrt(k)) / (4 * k**1.5) - edge / (2 * k)
    return (4 * math.pi * radial - 4 * math.pi / 3 * edge) / (1 - edge)


def kernel(r2: Array, k: float) -> Array:
    """Return g of squared radii."""
    return np.maximum(0.0, (np.exp(-k * r2) - math.exp(-k)) / (1 - math.exp(-k)))


def kernel_mean(r2: Array, speed: float, t0: Array, t1: Array, k: float, length: float) -> Array:
    """Return the mean of g over a slab of the given length, of which the chord [t0, t1] is inside the support.

    The square of the radius is r2 + speed² t² along the ray, t from the nearest point.
    """
    root = math.sqrt(k)
    gauss = np.exp(-k * r2) * math.sqrt(math.pi) / (2 * root * speed)
    whole = gauss * (erf(root * speed * t1) - erf(root * speed * t0)) - (t1 - t0) * math.exp(-k)
    return np.maximum(0.0, whole) / (1 - math.exp(-k)) / length


# Section 4: classification


@dataclass
class TransferFunction:
    """Points (value, r, g, b, opacity per reference length)."""

    points: Sequence[Sequence[float]]

    def table(self) -> Array:
        """Return the points as (n, 5)."""
        return np.asarray(self.points, float).reshape(-1, 5)

    def span(self) -> float:
        """Return v_max - v_min."""
        table = self.table()
        return float(table[-1, 0] - table[0, 0])

    def __call__(self, rho: Array) -> Array:
        """Return r, g, b, opacity, shape (..., 4)."""
        table = self.table()
        after = np.searchsorted(table[:, 0], rho, side="right")
        low = np.clip(after - 1, 0, len(table) - 1)
        high = np.clip(after, 0, len(table) - 1)
        width = table[high, 0] - table[low, 0]
        share = np.where(width > 0, (rho - table[low, 0]) / np.where(width > 0, width, 1), 0.0)[..., None]
        return np.asarray(table[low, 1:] * (1 - share) + table[high, 1:] * share)


def slice_opacity(a: Array, exponent: Array) -> Array:
    """Return 1 - (1 - a)^exponent."""
    with np.errstate(divide="ignore"):
        return -np.expm1(np.log1p(-a) * exponent)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(14)
MOST_OPACITY = 1 - 2.0**-24


def _segment(a0: Array, a1: Array, c0: Array, c1: Array) -> tuple[Array, Array]:
    """Return the means over a unit ramp of -ln(1 - a) and of it times c, a and c linear; a at most MOST_OPACITY."""
    u0, u1 = 1 - a0, 1 - a1
    tau = np.zeros(a0.shape)
    tau_c = np.zeros(c0.shape)
    for node, weight in zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True):
        value = -np.log1p(-(a0 + node * (a1 - a0)))
        tau += weight * value
        tau_c += weight * value[..., None] * (c0 + node * (c1 - c0))
    # Steep: the closed forms, with no more than a bit of cancellation there.
    steep = np.minimum(u0, u1) < 0.5 * np.maximum(u0, u1)
    if steep.any():
        x, y = u0[steep], u1[steep]
        d = y - x
        zero = (y - x - (y * np.log(y) - x * np.log(x))) / d
        # The integral of -u ln u is u²/4 - u² ln(u)/2.
        one = ((y**2 / 4 - y**2 * np.log(y) / 2) - (x**2 / 4 - x**2 * np.log(x) / 2)) / d
        share = (one - x * zero) / d
        tau[steep] = zero
        tau_c[steep] = zero[:, None] * c0[steep] + share[:, None] * (c1 - c0)[steep]
    return tau, tau_c


def ramp_means(tf: TransferFunction, first: Array, last: Array) -> tuple[Array, Array]:
    """Return the means of -ln(1 - min(a, 1 - 2^-24)) and of it times the colour, ρ from first to last, both (P,)."""
    table = tf.table()
    # A piece of the transfer function runs between two neighbours; the ends go on for ever.
    ends = np.concatenate([[-np.inf], table[:, 0], [np.inf]])
    low, high = np.minimum(first, last), np.maximum(first, last)
    tau, tau_c = np.zeros(first.shape), np.zeros((*first.shape, 3))
    width = high - low
    moving = width > 0
    for piece in range(len(table) + 1):
        left, right = table[max(piece - 1, 0)], table[min(piece, len(table) - 1)]
        if ends[piece] == ends[piece + 1]:
            continue
        cuts = [ends[piece], ends[piece + 1]]
        inner = 0 < piece < len(table)
        if inner and (left[4] > MOST_OPACITY) != (right[4] > MOST_OPACITY):
            cut = left[0] + (right[0] - left[0]) * (MOST_OPACITY - left[4]) / (right[4] - left[4])
            cuts.insert(1, min(max(cut, ends[piece]), ends[piece + 1]))
        for begin, end in zip(cuts, cuts[1:], strict=False):
            x, y = np.maximum(low, begin), np.minimum(high, end)
            at = moving & (y > x)
            if not at.any():
                continue
            x, y = x[at], y[at]

            def value(v: Array, inner: bool = inner, left: Array = left, right: Array = right) -> Array:
                s = (v - left[0]) / (right[0] - left[0]) if inner else np.zeros(v.shape)
                return np.asarray(left[1:] * (1 - s[:, None]) + right[1:] * s[:, None])

            p, q = value(x), value(y)
            t, tc = _segment(np.minimum(p[:, 3], MOST_OPACITY), np.minimum(q[:, 3], MOST_OPACITY), p[:, :3], q[:, :3])
            share = (y - x) / width[at]
            tau[at] += t * share
            tau_c[at] += tc * share[:, None]
    still = ~moving
    at_value = tf(first[still])
    tau[still] = -np.log1p(-np.minimum(at_value[:, 3], MOST_OPACITY))
    tau_c[still] = tau[still][:, None] * at_value[:, :3]
    return tau, tau_c


# Section 5: lights


@dataclass
class Light:
    """A directional light."""

    direction: Sequence[float]
    color: Sequence[float] = (1, 1, 1)
    space: str = "eye"


@dataclass
class Material:
    """Phong's numbers."""

    ambient: float = 0.1
    diffuse: float = 0.9
    specular: float = 0.0
    shininess: float = 32
    two_sided: bool = False


def unit(vector: ArrayLike) -> Array:
    """Return the vector divided by its length."""
    v = np.asarray(vector, float)
    return np.asarray(v / np.linalg.norm(v))


def shade(
    colour: Array,
    gradient: Array,
    to_camera: Array,
    weak: float,
    scene: Scene,
    turn: Array,
    points: Array,
    around: Around | None,
) -> Array:
    """Return the shaded colour of points; these, gradient and to_camera in eye space, turn from world to eye."""
    ambient = 1.0
    if around is not None and scene.ambient_occlusion is not None:
        ambient = around.ambient(points)[:, None]
    if not scene.lights:
        return colour * ambient
    length = np.linalg.norm(gradient, axis=-1)
    bound = np.maximum(length, weak)
    normal = -gradient / np.where(bound > 0, bound, 1)[..., None]
    material = scene.material
    shaded = colour * material.ambient * ambient
    for light in scene.lights:
        towards = unit(light.direction)
        if light.space == "world":
            towards = turn @ towards
        cosine = normal @ towards
        n = normal
        if material.two_sided:
            n = np.where(cosine[..., None] < 0, -normal, normal)
            cosine = np.abs(cosine)
        reflected = 2 * cosine[..., None] * n - towards
        highlight = np.maximum(0.0, (reflected * to_camera).sum(-1)) ** material.shininess
        amount = colour * material.diffuse + material.specular * highlight[..., None]
        reaches = around.light(points, towards)[:, None] if around is not None and scene.shadows else 1.0
        shaded = shaded + reaches * np.asarray(light.color, float) * np.maximum(0.0, cosine)[..., None] * amount
    return shaded


# Section 1: camera


@dataclass
class Camera:
    """A camera; height for orthographic, fov_y for perspective."""

    eye: Array
    target: Array
    up: Array
    height: float = 0.0
    fov_y: float = 0.0
    near: float = 0.0

    @classmethod
    def orthographic(cls, eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0, 1, 0), *, height: float) -> Camera:
        """Return a camera with parallel rays."""
        return cls(np.asarray(eye, float), np.asarray(target, float), np.asarray(up, float), height=height)

    @classmethod
    def perspective(
        cls, eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0, 1, 0), *, fov_y: float, near: float | None = None
    ) -> Camera:
        """Return a camera with rays through the eye."""
        e, t = np.asarray(eye, float), np.asarray(target, float)
        first = 1e-3 * float(np.linalg.norm(e - t)) if near is None else near
        return cls(e, t, np.asarray(up, float), fov_y=fov_y, near=first)

    @property
    def is_perspective(self) -> bool:
        """Whether rays meet in the eye."""
        return self.fov_y > 0

    def turn(self) -> Array:
        """Return the rotation from world to eye axes."""
        z = unit(self.eye - self.target)
        x = unit(np.cross(self.up, z))
        return np.stack([x, np.cross(z, x), z])

    def height_at_one(self) -> float:
        """Return the picture's height: in world units, or per unit of depth."""
        return 2 * math.tan(math.radians(self.fov_y) / 2) if self.is_perspective else self.height


# Section 10: effects


@dataclass
class Clip:
    """Half spaces (normal, offset) and a box; what is in all of them is kept."""

    planes: Sequence[tuple[Sequence[float], float]] = ()
    box: tuple[Sequence[float], Sequence[float]] | None = None

    def keeps(self, points: Array, camera: Camera, spacing: float) -> NDArray[np.bool_]:
        """Return which of the points (..., 3) of eye space are kept."""
        slack = 1e-6 * spacing
        # World axes, relative to the eye: what is far away keeps its digits.
        offset = points @ camera.turn()
        kept = np.ones(points.shape[:-1], bool)
        for normal, least in self.planes:
            length = float(np.linalg.norm(normal))
            n = np.asarray(normal, float) / length
            kept &= offset @ n >= least / length - n @ camera.eye - slack
        if self.box is not None:
            low, high = np.asarray(self.box, float) - camera.eye
            kept &= ((offset >= low - slack) & (offset <= high + slack)).all(-1)
        return kept


@dataclass
class DepthCue:
    """Colours fade from one depth to another."""

    start: float
    end: float
    color: Sequence[float] = (0, 0, 0)
    strength: float = 1.0


@dataclass
class AmbientOcclusion:
    """Ambient light fades where the surroundings are dense."""

    radius: float
    strength: float = 1.0


# Section 3, 6, 7: scene and picture


@dataclass
class Scene:
    """What is shown and how."""

    field: Any
    transfer_function: TransferFunction
    slice_spacing: float | None = None
    sampling: str = "point"
    reference_length: float | None = None
    mode: str = "composite"
    iso_value: float | None = None
    lights: Sequence[Light] = ()
    material: Material = field(default_factory=Material)
    opacity_stop: float = 0.98
    preintegration: bool | str = False
    filter: str | None = None
    gradient: str = "sheets"
    clip: Clip | None = None
    gradient_opacity: float | None = None
    depth_cue: DepthCue | None = None
    shadows: bool = False
    ambient_occlusion: AmbientOcclusion | None = None
    background: Sequence[float] | None = None

    def fields(self) -> list[RegularField | EllipsoidField]:
        """Return the fields."""
        return list(self.field) if isinstance(self.field, (list, tuple)) else [self.field]

    def default_spacing(self) -> float:
        """Return the slice spacing that holds unless given."""
        least = min(f.default_slice_spacing() for f in self.fields())
        return least if least < math.inf else 1.0

    def spacing(self) -> float:
        """Return the slice spacing."""
        return self.default_spacing() if self.slice_spacing is None else self.slice_spacing

    def length(self) -> float:
        """Return the reference length."""
        return self.default_spacing() if self.reference_length is None else self.reference_length


@dataclass
class Nudge:
    """What section 9 moves to find ambiguous pixels: ρ of points that are not empty, supports, A_stop."""

    rho: float = 0.0
    support: float = 1.0
    stop: float = 0.0


@dataclass
class Picture:
    """The result, float64."""

    rgba: Array | None
    scalar: Array | None
    coverage: Array
    depth: Array
    slices: int


@dataclass
class Samples:
    """ρ and what is empty on slices first - 2 ... last + 2, at the pixels and one more on every side."""

    depth: Array  # (S,)
    rho: Array  # (S, h + 2, w + 2)
    empty: Array  # (S, h + 2, w + 2)
    weight: Array  # (S, h, w)
    slope: Array  # (S, h, w, 3) analytic gradient of ρ, eye axes; zeros where the scene takes differences


def slice_depth(n: Array, centre: float, spacing: float) -> Array:
    """Return t_n."""
    return np.asarray(centre + (n + 0.5) * spacing)


@dataclass
class Placed:
    """The fields that have kernels, in eye space, and the depths that anchor and bound the slices."""

    fields: list[tuple[RegularField | EllipsoidField, Kernels]]
    centre: float
    begin: float
    end: float


def place(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge) -> Placed:
    """Return the kernels as they are sliced, and the interval of depth that their supports take (section 3)."""
    turn = camera.turn()
    pixel = camera.height_at_one() / size[1]
    placed = []
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    begin, end = np.inf, -np.inf
    for f in scene.fields():
        kernels = f.placed(camera.eye, turn)
        if len(kernels.centres) == 0:
            continue
        low, high = np.minimum(low, kernels.world.min(0)), np.maximum(high, kernels.world.max(0))
        if scene.filter == "ewa":
            at = np.abs(kernels.centres[:, 2]) if camera.is_perspective else np.ones(len(kernels.centres))
            kernels = kernels.filtered(pixel * at, scene.spacing())
        kernels = kernels.scaled(nudge.support)
        placed.append((f, kernels))
        begin = min(begin, float((-kernels.centres[:, 2] - kernels.reach()).min()))
        end = max(end, float((-kernels.centres[:, 2] + kernels.reach()).max()))
    return Placed(placed, -float(turn[2] @ ((low + high) / 2)) if placed else 0.0, begin, end)


def sample(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge) -> Samples:
    """Return ρ on all slices (sections 2 and 3)."""
    w, h = size
    spacing = scene.spacing()
    nothing = Samples(
        np.zeros(0),
        np.zeros((0, h + 2, w + 2)),
        np.zeros((0, h + 2, w + 2), bool),
        np.zeros((0, h, w)),
        np.zeros((0, h, w, 3)),
    )
    placed = place(scene, camera, size, nudge)
    if not placed.fields:
        return nothing
    centre, begin, end = placed.centre, placed.begin, placed.end
    n = np.arange(math.floor((begin - centre) / spacing), math.floor((end - centre) / spacing) + 1)
    depth = slice_depth(n, centre, spacing)
    if camera.is_perspective:
        depth = depth[depth > camera.near]
    if len(depth) == 0:
        return nothing
    all_depth = np.concatenate([depth[0] - spacing * np.array([2, 1]), depth, depth[-1] + spacing * np.array([1, 2])])
    count = len(all_depth)
    rho = np.zeros((count, (h + 2) * (w + 2)))
    weight = np.zeros((count, (h + 2) * (w + 2)))
    empty = np.ones((count, (h + 2) * (w + 2)), bool)
    slope = np.zeros((count, (h + 2) * (w + 2), 3))
    analytic = scene.gradient == "analytic"
    tall = camera.height_at_one()
    x, y = np.meshgrid(
        (2 * (np.arange(-1, w + 1) + 0.5) / w - 1) * tall / 2 * w / h,
        (1 - 2 * (np.arange(-1, h + 1) + 0.5) / h) * tall / 2,
    )
    x, y = x.ravel(), y.ravel()
    if camera.is_perspective:
        rays, start = np.stack([x, y, -np.ones(x.shape)], -1), np.zeros((len(x), 3))
    else:
        rays, start = np.tile(np.array([0.0, 0.0, -1.0]), (len(x), 1)), np.stack([x, y, np.zeros(x.shape)], -1)
    extra = spacing / 2 if scene.sampling == "slab" else 0.0
    for f, kernels in placed.fields:
        reach = (kernels.reach() + extra) * (1 + 1e-9)
        for s in range(2, count - 2):
            t = float(all_depth[s])
            near = np.abs(-kernels.centres[:, 2] - t) <= reach
            if not near.any():
                continue
            some = kernels.picked(near)
            data, weights, reached = np.zeros(x.shape), np.zeros(x.shape), np.zeros(x.shape, bool)
            data_slope, weight_slope = np.zeros((*x.shape, 3)), np.zeros((*x.shape, 3))
            step = max(1, CHUNK // len(some.centres))
            for p in range(0, len(x), step):
                part = slice(p, p + step)
                delta = some.turned((start[part] + t * rays[part])[:, None, :] - some.centres)
                if scene.sampling == "slab":
                    g, inside = _slab(delta, some.turned(rays[part]), spacing, f.falloff)
                else:
                    r2 = (delta**2).sum(-1)
                    g, inside = kernel(r2, f.falloff), r2 < 1
                if analytic:
                    along = some.turned(rays[part])
                    slopes = kernel_slopes(delta, along, some, f.falloff, spacing if scene.sampling == "slab" else 0.0)
                    amounts = np.ones(len(some.values)) if some.weights is None else some.weights
                    data_slope[part] = np.einsum("pka,k->pa", slopes, amounts * some.values)
                    weight_slope[part] = np.einsum("pka,k->pa", slopes, amounts)
                if some.weights is not None:
                    g = g * some.weights
                data[part] = g @ some.values
                weights[part] = g.sum(-1)
                reached[part] = inside.any(-1)
            rho[s] += np.where(reached, normalised(f, data, weights), 0.0)
            weight[s] += weights
            if analytic:
                slope[s] += normalised_slope(f, data, weights, data_slope, weight_slope)
            empty[s] &= ~reached
    rho += np.where(empty, 0.0, nudge.rho)
    shape = (count, h + 2, w + 2)
    inner = np.s_[:, 1:-1, 1:-1]
    return Samples(
        all_depth,
        rho.reshape(shape),
        empty.reshape(shape),
        weight.reshape(shape)[inner],
        slope.reshape((*shape, 3))[inner],
    )


def _slab(delta: Array, ray: Array, spacing: float, k: float) -> tuple[Array, Array]:
    """Return g's mean over the slab and whether it is met; delta (P, K, 3) mid-slab, ray (P, K | 1, 3) per depth."""
    speed = np.linalg.norm(ray, axis=-1)
    nearest = -(delta * ray).sum(-1) / speed**2
    r2 = ((delta + nearest[..., None] * ray) ** 2).sum(-1)
    half = np.sqrt(np.maximum(0.0, 1 - r2)) / speed
    t0 = np.maximum(-half, -spacing / 2 - nearest)
    t1 = np.minimum(half, spacing / 2 - nearest)
    inside = (r2 < 1) & (t1 > t0)
    g = np.zeros(r2.shape)
    full_speed = np.broadcast_to(speed, r2.shape)
    g[inside] = kernel_mean(r2[inside], full_speed[inside], t0[inside], t1[inside], k, spacing)  # type: ignore[arg-type]
    return g, inside


_SLAB_NODES, _SLAB_WEIGHTS = np.polynomial.legendre.leggauss(40)


def kernel_slopes(delta: Array, ray: Array, kernels: Kernels, k: float, length: float) -> Array:
    """Return ∇g in eye axes (P, K, 3), or its mean over a slab of that length along the ray, by quadrature."""

    def pulled(q: Array) -> Array:
        """Return -2k exp(-k r²) / (1 - exp(-k)) times the transposed inverse of B times q, without the support."""
        scale = -2 * k * np.exp(-k * (q**2).sum(-1)) / (1 - math.exp(-k))
        m = kernels.to_sphere
        return np.stack([scale * sum(m[:, a, b] * q[..., a] for a in range(3)) for b in range(3)], -1)

    if length == 0:
        return np.where(((delta**2).sum(-1) < 1)[..., None], pulled(delta), 0.0)
    speed = np.linalg.norm(ray, axis=-1)
    nearest = -(delta * ray).sum(-1) / speed**2
    r2 = ((delta + nearest[..., None] * ray) ** 2).sum(-1)
    half = np.sqrt(np.maximum(0.0, 1 - r2)) / speed
    t0, t1 = np.maximum(-half, -length / 2 - nearest), np.minimum(half, length / 2 - nearest)
    inside = (r2 < 1) & (t1 > t0)
    total = np.zeros(delta.shape)
    for node, weight in zip(_SLAB_NODES, _SLAB_WEIGHTS, strict=True):
        t = nearest + (t0 + t1) / 2 + node * (t1 - t0) / 2
        total += (weight * (t1 - t0) / 2)[..., None] * pulled(delta + t[..., None] * ray)
    return np.where(inside[..., None], total / length, 0.0)


def normalised_slope(
    f: RegularField | EllipsoidField, data: Array, weights: Array, data_slope: Array, weight_slope: Array
) -> Array:
    """Return ∇ρ of the sums D and W and their gradients (section 10)."""
    if f.normalization == "none":
        return data_slope
    if f.normalization == "lattice":
        return data_slope / f.mass()
    above = weights > f.w0
    w = np.where(above, weights, 1.0)[:, None]
    return np.where(above[:, None], (w * data_slope - data[:, None] * weight_slope) / w**2, data_slope / f.w0)


def density(scene: Scene, placed: Placed, points: Array, nudge: Nudge) -> tuple[Array, NDArray[np.bool_]]:
    """Return ρ by point sampling and what is empty, at points (P, 3) of eye space."""
    rho, empty = np.zeros(len(points)), np.ones(len(points), bool)
    for f, kernels in placed.fields:
        step = max(1, CHUNK // len(kernels.centres))
        for p in range(0, len(points), step):
            part = slice(p, p + step)
            r2 = (kernels.turned(points[part][:, None, :] - kernels.centres) ** 2).sum(-1)
            g = kernel(r2, f.falloff)
            if kernels.weights is not None:
                g = g * kernels.weights
            reached = (r2 < 1).any(-1)
            rho[part] += np.where(reached, normalised(f, g @ kernels.values, g.sum(-1)), 0.0)
            empty[part] &= ~reached
    return rho + np.where(empty, 0.0, nudge.rho), empty


class Around:
    """What takes light on its way to points of eye space (section 10, shadows and ambient occlusion)."""

    def __init__(self, scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge) -> None:
        self.scene, self.camera, self.nudge = scene, camera, nudge
        self.placed = place(scene, camera, size, nudge)

    def left(self, points: Array, direction: Array, most: float = math.inf) -> Array:
        """Return the product of 1 - α along the direction, one slice distance after the other."""
        spacing = self.scene.spacing()
        # No support is farther away than the farthest centre and the largest reach of all.
        far = 0.0
        for _, kernels in self.placed.fields:
            longest = np.broadcast_to(np.linalg.norm(kernels.factor, axis=(1, 2)), (len(kernels.centres),))
            gaps = np.linalg.norm(points[:, None, :] - kernels.centres, axis=-1) + longest
            far = max(far, float(gaps.max(initial=0.0)))
        left = np.ones(len(points))
        step = 1
        while step <= most and step * spacing <= far:
            there = points + step * spacing * direction
            rho, empty = density(self.scene, self.placed, there, self.nudge)
            alpha = slice_opacity(self.scene.transfer_function(rho)[:, 3], np.array(spacing / self.scene.length()))
            if self.scene.clip is not None:
                empty = empty | ~self.scene.clip.keeps(there, self.camera, spacing)
            left *= np.where(empty, 1.0, 1 - alpha)
            step += 1
        return left

    def light(self, points: Array, towards: Array) -> Array:
        """Return the share of a light that reaches the points."""
        return self.left(points, towards)

    def ambient(self, points: Array) -> Array:
        """Return the share of ambient light that reaches the points."""
        occlusion = self.scene.ambient_occlusion
        assert occlusion is not None
        most = max(1, math.floor(occlusion.radius / self.scene.spacing() + 1e-6))
        grid = [np.array(v, float) for v in np.ndindex(3, 3, 3)]
        around = [v - 1 for v in grid if np.abs(v - 1).sum() in (1, 3)]
        open_share = np.mean([self.left(points, self.camera.turn() @ unit(v), most) for v in around], axis=0)
        return np.asarray(1 - occlusion.strength * (1 - open_share))


def normalised(f: RegularField | EllipsoidField, data: Array, weights: Array) -> Array:
    """Return ρ of the sums D and W (section 2)."""
    if f.normalization == "none":
        return data
    if f.normalization == "threshold":
        return data / np.maximum(f.w0, weights)
    return data / f.mass()


def gradients(samples: Samples, camera: Camera, size: tuple[int, int], spacing: float) -> Array:
    """Return differences of ρ in eye space on slices 1 ... S - 2 of the samples, (S - 2, h, w, 3) (section 5)."""
    w, h = size
    rho = samples.rho
    pixel = np.full(len(samples.depth) - 2, camera.height_at_one() / h)
    tall = camera.height_at_one()
    if camera.is_perspective:
        pixel = pixel * samples.depth[1:-1]
    middle = rho[1:-1]
    width = np.where(pixel > 0, 2 * pixel, np.inf)[:, None, None]  # a slice that is not there has no gradient across
    dx = (middle[:, 1:-1, 2:] - middle[:, 1:-1, :-2]) / width
    dy = (middle[:, :-2, 1:-1] - middle[:, 2:, 1:-1]) / width
    dt = (rho[2:, 1:-1, 1:-1] - rho[:-2, 1:-1, 1:-1]) / (2 * spacing)
    if not camera.is_perspective:
        return np.stack([dx, dy, -dt], -1)
    x = (2 * (np.arange(w) + 0.5) / w - 1) * tall / 2 * w / h
    y = (1 - 2 * (np.arange(h) + 0.5) / h) * tall / 2
    return np.stack([dx, dy, x * dx + y[:, None] * dy - dt], -1)


def render(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge | None = None) -> Picture:
    """Return the picture (sections 4 to 7)."""
    w, h = size
    nudge = nudge or Nudge()
    spacing, length = scene.spacing(), scene.length()
    samples = sample(scene, camera, size, nudge)
    tall = camera.height_at_one()
    x = (2 * (np.arange(w) + 0.5) / w - 1) * tall / 2 * w / h
    y = (1 - 2 * (np.arange(h) + 0.5) / h) * tall / 2
    if camera.is_perspective:
        to_camera = np.stack([*np.broadcast_arrays(-x, -y[:, None]), np.ones((h, w))], -1)
        stretch = np.linalg.norm(to_camera, axis=-1)
        to_camera = to_camera / stretch[..., None]
    else:
        to_camera = np.zeros((h, w, 3))
        to_camera[..., 2] = 1
        stretch = np.ones((h, w))
    turn = camera.turn()
    rho, empty = samples.rho[1:-1, 1:-1, 1:-1], samples.empty[1:-1, 1:-1, 1:-1]
    depths = samples.depth[1:-1]
    kept = kept_points(scene, camera, size, depths)
    coverage = (samples.weight[1:-1] * kept).sum(0) * spacing * stretch
    depth = np.full((h, w), np.inf)
    found = max(len(depths) - 2, 0)
    if scene.mode in ("xray", "mip"):
        if scene.mode == "xray":
            scalar = (rho * kept).sum(0) * spacing * stretch
        else:
            scalar = np.maximum(0.0, np.where(kept, rho, 0.0).max(0)) if found else np.zeros((h, w))
        return Picture(None, scalar, coverage, depth, found)
    rgba = np.zeros((h, w, 4))
    if found:
        slopes = samples.slope[1:-1] if scene.gradient == "analytic" else gradients(samples, camera, size, spacing)
        weak = 1e-3 * scene.transfer_function.span() / length
        around = Around(scene, camera, size, nudge) if scene.shadows or scene.ambient_occlusion is not None else None

        def shaded(colour: Array, gradient: Array, at: Array, t: Array) -> Array:
            points = ray_points(camera, size, at, t)
            lit = shade(colour, gradient, to_camera[at], weak, scene, turn, points, around)
            cue = scene.depth_cue
            if cue is None:
                return lit
            share = (cue.strength * np.clip((t - cue.start) / (cue.end - cue.start), 0, 1))[:, None]
            return lit * (1 - share) + np.asarray(cue.color, float) * share

        paint = _isosurface if scene.mode == "isosurface" else _composite
        paint(scene, rho, empty, kept, depths, slopes, shaded, spacing * stretch, length, nudge, rgba, depth)
    if scene.background is not None:
        rgba[..., :3] += (1 - rgba[..., 3:]) * np.asarray(scene.background, float)
        rgba[..., 3] = 1
    return Picture(rgba, None, coverage, depth, found)


def ray_points(camera: Camera, size: tuple[int, int], at: NDArray[np.bool_], t: Array) -> Array:
    """Return where the rays of those pixels are at depths t, eye space (P, 3)."""
    w, h = size
    tall = camera.height_at_one()
    x = np.broadcast_to((2 * (np.arange(w) + 0.5) / w - 1) * tall / 2 * w / h, (h, w))[at]
    y = np.broadcast_to(((1 - 2 * (np.arange(h) + 0.5) / h) * tall / 2)[:, None], (h, w))[at]
    scale = t if camera.is_perspective else 1.0
    return np.stack([x * scale, y * scale, -t], -1)


def kept_points(scene: Scene, camera: Camera, size: tuple[int, int], depths: Array) -> NDArray[np.bool_]:
    """Return which points of slices clipping keeps, (S, h, w)."""
    w, h = size
    kept = np.ones((len(depths), h, w), bool)
    if scene.clip is None:
        return kept
    everywhere = np.ones((h, w), bool)
    for s, t in enumerate(depths):
        eye = ray_points(camera, size, everywhere, np.full(h * w, t))
        kept[s] = scene.clip.keeps(eye, camera, scene.spacing()).reshape(h, w)
    return kept


def gradient_share(scene: Scene, gradient: Array) -> Array:
    """Return what gradient opacity multiplies by."""
    if scene.gradient_opacity is None:
        return np.ones(len(gradient))
    return np.minimum(1.0, np.linalg.norm(gradient, axis=-1) / scene.gradient_opacity)


def first_order(tf: TransferFunction, first: Array, last: Array, lengths: Array) -> tuple[Array, Array]:
    """Return opacity and premultiplied colour of an interval with ρ from first to last."""
    tau, tau_c = ramp_means(tf, first, last)
    alpha = -np.expm1(-lengths * tau)
    return alpha, alpha[:, None] * tau_c / np.where(tau > 0, tau, 1)[:, None]


def second_order(tf: TransferFunction, rho: Sequence[Array], lengths: Array) -> tuple[Array, Array]:
    """Return opacity and premultiplied colour of an interval between the second and the third of four slices."""
    middle = (9 * (rho[1] + rho[2]) - rho[0] - rho[3]) / 16
    a1, c1 = first_order(tf, rho[1], rho[2], lengths)
    front, c_front = first_order(tf, rho[1], middle, lengths / 2)
    back, c_back = first_order(tf, middle, rho[2], lengths / 2)
    a2 = front + (1 - front) * back
    c2 = c_front + (1 - front)[:, None] * c_back
    return np.clip((4 * a2 - a1) / 3, 0, 1), np.maximum((4 * c2 - c1) / 3, 0)


Shader = Callable[[Array, Array, Array, Array], Array]


def _composite(
    scene: Scene,
    rho: Array,
    empty: Array,
    kept: Array,
    depths: Array,
    slopes: Array,
    shaded: Shader,
    step: Array,
    length: float,
    nudge: Nudge,
    rgba: Array,
    depth: Array,
) -> None:
    tf = scene.transfer_function
    stop = scene.opacity_stop + nudge.stop
    is_open = kept & ~empty
    for s in range(len(depths) - 1):
        live = rgba[..., 3] < stop
        if scene.preintegration:
            at = live & (is_open[s] | is_open[s + 1])
            gradient = (slopes[s][at] + slopes[s + 1][at]) / 2
            lengths = step[at] / length * gradient_share(scene, gradient)
            if scene.preintegration == "second_order":
                four = [rho[n][at] if 0 <= n < len(rho) else np.zeros(at.sum()) for n in range(s - 1, s + 3)]
                alpha, premultiplied = second_order(tf, four, lengths)
            else:
                alpha, premultiplied = first_order(tf, rho[s][at], rho[s + 1][at], lengths)
            colour = premultiplied / np.where(alpha > 0, alpha, 1)[:, None]
            t = np.full(alpha.shape, (depths[s] + depths[s + 1]) / 2)
        else:
            at = live & is_open[s]
            classified = tf(rho[s][at])
            gradient = slopes[s][at]
            share = gradient_share(scene, gradient)
            alpha, colour = slice_opacity(classified[:, 3] * share, step[at] / length), classified[:, :3]
            t = np.full(alpha.shape, depths[s])
        colour = shaded(colour, gradient, at, t)
        before = rgba[..., 3].copy()
        left = 1 - before[at]
        rgba[at, :3] += (left * alpha)[:, None] * colour
        rgba[at, 3] += left * alpha
        reached = (before < 0.5) & (rgba[..., 3] >= 0.5)
        depth[reached] = depths[s]


def _isosurface(
    scene: Scene,
    rho: Array,
    empty: Array,
    kept: Array,
    depths: Array,
    slopes: Array,
    shaded: Shader,
    step: Array,
    length: float,
    nudge: Nudge,
    rgba: Array,
    depth: Array,
) -> None:
    iso = float(scene.iso_value or 0.0)
    colour = scene.transfer_function(np.array(iso))[:3]
    for s in range(len(depths) - 1):
        at = (rgba[..., 3] == 0) & ((rho[s] < iso) != (rho[s + 1] < iso)) & kept[s] & kept[s + 1]
        share = (iso - rho[s][at]) / (rho[s + 1][at] - rho[s][at])
        gradient = slopes[s][at] * (1 - share)[:, None] + slopes[s + 1][at] * share[:, None]
        depth[at] = depths[s] + share * (depths[s + 1] - depths[s])
        rgba[at, :3] = shaded(np.broadcast_to(colour, gradient.shape), gradient, at, depth[at])
        rgba[at, 3] = 1


# Section 9: ambiguous pixels and gentle scenes


def ambiguous(scene: Scene, camera: Camera, size: tuple[int, int], picture: Picture) -> NDArray[np.bool_]:
    """Return the pixels that change by more than 1e-3 when ρ, the supports' radius or A_stop is nudged."""
    found = np.zeros((size[1], size[0]), bool)
    if picture.rgba is None:
        return found
    nudges = []
    for sign in (-1, 1):
        nudges.append(Nudge(rho=sign * 1e-5 * scene.transfer_function.span()))
        nudges.append(Nudge(support=1 + sign * 1e-5))
        if scene.mode == "composite":
            nudges.append(Nudge(stop=sign * 1e-5))
    for nudge in nudges:
        moved = render(scene, camera, size, nudge).rgba
        assert moved is not None
        found |= np.abs(moved - picture.rgba).max(-1) > 1e-3
    return found


def is_gentle(scene: Scene, camera: Camera, size: tuple[int, int]) -> bool:
    """Return whether the tighter bound of section 9 holds: slopes of at most 10 and a pixel of at least ℓ/100."""
    table = scene.transfer_function.table()
    span = scene.transfer_function.span()
    steps = np.diff(table[:, 0])
    rises = np.abs(np.diff(table[:, 1:], axis=0)).max(-1)
    if span == 0 or (rises[steps == 0] > 0).any():
        return False
    tall = camera.height_at_one()
    stretch = math.sqrt(1 + (tall / 2) ** 2 * (1 + (size[0] / size[1]) ** 2)) if camera.is_perspective else 1.0
    nearest = max(camera.near, place(scene, camera, size, Nudge()).begin) if camera.is_perspective else 1.0
    slope = (rises[steps > 0] / steps[steps > 0]).max() * span
    pixel = tall / size[1] * nearest
    return bool(slope * scene.spacing() * stretch / scene.length() <= 10 and pixel >= scene.length() / 100)

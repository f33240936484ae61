"""Transfer functions, lights, materials, cameras and scenes (sections 1, 4, 5 and 10)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .kernels import Array, Box, EllipsoidField, Mask, RegularField

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

    def counted_from(self, base: float) -> TransferFunction:
        """Return the function of ρ - base."""
        return TransferFunction([(value - base, *looks) for value, *looks in self.table().tolist()])

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


@dataclass
class Clip:
    """Half spaces (normal, offset) and a box; what is in all of them is kept."""

    planes: Sequence[tuple[Sequence[float], float]] = ()
    box: tuple[ArrayLike, ArrayLike] | Box | None = None

    def keeps(self, points: Array, camera: Camera, spacing: float) -> Mask:
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
            to_box = np.eye(3) if len(self.box) == 2 else self.box[2]
            low, high = (np.asarray(corner, float) - to_box @ camera.eye for corner in self.box[:2])
            at, near = offset @ to_box.T, slack * np.linalg.norm(to_box, axis=1)
            kept &= ((at >= low - near) & (at <= high + near)).all(-1)
        return kept

    def faces(self, camera: Camera, spacing: float) -> list[tuple[Array, float]]:
        """Return half spaces (normal, least) of eye space: planes, then the faces of the box."""
        world = [(np.asarray(normal, float), float(least)) for normal, least in self.planes]
        if self.box is not None:
            to_box = np.eye(3) if len(self.box) == 2 else self.box[2]
            for row, low, high in zip(to_box, *self.box[:2], strict=True):
                world += [(row, float(low)), (-row, -float(high))]
        made = []
        for normal, least in world:
            length = float(np.linalg.norm(normal))
            away = least / length - normal @ camera.eye / length - 1e-6 * spacing
            made.append((camera.turn() @ normal / length, away))
        return made


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


@dataclass
class Scene:
    """What is shown and how."""

    field: Any  # one, a sequence whose ρ add up, or as many of these as there are transfer functions
    transfer_function: TransferFunction | Sequence[TransferFunction]
    slice_spacing: float | None = None
    sampling: str = "point"
    reference_length: float | None = None
    mode: str = "composite"
    iso_value: float | Sequence[tuple[float, float]] | None = None
    lights: Sequence[Light] = ()
    material: Material = field(default_factory=Material)
    opacity_stop: float = 0.98
    preintegration: bool | str = False
    filter: str | None = None
    gradient: str = "sheets"
    clip: Clip | None = None
    gradient_opacity: float | None = None
    cut_faces: bool = False
    depth_cue: DepthCue | None = None
    shadows: bool = False
    ambient_occlusion: AmbientOcclusion | None = None
    background: Sequence[float] | None = None

    @property
    def scalar(self) -> bool:
        """Whether the picture shows ρ itself."""
        return self.mode not in ("composite", "isosurface")

    def groups(self) -> list[tuple[list[RegularField | EllipsoidField], TransferFunction]]:
        """Return the fields that add up and their transfer functions; in scalar modes all fields add up.

        Lattices are zero beyond their samples where the fields of a group end in different places.
        """

        def listed(one: Any) -> list[Any]:
            return list(one) if isinstance(one, (list, tuple)) else [one]

        def settled(fields: list[Any]) -> list[Any]:
            ends = {None if f.domain() is None else tuple(np.vstack(f.domain()).ravel().tolist()) for f in fields}
            if len(ends) == 1:
                return fields
            return [replace(f, boundary="zero", base=0.0) if isinstance(f, RegularField) else f for f in fields]

        if isinstance(self.transfer_function, TransferFunction):
            return [(settled(listed(self.field)), self.transfer_function)]
        parts = [settled(listed(one)) for one in self.field]
        if self.scalar:
            return [([one for part in parts for one in part], self.transfer_function[0])]
        return list(zip(parts, self.transfer_function, strict=True))

    def fields(self) -> list[RegularField | EllipsoidField]:
        """Return the fields."""
        return [one for fields, _ in self.groups() for one in fields]

    def bases(self) -> list[float]:
        """Return what the values of each group are counted from."""
        return [sum(f.counted_from() for f in fields) for fields, _ in self.groups()]

    def weakest(self) -> list[float]:
        """Return g0 of each group."""
        return [
            1e-3 * max(tf.span(), max(f.range() for f in fields) / 4096) / self.length() for fields, tf in self.groups()
        ]

    def inside(self, domain: Box | None, points: Array, camera: Camera) -> Mask:
        """Return which of the points (..., 3) of eye space are in a domain."""
        if domain is None:
            return np.ones(points.shape[:-1], bool)
        return Clip(box=domain).keeps(points, camera, self.spacing())

    def surfaces(self) -> list[tuple[float, float]]:
        """Return iso values and opacities."""
        given = self.iso_value
        return [(float(given or 0.0), 1.0)] if not isinstance(given, (list, tuple)) else list(given)

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

"""Sums of kernels and their gradients on the slices and their neighbours (sections 2, 3 and 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .kernels import (
    Array,
    EllipsoidField,
    Kernels,
    Mask,
    RegularField,
    kernel,
    kernel_slopes,
    normalised,
    normalised_slope,
    slab_mean,
)
from .scene import Camera, Scene

# Of the numbers held at once for one slice, pixels times kernels.
CHUNK = 2_000_000


@dataclass
class Nudge:
    """What section 9 moves to find ambiguous pixels: ρ of points that are not empty, supports, A_stop.

    ρ as a share of v_max - v_min.
    """

    rho: float = 0.0
    support: float = 1.0
    stop: float = 0.0


@dataclass
class Samples:
    """ρ and what is empty on slices first - 2 ... last + 2, at the pixels and one more on every side; G groups.

    ρ is counted from each group's base; in scalar modes it is what is shown, of the fields that have not ended.
    """

    depth: Array  # (S,)
    rho: Array  # (G, S, h + 2, w + 2)
    empty: Array  # (G, S, h + 2, w + 2)
    inside: Mask  # (G, S, h, w) the domain of the group
    weight: Array  # (S, h, w) of all fields that have not ended
    counts: Mask  # (S, h, w) a field that is not empty has W > 0
    slope: Array  # (G, S, h, w, 3) analytic gradient of ρ, eye axes; zeros where the scene takes differences
    cut: bool  # the near plane removes the slices before the first one


def screen(camera: Camera, size: tuple[int, int], border: int = 0) -> tuple[Array, Array]:
    """Return x (w,) and y (h,) of the centres of pixels at depth 1, of `border` more pixels on every side."""
    w, h = size
    tall = camera.height_at_one()
    x = (2 * (np.arange(-border, w + border) + 0.5) / w - 1) * tall / 2 * w / h
    y = (1 - 2 * (np.arange(-border, h + border) + 0.5) / h) * tall / 2
    return x, y


def slice_depth(n: Array, centre: float, spacing: float) -> Array:
    """Return t_n."""
    return np.asarray(centre + (n + 0.5) * spacing)


@dataclass
class Placed:
    """The fields that have kernels, in eye space, and the depths that anchor and bound the slices."""

    fields: list[tuple[int, RegularField | EllipsoidField, Kernels]]  # the first is the group's number
    bare: list[tuple[int, RegularField | EllipsoidField]]  # without kernels
    centre: float
    begin: float
    end: float


def place(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge) -> Placed:
    """Return the kernels as they are sliced, and the interval of depth that their supports take (section 3)."""
    turn = camera.turn()
    pixel = camera.height_at_one() / size[1]
    placed, bare = [], []
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    begin, end = np.inf, -np.inf
    numbered = [(number, f) for number, (fields, _) in enumerate(scene.groups()) for f in fields]
    for number, f in numbered:
        kernels = f.placed(camera.eye, turn)
        if len(kernels.centres) == 0:
            bare.append((number, f))
            continue
        anchors = f.anchors(camera.eye)
        low, high = np.minimum(low, anchors.min(0)), np.maximum(high, anchors.max(0))
        if scene.filter == "ewa":
            count = len(kernels.centres)
            at = np.maximum(-kernels.centres[:, 2], camera.near) if camera.is_perspective else np.ones(count)
            kernels = kernels.filtered(pixel * at, scene.spacing(), f.falloff)
        kernels = kernels.scaled(nudge.support)
        placed.append((number, f, kernels))
        begin = min(begin, float((-kernels.centres[:, 2] - kernels.reach()).min()))
        end = max(end, float((-kernels.centres[:, 2] + kernels.reach()).max()))
    return Placed(placed, bare, -float(turn[2] @ ((low + high) / 2)) if placed else 0.0, begin, end)


def sample(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge) -> Samples:
    """Return ρ on all slices (sections 2 and 3)."""
    w, h = size
    spacing = scene.spacing()
    groups = scene.groups()
    nothing = Samples(
        np.zeros(0),
        np.zeros((len(groups), 0, h + 2, w + 2)),
        np.zeros((len(groups), 0, h + 2, w + 2), bool),
        np.zeros((len(groups), 0, h, w), bool),
        np.zeros((0, h, w)),
        np.zeros((0, h, w), bool),
        np.zeros((len(groups), 0, h, w, 3)),
        False,
    )
    placed = place(scene, camera, size, nudge)
    if not placed.fields:
        return nothing
    centre, begin, end = placed.centre, placed.begin, placed.end
    n = np.arange(math.floor((begin - centre) / spacing), math.floor((end - centre) / spacing) + 1)
    depth = slice_depth(n, centre, spacing)
    cut = camera.is_perspective and bool((depth <= camera.near).any())
    if camera.is_perspective:
        depth = depth[depth > camera.near]
    if len(depth) == 0:
        return nothing
    all_depth = np.concatenate([depth[0] - spacing * np.array([2, 1]), depth, depth[-1] + spacing * np.array([1, 2])])
    count = len(all_depth)
    rho = np.zeros((len(groups), count, (h + 2) * (w + 2)))
    weight = np.zeros((count, (h + 2) * (w + 2)))
    empty = np.ones((len(groups), count, (h + 2) * (w + 2)), bool)
    inside = np.zeros((len(groups), count, (h + 2) * (w + 2)), bool)
    counts = np.zeros((count, (h + 2) * (w + 2)), bool)
    slope = np.zeros((len(groups), count, (h + 2) * (w + 2), 3))
    analytic = scene.gradient == "analytic"
    x, y = (plane.ravel() for plane in np.meshgrid(*screen(camera, size, border=1)))
    if camera.is_perspective:
        rays, start = np.stack([x, y, -np.ones(x.shape)], -1), np.zeros((len(x), 3))
    else:
        rays, start = np.tile(np.array([0.0, 0.0, -1.0]), (len(x), 1)), np.stack([x, y, np.zeros(x.shape)], -1)
    extra = spacing / 2 if scene.sampling == "slab" else 0.0
    for group, f in [one[:2] for one in placed.fields] + placed.bare:
        for s in range(count):
            within = scene.inside(f.domain(), start + float(all_depth[s]) * rays, camera)
            inside[group, s] |= within
            if scene.scalar:
                rho[group, s] += np.where(within, f.counted_from(), 0.0)
    for group, f, kernels in placed.fields:
        reach = (kernels.reach() + extra) * (1 + 1e-9)
        for s in range(2, count - 2):
            t = float(all_depth[s])
            within = scene.inside(f.domain(), start + t * rays, camera)
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
                    g, met = slab_mean(delta, some.turned(rays[part]), spacing, f.falloff)
                else:
                    r2 = (delta**2).sum(-1)
                    g, met = kernel(r2, f.falloff), r2 < 1
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
                reached[part] = met.any(-1)
            own = np.where(reached, normalised(f, data, weights), 0.0)
            rho[group, s] += np.where(within, own, 0.0) if scene.scalar else own
            weight[s] += np.where(within, weights, 0.0)
            reached &= within & (weights >= f.least_weight())
            counts[s] |= reached & (weights > 0)
            if analytic:
                slope[group, s] += normalised_slope(f, data, weights, data_slope, weight_slope)
            empty[group, s] &= ~reached
    for group, (_, tf) in enumerate(groups):
        rho[group] += np.where(empty[group], 0.0, nudge.rho * tf.span())
    shape = (len(groups), count, h + 2, w + 2)
    return Samples(
        all_depth,
        rho.reshape(shape),
        empty.reshape(shape),
        inside.reshape(shape)[:, :, 1:-1, 1:-1],
        weight.reshape(shape[1:])[:, 1:-1, 1:-1],
        counts.reshape(shape[1:])[:, 1:-1, 1:-1],
        slope.reshape((*shape, 3))[:, :, 1:-1, 1:-1],
        cut,
    )


def density(scene: Scene, placed: Placed, camera: Camera, points: Array, nudge: Nudge) -> tuple[Array, Mask, Mask]:
    """Return ρ of each group by point sampling, what is empty and what is in its domain, at points (P, 3) of eye space.

    All are (G, P); ρ is counted from the group's base.
    """
    groups = scene.groups()
    within = np.stack([scene.inside(fields[0].domain(), points, camera) for fields, _ in groups])
    rho, empty = np.zeros((len(groups), len(points))), np.ones((len(groups), len(points)), bool)
    for group, f, kernels in placed.fields:
        # No support reaches out of this box.
        longest = 1.001 * np.linalg.norm(kernels.factor, axis=(1, 2))[:, None]
        low, high = (kernels.centres - longest).min(0), (kernels.centres + longest).max(0)
        inside = np.flatnonzero(((points >= low) & (points <= high)).all(-1))
        step = max(1, CHUNK // len(kernels.centres))
        for p in range(0, len(inside), step):
            part = inside[p : p + step]
            r2 = (kernels.turned(points[part][:, None, :] - kernels.centres) ** 2).sum(-1)
            g = kernel(r2, f.falloff)
            if kernels.weights is not None:
                g = g * kernels.weights
            reached = (r2 < 1).any(-1)
            rho[group, part] += np.where(reached, normalised(f, g @ kernels.values, g.sum(-1)), 0.0)
            empty[group, part] &= ~(reached & (g.sum(-1) >= f.least_weight()))
    spans = np.array([tf.span() for _, tf in groups])[:, None]
    return rho + np.where(empty, 0.0, nudge.rho * spans), empty | ~within, within


def gradients(samples: Samples, group: int, camera: Camera, size: tuple[int, int], spacing: float) -> Array:
    """Return differences of ρ in eye space on slices 1 ... S - 2 of the samples, (S - 2, h, w, 3) (section 5)."""
    rho = samples.rho[group]
    pixel = np.full(len(samples.depth) - 2, camera.height_at_one() / size[1])
    if camera.is_perspective:
        pixel = pixel * samples.depth[1:-1]
    middle = rho[1:-1]
    width = np.where(pixel > 0, 2 * pixel, np.inf)[:, None, None]  # a slice that is not there has no gradient across
    dx = (middle[:, 1:-1, 2:] - middle[:, 1:-1, :-2]) / width
    dy = (middle[:, :-2, 1:-1] - middle[:, 2:, 1:-1]) / width
    dt = (rho[2:, 1:-1, 1:-1] - rho[:-2, 1:-1, 1:-1]) / (2 * spacing)
    if not camera.is_perspective:
        return np.stack([dx, dy, -dt], -1)
    x, y = screen(camera, size)
    return np.stack([dx, dy, x * dx + y[:, None] * dy - dt], -1)

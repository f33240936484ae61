"""Pictures: classifying, shading and compositing samples (sections 4 to 7 and 10), ambiguous pixels (section 9)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .kernels import Array, Mask
from .samples import Nudge, density, gradients, place, sample, screen
from .scene import Camera, Scene, first_order, second_order, slice_opacity, unit


@dataclass
class Picture:
    """The result, float64."""

    rgba: Array | None
    scalar: Array | None
    coverage: Array
    depth: Array
    slices: int


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


def render(scene: Scene, camera: Camera, size: tuple[int, int], nudge: Nudge | None = None) -> Picture:
    """Return the picture (sections 4 to 7)."""
    w, h = size
    nudge = nudge or Nudge()
    spacing, length = scene.spacing(), scene.length()
    samples = sample(scene, camera, size, nudge)
    x, y = screen(camera, size)
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
        slices = Slices(depths, rho, empty, kept, slopes, spacing * stretch / length)
        paint(scene, slices, shaded, scene.opacity_stop + nudge.stop, rgba, depth)
    if scene.background is not None:
        rgba[..., :3] += (1 - rgba[..., 3:]) * np.asarray(scene.background, float)
        rgba[..., 3] = 1
    return Picture(rgba, None, coverage, depth, found)


def ray_points(camera: Camera, size: tuple[int, int], at: Mask, t: Array) -> Array:
    """Return where the rays of those pixels are at depths t, eye space (P, 3)."""
    w, h = size
    x, y = screen(camera, size)
    x, y = np.broadcast_to(x, (h, w))[at], np.broadcast_to(y[:, None], (h, w))[at]
    scale = t if camera.is_perspective else 1.0
    return np.stack([x * scale, y * scale, -t], -1)


def kept_points(scene: Scene, camera: Camera, size: tuple[int, int], depths: Array) -> Mask:
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


# Colour, gradient, pixels and depth to shaded colour.
Shader = Callable[[Array, Array, Mask, Array], Array]


@dataclass
class Slices:
    """What is composited: S slices of h x w pixels."""

    depths: Array  # (S,)
    rho: Array  # (S, h, w)
    empty: Mask  # (S, h, w)
    kept: Mask  # (S, h, w) by clipping
    slopes: Array  # (S, h, w, 3) gradients of rho, eye axes
    lengths: Array  # (h, w) of a slice along the ray, in reference lengths


def _composite(scene: Scene, slices: Slices, shaded: Shader, stop: float, rgba: Array, depth: Array) -> None:
    """Composite slices, or intervals between them, front to back into rgba and depth (section 6)."""
    tf = scene.transfer_function
    is_open = slices.kept & ~slices.empty
    for s in range(len(slices.depths) - 1):
        live = rgba[..., 3] < stop
        if scene.preintegration:
            at = live & (is_open[s] | is_open[s + 1])
            gradient = (slices.slopes[s][at] + slices.slopes[s + 1][at]) / 2
            lengths = slices.lengths[at] * gradient_share(scene, gradient)
            if scene.preintegration == "second_order":
                four = [
                    slices.rho[n][at] if 0 <= n < len(slices.rho) else np.zeros(at.sum()) for n in range(s - 1, s + 3)
                ]
                alpha, premultiplied = second_order(tf, four, lengths)
            else:
                alpha, premultiplied = first_order(tf, slices.rho[s][at], slices.rho[s + 1][at], lengths)
            colour = premultiplied / np.where(alpha > 0, alpha, 1)[:, None]
            t = np.full(alpha.shape, (slices.depths[s] + slices.depths[s + 1]) / 2)
        else:
            at = live & is_open[s]
            classified = tf(slices.rho[s][at])
            gradient = slices.slopes[s][at]
            share = gradient_share(scene, gradient)
            alpha, colour = slice_opacity(classified[:, 3] * share, slices.lengths[at]), classified[:, :3]
            t = np.full(alpha.shape, slices.depths[s])
        colour = shaded(colour, gradient, at, t)
        before = rgba[..., 3].copy()
        left = 1 - before[at]
        rgba[at, :3] += (left * alpha)[:, None] * colour
        rgba[at, 3] += left * alpha
        reached = (before < 0.5) & (rgba[..., 3] >= 0.5)
        depth[reached] = slices.depths[s]


def _isosurface(scene: Scene, slices: Slices, shaded: Shader, stop: float, rgba: Array, depth: Array) -> None:
    """Draw the first crossing of the iso value into rgba and depth (section 7)."""
    iso = float(scene.iso_value or 0.0)
    colour = scene.transfer_function(np.array(iso))[:3]
    for s in range(len(slices.depths) - 1):
        at = (
            (rgba[..., 3] == 0)
            & ((slices.rho[s] < iso) != (slices.rho[s + 1] < iso))
            & slices.kept[s]
            & slices.kept[s + 1]
        )
        share = (iso - slices.rho[s][at]) / (slices.rho[s + 1][at] - slices.rho[s][at])
        gradient = slices.slopes[s][at] * (1 - share)[:, None] + slices.slopes[s + 1][at] * share[:, None]
        depth[at] = slices.depths[s] + share * (slices.depths[s + 1] - slices.depths[s])
        rgba[at, :3] = shaded(np.broadcast_to(colour, gradient.shape), gradient, at, depth[at])
        rgba[at, 3] = 1


# Section 9: ambiguous pixels and gentle scenes


def ambiguous(scene: Scene, camera: Camera, size: tuple[int, int], picture: Picture) -> Mask:
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

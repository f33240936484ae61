"""Pictures: classifying, shading and compositing samples (sections 4 to 7 and 10), ambiguous pixels (section 9)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .kernels import Array, Box, Mask
from .samples import Nudge, density, gradients, place, sample, screen
from .scene import MOST_OPACITY, Camera, Clip, Scene, TransferFunction, ramp_means, second_order, slice_opacity, unit


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
        """Return what is left of light along the direction, one slice distance after the other.

        The product of 1 - α at the points; in mode isosurface of 1 - o over the crossings between them.
        """
        spacing = self.scene.spacing()
        # No support is farther away than the farthest centre and the largest reach of all.
        far = 0.0
        for _, _, kernels in self.placed.fields:
            longest = np.broadcast_to(np.linalg.norm(kernels.factor, axis=(1, 2)), (len(kernels.centres),))
            gaps = np.linalg.norm(points[:, None, :] - kernels.centres, axis=-1) + longest
            far = max(far, float(gaps.max(initial=0.0)))
        count = math.floor(far / spacing) + 2
        left = np.ones(len(points))
        if self.scene.mode == "isosurface":
            front = self.look_at(points + spacing * direction)
            for step in range(2, int(min(most, count)) + 1):
                back = self.look_at(points + step * spacing * direction)
                left *= self.between(front, back)
                front = back
            return left
        for step in range(1, int(min(most, count)) + 1):
            left *= self.clear(points + step * spacing * direction)
        return left

    def kept(self, points: Array) -> Mask:
        """Return which points clipping keeps."""
        clip = self.scene.clip
        return np.ones(len(points), bool) if clip is None else clip.keeps(points, self.camera, self.scene.spacing())

    def clear(self, points: Array) -> Array:
        """Return 1 - α of points, of all groups."""
        scene = self.scene
        rho, empty, _ = density(scene, self.placed, self.camera, points, self.nudge)
        left = np.ones(len(points))
        if empty.all():
            return left
        for group, ((_, tf), base) in enumerate(zip(scene.groups(), scene.bases(), strict=True)):
            alpha = slice_opacity(tf.counted_from(base)(rho[group])[:, 3], np.array(scene.spacing() / scene.length()))
            left *= np.where(empty[group], 1.0, 1 - alpha)
        return np.where(self.kept(points), left, 1.0)

    def look_at(self, points: Array) -> tuple[Array, Mask]:
        """Return rho of each group at points, and which of them clipping keeps in its domain."""
        rho, _, within = density(self.scene, self.placed, self.camera, points, self.nudge)
        return rho, within & self.kept(points)

    def between(self, front: tuple[Array, Mask], back: tuple[Array, Mask]) -> Array:
        """Return the product of 1 - o over the surfaces between points that were looked at."""
        (before, kept_before), (after, kept_after) = front, back
        both = kept_before & kept_after
        left = np.ones(both.shape[1])
        for value, opacity in self.scene.surfaces():
            for one, other, kept, base in zip(before, after, both, self.scene.bases(), strict=True):
                left *= np.where(kept & ((one < value - base) != (other < value - base)), 1 - opacity, 1.0)
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
    face: tuple[Array, Array],
) -> Array:
    """Return the shaded colour of points; these, gradient and to_camera in eye space, turn from world to eye.

    `face`: what normals of cuts count, and these.
    """
    ambient = 1.0
    if around is not None and scene.ambient_occlusion is not None:
        ambient = around.ambient(points)[:, None]
    if not scene.lights:
        return colour * ambient
    length = np.linalg.norm(gradient, axis=-1)
    bound = np.maximum(length, weak)
    normal = -gradient / np.where(bound > 0, bound, 1)[..., None]
    normal = (1 - face[0])[:, None] * normal + face[0][:, None] * face[1]
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


def render(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    nudge: Nudge | None = None,
    depth_limit: Array | None = None,
) -> Picture:
    """Return the picture (sections 4 to 7), cut off at depths (h, w) where they are given (section 10)."""
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
    inner = np.s_[:, 1:-1, 1:-1, 1:-1]
    rho, empty = samples.rho[inner], samples.empty[inner]
    depths, weights, counts = samples.depth[1:-1], samples.weight[1:-1], samples.counts[1:-1]
    kept = kept_points(scene, camera, size, depths)
    if depth_limit is not None:
        kept &= before_limit(depths, depth_limit, spacing)
    coverage = (weights * kept).sum(0) * spacing * stretch
    depth = np.full((h, w), np.inf)
    found = max(len(depths) - 2, 0)
    if scene.scalar:
        return Picture(None, _scalar(scene.mode, rho[0], counts, kept, spacing * stretch), coverage, depth, found)
    rgba = np.zeros((h, w, 4))
    if found:
        around = Around(scene, camera, size, nudge) if scene.shadows or scene.ambient_occlusion is not None else None

        def shader(weak: float, entered: tuple[Array, Array]) -> Shader:
            def shaded(colour: Array, gradient: Array, at: Mask, t: Array, own: Array) -> Array:
                points = ray_points(camera, size, at, t)
                share = face_share(scene, (t - entered[0][at]), own, rgba[at, 3])
                lit = shade(colour, gradient, to_camera[at], weak, scene, turn, points, around, (share, entered[1][at]))
                cue = scene.depth_cue
                if cue is None:
                    return lit
                faded = (cue.strength * np.clip((t - cue.start) / (cue.end - cue.start), 0, 1))[:, None]
                return lit * (1 - faded) + np.asarray(cue.color, float) * faded

            return shaded

        groups = []
        bases, weakest = scene.bases(), scene.weakest()
        for number, (fields, tf) in enumerate(scene.groups()):
            base, inside = bases[number], samples.inside[number, 1:-1]
            analytic = scene.gradient == "analytic"
            slopes = samples.slope[number, 1:-1] if analytic else gradients(samples, number, camera, size, spacing)
            entered = entries(scene, fields[0].domain(), camera, size)
            counted, shaded = tf.counted_from(base), shader(weakest[number], entered)
            groups.append(Group(counted, base, rho[number], empty[number] | ~inside, inside, slopes, shaded))
        paint = _isosurface if scene.mode == "isosurface" else _composite
        slices = Slices(depths, kept, spacing * stretch / length, samples.cut)
        paint(scene, slices, groups, scene.opacity_stop + nudge.stop, rgba, depth)
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


def before_limit(depths: Array, limit: Array, spacing: float) -> Mask:
    """Return which points of slices are in front of a depth limit, (S, h, w)."""
    return np.asarray(depths[:, None, None] < limit - 1e-6 * spacing)


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


def entries(scene: Scene, domain: Box | None, camera: Camera, size: tuple[int, int]) -> tuple[Array, Array]:
    """Return where rays enter what clip and domain keep: depths (h, w) and outward normals (h, w, 3) of faces."""
    w, h = size
    everywhere = np.ones((h, w), bool)
    start, end = (ray_points(camera, size, everywhere, np.full(h * w, t)) for t in (0.0, 1.0))
    depth, normal = np.full(h * w, -np.inf), np.zeros((h * w, 3))
    clips = [scene.clip or Clip(), Clip(box=domain)]
    for outward, least in [face for clip in clips for face in clip.faces(camera, scene.spacing())]:
        rises = (end - start) @ outward
        found = (least - start @ outward) / np.where(rises > 0, rises, 1.0)
        later = (rises > 0) & (found > depth + 1e-3 * scene.spacing())
        depth[later], normal[later] = found[later], -outward
    return depth.reshape(h, w), normal.reshape(h, w, 3)


def face_share(scene: Scene, behind: Array, alpha: Array, in_front: Array) -> Array:
    """Return what normals of cuts count, so far behind them, where slices have these opacities."""
    if not scene.cut_faces:
        return np.zeros(len(behind))
    unit_length = max(scene.spacing(), scene.length())
    with np.errstate(divide="ignore"):
        tau = np.minimum(-np.log1p(-alpha) * unit_length / scene.spacing(), 24 * math.log(2))
        hidden = -np.log1p(-in_front)
    d = behind / unit_length
    through = hidden / np.where(tau > 0, tau, 1)
    return np.asarray((1 - np.exp(-4 * tau)) * np.clip(2 - d / 4, 0, 1) * np.clip(2 - (d - through), 0, 1))


# Colour, gradient, pixels, depth and opacity to shaded colour.
Shader = Callable[[Array, Array, Mask, Array, Array], Array]


@dataclass
class Slices:
    """What is composited: S slices of h x w pixels."""

    depths: Array  # (S,) the first and the last are of slices that do not exist
    kept: Mask  # (S, h, w) by clipping
    lengths: Array  # (h, w) of a slice along the ray, in reference lengths
    cut: bool  # the near plane removes what is before slice 1


@dataclass
class Group:
    """Fields whose ρ add up, on those slices."""

    tf: TransferFunction  # of ρ - base
    base: float
    rho: Array  # (S, h, w) less the base
    empty: Mask  # (S, h, w)
    inside: Mask  # (S, h, w) the group's domain
    slopes: Array  # (S, h, w, 3) gradients of rho, eye axes
    shaded: Shader


def _scalar(mode: str, rho: Array, counts: Mask, kept: Mask, lengths: Array) -> Array:
    """Return the picture of a scalar mode (section 7)."""
    counted = kept & counts
    total = np.where(counted, rho, 0.0).sum(0)
    if mode == "xray":
        return np.asarray(total * lengths)
    if mode == "mip":
        found = np.where(counted, rho, -np.inf).max(0, initial=-np.inf)
    elif mode == "minimum":
        found = np.where(counted, rho, np.inf).min(0, initial=np.inf)
    else:
        found = total / np.maximum(1, counted.sum(0))
    return np.where(counted.any(0), found, np.nan)


def _put_behind(rgba: Array, depth: Array, at: Mask, colour: Array, alpha: Array, t: Array) -> None:
    """Composite colours of some pixels behind what is there (section 6), and note where A reaches one half."""
    before = rgba[at, 3]
    rgba[at, :3] += ((1 - before) * alpha)[:, None] * colour
    rgba[at, 3] += (1 - before) * alpha
    depth[at] = np.where((before < 0.5) & (rgba[at, 3] >= 0.5), t, depth[at])


def _composite(scene: Scene, slices: Slices, groups: list[Group], stop: float, rgba: Array, depth: Array) -> None:
    """Composite slices, or intervals between them, front to back into rgba and depth (section 6)."""
    for s in range(len(slices.depths) - 1):
        live = rgba[..., 3] < stop
        middle = (slices.depths[s] + slices.depths[s + 1]) / 2
        # Per pixel: α of all groups, and the sums of τ and of τ times the colour.
        alpha, tau, tau_c = np.zeros(live.shape), np.zeros(live.shape), np.zeros((*live.shape, 3))
        for group in groups:
            is_open = slices.kept & ~group.empty
            at = live & (is_open[s] | is_open[s + 1] if scene.preintegration else is_open[s])
            gradient = group.slopes[s][at]
            if scene.preintegration:
                gradient = (gradient + group.slopes[s + 1][at]) / 2
            share = gradient_share(scene, gradient)
            if scene.preintegration == "second_order":
                four = [
                    group.rho[n][at] if 0 <= n < len(group.rho) else np.zeros(at.sum()) for n in range(s - 1, s + 3)
                ]
                own, premultiplied = second_order(group.tf, four, slices.lengths[at] * share)
                colour = premultiplied / np.where(own > 0, own, 1)[:, None]
                weight, t = np.where(own > 0, 1.0, 0.0), middle
            elif scene.preintegration:
                mean, mean_c = ramp_means(group.tf, group.rho[s][at], group.rho[s + 1][at])
                own = -np.expm1(-slices.lengths[at] * share * mean)
                colour = mean_c / np.where(mean > 0, mean, 1)[:, None]
                weight, t = mean * share, middle
            else:
                classified = group.tf(group.rho[s][at])
                opacity, colour = classified[:, 3] * share, classified[:, :3]
                own = slice_opacity(opacity, slices.lengths[at])
                weight, t = -np.log1p(-np.minimum(opacity, MOST_OPACITY)), slices.depths[s]
            lit = group.shaded(colour, gradient, at, np.full(at.sum(), t), own)
            alpha[at] += (1 - alpha[at]) * own
            tau[at] += weight
            tau_c[at] += weight[:, None] * lit
        some = live & (tau > 0)
        reported = max(middle, slices.depths[1]) if scene.preintegration else slices.depths[s]
        colour = tau_c[some] / tau[some][:, None]
        _put_behind(rgba, depth, some, colour, alpha[some], np.full(some.sum(), reported))


def _isosurface(scene: Scene, slices: Slices, groups: list[Group], stop: float, rgba: Array, depth: Array) -> None:
    """Composite the crossings of the iso values into rgba and depth (section 7)."""
    surfaces = [(group, value - group.base, opacity) for group in groups for value, opacity in scene.surfaces()]
    spacing = slices.depths[1] - slices.depths[0]
    for s in range(1 if slices.cut else 0, len(slices.depths) - 1):
        crossed = np.array([(g.rho[s] < value) != (g.rho[s + 1] < value) for g, value, _ in surfaces])
        crossed &= np.array([g.inside[s] & g.inside[s + 1] for g, _, _ in surfaces])
        crossed &= slices.kept[s] & slices.kept[s + 1]
        place = np.full(crossed.shape, np.inf)
        for number, (g, value, _) in enumerate(surfaces):
            at = crossed[number]
            place[number][at] = (value - g.rho[s][at]) / (g.rho[s + 1][at] - g.rho[s][at])
        order = np.argsort(place, axis=0, kind="stable")
        for rank in range(len(surfaces)):
            for number, (g, value, opacity) in enumerate(surfaces):
                at = (order[rank] == number) & crossed[number] & (rgba[..., 3] < stop)
                share = place[number][at]
                gradient = g.slopes[s][at] * (1 - share)[:, None] + g.slopes[s + 1][at] * share[:, None]
                t = slices.depths[s] + share * spacing
                colour = np.broadcast_to(g.tf(np.array(value))[:3], gradient.shape)
                lit = g.shaded(colour, gradient, at, t, np.zeros(at.sum()))
                _put_behind(rgba, depth, at, lit, np.full(share.shape, opacity), t)


# Section 9: ambiguous pixels and gentle scenes


def ambiguous(scene: Scene, camera: Camera, size: tuple[int, int], picture: Picture) -> Mask:
    """Return the pixels that change by more than 1e-3 when ρ, the supports' radius or A_stop is nudged."""
    found = np.zeros((size[1], size[0]), bool)
    if picture.rgba is None:
        return found
    nudges = []
    for sign in (-1, 1):
        nudges.append(Nudge(rho=sign * 1e-5))
        nudges.append(Nudge(support=1 + sign * 1e-5))
        if not scene.scalar:
            nudges.append(Nudge(stop=sign * 1e-5))
    for nudge in nudges:
        moved = render(scene, camera, size, nudge).rgba
        assert moved is not None
        found |= np.abs(moved - picture.rgba).max(-1) > 1e-3
    return found


def is_gentle(scene: Scene, camera: Camera, size: tuple[int, int]) -> bool:
    """Return whether the tighter bound of section 9 holds: slopes of at most 10 and, at t_c, a pixel of ℓ/100."""
    return all(_is_gentle(tf, scene, camera, size) for _, tf in scene.groups())


def _is_gentle(tf: TransferFunction, scene: Scene, camera: Camera, size: tuple[int, int]) -> bool:
    table, span = tf.table(), tf.span()
    steps = np.diff(table[:, 0])
    rises = np.abs(np.diff(table[:, 1:], axis=0)).max(-1)
    if span == 0 or (rises[steps == 0] > 0).any():
        return False
    tall = camera.height_at_one()
    stretch = math.sqrt(1 + (tall / 2) ** 2 * (1 + (size[0] / size[1]) ** 2)) if camera.is_perspective else 1.0
    centre = place(scene, camera, size, Nudge()).centre if camera.is_perspective else 1.0
    slope = (rises[steps > 0] / steps[steps > 0]).max() * span
    pixel = tall / size[1] * centre
    return bool(slope * scene.spacing() * stretch / scene.length() <= 10 and pixel >= scene.length() / 100)

"""Kernels that are small beside pixels or slices: those that call for the filter, and what is lost without it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, triple
from sheetsplat.camera import Camera
from sheetsplat.fields import BrickedField, BrickedKernels, EllipsoidField, Field, RegularField
from sheetsplat.fields.ending import DOMAIN, heights
from sheetsplat.look.visible import camera_axes, corners_of, depths_of
from sheetsplat.modes import TRAITS
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]

# Kernels of a field that are looked at; of more, every n-th.
_MOST = 50_000
# Kernels whose neighbours are looked at; one with less than this times its own weight at its centre stands alone.
_ENOUGH = 256
_ALONE = 2.0
#: Kernels between slices are told from this share of what shows on; `image.error` cannot see them.
LEAST_UNMET = 1e-3
# What rounding makes of equal lengths.
_EQUAL = 1.0 + 1e-6
#: The filter is taken in these modes where kernels of such a share of the mass are coarsely sampled, or where their
#: mass is expected to be wrong by such a share.
LEAST_COARSE = 1e-3
LEAST_WRONG = 2e-3
#: A picture that loses, or gains, this share of its mass is warned of.
LEAST_LOST = 1e-2
# The mass of a kernel that is coarsely sampled depends on where pixels and slices lie by at least this share: one
# of falloff 8 whose support is three pixels wide, or as many slices long.
_COARSE = 0.1
# So many samples across a volume of one value have its mass within a hundredth, wherever its faces lie between them.
# Where values at the faces are other than their mean it is in proportion, up to a limit; hardly any do not count.
_ENOUGH_ACROSS = 200.0
_MOST_JUMP = 2.0
_JUMP = 1e-2
# Samples across a volume whose values at the faces are 0: the filter spreads each by some. Parts of a pixel across
# below which more samples do not find it, and the least sine of the angle between a face and a slice.
_LEAST_ACROSS, _NARROWEST, _LEAST_TILT = 8.0, 0.25, 1e-9
# A view is along an axis of the world whose part in its direction is above this; a volume has so many slices at least.
_ALONG = 1.0 - 1e-6
_FEWEST_SLICES = 4
# Samples across the box of a clip, and slices in it seen along an axis: what it cuts counts to a thousandth.
_ACROSS_CUTS, _SLICES_OF_CUTS, _SLICES_OF_REGIONS = 1600.0, 512, 128
_FACES = ([0, -1], (slice(None), [0, -1]), (slice(None), slice(None), [0, -1]))
# Pixels and slices on each side of a kernel that are looked at for what it loses; larger ones lose nothing that way.
_NEIGHBOURS = 4
# Kernels that are looked at for it, and those whose neighbours are.
_LOOKED_AT = 4096
_WEIGHED = 2048
# A scalar is a mean of kernels where their weights add up to more than this times w0.
_MEAN = 1.5
#: The filter is not taken where means are more than this share of the mass: it would only widen them.
MOST_MEANS = 0.01


@dataclass(frozen=True)
class Small:
    """The small ones among the scattered kernels that show and lie in the picture.

    Shares are parts of what all of these kernels cover in the picture, each its area times its opacity.

    Attributes
    ----------
    share
        Share of those that are narrower than two pixels, half a pixel for the standard deviation of a Gaussian, or
        thinner than a slice distance along the view, and stand alone: sums of many that overlap are as smooth as those
        of larger ones.
    hidden
        Share of the small ones whose values the filter would lower to where nothing shows.
    """

    share: float = 0.0
    hidden: float = 0.0


@dataclass(frozen=True)
class Unmet:
    """The scattered kernels in the picture that would show and that no slice meets.

    Attributes
    ----------
    share
        Their share of what all kernels that show cover in the picture, as in `Small`.
    count
        How many; an estimate where a field has more than 50,000 kernels.
    thinnest
        The shortest semi-axis of one of them along the view, world units; infinite without any.
    """

    share: float = 0.0
    count: int = 0
    thinnest: float = math.inf


@dataclass(frozen=True)
class Sums:
    """How well pixels and slices sample the kernels in the picture whose sums along rays it shows.

    Shares are parts of the mass of all of them, each its integral times its value, of either sign.

    Attributes
    ----------
    coarse
        Share of those whose mass depends on where pixels and slices lie by a tenth and more.
    wrong
        By which share the mass of all is expected to be wrong, if pixels and slices lie anywhere.
    means
        Share of those, of normalisation "threshold", that lie where weights add up to more than w0: what is shown
        there is a mean, of which the filter keeps nothing.
    """

    coarse: float = 0.0
    wrong: float = 0.0
    means: float = 0.0

    @property
    def lose_mass(self) -> bool:
        """Whether a picture without the filter is expected not to have the mass of what it shows."""
        return self.coarse >= LEAST_COARSE or self.wrong >= LEAST_WRONG


@dataclass(frozen=True)
class ShownKernels:
    """Kernels of a field that show and lie in the picture, every `step`-th of those there are.

    `optical_depths` are those of values, for the field's group.
    """

    field: EllipsoidField
    step: int
    picked: NDArray[np.int64]
    # Rows: right, up and back in the camera's space.
    axes: Floats
    depths: Floats
    # Width of a pixel at the kernel's depth.
    pixels: Floats
    # Half the length along the view, the width of the projection, and its area times opacity.
    halves: Floats
    widths: Floats
    covers: Floats
    optical_depths: Callable[[Floats], Floats]


def small_kernels(scene: Scene, camera: Camera, size: tuple[int, int]) -> Small:
    """Return what a scene has of small kernels, as a camera sees it without a filter."""
    covered = small = hidden = 0.0
    for shown in shown_kernels(scene, camera, size):
        covered += float(shown.covers.sum()) * shown.step
        found = (shown.widths < shown.pixels) | (2.0 * shown.halves < scene.slice_spacing)
        alone = shown.step * _share_alone(shown.field, shown.picked[found])
        gone = shown.optical_depths(_filtered_values(shown, found, scene.slice_spacing)) <= 0.0
        small += float(shown.covers[found].sum()) * alone
        hidden += float(shown.covers[found][gone].sum()) * alone
    return Small(small / covered, hidden / covered) if covered > 0.0 else Small()


def unmet_kernels(scene: Scene, camera: Camera, size: tuple[int, int]) -> Unmet:
    """Return what a scene has of kernels that no slice meets, as a camera sees it without a filter."""
    low, high = _centres(scene)
    middle = float(depths_of(np.asarray([0.5 * (low + high)]), camera)[0])
    covered, unmet, count, thinnest = 0.0, 0.0, 0, math.inf
    for shown in shown_kernels(scene, camera, size):
        # Slices lie at middle + (n + 1/2) spacing.
        place = (shown.depths - middle) / scene.slice_spacing - 0.5
        missed = np.abs(place - np.round(place)) * scene.slice_spacing >= shown.halves
        covered += float(shown.covers.sum()) * shown.step
        unmet += float(shown.covers[missed].sum()) * shown.step
        count += int(missed.sum()) * shown.step
        thinnest = min(thinnest, float(np.min(shown.halves[missed], initial=math.inf)))
    return Unmet(unmet / covered, count, thinnest) if covered > 0.0 else Unmet()


def sampled_sums(scene: Scene, camera: Camera, size: tuple[int, int]) -> Sums:
    """Return how well a picture without a filter samples the scattered kernels that it shows sums of.

    A sum of samples a distance d apart is the integral up to the spectrum at 1/d and its multiples: of a Gaussian of
    the standard deviation s up to 2 exp(-2 pi^2 s^2 / d^2), more or less by where the samples lie.
    """
    total = coarse = squares = means = 0.0
    for shown in shown_kernels(scene, camera, size):
        masses, times = _masses(shown), float(shown.step)
        across, along = _sampling_errors(shown, scene.slice_spacing)
        errors = np.minimum(across + along, 1.0)
        if shown.field.normalization == "threshold":
            # What a kernel adds to a mean is its share of the weights there.
            each = max(1, math.ceil(len(masses) / _WEIGHED))
            picked, w0 = shown.picked[::each], shown.field.w0
            weights = shown.field.weight_at(shown.field.centers[picked])
            masses, errors, times = masses[::each], errors[::each], times * each
            if shown.field.weights is not None:
                masses = masses * shown.field.weights[picked]
            masses = masses / np.maximum(weights, w0)
            mean = weights > _MEAN * w0
            means += float(masses[mean].sum()) * times
            # (More samples a pixel help there, and slices stay.)
            errors[mean] = across[::each][mean]
        total += float(masses.sum()) * times
        coarse += float(masses[errors >= _COARSE].sum()) * times
        squares += float(np.square(masses * errors).sum()) * times
    if total <= 0.0:
        return Sums()
    return Sums(coarse / total, math.sqrt(squares) / total, means / total)


def coarse_lattice(scene: Scene, camera: Camera, size: tuple[int, int], times: float = 1.0) -> str:
    """Return what is longer than `times` the sample distance of a lattice whose sums are shown; "" where nothing is.

    Samples a distance h apart have waves down to a length of 2 h. Pixels, or slices, farther apart than h do not tell
    these from longer ones.
    """
    for one in scene.fields:
        if not isinstance(one, RegularField) or not one.size or one.normalization == "threshold":
            continue
        distance, wide = _sample_distance(one), widest_pixel(camera, size, one.centre_bounds)
        if wide > times * distance * _EQUAL:
            return f"a pixel is up to {wide / distance:.3g} samples of a volume wide"
        if scene.slice_spacing > times * distance * _EQUAL:
            return f"slices are {scene.slice_spacing / distance:.3g} samples of a volume apart"
    return ""


def samples_for_ends(scene: Scene, camera: Camera, size: tuple[int, int], *, cuts: bool = False) -> int:
    """Return how many samples a pixel along each axis an x-ray needs where volumes end with a jump.

    `cuts`: and where the box of a clip cuts them.

    A volume of n pixels has the mass of n + 1/2 of them or of n - 1/2, along each axis, by where its faces lie between
    pixels. And what the filter spreads beyond the end is cut off, whatever the values there. 1: one sample is enough.
    """
    if not TRAITS[scene.mode].integrates:
        return 1
    count = 1
    for end in _ends(scene, cuts=cuts):
        corners = end.corners
        seen = (corners - np.asarray(camera.eye)) @ camera_axes(camera)[:2].T
        if camera.kind == "perspective":
            seen /= np.maximum(depths_of(corners, camera), camera.near)[:, None]
        pixels = np.ptp(seen, axis=0).min() / _pixel(camera, size)
        # Of each pair of faces the distance within a slice.
        tilts = np.linalg.norm(end.normals @ camera_axes(camera)[:2].T, axis=1)
        narrow = (end.lengths / np.maximum(tilts, _LEAST_TILT)).min()
        narrow /= widest_pixel(camera, size, (corners.min(axis=0), corners.max(axis=0)))
        count = max(
            count, math.ceil(end.across / max(float(pixels), 1.0)), math.ceil(_LEAST_ACROSS / max(narrow, _NARROWEST))
        )
    return count


@dataclass(frozen=True)
class _End:
    """What is shown ends at the faces of a parallelepiped.

    Attributes
    ----------
    corners
        (8, 3), world.
    normals, lengths
        Unit normals of its pairs of faces, (3, 3), and their distances, (3,).
    across, slices
        Samples across it, and slices in it, that an x-ray needs.
    """

    corners: Floats
    normals: Floats
    lengths: Floats
    across: float
    slices: int

    @classmethod
    def of_box(cls, box: Bounds, across: float, slices: int) -> _End:
        """Return that of a box along the world's axes."""
        return cls(corners_of(box), np.eye(3), np.subtract(box[1], box[0]), across, slices)


def _ends(scene: Scene, *, cuts: bool = True) -> Iterator[_End]:
    """Yield where what is shown ends: at the ends of fields, and at a clip."""
    for one in scene.fields:
        box = one.domain if one.size else None
        jump = None if box is None else _jump(one)
        if box is None or jump is None:
            continue
        needs = _ENOUGH_ACROSS * min(jump, _MOST_JUMP), _FEWEST_SLICES if jump > _JUMP else 0
        if isinstance(one, RegularField) and one.axes is not None:
            layer, normals = heights(one.steps)
            counts = np.array(one.shape[::-1])
            corners = one.origin + (corners_of(((0.0,) * 3, (1.0,) * 3)) * counts - DOMAIN) @ one.steps
            yield _End(corners, normals, layer * counts, *needs)
            continue
        bounded = np.where(np.isfinite(box), box, one.bounds)
        yield _End.of_box((triple("end", bounded[0]), triple("end", bounded[1])), *needs)
    # A clip cuts what it finds. At a sphere's edge pixels and slices are cut by chance, which averages out.
    clip = scene.options["clip"]
    if cuts and clip.box is not None and any(one.size for one in scene.fields):
        yield _End.of_box(clip.box, _ACROSS_CUTS, _SLICES_OF_CUTS)


def slices_for_ends(scene: Scene, camera: Camera) -> float | None:
    """Return a distance of slices that cut an x-ray of volumes into whole slabs, seen along an axis; None: as it is.

    Slices stand on both sides of the middle. Seen along an axis, all rays have as many inside of a volume, and these
    are as long as it is if they are an even number: of 3 layers 1 apart they would be 4, two of them on its faces.
    """
    if not TRAITS[scene.mode].integrates:
        return None
    wanted, back = scene.slice_spacing, camera_axes(camera)[2]
    region = scene.options["clip"].region
    if region is not None:
        # Slices that all rays share cut it in few places, whatever the direction.
        wanted = min(wanted, float(np.ptp(corners_of(region) @ back)) / _SLICES_OF_REGIONS)
    for end in _ends(scene):
        along = np.flatnonzero(np.abs(end.normals @ back) > _ALONG)
        length = float(end.lengths[along[0]]) if along.size else 0.0
        if end.slices and length > 0.0:
            wanted = min(wanted, length / max(2 * math.ceil(0.5 * length / wanted * (1.0 - 1e-9)), end.slices))
    return None if math.isclose(wanted, scene.slice_spacing, rel_tol=1e-9) else wanted


def _jump(field: Field) -> float | None:
    """Return by how much values jump where a field ends, over their mean: magnitudes, at samples that may be some.

    None where all are 0.
    """
    if not isinstance(field, RegularField):
        # In a periodic box they are at the faces what they are elsewhere.
        return 1.0
    coarse = np.abs(field.samples.on_grid(field.samples.steps).astype(np.float64))
    values = coarse if isinstance(field, BrickedField) else field.values
    mean = float(np.nanmean(coarse)) if np.isfinite(coarse).any() else 0.0
    faces = [float(np.nanmean(np.abs(values[face]))) for face in _FACES if np.isfinite(values[face]).any()]
    return max(faces, default=0.0) / mean if mean > 0.0 else None


def lost_mass(scene: Scene, camera: Camera, size: tuple[int, int]) -> float:
    """Return the share of the mass of scattered kernels that a picture of sums without a filter does not show.

    Negative where it shows more. Kernels smaller than a few pixels or slices are summed where pixels and slices lie,
    across the view and along it by themselves.
    """
    total = lost = 0.0
    for shown in shown_kernels(scene, camera, size):
        if not _shows_mass(shown.field):
            continue
        masses = _masses(shown)
        total += float(masses.sum()) * shown.step
        found = np.flatnonzero(sum(_sampling_errors(shown, scene.slice_spacing)) >= _COARSE)
        order = found[np.argsort(-masses[found], kind="stable")]
        # The heaviest ones, and some of the others, which stand for all of those.
        heavy, light = order[: _LOOKED_AT // 2], order[_LOOKED_AT // 2 :]
        each = max(1, math.ceil(len(light) / (_LOOKED_AT // 2)))
        for some, times in ((heavy, 1), (light[::each], each)):
            kept = _sampled_share(shown, some, scene, camera, size)
            lost += float((masses[some] * (1.0 - kept)).sum()) * times * shown.step
    return lost / total if total > 0.0 else 0.0


def may_be_thin(scene: Scene, camera: Camera, size: tuple[int, int]) -> bool:
    """Return whether some scattered kernel, shown or not, is smaller than two pixels or a slice distance."""
    if may_be_flat(scene):
        return True
    thinnest = min((one.scale_range[0] / _longer(one) for one in _scattered(scene)), default=math.inf)
    return math.isfinite(thinnest) and thinnest < widest_pixel(camera, size, _centres(scene))


def may_be_flat(scene: Scene) -> bool:
    """Return whether some scattered kernel, shown or not, is thinner than a slice distance."""
    return any(2.0 * one.scale_range[0] / _longer(one) < scene.slice_spacing for one in _scattered(scene))


def _longer(field: EllipsoidField) -> float:
    """Return how many times the semi-axes of a sample of kernels in bricks are as long as the kernels' own."""
    return field.facts.stride ** (1.0 / 3.0) if isinstance(field, BrickedKernels) else 1.0


def _scattered(scene: Scene) -> list[EllipsoidField]:
    return [one for one in scene.fields if isinstance(one, EllipsoidField) and one.size > one.ghosts]


def shown_kernels(scene: Scene, camera: Camera, size: tuple[int, int]) -> Iterator[ShownKernels]:
    """Yield the kernels of each scattered field that show and lie in the picture."""
    for group, function in zip(scene.groups, scene.transfer_functions, strict=True):
        for field in group:
            if isinstance(field, EllipsoidField) and field.size > field.ghosts:
                found = partial(optical_depths, scene=scene, function=function)
                yield _shown_of(field, found, camera, size)


def _shown_of(
    field: EllipsoidField, optical: Callable[[Floats], Floats], camera: Camera, size: tuple[int, int]
) -> ShownKernels:
    known = field.size - field.ghosts
    step = max(1, math.ceil(known / _MOST))
    picked = np.arange(0, known, step)
    if field.weights is not None:
        picked = picked[field.weights[picked] > 0]
    pixel = _pixel(camera, size)
    depths, inside = _in_picture(field.centers[picked], camera, size, pixel)
    thickness = optical(_values(field, picked))
    kept = inside & (thickness > 0)
    picked, depths, opacity = picked[kept], depths[kept], -np.expm1(-thickness[kept])
    pixels = pixel * depths if camera.kind == "perspective" else np.full(len(depths), pixel)
    axes = np.einsum("ai,nij->naj", camera_axes(camera), field.native.shapes(picked)) / _longer(field)
    # The projection's semi-axes are the singular values of the first two rows.
    a, b = np.sum(axes[:, 0] ** 2, axis=1), np.sum(axes[:, 1] ** 2, axis=1)
    c = np.sum(axes[:, 0] * axes[:, 1], axis=1)
    area = np.sqrt(np.maximum(a * b - c * c, 0.0))
    widths = area / np.sqrt(0.5 * (a + b + np.hypot(a - b, 2.0 * c)))
    halves = np.linalg.norm(axes[:, 2], axis=1)
    return ShownKernels(field, step, picked, axes, depths, pixels, halves, widths, opacity * area, optical)


def _share_alone(field: EllipsoidField, picked: NDArray[np.int64]) -> float:
    """Return the share of kernels that stand alone."""
    if not len(picked):
        return 0.0
    some = picked[:: math.ceil(len(picked) / _ENOUGH)]
    own = 1.0 if field.weights is None else field.weights[some]
    return float(np.mean(field.weight_at(field.centers[some]) < _ALONE * own))


def _shows_mass(field: EllipsoidField) -> bool:
    """Return whether a field is a sum of kernels, which the filter keeps; of means it keeps nothing."""
    return field.normalization != "threshold"


def _sample_distance(field: RegularField) -> float:
    """Return the least distance of samples along an axis, world units; of BCC that of its layers' neighbours."""
    return field.spacing[0] / math.sqrt(2.0) if field.lattice == "bcc" else float(heights(field.steps)[0].min())


def _masses(shown: ShownKernels) -> Floats:
    """Return integrals of kernels times their values, without sign, up to a factor of the field."""
    return np.asarray(np.abs(_counted(shown.field, shown.picked)) * np.abs(np.linalg.det(shown.axes)))


def _deviation(falloff: float) -> float:
    """Return the standard deviation of a kernel's profile along an axis, in semi-axes. Conventions, section 2."""
    r = (np.arange(256) + 0.5) / 256
    weights = np.square(r) * (np.exp(-falloff * np.square(r)) - math.exp(-falloff))
    return math.sqrt(float((weights * np.square(r)).sum() / weights.sum()) / 3.0)


def _sampling_errors(shown: ShownKernels, spacing: float) -> tuple[Floats, Floats]:
    """Return by how much the sums over pixels and over slices of each kernel may differ from its integral, 0 to 1."""
    deviation = _deviation(shown.field.falloff)
    across = 2.0 * np.exp(-2.0 * np.square(math.pi * deviation * shown.widths / shown.pixels))
    along = 2.0 * np.exp(-2.0 * np.square(math.pi * deviation * shown.halves / spacing))
    return np.asarray(np.minimum(across, 1.0)), np.asarray(np.minimum(along, 1.0))


def _sampled_share(
    shown: ShownKernels, which: NDArray[np.int64], scene: Scene, camera: Camera, size: tuple[int, int]
) -> Floats:
    """Return the sum over pixels and slices of kernels over their integrals; 1 where they are large along all axes."""
    if not len(which):
        return np.ones(0)
    k, pixels = shown.field.falloff, shown.pixels[which]
    low, high = _centres(scene)
    middle = float(depths_of(np.asarray([0.5 * (low + high)]), camera)[0])
    # Along the view: the profile's integral over a section across it.
    place = (shown.depths[which] - middle) / scene.slice_spacing - 0.5
    steps = np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1)
    halves = shown.halves[which] / scene.slice_spacing
    u = (np.round(place)[:, None] + steps - place[:, None]) / halves[:, None]
    along = _section(u, k).sum(axis=1) / (halves * _integral(k, 1))
    along[halves > _NEIGHBOURS] = 1.0
    # Across the view: the profile's integral along the view, over the projected ellipse.
    rows = shown.axes[which, :2] / pixels[:, None, None]
    inverse = np.linalg.inv(rows @ np.swapaxes(rows, 1, 2))
    right, up, _ = camera_axes(camera)
    away = shown.field.centers[shown.picked[which]] - np.asarray(camera.eye)
    centres = np.column_stack((away @ right / pixels, away @ up / pixels))
    centres += 0.5 * np.asarray(size) - np.asarray(camera.shift) * size[1] - 0.5
    offsets = np.round(centres)[:, None] + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
    offsets -= centres[:, None]
    r2 = np.einsum("nmi,nij,nmj->nm", offsets, inverse, offsets)
    areas = np.sqrt(1.0 / np.linalg.det(inverse))
    across = _line(r2, k).sum(axis=1) / (areas * _integral(k, 2))
    across[np.abs(rows).max(axis=(1, 2)) > _NEIGHBOURS] = 1.0
    return np.asarray(across * along)


def _section(u: Floats, k: float) -> Floats:
    """Return the profile's integral over the section at u semi-axes from its centre, up to a factor."""
    inside = np.square(np.minimum(np.abs(u), 1.0))
    return np.asarray(np.exp(-k * inside) - math.exp(-k) - k * math.exp(-k) * (1.0 - inside))


def _line(r2: Floats, k: float) -> Floats:
    """Return the profile's integral along a line at the square of a distance from its centre, up to a factor."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.sqrt(np.maximum(1.0 - r2, 0.0))
    found = np.zeros_like(r2)
    for node, weight in zip(nodes, weights, strict=True):
        found += weight * (np.exp(-k * (np.minimum(r2, 1.0) + np.square(half * node))) - math.exp(-k))
    return np.asarray(half * found)


def _integral(k: float, dimensions: int) -> float:
    """Return the integral of `_section` (1) over its axis, or of `_line` (2) over the unit disk."""
    r = (np.arange(2048) + 0.5) / 2048
    if dimensions == 1:
        return float(2.0 * _section(r, k).mean())
    return float((2.0 * math.pi * r * _line(np.square(r), k)).mean())


def _filtered_values(shown: ShownKernels, which: NDArray[np.bool_], spacing: float) -> Floats:
    """Return the scalar that a kernel alone would have at its centre with the filter (conventions, section 10)."""
    field, picked, axes = shown.field, shown.picked[which], shown.axes[which]
    added = np.zeros((len(picked), 3, 3))
    added[:, 0, 0] = added[:, 1, 1] = 0.5 * field.falloff * np.square(shown.pixels[which])
    added[:, 2, 2] = 0.5 * field.falloff * spacing * spacing
    own = axes @ np.swapaxes(axes, 1, 2)
    height = np.sqrt(np.maximum(np.linalg.det(own), 0.0) / np.linalg.det(own + added))
    if field.normalization == "threshold":
        weights = 1.0 if field.weights is None else field.weights[picked]
        height = np.minimum(height * weights / field.w0, 1.0)
    return np.asarray(field.base + _counted(field, picked) * height)


def _values(field: EllipsoidField, picked: NDArray[np.int64]) -> Floats:
    """Return the scalar that a kernel alone would have at its centre."""
    return np.asarray(field.base + _counted(field, picked))


def _counted(field: EllipsoidField, picked: NDArray[np.int64]) -> Floats:
    """Return the same offset by the field's base."""
    values = field.values[picked] - field.base
    if field.normalization == "threshold":
        return np.asarray(values)
    if field.weights is not None:
        values = values * field.weights[picked]
    return np.asarray(values / field.native.lattice_constant if field.normalization == "lattice" else values)


def optical_depths(values: Floats, scene: Scene, function: TransferFunction) -> Floats:
    """Return the optical depth over the reference length of values; in modes without opacity 1 where they count."""
    if TRAITS[scene.mode].shows_surfaces:
        lowest = min((value for value, opacity in scene.surfaces if opacity > 0), default=math.inf)
        return np.where(values >= lowest, 1.0, 0.0)
    if not TRAITS[scene.mode].is_composited:
        return np.where(values != 0.0, 1.0, 0.0)
    found: Floats = -np.log1p(-np.minimum(function.at(values)[..., 3], 1.0 - 1e-9))
    return found


def _pixel(camera: Camera, size: tuple[int, int]) -> float:
    """Return the width of a pixel, world units; in perspective at a depth of 1."""
    if camera.kind == "orthographic":
        return camera.height / size[1]
    return 2.0 * math.tan(0.5 * math.radians(camera.fov_y)) / size[1]


def widest_pixel(camera: Camera, size: tuple[int, int], box: Any) -> float:
    """Return the width of a pixel where a box is farthest from the camera, world units."""
    pixel = _pixel(camera, size)
    if camera.kind == "orthographic":
        return pixel
    return pixel * max(float(depths_of(corners_of(box), camera).max()), camera.near)


def _in_picture(
    points: Floats, camera: Camera, size: tuple[int, int], pixel: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the depths of points, and which of them lie in the picture."""
    right, up, back = camera_axes(camera)
    away = points - np.asarray(camera.eye)
    depth = -(away @ back)
    width = pixel * np.maximum(depth, 0.0) if camera.kind == "perspective" else pixel
    x, y = (one * size[1] * width for one in camera.shift)
    inside = (np.abs(away @ right - x) <= 0.5 * size[0] * width) & (np.abs(away @ up - y) <= 0.5 * size[1] * width)
    if camera.kind == "perspective":
        inside &= depth > camera.near
    return depth, inside


def _centres(scene: Scene) -> tuple[Floats, Floats]:
    """Return the corners of the box around the centres of all kernels, which anchors the slices."""
    boxes = [one.centre_bounds for one in scene.fields if one.size]
    corners = np.asarray(boxes, dtype=np.float64)
    return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)

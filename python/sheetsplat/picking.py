"""What is seen at a pixel: the place along its ray, and the field there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, number, shown, triple
from sheetsplat.camera import Camera, Rays
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import EllipsoidField, Field, RegularField, Wrapping
from sheetsplat.fields.summed import as_summed
from sheetsplat.labels import LabelColors
from sheetsplat.limits import in_front
from sheetsplat.modes import TRAITS
from sheetsplat.planes_in_view import nearest, planes_of
from sheetsplat.transfer import TransferFunction

if TYPE_CHECKING:
    from sheetsplat.image import Image
    from sheetsplat.scene import Scene

Floats = NDArray[np.float64]
# A crossing is looked for in so many parts of an interval, and in as many of the part that has it.
_PARTS = 64


@dataclass(frozen=True)
class Pick:
    """What is seen at a pixel.

    Attributes
    ----------
    position
        World position. Of composited colours on the slice where the opacity of the pixel first reaches ½, as
        `Image.depth` has it; where it stays below ½, on the slice that contributes most. Of surfaces where the ray
        crosses the value; of several likewise. In scalar modes on the slice with the largest scalar; where the smallest
        is shown, with that. Where what lies in front of a slice plane stays below ½, on the plane.
    depth
        Its depth: world units from the eye along the view direction.
    value
        The scalar there, in float64, whatever the picture was drawn with: of the fields that add up; where groups have
        transfer functions of their own, of the group that is most opaque there, or whose surface it is.
    gradient
        Its derivatives along x, y, z, per world unit.
    opacity
        Opacity per reference length there; of an isosurface its own; of a slice plane 1; None in scalar modes.
    field
        Number of the field with the nearest kernel, in the scene.
    kernel
        Number of the kernel in that field whose centre is nearest among those that reach the position, in the data
        where the picture left kernels out (`Field.trim`); of volumes the number of the sample in ``values.ravel()``.
    sample
        (k, j, i) of that sample; None for scattered kernels.
    label, name
        The label that is seen, which `value` is too, and what it is called; None for values.

    Examples
    --------
    >>> image = ss.render(values, mode="isosurface", iso_value=0.5, direction=(0, 0, -1), up="y", size=(32, 32))
    >>> found = image.pick(16, 16)
    >>> round(found.value, 6)
    0.5
    >>> image.pick(0, 0) is None
    True
    """

    position: Triple
    depth: float
    value: float
    gradient: Triple
    opacity: float | None
    field: int
    kernel: int
    sample: tuple[int, int, int] | None = None
    label: int | None = None
    name: str | None = None


def _number(what: str, value: object, count: int) -> int:
    found = number(f"Image.pick: {what}", value)
    if not (math.isfinite(found) and 0 <= found < count):
        raise complain(
            unusable(f"Image.pick: {what}"), shown(value), f"from 0 to below {count}, a place in the picture"
        )
    return int(found)


@dataclass(frozen=True)
class _Samples:
    """What the fields of a group that add up are at points."""

    values: Floats
    slopes: Floats
    reached: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    base: float

    @classmethod
    def of(cls, fields: tuple[Field, ...], points: Floats) -> _Samples:
        """Return the scalar of all fields together, its gradient, whether any is not empty, and where they do not end.

        The fields end at one place, or nowhere.
        """
        values, slopes, reached = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros(len(points), bool)
        for field in fields:
            value, slope, nearest = field.probe(points)
            values, slopes, reached = values + value, slopes + slope, reached | (nearest >= 0)
        return cls(values, slopes, reached, fields[0].inside(points), sum(one.base for one in fields))

    @classmethod
    def sum_of(cls, groups: list[tuple[Field, ...]], points: Floats) -> _Samples:
        """Return the same of groups that add up where they do not end."""
        parts = [cls.of(fields, points) for fields in groups]
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.sum([np.where(one.inside, one.values, 0.0) for one in parts], axis=0),
            np.sum([np.where(one.inside[:, None], one.slopes, 0.0) for one in parts], axis=0),
            np.any([one.reached for one in parts], axis=0),
            np.any([one.inside for one in parts], axis=0),
            sum(one.base for one in parts),
        )


@dataclass(frozen=True)
class _Shown:
    """What is classified by itself: a group of fields, or a label."""

    fields: tuple[Field, ...]
    # Number of the first of them in the scene.
    first: int
    function: TransferFunction
    surfaces: tuple[tuple[float, float], ...]
    # Of a label, the volume of labels, and the other ones.
    label: int | None = None
    name: str | None = None
    others: tuple[Field, ...] = ()

    def at(self, points: Floats) -> _Samples:
        """Return what is classified, at points; of a label how far it is above the largest of the others."""
        own = _Samples.of(self.fields, points)
        if self.label is None:
            return own
        largest, slopes = np.zeros(len(points)), np.zeros((len(points), 3))
        for other in self.others:
            value, slope, _ = other.probe(points)
            above = value > largest
            largest, slopes = np.where(above, value, largest), np.where(above[:, None], slope, slopes)
        reached = own.reached & (own.values > 0.0)
        return _Samples(own.values - largest, own.slopes - slopes, reached, own.inside, 0.0)


def _shown_of(scene: Scene) -> list[_Shown]:
    """Return what of a scene is classified by itself."""
    found: list[_Shown] = []
    first = 0
    for fields, function in zip(scene.groups, scene.transfer_functions, strict=True):
        volume = fields[0]
        if isinstance(volume, RegularField) and volume.labels:
            colors = LabelColors.of(function, volume.labels_found)
            parts = {one: volume.field_of_label(one) for one in volume.labels_found}
            for label, (*rgb, opacity) in colors.colors.items():
                if label in parts:
                    others = tuple(part for one, part in parts.items() if one != label)
                    step = TransferFunction([(0.0, *rgb, 0.0), (0.0, *rgb, opacity), (1.0, *rgb, opacity)])
                    name = colors.name_of(label)
                    found.append(
                        _Shown((parts[label],), first, step, ((0.0, opacity),), label=label, name=name, others=others)
                    )
        else:
            found.append(_Shown(as_summed(fields), first, function, scene.surfaces))
        first += len(fields)
    return found


def pick(image: Image, scene: Scene, x: object, y: object) -> Pick | None:
    """Return what is seen at a pixel of a picture of a scene; see `Image.pick`."""
    width, height = image.size
    column, row = _number("x", x, width), _number("y", y, height)
    ray = Rays.of(image.camera, image.size, column, row)
    plan = image.plan
    depths: Floats = plan.first_depth + plan.slice_spacing * np.arange(plan.slices, dtype=np.float64)
    if not depths.size:
        return None
    points = ray.at(depths)
    surface = math.inf if image.depth_limit is None else float(image.depth_limit[row, column])
    plane = _plane_at(scene, image.camera, ray, surface)
    surface, hides = min(surface, plane), plane < math.inf
    visible = in_front(surface, depths, plan.slice_spacing)
    kept, stop = scene.options["clip"].keeps(points) & visible, float(image.recipe.options["opacity_stop"])
    mode = TRAITS[scene.mode]
    if mode.is_scalar:
        fields_of = [as_summed(fields) for fields in scene.groups]
        all_fields = _Samples.sum_of(fields_of, points)
        shown_here = all_fields.reached & all_fields.inside & kept
        if not shown_here.any():
            return None
        every = tuple(one for fields in fields_of for one in fields)
        seen = np.flatnonzero(shown_here)
        return _pick_at(every, 0, ray, float(depths[seen[mode.shown_at(all_fields.values[seen])]]), None)
    things = _shown_of(scene)
    groups = [thing.at(points) for thing in things]
    if mode.shows_surfaces:
        # Slices behind the last one are empty, but a surface may hide them.
        behind = depths[-1:] + plan.slice_spacing
        open_back = bool(in_front(surface, behind, plan.slice_spacing)[0])
        beyond = ray.at(np.concatenate([depths[:1] - plan.slice_spacing, behind]))
        open_ends = np.array([not plan.cut_by_near, open_back])
        ends = [
            (bool(front), bool(back)) for front, back in (open_ends & one.fields[0].inside(beyond) for one in things)
        ]
        found = _seen_surface(things, groups, depths, kept, plan.slice_spacing, stop, ends, hides=hides)
        if found is None:
            return _on_plane(things, ray, plane) if hides else None
        return _surface_at(things[found[0].group], ray, *found)
    opacities = np.array(
        [_opacities(scene, thing.function, group, kept) for thing, group in zip(things, groups, strict=True)]
    )
    lengths = plan.slice_spacing * ray.stretch / scene.reference_length
    with np.errstate(divide="ignore"):
        alpha = -np.expm1(lengths * np.log1p(-opacities).sum(axis=0))
    n = _seen(alpha, stop, hides=hides)
    if n is None:
        return _on_plane(things, ray, plane) if hides else None
    # The group that is most opaque there.
    which = int(opacities[:, n].argmax())
    return _pick_of(things[which], ray, float(depths[n]), float(opacities[which, n]))


def _plane_at(scene: Scene, camera: Camera, ray: Rays, surface: float) -> float:
    """Return the depth of the slice plane on a ray that is nearest, infinite where none is before a surface."""
    planes = planes_of(scene)
    depth = float(nearest(planes, scene, camera, ray)[0]) if planes else math.inf
    return depth if depth <= surface else math.inf


def _on_plane(things: list[_Shown], ray: Rays, depth: float) -> Pick:
    """Return what is seen on a slice plane: of labels the one that is farthest above the others."""
    point = ray.at(np.asarray([depth]))
    return _pick_of(max(things, key=lambda one: one.at(point).values[0]), ray, depth, 1.0)


def _opacities(scene: Scene, function: TransferFunction, group: _Samples, kept: NDArray[np.bool_]) -> Floats:
    """Return opacities of a group per reference length; 0 where nothing is shown."""
    opacity: Floats = np.where(group.reached & group.inside & kept, function.at(group.values)[:, 3], 0.0)
    steep = scene.options["gradient_opacity"]
    if steep is not None:
        opacity *= np.minimum(1.0, np.sqrt((group.slopes * group.slopes).sum(axis=1)) / steep)
    return opacity


def _seen(alpha: Floats, stop: float, *, hides: bool) -> int | None:
    """Return where along a ray the opacity first reaches ½, else what contributes most; None without opacity.

    hides: an opaque plane lies behind all of it, and is what is seen where the opacity stays below ½.
    """
    left = np.concatenate([[1.0], np.cumprod(1.0 - alpha)])
    # A pixel is finished with what takes it to the stop.
    contributions = np.where(1.0 - left[:-1] < stop, left[:-1] * alpha, 0.0)
    total = np.cumsum(contributions)
    if not (total.size and total[-1] > 0):
        return None
    half = np.flatnonzero(total >= 0.5)
    if not half.size and hides:
        return None
    return int(half[0] if half.size else contributions.argmax())


@dataclass(frozen=True)
class _Crossing:
    """Where the ray crosses a surface, between two slices; ordered as surfaces are composited."""

    interval: int
    place: float
    group: int
    surface: int
    start: float
    end: float
    below_first: bool


def _seen_surface(
    things: list[_Shown],
    groups: list[_Samples],
    depths: Floats,
    kept: NDArray[np.bool_],
    spacing: float,
    stop: float,
    ends_kept: list[tuple[bool, bool]],
    *,
    hides: bool,
) -> tuple[_Crossing, float, float] | None:
    """Return the crossing that is seen, its value and its opacity, or None. Conventions, section 7 (Modes).

    ends_kept: of each group, whether the slices that there are not, before the first one and behind the last, may end
    an interval. hides: as for `_seen`.
    """
    ends = np.concatenate([[depths[0] - spacing], depths, [depths[-1] + spacing]])
    crossings = []
    for number_of_group, group in enumerate(groups):
        own, (front, back) = kept & group.inside, ends_kept[number_of_group]
        both = np.concatenate([[front], own]) & np.concatenate([own, [back]])
        # Outside of all slices the scalar is the base.
        values = np.concatenate([[group.base], group.values, [group.base]])
        for surface, (iso, opacity) in enumerate(things[number_of_group].surfaces):
            below = values < iso
            for n in np.flatnonzero((below[1:] != below[:-1]) & both).tolist() if opacity > 0 else ():
                place = (iso - values[n]) / (values[n + 1] - values[n])
                start, end = float(ends[n]), float(ends[n + 1])
                crossings.append(_Crossing(n, float(place), number_of_group, surface, start, end, bool(below[n])))
    crossings.sort(key=lambda one: (one.interval, one.place, one.group, one.surface))
    surfaces = [things[one.group].surfaces[one.surface] for one in crossings]
    seen = _seen(np.array([opacity for _, opacity in surfaces]), stop, hides=hides)
    return None if seen is None else (crossings[seen], *surfaces[seen])


def _surface_at(thing: _Shown, ray: Rays, crossing: _Crossing, iso: float, opacity: float) -> Pick:
    """Return what is seen where a ray crosses a surface, whose place between the slices is found first."""
    start, end = crossing.start, crossing.end
    for _ in range(2):
        inside = np.linspace(start, end, _PARTS + 1)
        scalars = thing.at(ray.at(inside)).values
        sides = scalars < iso
        # The ends are on their sides, whatever the field is beyond the last slice.
        sides[0], sides[-1] = crossing.below_first, not crossing.below_first
        m = int(np.flatnonzero(sides[1:] != sides[:-1])[0])
        start, end = float(inside[m]), float(inside[m + 1])
        here, there = float(scalars[m]), float(scalars[m + 1])
    share = (iso - here) / (there - here) if there != here else 0.5
    depth = start + min(max(share, 0.0), 1.0) * (end - start)
    return _pick_of(thing, ray, depth, opacity)


def _pick_of(thing: _Shown, ray: Rays, depth: float, opacity: float) -> Pick:
    """Return what is seen of a group, or of a label, at a depth of a ray."""
    found = _pick_at(thing.fields, thing.first, ray, depth, opacity)
    if thing.label is None:
        return found
    slope = triple("gradient", thing.at(ray.at(np.asarray([depth]))).slopes[0])
    return replace(found, value=float(thing.label), gradient=slope, label=thing.label, name=thing.name)


def _pick_at(fields: tuple[Field, ...], first: int, ray: Rays, depth: float, opacity: float | None) -> Pick:
    """Return what fields that add up are at a depth of a ray; `first`: the number of the first of them in the scene."""
    point = ray.at(np.asarray([depth]))
    probes = [field.probe(point) for field in fields]
    # Lattices add nothing outside of their domains.
    adds = [bool(field.inside(point)[0]) for field in fields]
    nearest = [int(numbers[0]) for _, _, numbers in probes]
    which = 0
    if len(fields) > 1:
        distances = [_distance(field, n, point[0]) for field, n in zip(fields, nearest, strict=True)]
        which = int(np.argmin(distances))
    field, kernel = fields[which], nearest[which]
    sample = _sample(field, kernel) if isinstance(field, RegularField) and kernel >= 0 else None
    value = float(sum(values[0] for (values, _, _), there in zip(probes, adds, strict=True) if there))
    slope = sum((slopes[0] for (_, slopes, _), there in zip(probes, adds, strict=True) if there), np.zeros(3))
    gradient = triple("gradient", slope)
    number_in_data = field.trim.number_in_data(kernel)
    return Pick(triple("position", point[0]), depth, value, gradient, opacity, first + which, number_in_data, sample)


def _sample(field: RegularField, kernel: int) -> tuple[int, int, int]:
    """Return (k, j, i) of a sample by its number."""
    k, j, i = (int(part) for part in np.unravel_index(kernel, field.shape))
    return k, j, i


def _distance(field: Field, kernel: int, point: Floats) -> float:
    """Return the distance of a kernel's centre from a point; infinite for -1, no kernel."""
    if kernel < 0:
        return math.inf
    if isinstance(field, RegularField):
        k, j, i = _sample(field, kernel)
        centre: Any = field.native.position(i, j, k)
    else:
        assert isinstance(field, EllipsoidField)
        centre = field.centers[kernel]
    offset = point - np.asarray(centre)
    if isinstance(field, EllipsoidField):
        offset = Wrapping(field.periodic).apart(offset)
    return float(np.linalg.norm(offset))

"""What a quality sets of the options that nobody gave: `Choice` follows a picture from its fields to its scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from sheetsplat._checks import choice
from sheetsplat.camera import Camera
from sheetsplat.fields import Field, RegularField
from sheetsplat.fields.regular import PLAIN_KERNEL
from sheetsplat.options.core import SUMMING, definitions
from sheetsplat.options.quality import QUALITIES
from sheetsplat.options.scene import MOST_SAMPLES, SceneOptions
from sheetsplat.plan import PictureQuality, QualitySetting
from sheetsplat.quality.samples import through_samples
from sheetsplat.quality.slicing import SLICES, can_be_estimated, depth_extent, has_lit_kernels, slicing_error
from sheetsplat.quality.thin import (
    LEAST_UNMET,
    LEAST_WRONG,
    MOST_MEANS,
    coarse_lattice,
    may_be_thin,
    sampled_sums,
    samples_for_ends,
    slices_for_ends,
    small_kernels,
    unmet_kernels,
)
from sheetsplat.scene import Scene
from sheetsplat.supersampling import fine_size

Made = TypeVar("Made", bound=Field)
_AS_GIVEN = "as given"
_ONE_SAMPLE = "one sample a pixel, at its centre"
_DEFAULT_STOP: Any = definitions(SceneOptions)["opacity_stop"].default
# Options that say how a lattice's sums become values: with one of them nothing is left to a prefilter.
_OWN_SUMS = ("normalization", "w0")
# The filter is taken where kernels that are smaller than two pixels, or a slice distance, are this share of what shows:
# there a picture with it is nearer to one of many samples a pixel than a picture without.
_LEAST_SHARE = 0.2
# The filter keeps the mass of kernels and so lowers their values: of the small ones this share may vanish by it.
_MOST_HIDDEN = 0.5
# Longest side, in samples, of pictures that get several samples a pixel for what they show sums of.
_MOST_FINE = 1600


@dataclass(frozen=True)
class _Samples:
    """Several samples a pixel, where light calls for few slices: more of both would take too long.

    Attributes
    ----------
    count
        Samples along each axis.
    slices
        Slices to one of the default distance. Where light calls for more, a pixel has one sample.
    """

    count: int
    slices: int


@dataclass(frozen=True)
class _Level:
    """What a quality sets.

    Attributes
    ----------
    kernel
        Radius and falloff of volumes whose values pass through their samples; None: plain sums.
    volumes, plain_volumes, scattered
        How many slices there are to one of the default distance, by the mode; 1 in modes that are not named. "unlit" is
        mode composite without lights, where named. Volumes of plain sums alone have smaller kernels, or fewer that
        show, so that more slices take the same time.
    few
        Of lit scattered kernels, whose thinnest ones may set the distance of slices for all: an error, and how many
        slices are tried, and twice as many, where there would be over twice as many. Those that keep the error are
        taken.
    lit
        Error that the slices of lit volumes in mode composite may have, and the least and the most of them to one of
        the default distance; None: `volumes` holds.
    stop
        Opacity at which a pixel is finished; None: the default.
    filters
        Whether small scattered kernels call for the filter.
    samples
        Of lit volumes of plain sums in mode composite; None: one sample a pixel. Wider kernels leave little that is
        finer than a pixel, and take as long as they are wide.
    """

    kernel: tuple[float, float] | None
    volumes: Mapping[str, int]
    plain_volumes: Mapping[str, int]
    scattered: Mapping[str, int]
    few: tuple[float, int]
    lit: tuple[float, int, int] | None
    stop: float | None
    filters: bool
    samples: _Samples | None = None


_TWICE = dict.fromkeys(("composite", "isosurface", "mip", "minimum"), 2)
# What a draft may be wrong.
_ROUGH = 2e-2
# Found by measurement: docs/quality.md, "Accuracy and time of each quality", and ./run bench quality.
_LEVELS = {
    "draft": _Level(None, {}, {}, {}, (1e-2, 128), None, None, False),
    "good": _Level((2.0, 5.0), _TWICE, _TWICE, {"composite": 2}, (5e-3, 256), (5e-3, 2, 3), 0.995, True),
    "best": _Level(
        (2.5, 7.0),
        {**dict.fromkeys(_TWICE, 4), "unlit": 3, "average": 2},
        {**dict.fromkeys(_TWICE, 6), "average": 2},
        {"composite": 4, "isosurface": 2, "mip": 2, "minimum": 2},
        (1.7e-3, 512),
        (1.7e-3, 4, 8),
        0.999,
        True,
        _Samples(2, 3),
    ),
}


def allowed_error(name: str) -> float:
    """Return the root mean square error that a picture of a quality may have by the coarseness of its data."""
    lit = _LEVELS[name].lit
    return _ROUGH if lit is None else lit[0]


class Choice:
    """What one call sets by its quality, step by step: kernels, then slices, then the filter.

    Parameters
    ----------
    owner
        The function, for messages.
    options
        The keyword arguments that were given. None stands for an option that was left open, but for `filter`, where it
        means none.
    """

    def __init__(self, owner: str, options: Mapping[str, Any]) -> None:
        given = {name: value for name, value in options.items() if value is not None}
        if "filter" in options:
            given["filter"] = choice(
                f"{owner}: filter", "off" if options["filter"] is None else options["filter"], ("ewa", "off", "auto")
            )
        self.name = choice(f"{owner}: quality", given.get("quality", "good"), QUALITIES)
        self._kept = self._free = False
        self._level = _LEVELS[self.name]
        self._given = given
        self._settings: list[QualitySetting] = []

    @property
    def quality(self) -> PictureQuality:
        """What was set so far."""
        return PictureQuality(self.name, tuple(dict.fromkeys(self._settings)))

    def _set(self, option: str, value: float | bool | str | None, reason: str, *, given: bool = False) -> None:
        self._settings.append(QualitySetting(option, value, reason, given))

    def _set_again(self, option: str, value: float, reason: str) -> None:
        self._settings = [one for one in self._settings if one.option != option]
        self._set(option, value, reason)

    def kept(self, scene: Scene) -> Scene:
        """Return a scene that the caller made: all of it was given."""
        volumes = [one for one in scene.fields if isinstance(one, RegularField)]
        values: dict[str, float | bool | str] = {"slice_spacing": scene.slice_spacing, "filter": scene.filter or "off"}
        if volumes:
            values["prefilter"] = any(one.prefilter for one in volumes)
        if scene.mode == "composite":
            values["opacity_stop"] = scene.options["opacity_stop"]
        values["supersampling"] = scene.supersampling
        for option, value in values.items():
            self._set(option, value, "as the scene has it", given=True)
        self._kept = True
        return scene

    def kernels(self, fields: Sequence[Field], *, made: bool) -> list[Field]:
        """Return fields with the kernels of the quality; `made`: the caller made them, and what they settled stays."""
        return [self.kernel(one, made=made) for one in fields]

    def kernel(self, field: Made, *, made: bool) -> Made:
        """Return a field with the kernels of the quality; `made` as for `kernels`."""
        if not isinstance(field, RegularField):
            return field
        if made and field.settled:
            self._set("prefilter", field.prefilter, "as the field has it", given=True)
            return field
        return cast(Made, self._lattice(field, made=made).as_settled())

    def _lattice(self, field: RegularField, *, made: bool) -> RegularField:
        wanted = self._level.kernel
        own_kernel = "radius" in self._given or "falloff" in self._given
        own_kernel |= made and (field.radius, field.falloff) != PLAIN_KERNEL
        radius, falloff = (field.radius, field.falloff) if own_kernel or wanted is None else wanted
        if "prefilter" in self._given:
            shown = field
            if field.prefilter and (radius, falloff) != (field.radius, field.falloff):
                shown = field.replace(radius=radius, falloff=falloff)
            self._set("prefilter", shown.prefilter, _AS_GIVEN, given=True)
        elif own := [name for name in _OWN_SUMS if name in self._given]:
            shown = field
            self._set("prefilter", False, f"{' and '.join(own)} as given: sums are divided in another way", given=True)
        elif made and field.normalization != "lattice":
            shown = field
            self._set(
                "prefilter", False, "normalization as the field has it: sums are divided in another way", given=True
            )
        elif wanted is None:
            shown = field
            self._set("prefilter", False, "plain sums of the samples, which smooth a little")
        else:
            found = through_samples(field, radius, falloff)
            shown = found.field
            self._set("prefilter", shown.prefilter, found.reason)
        wide = (shown.radius, shown.falloff) != PLAIN_KERNEL
        why = _AS_GIVEN if own_kernel else "exact between samples too; frames take twice as long" if wide else "plain"
        self._set("radius", shown.radius, why, given=own_kernel)
        self._set("falloff", shown.falloff, why, given=own_kernel)
        return shown

    def slices(self, scene: Scene, *, free: bool) -> Scene:
        """Return a scene with the slices of the quality; `free`: max_error or max_seconds decides on their distance."""
        self._free = free
        found = {"slice_spacing": self._spacing(scene)}
        if scene.mode == "composite":
            found["opacity_stop"] = self._stop(scene)
        changes: dict[str, float] = {}
        for option, (value, reason) in found.items():
            now = scene.slice_spacing if option == "slice_spacing" else scene.options[option]
            if option in self._given:
                self._set(option, now, _AS_GIVEN, given=True)
            elif free and option == "slice_spacing":
                self._set(option, now, "chosen anew by max_error or max_seconds", given=True)
            else:
                self._set(option, value, reason)
                if value != now:
                    changes[option] = value
        if "supersampling" in self._given:
            self._set("supersampling", scene.supersampling, _AS_GIVEN, given=True)
        else:
            self._set("supersampling", 1, _ONE_SAMPLE)
        return scene.replace(**changes) if changes else scene

    def _spacing(self, scene: Scene) -> tuple[float, str]:
        """Return the distance of slices, and why."""
        more = _slices_more(self._level, scene)
        if more == 1:
            return scene.slice_spacing, "the default"
        return scene.slice_spacing / more, f"1/{more} of the default, so that slices do not show"

    def _stop(self, scene: Scene) -> tuple[float, str]:
        """Return the opacity at which pixels are finished, and why."""
        stop = scene.options["opacity_stop"] if self._level.stop is None else self._level.stop
        least = self._given.get("max_error")
        if isinstance(least, int | float) and 0.0 < least < 1.0 - stop:
            return 1.0 - least, "what a pixel leaves out stays below max_error"
        if self._level.stop is None:
            return stop, "the default"
        return stop, "what lies behind a nearly opaque pixel counts as well"

    def finished(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return the scene with its filter, and with what was set, for the plan."""
        if not self._kept:
            scene = self._with_few_slices(self._with_slices_for_light(scene, camera, size), camera, size)
            scene = self._with_samples_for_ends(self._with_slices_for_ends(scene, camera), camera, size)
            scene = self._with_samples_for_means(scene, camera, size)
            scene = self._filtered(scene, camera, size)
        return scene.with_quality(self.quality)

    def fitted(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return an x-ray that was finished with the slices and samples that another camera or size calls for."""
        if scene.mode != "xray" or "supersampling" in self._given:
            return scene
        made = self._with_slices_for_ends(scene.replace(supersampling=1), camera)
        made = self._with_samples_for_means(self._with_samples_for_ends(made, camera, size), camera, size)
        return made.with_quality(scene.quality)

    def _with_slices_for_light(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return a scene with as many slices as its light calls for."""
        if self._level.lit is None or self._free or "slice_spacing" in self._given or not can_be_estimated(scene):
            return scene
        most, least_slices, most_slices = self._level.lit
        error = slicing_error(scene, camera, size)
        # Errors fall at first order at least.
        called_for = math.ceil(error * SLICES / most)
        samples, reason = self._samples(scene, called_for)
        if samples is not None:
            least_slices = samples.slices
        slices = min(max(called_for, least_slices), most_slices)
        changes: dict[str, float] = {}
        if "supersampling" not in self._given:
            changes["supersampling"] = 1 if samples is None else samples.count
            self._set_again("supersampling", changes["supersampling"], reason)
        changes["slice_spacing"] = _finest(scene) / slices
        reason = f"1/{slices} of the default: an estimated error of {error * SLICES / slices:.1e} by slices"
        self._set_again("slice_spacing", changes["slice_spacing"], reason)
        return scene.replace(**changes)

    def _with_few_slices(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return a scene of scattered kernels with fewer slices where thin kernels that hardly show call for many."""
        if self._free or "slice_spacing" in self._given or not has_lit_kernels(scene):
            return scene
        (most, first), extent = self._level.few, depth_extent(scene, camera)
        for slices in (first, 2 * first):
            if extent <= 2 * slices * scene.slice_spacing:
                break
            coarse = scene.replace(slice_spacing=extent / slices)
            error = slicing_error(scene, camera, size, SLICES * coarse.slice_spacing)
            if error <= most and unmet_kernels(coarse, camera, size).share < LEAST_UNMET:
                reason = f"{slices} slices, and not those of the thinnest kernels: an estimated error of {error:.1e}"
                self._set_again("slice_spacing", coarse.slice_spacing, reason)
                return coarse
        return scene

    def _samples(self, scene: Scene, slices: int) -> tuple[_Samples | None, str]:
        """Return how many samples a pixel has where light calls for so many slices, and why; None: one, or as given."""
        samples = self._level.samples
        if samples is None or "supersampling" in self._given:
            return None, _ONE_SAMPLE
        if any(isinstance(one, RegularField) and one.prefilter for one in scene.fields):
            return None, _ONE_SAMPLE
        several = f"{samples.count} x {samples.count} samples"
        if slices > samples.slices:
            return None, f"one sample a pixel: {several}, with the slices that light calls for, would take too long"
        return samples, f"{several} a pixel, for light that changes within a pixel; frames take twice as long"

    def _with_slices_for_ends(self, scene: Scene, camera: Camera) -> Scene:
        """Return a scene whose slices cut an x-ray of volumes into whole slabs."""
        if self._free or "slice_spacing" in self._given or not self._level.filters:
            return scene
        spacing = slices_for_ends(scene, camera)
        if spacing is None:
            return scene
        self._set_again("slice_spacing", spacing, "whole slabs of the volume, so that an x-ray has its mass")
        return scene.replace(slice_spacing=spacing)

    def _with_samples_for_ends(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return a scene with several samples a pixel where an x-ray of volumes that end would not have their mass."""
        if "supersampling" in self._given or not self._level.filters:
            return scene
        count = min(samples_for_ends(scene, camera, size), MOST_SAMPLES, max(1, _MOST_FINE // max(size)))
        if count <= scene.supersampling:
            return scene
        self._set_again("supersampling", count, f"{count} x {count} samples a pixel: values jump where a volume ends")
        return scene.replace(supersampling=count)

    def _with_samples_for_means(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        """Return a scene with several samples a pixel where sums along rays are of means finer than pixels.

        Means of kernels (normalisation "threshold") are as wide as their kernels, and the filter would widen them.
        """
        given = "supersampling" in self._given or self._given.get("filter") in ("ewa", "off")
        fine = fine_size(size, scene.supersampling)
        if scene.mode not in SUMMING or given or not self._level.filters or coarse_lattice(scene, camera, fine):
            return scene
        if sampled_sums(scene, camera, fine).means <= MOST_MEANS:
            return scene
        count, most = scene.supersampling, min(MOST_SAMPLES, _MOST_FINE // max(size))
        while count < most and sampled_sums(scene, camera, fine_size(size, count)).wrong >= LEAST_WRONG:
            count += 1
        if count == scene.supersampling:
            return scene
        reason = f"{count} x {count} samples a pixel: what sums along rays add up is finer than a pixel"
        self._set_again("supersampling", count, reason)
        return scene.replace(supersampling=count)

    def _filtered(self, scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene:
        given = self._given.get("filter")
        if given in ("ewa", "off"):
            self._set("filter", given, _AS_GIVEN, given=True)
            return scene.replace(filter=given)
        if given is None and not self._level.filters:
            self._set("filter", "off", "kernels as they are")
            return scene
        # The filter's pixels are those of the samples.
        on, reason = _calls_for_filter(scene, camera, fine_size(size, scene.supersampling))
        self._set("filter", "ewa" if on else "off", reason)
        return scene.replace(filter="ewa") if on else scene


def scene_of_quality(scene: Scene, name: str, camera: Camera, size: tuple[int, int]) -> Scene:
    """Return what a scene would be at a quality: kernels of volumes, slices, opacity stop and filter anew."""
    chosen = Choice("quality", {"quality": name})
    groups = [chosen.kernels([_plain(one) for one in fields], made=False) for fields in scene.groups]
    changes: dict[str, Any] = {"slice_spacing": _draft_spacing(scene), "reference_length": scene.reference_length}
    changes |= {"field": groups if len(groups) > 1 else groups[0], "opacity_stop": _DEFAULT_STOP, "filter": None}
    changes["supersampling"] = 1
    return chosen.finished(chosen.slices(scene.replace(**changes), free=False), camera, size)


def _plain(field: Field) -> Field:
    """Return a volume with plain kernels; one that is divided in a way of its own, and any other field, as it is."""
    if not isinstance(field, RegularField) or not (field.prefilter or field.normalization == "lattice"):
        return field
    return field.replace(radius=PLAIN_KERNEL[0], falloff=PLAIN_KERNEL[1], normalization="lattice", prefilter=False)


def _finest(scene: Scene) -> float:
    """Return the default distance of slices."""
    return min(one.default_slice_spacing for one in scene.fields)


def _draft_spacing(scene: Scene) -> float | None:
    """Return the distance of slices of a draft; None: that of the fields."""
    if can_be_estimated(scene):
        return None
    set_by = next(
        (one for one in (scene.quality.settings if scene.quality else ()) if one.option == "slice_spacing"), None
    )
    if set_by is None or set_by.given or scene.quality is None:
        return None
    return scene.slice_spacing * _slices_more(_LEVELS[scene.quality.name], scene)


def _slices_more(level: _Level, scene: Scene) -> int:
    """Return how many slices a quality takes in place of one of the default distance."""
    volumes = [one for one in scene.fields if isinstance(one, RegularField)]
    plain = not any(one.prefilter for one in volumes)
    counts = level.scattered if not volumes else level.plain_volumes if plain else level.volumes
    kind = "unlit" if scene.mode == "composite" and not scene.lights else scene.mode
    return counts.get(kind, counts.get(scene.mode, 1))


def _calls_for_filter(scene: Scene, camera: Camera, size: tuple[int, int]) -> tuple[bool, str]:
    """Return whether small kernels call for the filter, and why."""
    if scene.mode in SUMMING:
        return _sums_call_for_filter(scene, camera, size)
    if any(isinstance(one, RegularField) for one in scene.fields):
        # Measured up to 8 samples a pixel (docs/quality.md).
        return False, "kernels of volumes overlap and leave no gaps; widened, they blur values before their colours"
    if not may_be_thin(scene, camera, size):
        return False, "no kernel is smaller than two pixels or a slice distance"
    small = small_kernels(scene, camera, size)
    what = "stands alone and is smaller than two pixels or a slice distance"
    if small.hidden > _MOST_HIDDEN * small.share:
        return False, f"it would lower {100.0 * small.hidden:.3g} % of what shows to values without opacity"
    return small.share >= _LEAST_SHARE, f"{100.0 * small.share:.3g} % of what shows {what}"


def _sums_call_for_filter(scene: Scene, camera: Camera, size: tuple[int, int]) -> tuple[bool, str]:
    """Return whether sums along rays would lose mass between pixels or slices, and why."""
    if coarse := coarse_lattice(scene, camera, size):
        return True, f"{coarse}: without it sums along rays lose what lies between pixels or slices"
    sums = sampled_sums(scene, camera, size)
    if sums.means > MOST_MEANS:
        return False, f"{100.0 * sums.means:.3g} % of what shows are means of kernels, which it would only widen"
    if sums.lose_mass:
        share = f"{100.0 * sums.coarse:.3g} % of the mass is in kernels of fewer than three pixels or slices"
        return True, f"{share}: without it sums along rays lose what lies between"
    return False, "pixels and slices are close enough for sums along rays to keep their mass"

"""What a pixel is made of: samples, the filter, and the opacity at which it is finished."""

from __future__ import annotations

from sheetsplat.camera import Camera
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.decisions import AS_GIVEN, Decision
from sheetsplat.fields import RegularField
from sheetsplat.modes import TRAITS
from sheetsplat.options.scene import MOST_SAMPLES
from sheetsplat.quality.thin import (
    LEAST_WRONG,
    MOST_MEANS,
    coarse_lattice,
    may_be_thin,
    sampled_sums,
    samples_for_ends,
    small_kernels,
)
from sheetsplat.scene import Scene
from sheetsplat.supersampling import fine_size

Size = tuple[int, int]
#: What pixels have where nothing calls for more.
ONE_SAMPLE = Decision("supersampling", 1, "one sample a pixel, at its centre", "default")
# The filter is taken where kernels that are smaller than two pixels, or a slice distance, are this share of what shows:
# there a picture with it is nearer to one of many samples a pixel than a picture without.
_LEAST_SHARE = 0.2
# The filter keeps the mass of kernels and so lowers their values: of the small ones this share may vanish by it.
_MOST_HIDDEN = 0.5
# Longest side, in samples, of pictures that get several samples a pixel for what they show sums of.
_MOST_FINE = 1600


def opacity_stop(scene: Scene, asked: Asked) -> Decision:
    """Return the opacity at which pixels are finished."""
    stop, usual = scene.options["opacity_stop"], asked.level.stop
    if "opacity_stop" in asked:
        return Decision("opacity_stop", stop, AS_GIVEN, "caller")
    stop, least = stop if usual is None else usual, asked.given.get("max_error")
    if isinstance(least, int | float) and 0.0 < least < 1.0 - stop:
        return Decision("opacity_stop", 1.0 - least, "what a pixel leaves out stays below max_error", "quality")
    if usual is None:
        return Decision("opacity_stop", stop, "the default", "default")
    return Decision("opacity_stop", stop, "what lies behind a nearly opaque pixel counts as well", "quality")


def samples_for_light(scene: Scene, asked: Asked, light: float | None) -> Decision:
    """Return how many samples a pixel has for light that changes within one; `light`: as for `slice_spacing`."""
    several = asked.level.samples
    prefiltered = any(isinstance(one, RegularField) and one.prefilter for one in scene.fields)
    if several is None or light is None or prefiltered or "supersampling" in asked:
        return ONE_SAMPLE
    count, most_slices = several
    words = f"{count} x {count} samples"
    if asked.level.slices_for(light) > most_slices:
        reason = f"one sample a pixel: {words}, with the slices that light calls for, would take too long"
        return Decision("supersampling", 1, reason, "quality")
    reason = f"{words} a pixel, for light that changes within a pixel; frames take twice as long"
    return Decision("supersampling", count, reason, "quality")


def supersampling(scene: Scene, asked: Asked, camera: Camera, size: Size, lit: Decision = ONE_SAMPLE) -> Decision:
    """Return how many samples a pixel has along each axis, with the slices of a scene and what its light calls for."""
    if "supersampling" in asked:
        return Decision("supersampling", scene.supersampling, AS_GIVEN, "caller")
    if not TRAITS[scene.mode].adds or not asked.level.filters:
        return lit
    most = min(MOST_SAMPLES, max(1, _MOST_FINE // max(size)))
    ends = min(samples_for_ends(scene, camera, size, cuts=True), most)
    count, reason = (
        _samples_for_means(scene, asked, camera, size, ends, most),
        "a volume that ends, or a box that cuts, is few pixels wide",
    )
    if count > ends:
        reason = "what sums along rays add up is finer than a pixel"
    return (
        ONE_SAMPLE
        if count == 1
        else Decision("supersampling", count, f"{count} x {count} samples a pixel: {reason}", "quality")
    )


def _samples_for_means(scene: Scene, asked: Asked, camera: Camera, size: Size, count: int, most: int) -> int:
    """Return how many samples a pixel needs, at least `count`, where sums along rays are of means finer than pixels.

    Means of kernels (normalisation "threshold") are as wide as their kernels, and the filter would widen them.
    """
    fine = fine_size(size, count)
    if asked.given.get("filter") in ("ewa", "off") or coarse_lattice(scene, camera, fine):
        return count
    sums = sampled_sums(scene, camera, fine)
    if sums.means > MOST_MEANS:
        while count < most and sums.wrong >= LEAST_WRONG:
            count += 1
            sums = sampled_sums(scene, camera, fine_size(size, count))
    return count


def kernel_filter(scene: Scene, asked: Asked, camera: Camera, size: Size) -> Decision:
    """Return the filter of a scene that has its slices and samples."""
    given = asked.given.get("filter")
    if given in ("ewa", "off"):
        return Decision("filter", given, AS_GIVEN, "caller")
    if given is None and not asked.level.filters:
        return Decision("filter", "off", "kernels as they are", "default")
    # The filter's pixels are those of the samples.
    on, reason = _calls_for_filter(scene, camera, fine_size(size, scene.supersampling))
    return Decision("filter", "ewa" if on else "off", reason, "quality")


def _calls_for_filter(scene: Scene, camera: Camera, size: Size) -> tuple[bool, str]:
    """Return whether small kernels call for the filter, and why."""
    if TRAITS[scene.mode].adds:
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


def _sums_call_for_filter(scene: Scene, camera: Camera, size: Size) -> tuple[bool, str]:
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

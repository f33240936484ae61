"""About how long a picture takes, told before it is drawn: by what is summed, from measured rates."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat._time_left import about
from sheetsplat.backends import BACKEND_TRAITS, EXACT
from sheetsplat.camera import Camera
from sheetsplat.errors import Words, option_ref
from sheetsplat.fields import EllipsoidField, Field, RegularField, joined_bounds
from sheetsplat.look.visible import camera_axes, depths_of
from sheetsplat.modes import TRAITS
from sheetsplat.notices import warn
from sheetsplat.quality.slicing import depth_extent
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]

#: Seconds beyond which a warning precedes a picture.
LONG = 60.0
# Kernels of a field that are looked at: enough for one digit.
_SOME = 512
# Pixels whose lines to lights are followed for the error of light, and lines and steps of lines (light_error.cpp).
_PROBES, _LINES, _STEPS = 2048, 256 * 8, 2000


# Kernels that a core puts into a grid in a second.
_SCATTERED = 1.5e6


@dataclass(frozen=True)
class ExpectedTime:
    """About how long a picture takes.

    Attributes
    ----------
    seconds
        Of a machine like that of the measured rates; another one may take three times as long, or a third.
    cause
        What takes most of them.
    """

    seconds: float
    cause: Words


def expected_time(
    scene: Scene, camera: Camera, size: tuple[int, int], backend: str, device: str, *, slices: int, spacing: float
) -> ExpectedTime | None:
    """Return about how long a picture takes; None where no rate is known: OpenGL by a graphics processor.

    Parameters
    ----------
    scene, camera, size
        The picture, (width, height) in pixels.
    backend, device, slices, spacing
        Of its plan; spacing in world units.
    """
    rates = BACKEND_TRAITS[backend]
    if rates.rated_device not in device or not any(one.size for one in scene.fields):
        return None
    threads = _threads(device)
    screen = _Screen.of(scene, camera, size)
    scattered = sum(one.size for one in scene.fields if isinstance(one, EllipsoidField))
    pixels, sections = 0.0, 0.0
    for group, function in zip(scene.groups, scene.transfer_functions, strict=True):
        for one in group:
            if one.size:
                count, axes = _all_kernels(one)
                own = _sums(count * _share(one, scene, function, screen), axes, screen, slices, spacing)
                pixels, sections = pixels + own[0], sections + own[1]
    light = _light(scene, screen, slices, threads)
    kernels = (pixels / rates.pixels + sections / rates.sections) / threads + scattered / _SCATTERED
    summed = float(slices) * screen.points / rates.points / threads
    largest = max(kernels, summed, light)
    fewer = "draw fewer pixels, or use a larger " + option_ref("slice_spacing")
    if largest == kernels:
        each = max(1.0, pixels / max(sections, 1.0))
        if any(isinstance(one, RegularField) and one.radius > 2.0 for one in scene.fields):
            fewer = "use a smaller " + option_ref("radius") + ", or " + fewer
        cause = f"{sections:.2g} times a slice cuts a kernel, {each:.2g} pixels each; " + fewer
    elif largest == summed:
        cause = f"{slices} slices of {screen.size[0]} x {screen.size[1]} pixels; " + fewer
    else:
        cause = f"light along {slices} slices; use a larger " + option_ref("slice_spacing")
    return ExpectedTime(kernels + summed + light, Words.of(cause))


def may_be_long(scene: Scene, camera: Camera, size: tuple[int, int], backend: str) -> bool:
    """Return whether a picture may take more than `LONG`, by bounds that are known in a fraction of a millisecond."""
    rates, spacing = BACKEND_TRAITS.get(backend, BACKEND_TRAITS[EXACT]), scene.slice_spacing
    if not any(one.size for one in scene.fields):
        return False
    screen = _Screen.of(scene, camera, size)
    slices = depth_extent(scene, camera) / spacing
    seconds = slices * screen.points / rates.points + _light(scene, screen, slices, 1)
    for one in scene.fields:
        pixels, sections = _sums(*_all_kernels(one, most=True), screen, slices, spacing) if one.size else (0.0, 0.0)
        seconds += pixels / rates.pixels + sections / rates.sections
    return seconds > LONG


def warn_of_time(expected: ExpectedTime | None) -> None:
    """Warn of a picture that takes more than a minute."""
    if expected is not None and expected.seconds > LONG:
        warn(f"the picture takes about {about(expected.seconds)}: " + expected.cause)


def _threads(device: str) -> int:
    """Return the threads that a device is said to have ("2 threads"), or 1."""
    words = device.replace(",", "").split()
    return next((int(a) for a, b in itertools.pairwise(words) if b.startswith("thread") and a.isdigit()), 1)


@dataclass(frozen=True)
class _Screen:
    """A picture and its pixels, where it shows the middle of a scene."""

    camera: Camera
    size: tuple[int, int]
    depth: float

    @classmethod
    def of(cls, scene: Scene, camera: Camera, size: tuple[int, int]) -> _Screen:
        """Return that of a scene with several samples a pixel."""
        fine = (size[0] * scene.supersampling, size[1] * scene.supersampling)
        middle = np.mean(joined_bounds([one.bounds for one in scene.fields if one.size]), axis=0)
        return cls(camera, fine, float(depths_of(middle, camera)))

    @property
    def points(self) -> int:
        """Number of pixels."""
        return self.size[0] * self.size[1]

    @property
    def pixel(self) -> float:
        """Width of a pixel, world units."""
        return float(self._high(np.asarray(self.depth))) / self.size[1]

    def _high(self, depths: Floats) -> Floats:
        if self.camera.kind == "orthographic":
            return np.full(depths.shape, self.camera.height)
        return 2.0 * math.tan(0.5 * math.radians(self.camera.fov_y)) * np.maximum(depths, self.camera.near)

    def shows(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points (N, 3) lie in the picture."""
        right, up, back = camera_axes(self.camera)
        from_eye = points - np.asarray(self.camera.eye)
        depths = -(from_eye @ back)
        high = self._high(depths)
        shift = self.camera.shift if self.camera.kind == "perspective" else (0.0, 0.0)
        beside = np.abs(from_eye @ right / high - shift[0]) < 0.5 * self.size[0] / self.size[1]
        above = np.abs(from_eye @ up / high - shift[1]) < 0.5
        return np.asarray(beside & above & ((self.camera.kind == "orthographic") | (depths > self.camera.near)))


def _all_kernels(field: Field, *, most: bool = False) -> tuple[float, Floats]:
    """Return how many kernels a field has, and semi-axes of some, (n, 3); `most`: longer ones than any has."""
    if isinstance(field, RegularField):
        # Beyond each end samples are mirrored as far as kernels reach; half of what these cover is in the volume.
        more = field.radius - 1.0 if field.boundary == "edge" else 0.0
        radius = field.radius * (math.sqrt(0.5) if field.lattice == "bcc" else 1.0)
        return math.prod(length + more for length in field.shape), radius * np.asarray([field.spacing])
    if not isinstance(field, EllipsoidField):
        return 0.0, np.zeros((1, 3))
    if most:
        return float(field.size), np.full((1, 3), field.native.scale_range[1])
    scales = field.scales[:: max(1, field.size // (64 * _SOME))]
    return float(field.size), np.broadcast_to(scales.reshape(len(scales), -1), (len(scales), 3)).astype(np.float64)


def _sums(count: float, axes: Floats, screen: _Screen, slices: float, spacing: float) -> tuple[float, float]:
    """Return how many pixels of slices kernels cover together, and in how many sections."""
    radii = np.cbrt(axes.prod(axis=1))
    # Half of the kernels that are thinner than slices meet one; those that reach beyond the picture end there.
    sections = np.clip(2.0 * radii / spacing, 0.5, max(slices, 1.0))
    pixels = np.clip(2.0 / 3.0 * math.pi * (radii / screen.pixel) ** 2, 1.0, screen.points)
    return count * float((pixels * sections).mean()), count * float(sections.mean())


def _share(field: Field, scene: Scene, function: TransferFunction, screen: _Screen) -> float:
    """Return which share of the kernels lies in the picture and shows, by some: of a volume by the samples around."""
    if isinstance(field, EllipsoidField):
        return float(screen.shows(np.asarray(field.centers[:: max(1, field.size // _SOME)], np.float64)).mean())
    if not isinstance(field, RegularField):
        return 0.0
    random, shape = np.random.default_rng(2006), field.shape
    places = [random.integers(0, n, (_SOME, 1)) for n in shape]
    low, high = np.asarray(field.centre_bounds)
    shares = np.hstack(places[::-1]) / np.maximum(np.asarray(shape[::-1]) - 1, 1)
    seen = screen.shows(low + shares * (high - low))
    if TRAITS[scene.mode].is_scalar:
        return float(seen.mean())
    reach = np.indices((5, 5, 5)).reshape(3, -1) - 2
    near = tuple(np.clip(place + step, 0, n - 1) for place, step, n in zip(places, reach, shape, strict=True))
    around = field.values[near].astype(np.float64)
    # Nothing is known of a sum but that it lies between its values and the base.
    least, most = np.fmin(around.min(axis=1), field.base), np.fmax(around.max(axis=1), field.base)
    if TRAITS[scene.mode].is_composited:
        points = function.points
        opaque = (points[:, 0] >= least[:, None]) & (points[:, 0] <= most[:, None]) & (points[:, 4] > 0.0)
        ends = function.at(np.stack([least, most], axis=1))[..., 3] > 0.0
        return float((seen & (opaque.any(axis=1) | ends.any(axis=1))).mean())
    values = np.unique([value for surfaces in scene.surfaces for value in np.atleast_1d(surfaces)])
    crossed = np.any((least[:, None] < values) & (most[:, None] >= values), axis=1)
    return float((seen & crossed).mean())


def _light(scene: Scene, screen: _Screen, slices: float, threads: int) -> float:
    """Return the seconds for grids of light and for its error: lines through slices and to lights."""
    if not scene.options["shadows"] and not scene.options["ambient_occlusion"]:
        return 0.0
    around = 14 if scene.options["ambient_occlusion"] else len(scene.lights)
    looked = min(screen.points, 4 * _PROBES) * slices * 3.5e-8
    return (looked + _LINES * around * min(slices, _STEPS) * 5e-8) / threads


__all__ = ["LONG", "ExpectedTime", "expected_time", "may_be_long", "warn_of_time"]

"""Camera paths: smooth ways through key frames, and turns about an axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sheetsplat._checks import instance, number, parts, shown, truth
from sheetsplat.camera import Camera
from sheetsplat.errors import complain, unusable
from sheetsplat.look.measure import Floats
from sheetsplat.options.film import frames_of

_MOST_KEYS = 10_000
# Targets that differ by less than this share of the distance are one: the path leads around it.
_SAME_TARGET = 1e-9
# A closed path goes on beyond its ends by so many keys, so that it is smooth there as well.
_BEYOND = 3


class CameraPath:
    """A smooth path through key frames. Immutable.

    Positions follow a cubic spline and directions a spline of rotations with continuous angular acceleration (SciPy's
    CubicSpline and RotationSpline). Where all keys look at one target, the eye stays around it: distance and direction
    are interpolated, and key frames on a circle give a circle. Heights of orthographic cameras, distances and angles of
    view change monotonically between keys, by their logarithms.

    >>> keys = [ss.Camera.fit(scene, direction, "z") for direction in ("-x", "-y")]
    >>> path = ss.CameraPath(keys)
    >>> path.cameras(3)[2] == keys[1]
    True

    Parameters
    ----------
    keys
        Cameras, two or more, all orthographic or all perspective.
    times
        When each is reached, in increasing order; evenly spaced unless given. For a closed path one more, when it is
        at the first key again.
    closed
        Whether it leads back to the first key.

    Raises
    ------
    InvalidInput
        For fewer than two keys, keys of both projections, and times that do not rise.
    """

    __slots__ = ("_closed", "_interpolators", "_keys", "_times")

    def __init__(self, keys: Sequence[Camera], times: Sequence[float] | None = None, *, closed: bool = False) -> None:
        what = "CameraPath: keys"
        wanted = "a sequence of two cameras or more"
        found = parts(what, keys, wanted, _MOST_KEYS)
        for one in found:
            instance(what, one, Camera)
        if not 2 <= len(found) <= _MOST_KEYS:
            raise complain(unusable(what), f"{len(found)} cameras", wanted)
        if len({one.kind for one in found}) > 1:
            raise complain(unusable(what), "orthographic and perspective cameras", "cameras of one projection")
        self._keys: tuple[Camera, ...] = tuple(found)
        self._closed = truth("CameraPath: closed", closed)
        self._times = self._checked_times(times)
        self._interpolators = self._interpolated()

    def _checked_times(self, times: object) -> Floats:
        count = len(self._keys) + self._closed
        if times is None:
            return np.linspace(0.0, 1.0, count)
        what = "CameraPath: times"
        wanted = f"{count} numbers that rise"
        found = np.array([number(what, one) for one in parts(what, times, wanted, _MOST_KEYS + 1)])
        if len(found) != count or not np.all(np.isfinite(found)) or not np.all(np.diff(found) > 0):
            raise complain(unusable(what), shown(times), wanted)
        shares: Floats = (found - found[0]) / (found[-1] - found[0])
        return shares

    def _interpolated(self) -> tuple[bool, Any, Any, Any, Any]:
        """Return whether the target is fixed, and the interpolators of position, rotation and lengths."""
        from scipy.interpolate import CubicSpline, PchipInterpolator  # type: ignore[import-untyped]
        from scipy.spatial.transform import Rotation, RotationSpline  # type: ignore[import-untyped]

        keys, times = list(self._keys), self._times
        if self._closed:
            reach = range(-_BEYOND, len(keys) + 1 + _BEYOND)
            gaps = np.diff(times)
            whole, count = float(times[-1]), len(keys)
            times = np.array([whole * (at // count) + float(times[at % count]) for at in reach])
            keys = [keys[at % count] for at in reach]
            assert len(gaps) == count
        eyes, targets = (np.array([getattr(one, name) for one in keys]) for name in ("eye", "target"))
        distances = np.linalg.norm(eyes - targets, axis=1)
        around = bool(np.ptp(targets, axis=0).max() <= _SAME_TARGET * distances.max())
        axes = [np.array(one.world_axes()).T for one in keys]
        turns = RotationSpline(times, Rotation.from_matrix(np.array(axes)))
        lengths: list[tuple[float, ...]]
        if keys[0].kind == "orthographic":
            lengths = [(distance, one.height) for distance, one in zip(distances, keys, strict=True)]
        else:
            slopes = [(math.tan(math.radians(one.fov_y) / 2), one.near) for one in keys]
            lengths = [(distance, *more) for distance, more in zip(distances, slopes, strict=True)]
        ends = PchipInterpolator(times, np.log(np.array(lengths)))
        return around, CubicSpline(times, eyes), turns, ends, PchipInterpolator(times, [one.shift for one in keys])

    @property
    def keys(self) -> tuple[Camera, ...]:
        """The key frames."""
        return self._keys

    @property
    def is_closed(self) -> bool:
        """Whether it leads back to its first key."""
        return self._closed

    def at(self, share: float) -> Camera:
        """Return the camera at a fraction of the path, 0 to 1. InvalidInput for other numbers."""
        at = number("CameraPath: share", share)
        if not 0.0 <= at <= 1.0:
            raise complain(unusable("CameraPath: share"), f"{at:g}", "a number from 0 to 1")
        exact = np.flatnonzero(self._times == at)
        if len(exact):
            return self._keys[int(exact[0]) % len(self._keys)]
        around, eyes, turns, lengths, shifts = self._interpolators
        axes = turns(at).as_matrix()
        up, back = axes[:, 1], axes[:, 2]
        distance, *ends = np.exp(lengths(at)).tolist()
        if around:
            target = np.asarray(self._keys[0].target)
            eye = target + distance * back
        else:
            eye = eyes(at)
            target = eye - distance * back
        if self._keys[0].kind == "orthographic":
            return Camera.orthographic(eye, target, up, height=ends[0])
        angle = 2 * math.degrees(math.atan(ends[0]))
        return Camera.perspective(eye, target, up, fov_y=angle, near=ends[1], shift=tuple(shifts(at).tolist()))

    def cameras(self, count: int) -> list[Camera]:
        """Return cameras at equal steps of time, from the first key to the last; a closed path leaves out the last.

        Raises InvalidInput unless `count` is a whole number from 1 on.
        """
        number_of = frames_of("CameraPath: count", count)
        last = number_of if self._closed else max(1, number_of - 1)
        return [self.at(n / last) for n in range(number_of)]

    def __eq__(self, other: object) -> bool:
        """Return whether keys and times are the same."""
        if not isinstance(other, CameraPath):
            return NotImplemented
        same = self._keys == other._keys and self._closed == other._closed
        return same and bool(np.array_equal(self._times, other._times))

    def __hash__(self) -> int:
        """Return a hash of the keys."""
        return hash((self._keys, self._closed))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by keys and times."""
        return _path, (self._keys, self._times.tolist(), self._closed)

    def __repr__(self) -> str:
        """Return a short description."""
        kind = self._keys[0].kind
        return f"CameraPath({len(self._keys)} {kind} cameras{', closed' if self._closed else ''})"


def _path(keys: tuple[Camera, ...], times: list[float], closed: bool) -> CameraPath:
    """Return the path of what `CameraPath.__reduce__` gave."""
    return CameraPath(keys, times, closed=closed)


def turned(camera: Camera, axis: Floats, degrees: float) -> Camera:
    """Return a camera that is turned about an axis through its target, counter-clockwise seen against the axis."""
    from scipy.spatial.transform import Rotation

    if degrees == 0.0:
        return camera
    turn = Rotation.from_rotvec(math.radians(degrees) * axis / np.linalg.norm(axis))
    target = np.asarray(camera.target)
    eye = target + turn.apply(np.asarray(camera.eye) - target)
    up = turn.apply(np.asarray(camera.up))
    if camera.kind == "orthographic":
        return Camera.orthographic(eye, target, up, height=camera.height)
    return Camera.perspective(eye, target, up, fov_y=camera.fov_y, near=camera.near, shift=camera.shift)


def turns(camera: Camera, axis: Floats, frames: int, degrees: float) -> list[Camera]:
    """Return the cameras of a turn. The last of a whole turn is one step before the first one, so that it repeats."""
    whole = degrees != 0.0 and math.isclose(abs(degrees) % 360.0, 0.0, abs_tol=1e-9)
    last = frames if whole else max(1, frames - 1)
    return [turned(camera, axis, degrees * n / last) for n in range(frames)]

"""Cameras: orthographic and perspective. Conventions, section 1 (Coordinates)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType, SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import (
    Bounds,
    Triple,
    Vector,
    attribute,
    choice,
    image_size,
    measurable,
    number,
    optional_number,
    pair,
    shown,
    triple,
)
from sheetsplat._checks import (
    direction as axis_or_vector,
)
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import Field, joined_bounds

Kind = Literal["orthographic", "perspective"]


def bounds_of(thing: object, levels: int = 2) -> Bounds:
    """Return the world-aligned box of a field, of a sequence of fields or groups, or of anything with ``bounds``.

    levels: of sequences in each other. ``bounds`` are two corners, ((x0, y0, z0), (x1, y1, z1)). Raises InvalidInput
    for anything else.
    """
    wanted = "a field, a scene, a sequence of fields, or something with bounds ((x0, y0, z0), (x1, y1, z1))"
    if isinstance(thing, list | tuple) and levels:
        if not thing:
            raise complain("Camera.fit: there is nothing to look at", "an empty sequence", wanted)
        # A field without a kernel has no box.
        there = [one for one in thing if not (isinstance(one, Field) and one.size == 0)]
        return joined_bounds([bounds_of(one, levels - 1) for one in there or thing])
    bounds = attribute(thing, "bounds")
    try:
        bounds = bounds() if callable(bounds) else bounds
        corners = np.asarray(bounds, dtype=np.float64)
    except Exception:  # Objects of others raise whatever they like.
        corners = np.empty(0)
    if corners.shape == (2, 3) and np.all(corners[0] > corners[1]):
        raise complain("Camera.fit: there is nothing to look at", f"no kernels in {shown(thing)}", wanted)
    if bounds is None or corners.shape != (2, 3) or not np.all(corners[0] <= corners[1]):
        raise complain("Camera.fit: this cannot be looked at", shown(thing if bounds is None else bounds), wanted)
    return triple("bounds", corners[0]), triple("bounds", corners[1])


def _refuse_distorted(camera: Any) -> None:
    """Raise Unsupported for a camera of VTK whose pictures are not those of an eye, a target and an angle."""
    transform = camera.GetModelTransformMatrix()
    moved = any(transform.GetElement(i, j) != float(i == j) for i in range(4) for j in range(4))
    distortions = {
        "a model transform": moved,
        "a window centre": tuple(camera.GetWindowCenter()) != (0.0, 0.0),
        "a shear": tuple(camera.GetViewShear()) != (0.0, 0.0, 1.0),
        "a projection matrix of its own": bool(camera.GetUseExplicitProjectionTransformMatrix()),
        "an off-axis projection": bool(camera.GetUseOffAxisProjection()),
    }
    found = [name for name, there in distortions.items() if there]
    if found:
        raise complain(
            "Camera.from_pyvista: this camera has no counterpart",
            f"a camera with {', '.join(found)}",
            "position, focal point, up, and an angle or a parallel scale",
            "leave them out",
            kind=Unsupported,
        )


class Camera:
    """Position and projection of the view. Immutable; made by `orthographic`, `perspective`, `fit` or `from_pyvista`.

    The camera looks from eye to target; lengths are world units, angles degrees.

    Examples
    --------
    >>> camera = ss.Camera.perspective(eye=(0, -20, 5), target=(0, 0, 0), up=(0, 0, 1), fov_y=30)
    >>> camera.kind, camera.fov_y
    ('perspective', 30.0)
    """

    __slots__ = ("_maker", "native")
    _maker: tuple[str, dict[str, Any]]
    native: _sheetsplat.Camera

    def __init__(self) -> None:
        raise TypeError(
            "a Camera is made by Camera.orthographic, Camera.perspective, Camera.fit or Camera.from_pyvista"
        )

    @classmethod
    def _by(cls, maker: str, **arguments: Any) -> Camera:
        """Return the camera that a function of the native camera makes of arguments."""
        camera = cls.__new__(cls)
        object.__setattr__(camera, "_maker", (maker, arguments))
        camera.native = getattr(_sheetsplat.Camera, maker)(**arguments)
        return camera

    @classmethod
    def of_arguments(cls, maker: str, arguments: Mapping[str, Any]) -> Camera:
        """Return the camera of what `maker` and `arguments` of another one are, the same to the bit."""
        given = dict(arguments)
        if maker == "fit":
            return cls.fit(SimpleNamespace(bounds=(given.pop("lower"), given.pop("upper"))), **given)
        made: Camera = getattr(cls, choice("Camera: maker", maker, ("orthographic", "perspective")))(**given)
        return made

    @classmethod
    def orthographic(cls, eye: Vector, target: Vector, up: Vector = (0.0, 1.0, 0.0), *, height: float) -> Camera:
        """Return a camera without perspective.

        Parameters
        ----------
        eye, target
            World positions.
        up
            World direction that is up in the picture; not along the view.
        height
            World units from the bottom edge of the picture to the top, > 0.

        Raises
        ------
        InvalidInput
            Where eye = target, up is along the view, a number is not finite, or height is not positive.
        """
        return cls._by(
            "orthographic",
            eye=triple("Camera: eye", eye),
            target=triple("Camera: target", target),
            up=measurable("Camera: up", triple("Camera: up", up)),
            height=number("Camera: height", height),
        )

    @classmethod
    def perspective(
        cls,
        eye: Vector,
        target: Vector,
        up: Vector = (0.0, 1.0, 0.0),
        *,
        fov_y: float,
        near: float | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> Camera:
        """Return a camera with perspective.

        Parameters
        ----------
        eye, target
            World positions.
        up
            World direction that is up in the picture; not along the view.
        fov_y
            Vertical angle in degrees, between 0 and 180; with a shift that of the picture without it.
        near
            Depth in front of which nothing is shown, > 0; a thousandth of the distance from eye to target unless given.
        shift
            How far the middle of the picture lies to the right of the target and above it, in heights of the picture:
            other than (0, 0) the projection is off-axis, as that of a part of a larger picture.

        Raises
        ------
        InvalidInput
            Where eye = target, up is along the view, a number is not finite, or an angle or depth is out of range.
        """
        return cls._by(
            "perspective",
            eye=triple("Camera: eye", eye),
            target=triple("Camera: target", target),
            up=measurable("Camera: up", triple("Camera: up", up)),
            fov_y=number("Camera: fov_y", fov_y),
            near=optional_number("Camera: near", near),
            shift=pair("Camera: shift", shift),
        )

    @classmethod
    def fit(
        cls,
        field: object,
        direction: Vector | str = (0.0, 0.0, -1.0),
        up: Vector | str = (0.0, 1.0, 0.0),
        kind: Kind = "orthographic",
        margin: float = 1.05,
        *,
        fov_y: float = 30.0,
    ) -> Camera:
        """Return a camera that looks along `direction` and shows all of something in a square picture.

        Parameters
        ----------
        field
            A field, a scene, a data set, a sequence of fields, or anything with ``bounds`` ((x0, y0, z0),
            (x1, y1, z1)). What is fitted is that box, for fields the box around all supports, whether or not
            anything in it is visible: in orthographic views its projection, in perspective the sphere around it.
        direction
            World direction of the view, from the eye into the scene, or an axis such as "x" or "-z".
        up
            World direction that is up in the picture, or an axis; not along the view.
        kind
            "orthographic" or "perspective".
        margin
            Size of the picture relative to the fitted box, > 0.
        fov_y
            Vertical angle in degrees, for perspective.

        Raises
        ------
        InvalidInput
            Where there is no box to fit, or a number is out of range.
        """
        lower, upper = bounds_of(field)
        return cls._by(
            "fit",
            lower=lower,
            upper=upper,
            direction=axis_or_vector("Camera: direction", direction),
            up=axis_or_vector("Camera: up", up),
            kind=choice("Camera: kind", kind, ("orthographic", "perspective")),
            margin=number("Camera: margin", margin),
            fov_y=number("Camera: fov_y", fov_y),
        )

    @classmethod
    def from_pyvista(cls, plotter: Any, size: tuple[int, int] | None = None) -> Camera:
        """Return the camera of a plotter of PyVista: pictures of both show every point at the same pixel.

        The plotter's own clipping range is left out: it follows from the surfaces alone. A camera that was not placed
        yet is placed as the plotter's first picture would place it.

        Parameters
        ----------
        plotter
            A ``pyvista.Plotter``, or a camera of PyVista or VTK.
        size
            (width, height) of the picture in pixels; it matters only where the camera holds a horizontal angle. The
            size of the plotter's window unless given.

        Raises
        ------
        InvalidInput
            For anything else.
        Unsupported
            For what this camera does not have: a model transform, a window centre, a shear, a projection matrix.

        Examples
        --------
        >>> import pyvista
        >>> plotter = pyvista.Plotter(off_screen=True, window_size=(64, 48))
        >>> plotter.camera_position = [(20, -30, 15), (4, 4, 4), (0, 0, 1)]
        >>> camera = ss.Camera.from_pyvista(plotter)
        >>> camera.kind, camera.fov_y
        ('perspective', 30.0)
        >>> image = ss.render(values, camera=camera, size=(64, 48))
        >>> plotter.close()
        """
        source = getattr(plotter, "camera", plotter)
        if not hasattr(source, "GetParallelProjection"):
            raise complain("Camera.from_pyvista: there is no camera", shown(plotter), "a plotter of PyVista")
        renderer = getattr(plotter, "renderer", None)
        if renderer is not None and not source.is_set:
            renderer.camera_position = renderer.get_default_cam_pos()
            renderer.ResetCamera()
        _refuse_distorted(source)
        placed = source.GetPosition(), source.GetFocalPoint(), source.GetViewUp()
        if source.GetParallelProjection():
            return cls.orthographic(*placed, height=2.0 * source.GetParallelScale())
        angle = source.GetViewAngle()
        if source.GetUseHorizontalViewAngle():
            width, height = image_size(getattr(plotter, "window_size", None) if size is None else size)
            angle = 2.0 * math.degrees(math.atan(math.tan(0.5 * math.radians(angle)) * height / width))
        return cls.perspective(*placed, fov_y=angle)

    @property
    def kind(self) -> str:
        """Either "orthographic" or "perspective"."""
        return self.native.kind

    @property
    def eye(self) -> Triple:
        """World position of the eye."""
        return self.native.eye

    @property
    def target(self) -> Triple:
        """World position at which the camera looks."""
        return self.native.target

    @property
    def up(self) -> Triple:
        """World direction that is up in the picture, as given."""
        return self.native.up

    @property
    def height(self) -> float:
        """World units from the bottom edge of the picture to the top, for orthographic cameras."""
        return self.native.height

    @property
    def fov_y(self) -> float:
        """Vertical angle in degrees, for perspective cameras."""
        return self.native.fov_y

    @property
    def near(self) -> float:
        """Depth of the near plane of a perspective camera."""
        return self.native.near

    @property
    def shift(self) -> tuple[float, float]:
        """How far the middle of a perspective camera's picture lies right of the target and above it, in heights."""
        return self.native.shift

    @property
    def maker(self) -> str:
        """The function that made it: "orthographic", "perspective" or "fit"."""
        return self._maker[0]

    @property
    def arguments(self) -> Mapping[str, Any]:
        """The arguments of that function; of "fit" the box, `lower` and `upper`, in place of the field."""
        return MappingProxyType(self._maker[1])

    def world_axes(self) -> tuple[Triple, Triple, Triple]:
        """Return the world directions that point right, up, and back towards the viewer in the picture; unit length."""
        rows = [self.native.direction_to_eye(axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        # The columns are the axes of eye space in world coordinates.
        right, up, back = ((rows[0][n], rows[1][n], rows[2][n]) for n in range(3))
        return right, up, back

    def _parts(self) -> tuple[Any, ...]:
        last: Any = self.height if self.kind == "orthographic" else (self.fov_y, self.near, self.shift)
        return self.kind, self.eye, self.target, self.up, self.world_axes(), last

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the arguments."""
        return Camera.of_arguments, (self.maker, dict(self.arguments))

    def __eq__(self, other: object) -> bool:
        """Return whether position, axes and projection are the same."""
        return self._parts() == other._parts() if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash of position, axes and projection."""
        return hash(self._parts())

    def __repr__(self) -> str:
        """Return a short description."""
        last = f"height={self.height:g}" if self.kind == "orthographic" else f"fov_y={self.fov_y:g}, near={self.near:g}"
        last += f", shift={self.shift}" if any(self.shift) else ""
        return f"Camera.{self.kind}(eye={self.eye}, target={self.target}, up={self.up}, {last})"


@dataclass(frozen=True)
class Rays:
    """The rays of pixels: world positions at depths. Conventions, section 1 (Coordinates).

    Attributes
    ----------
    start
        Positions at depth 0, (..., 3).
    along
        World units for each unit of depth, (..., 3).
    """

    start: NDArray[np.float64]
    along: NDArray[np.float64]

    @classmethod
    def of(cls, camera: Camera, size: tuple[int, int], columns: Any, rows: Any) -> Rays:
        """Return the rays through the centres of pixels, by their columns and rows: numbers, or arrays of one shape."""
        width, height = size
        right, up, back = (np.asarray(axis) for axis in camera.world_axes())
        x = (2.0 * (np.asarray(columns)[..., None] + 0.5) / width - 1.0) * width / height
        y = 1.0 - 2.0 * (np.asarray(rows)[..., None] + 0.5) / height
        eye = np.asarray(camera.eye)
        if camera.kind == "orthographic":
            start = eye + 0.5 * camera.height * (x * right + y * up)
            return cls(start, np.broadcast_to(-back, start.shape))
        slope = math.tan(math.radians(camera.fov_y) / 2.0)
        x, y = x + 2.0 * camera.shift[0], y + 2.0 * camera.shift[1]
        along = slope * (x * right + y * up) - back
        return cls(np.broadcast_to(eye, along.shape), along)

    @property
    def stretch(self) -> Any:
        """Length of the rays in each unit of depth."""
        return np.linalg.norm(self.along, axis=-1)

    def at(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions at depths: of one ray (M, 3) at depths (M,), else one for each ray."""
        return self.start + depths[..., None] * self.along

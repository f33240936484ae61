"""The short way: one call from data to a picture, and the pieces that it and the command line are made of."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from sheetsplat import advice, automatic
from sheetsplat._checks import (
    Bounds,
    Triple,
    Vector,
    choice,
    image_size,
    names,
    number,
    shown,
    triple,
    whole,
)
from sheetsplat._checks import (
    direction as axis_or_vector,
)
from sheetsplat.camera import Camera, Kind, bounds_of
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField, Field, Lattice, NanPolicy, Normalization, RegularField
from sheetsplat.image import Image
from sheetsplat.renderer import OUTPUTS, Backend, Output, Packing, Precision, Progress, Renderer, Tagging
from sheetsplat.scene import (
    MODES,
    AmbientOcclusion,
    Clip,
    DepthCue,
    Filter,
    Gradient,
    Light,
    Material,
    Mode,
    Preintegration,
    Sampling,
    Scene,
)
from sheetsplat.transfer import Colormap, Opacity, TransferFunction

if TYPE_CHECKING:
    from sheetsplat.bcc import BccVolume
    from sheetsplat.datasets import Dataset
    from sheetsplat.io.scattered import Fit

Data = Field | Sequence[Field] | ArrayLike | str | os.PathLike[str]

_log = logging.getLogger("sheetsplat")

DEFAULT_CMAP = "viridis"
# Straight on, a volume shows one face; from here it shows three.
AZIMUTH, ELEVATION = 25.0, 20.0
# One light over the viewer's left shoulder; with the specular share it shows the shape of smooth surfaces.
HEAD_LIGHT = Light(direction=(-0.3, 0.4, 1.0))
SHINY = Material(ambient=0.3, diffuse=0.85, specular=0.3, shininess=24.0, two_sided=True)
# Where in the colormap a surface lies whose limits nobody gave: bright enough in maps that begin dark.
SURFACE_SHARE = 0.7


def open(
    path: str | os.PathLike[str],
    *,
    shape: tuple[int, int, int] | None = None,
    dtype: DTypeLike | None = None,
    offset: int = 0,
    name: str | None = None,
    spacing: Vector | None = None,
    origin: Vector | None = None,
    lattice: Lattice | None = None,
    radius: float | None = None,
    falloff: float | None = None,
    normalization: Normalization | None = None,
    w0: float | None = None,
    prefilter: bool = False,
    nan: NanPolicy | None = None,
    grid: str | os.PathLike[str] | None = None,
    scalar: str | None = None,
    particles: str | None = None,
    support: float | None = None,
    fit: Fit | None = None,
    neighbors: int | None = None,
    min_scale: float | None = None,
    log: bool | float = False,
) -> RegularField | EllipsoidField:
    """Return the field of a file, which may be gzipped.

    Regular volumes: .npy, .npz, NRRD, MetaImage (.mhd, .mha), VTK's .vti, raw samples. Scattered data: PLOT3D with its
    grid, VTK's .vtu and .vtp, HDF5 with particles, .ply of 3D Gaussian Splatting, .csv, .npz with an array centers.

    Parameters
    ----------
    path
        The file; its format is found by content, then by suffix.
    shape, dtype, offset
        For raw samples: (nk, nj, ni), the order of the array [k, j, i], with i, along x, the fastest; their type (">i2"
        for big-endian); the bytes before the first sample.
    name
        For .npz: the array to take, where the file has several with three axes.
    spacing, origin
        World units along x, y, z; what the file says unless given.
    lattice, radius, prefilter, nan
        As for `RegularField`; for regular volumes.
    falloff, normalization, w0
        As for `RegularField` or `EllipsoidField`.
    grid
        For PLOT3D: the grid; `path` is the solution.
    scalar
        For scattered data and .vti: what is shown, by the name that it has in the file (NAME_x for one component of a
        vector, NAME for its length); for PLOT3D density, momentum, energy, pressure, mach and others.
    particles, support
        For HDF5: the group, PartType0 unless given, and the radius of the kernels' supports in smoothing lengths, which
        is found by the densities unless given.
    fit, neighbors
        For scattered data: how points become ellipsoids, "delaunay" or "nearest" (by so many neighbours); unless given,
        the kernels that the file has, else its mesh or the Delaunay tetrahedra.
    min_scale
        For scattered data: as for `EllipsoidField`.
    log
        Show decades above the smallest value, log10(v / smallest), or above this number, to which smaller values are
        raised.

    Raises
    ------
    InvalidInput
        For files that are damaged, lie about their size, or hold something else, and options without a meaning there.
    OutOfMemory
        Where the samples do not fit.
    Error
        Where the file cannot be read.
    """
    from sheetsplat.io.opening import open_field

    sizes: tuple[int, int, int] | None = None
    if shape is not None:
        if isinstance(shape, str) or not isinstance(shape, Iterable):
            raise complain("open: shape cannot be used", shown(shape), "three whole numbers, (nk, nj, ni)")
        # Iterators may have no end.
        parts = list(islice(shape, 4))
        if len(parts) != 3:
            raise complain("open: shape cannot be used", shown(shape), "three whole numbers, (nk, nj, ni)")
        nk, nj, ni = (whole("open: shape", part) for part in parts)
        sizes = nk, nj, ni
    options: dict[str, Any] = {
        "shape": sizes,
        "dtype": dtype,
        "offset": whole("open: offset", offset) or None,
        "name": name,
        "spacing": spacing,
        "origin": origin,
        "lattice": lattice,
        "radius": radius,
        "falloff": falloff,
        "normalization": normalization,
        "w0": w0,
        "prefilter": prefilter or None,
        "nan": nan,
        "grid": grid,
        "scalar": scalar,
        "particles": particles,
        "support": support,
        "fit": fit,
        "neighbors": neighbors,
        "min_scale": min_scale,
        "log": log or None,
    }
    return open_field(path, {option: value for option, value in options.items() if value is not None})


# Options of `open` that mean nothing for arrays.
_OF_FILES = (
    *("shape", "dtype", "offset", "name", "grid", "scalar", "particles", "support"),
    *("fit", "neighbors", "min_scale", "log"),
)


def to_fields(data: Data, **options: Any) -> list[Field]:
    """Return the fields of an array, a path, a field or several fields; `options` make fields of the first two."""
    given = {name: value for name, value in options.items() if value is not None}
    # The generated data sets, and whatever else makes a field of itself.
    maker = None if isinstance(data, np.ndarray) else getattr(data, "field", None)
    if callable(maker):
        data = maker()
    if isinstance(data, str | os.PathLike):
        return [open(data, **given)]
    is_fields = isinstance(data, list | tuple) and bool(data) and all(isinstance(one, Field) for one in data)
    if isinstance(data, Field) or is_fields:
        if given:
            raise complain(
                "render: these options cannot be used",
                ", ".join(given) + " for a field that is made already",
                "them only for arrays and files",
                "give them to the field itself, or to sheetsplat.open",
            )
        return [data] if isinstance(data, Field) else list(data)  # type: ignore[arg-type]
    for name in _OF_FILES:
        if name in given:
            raise complain(f"render: {name} cannot be used", "an array", f"{name} only for files")
    return [RegularField(data, **given)]  # type: ignore[arg-type]


def compose_scene(
    fields: Sequence[Field],
    *,
    transfer_function: TransferFunction | None = None,
    cmap: Colormap | None = None,
    opacity: Opacity | None = None,
    clim: Sequence[float] | None = None,
    mode: Mode = "composite",
    iso_value: float | None = None,
    shading: bool = True,
    lights: Iterable[Light] | None = None,
    material: Material | None = None,
    spacing_is_free: bool = False,
    **options: Any,
) -> Scene:
    """Return a scene; what is not given is chosen by the scalars, for scattered fields also the distance of slices.

    Where `spacing_is_free`, that distance is left to a renderer which has an error or a time to keep. Other options go
    to `Scene`.
    """
    if transfer_function is not None:
        clash = [name for name, value in (("cmap", cmap), ("opacity", opacity), ("clim", clim)) if value is not None]
        if clash:
            raise complain(
                "render: these options cannot be used together",
                ", ".join(["transfer_function", *clash]),
                "either a transfer function, or cmap, opacity and clim",
            )
    elif mode in ("xray", "mip"):
        # These look at no colours at all.
        transfer_function = TransferFunction([(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])
    if mode == "isosurface" and iso_value is None:
        iso_value = automatic.choose(fields).surface
    if mode == "isosurface" and transfer_function is None and clim is None:
        clim = _surface_limits(fields, number("render: iso_value", iso_value))
    look = automatic.choose(fields) if transfer_function is None and (opacity is None or clim is None) else None
    if transfer_function is None:
        if clim is None:
            assert look is not None
            limits: Sequence[float] = look.clim
            opacities = look.opacity if opacity is None else opacity
        else:
            limits = clim
            top = automatic.TOP_OPACITY if look is None else look.top_opacity
            opacities = (0.0, top) if opacity is None else opacity
        chooses = mode == "composite" and options.get("slice_spacing") is None and not spacing_is_free
        if look is not None and chooses:
            options["slice_spacing"] = look.slice_spacing
        transfer_function = TransferFunction.from_colormap(DEFAULT_CMAP if cmap is None else cmap, opacities, limits)
    scattered = [one for one in fields if isinstance(one, EllipsoidField) and one.size]
    if mode == "isosurface" and scattered and options.get("slice_spacing") is None and not spacing_is_free:
        # A crossing is found between two slices by a straight line, which two slices in a kernel's thickness do not
        # give; what the opacities mean does not change.
        options["slice_spacing"] = min(one.default_slice_spacing for one in fields if one.size) / 4
    if lights is None:
        lights = (HEAD_LIGHT,) if shading and mode in ("composite", "isosurface") else ()
    scene = Scene(
        list(fields),
        transfer_function,
        mode=mode,
        iso_value=iso_value,
        lights=lights,
        material=SHINY if material is None else material,
        **options,
    )
    if options.get("shadows") and not scene.lights:
        _log.warning("shadows change nothing where there are no lights")
    return scene


def fitting_depth_cue(scene: Scene, camera: Camera, color: Vector = (0.0, 0.0, 0.0), strength: float = 0.8) -> DepthCue:
    """Return a depth cue from the nearest to the farthest corner of what the fields take, as far as it can be seen."""
    low, high = bounds_of(scene)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    depths = [-camera.native.to_eye((float(x), float(y), float(z)))[2] for x, y, z in corners]
    start = max(min(depths), camera.near) if camera.kind == "perspective" else min(depths)
    # A field of one kernel may take none, and all of it may be behind the eye.
    end = max(depths) if max(depths) > start else start + max(abs(start), 1.0)
    return DepthCue(start, end, color, strength)


def _surface_limits(fields: Sequence[Field], iso_value: float) -> tuple[float, float] | None:
    """Return limits as wide as the values that give a surface a colour from the upper part of a map."""
    ranges = [one.value_range for one in fields if one.size]
    width = sum(high - low for low, high in ranges)
    if not math.isfinite(iso_value):
        return None
    if not width > 1e-6 * abs(iso_value):
        width = max(abs(iso_value), 1.0) * 1e-3
    limits = iso_value - SURFACE_SHARE * width, iso_value + (1.0 - SURFACE_SHARE) * width
    return limits if math.isfinite(limits[1] - limits[0]) else None


def surface_text(scene: Scene) -> str:
    """Return in words which iso value and which colour a scene's surface has."""
    assert scene.iso_value is not None
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in surface_color(scene))
    return f"isosurface at {scene.iso_value:g}, colour #{red:02x}{green:02x}{blue:02x}"


def surface_color(scene: Scene) -> Triple:
    """Return red, green, blue of a scene's surface before it is lit."""
    return triple("colour", scene.transfer_function.at(scene.iso_value or 0.0)[:3])


def _turned(direction: Triple, up: Triple, azimuth: float, elevation: float) -> Triple:
    """Return the direction of view after the eye went round `up` by azimuth and towards it by elevation, in degrees."""
    view = np.asarray(direction) / np.linalg.norm(direction)
    axis = np.asarray(up) / np.linalg.norm(up)
    turned = _rotate(view, axis, math.radians(azimuth))
    right = np.cross(turned, axis)
    length = float(np.linalg.norm(right))
    if length < 1e-9:
        # Seen from above or below there is no horizon to rise from; the camera says what is wrong with such an up.
        return triple("direction", turned)
    return triple("direction", _rotate(turned, right / length, -math.radians(elevation)))


def _rotate(vector: Any, axis: Any, angle: float) -> Any:
    """Return the vector turned round a unit axis, counter-clockwise seen against the axis (Rodrigues' formula)."""
    along = axis * np.dot(axis, vector)
    return along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(axis, vector)


def compose_camera(
    thing: object,
    size: tuple[int, int],
    *,
    direction: Vector | str | None = None,
    up: Vector | str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float = 1.0,
    target: Vector | None = None,
    projection: Kind = "orthographic",
    fov_y: float = 30.0,
    margin: float = 1.05,
) -> Camera:
    """Return a camera that shows all of a field or a scene in a picture of any shape, turned, zoomed and centred."""
    if target is not None:
        middle = np.asarray(triple("render: target", target))
        if not np.all(np.isfinite(middle)):
            raise complain("render: target cannot be used", f"{tuple(middle.tolist())}", "three finite numbers")
        camera = compose_camera(
            thing,
            size,
            direction=direction,
            up=up,
            azimuth=azimuth,
            elevation=elevation,
            zoom=zoom,
            projection=projection,
            fov_y=fov_y,
            margin=margin,
        )
        eye = middle + (np.asarray(camera.eye) - np.asarray(camera.target))
        if projection == "perspective":
            return Camera.perspective(eye, middle, camera.up, fov_y=camera.fov_y, near=camera.near)
        return Camera.orthographic(eye, middle, camera.up, height=camera.height)
    # Without a kernel there is no box, and the picture is empty from anywhere.
    bounds: Bounds = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)) if _is_empty(thing) else bounds_of(thing)
    view = axis_or_vector("render: direction", (0.0, 0.0, -1.0) if direction is None else direction)
    upward = axis_or_vector("render: up", (0.0, 1.0, 0.0) if up is None else up)
    # Who gives a direction wants just that.
    turn = number("render: azimuth", (AZIMUTH if direction is None else 0.0) if azimuth is None else azimuth)
    rise = number("render: elevation", (ELEVATION if direction is None else 0.0) if elevation is None else elevation)
    if not (math.isfinite(turn) and math.isfinite(rise)):
        raise complain("render: azimuth or elevation cannot be used", f"{turn:g}, {rise:g}", "finite angles, degrees")
    if any(view) and any(upward) and np.all(np.isfinite(view)) and np.all(np.isfinite(upward)):
        if up is None and _parallel(view, upward):
            # What would be up if the eye had risen to there from the front.
            upward = (0.0, 0.0, math.copysign(1.0, view[1]))
        level = _turned(view, upward, turn, 0.0)
        view = _turned(view, upward, turn, rise)
        if _parallel(view, upward) and not _parallel(level, upward):
            # Straight from above or below: up is where the eye was looking before it rose, or where it came from.
            ahead = np.asarray(level) - np.asarray(view) * np.dot(level, view)
            upward = triple("up", ahead if np.dot(view, upward) < 0 else -ahead)
    nearer = number("render: zoom", zoom)
    if not (math.isfinite(nearer) and nearer > 0):
        raise complain("render: zoom cannot be used", f"{nearer:g}", "a finite number above 0")
    width, height = size
    reach = number("render: margin", margin)
    box = _Box(bounds)
    if projection == "perspective":
        camera = _nearest(Camera.fit(box, view, upward, projection, reach, fov_y=fov_y), bounds, height / width, reach)
        if nearer == 1.0:
            return camera
        # Going nearer would end inside the thing; a narrower angle enlarges it where it is.
        angle = 2 * math.degrees(math.atan(math.tan(math.radians(camera.fov_y) / 2) / nearer))
        return Camera.perspective(camera.eye, camera.target, camera.up, fov_y=angle, near=camera.near)
    camera = Camera.fit(box, view, upward, projection, reach, fov_y=fov_y)
    # Width and height of the box as this camera sees it: the sums of its edges' shares.
    edges = np.diag(np.subtract(bounds[1], bounds[0]))
    across, high, _ = np.abs([camera.native.direction_to_eye(triple("edge", edge)) for edge in edges]).sum(axis=0)
    if across > 0 and high > 0:
        reach *= max(high, across * height / width) / max(high, across)
    return Camera.fit(box, view, upward, projection, reach / nearer, fov_y=fov_y)


def _is_empty(thing: object) -> bool:
    """Return True for a field or a scene without a single kernel."""
    fields = thing.fields if isinstance(thing, Scene) else thing
    several = fields if isinstance(fields, list | tuple) else [fields]
    return bool(several) and all(isinstance(one, Field) and one.size == 0 for one in several)


def _parallel(first: Triple, second: Triple) -> bool:
    a, b = np.asarray(first), np.asarray(second)
    return float(np.linalg.norm(np.cross(a / np.linalg.norm(a), b / np.linalg.norm(b)))) < 1e-6


def _nearest(camera: Camera, bounds: Bounds, aspect: float, margin: float) -> Camera:
    """Return a perspective camera that came as near as the corners of a box let it; aspect is height over width."""
    half = 0.5 * np.subtract(bounds[1], bounds[0])
    slope = math.tan(math.radians(camera.fov_y) / 2)
    edges = [camera.native.direction_to_eye(triple("edge", edge)) for edge in np.diag(half)]
    signs = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)]), axis=-1).reshape(8, 3)
    corners = np.abs(signs @ np.asarray(edges)[:, :2]), signs @ np.asarray(edges)[:, 2]
    distance = float((corners[1] + margin / slope * np.maximum(corners[0][:, 0] * aspect, corners[0][:, 1])).max())
    target = np.asarray(camera.target)
    back = np.asarray(camera.eye) - target
    length = float(np.linalg.norm(back))
    # A box without an extent, or one so far from 0 that there are no digits for it: as the fit had it.
    if not distance > 1e-9 * max(1.0, float(np.abs(target).max())) or not math.isfinite(distance):
        return camera
    return Camera.perspective(target + back * (distance / length), target, camera.up, fov_y=camera.fov_y)


class _Box:
    """Something with bounds."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds


def _suggested(data: object, given: Mapping[str, object]) -> dict[str, Any]:
    """Return the look that generated data sets suggest, where nobody gave another one."""
    suggested: Any = getattr(data, "suggested", None)
    if not isinstance(suggested, Mapping) or {"transfer_function", "cmap", "opacity", "clim"} & given.keys():
        return {}
    look: dict[str, Any] = {}
    mode = given.get("mode") or suggested.get("mode", "composite")
    if mode == "isosurface" and "iso_value" in suggested and "iso_value" not in given:
        look["iso_value"] = suggested["iso_value"]
    if mode == "composite" or "iso_value" in look:
        maker: Any = data
        look["transfer_function"] = maker.transfer_function()
    return {"mode": mode, **look}


def _refuse_beside_a_scene(given: Mapping[str, object]) -> None:
    clash = [name for name, value in given.items() if value is not None]
    if clash:
        raise complain(
            "render: these options cannot be used",
            ", ".join(clash) + " for a scene that is made already",
            "them only for arrays, files and fields",
            "give them to sheetsplat.Scene",
        )


def render(
    data: Data | Dataset | BccVolume | Scene,
    *,
    size: tuple[int, int] = (400, 400),
    cmap: Colormap | None = None,
    opacity: Opacity | None = None,
    clim: Sequence[float] | None = None,
    transfer_function: TransferFunction | None = None,
    shading: bool | None = None,
    lights: Iterable[Light] | None = None,
    material: Material | None = None,
    background: Vector | str | None = None,
    mode: Mode | None = None,
    iso_value: float | None = None,
    slice_spacing: float | None = None,
    sampling: Sampling | None = None,
    reference_length: float | None = None,
    opacity_stop: float | None = None,
    preintegration: Preintegration | None = None,
    filter: Filter | None = None,
    gradient: Gradient | None = None,
    clip: Clip | None = None,
    gradient_opacity: float | None = None,
    depth_cue: DepthCue | str | None = None,
    shadows: bool | None = None,
    ambient_occlusion: AmbientOcclusion | None = None,
    camera: Camera | None = None,
    direction: Vector | str | None = None,
    up: Vector | str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float = 1.0,
    target: Vector | None = None,
    projection: Kind = "orthographic",
    fov_y: float = 30.0,
    margin: float = 1.05,
    renderer: Renderer | None = None,
    backend: Backend = "auto",
    device: int | None = None,
    precision: Precision = "auto",
    tagging: Tagging = "auto",
    packing: Packing = "auto",
    effects: Mapping[str, bool] | None = None,
    allow_inexact: bool = False,
    threads: int | None = None,
    max_error: float | None = None,
    max_seconds: float | None = None,
    outputs: Iterable[Output] = (),
    progress: Progress | None = None,
    spacing: Vector | None = None,
    origin: Vector | None = None,
    lattice: Lattice | None = None,
    radius: float | None = None,
    falloff: float | None = None,
    normalization: Normalization | None = None,
    w0: float | None = None,
    prefilter: bool = False,
    nan: NanPolicy | None = None,
    shape: tuple[int, int, int] | None = None,
    dtype: DTypeLike | None = None,
    offset: int | None = None,
    name: str | None = None,
    grid: str | os.PathLike[str] | None = None,
    scalar: str | None = None,
    particles: str | None = None,
    support: float | None = None,
    fit: Fit | None = None,
    neighbors: int | None = None,
    min_scale: float | None = None,
    log: bool | float | None = None,
) -> Image:
    """Return a picture of an array, a file, a field or several fields. What is not given is chosen to show something.

    Parameters
    ----------
    data
        Array [k, j, i], path of a file, field, sequence of fields, or what makes a field by its method ``field()``, as
        generated data sets do. A data set is shown as it suggests where no colours are given. A scene is taken as it
        is; then only size, camera, renderer, outputs, progress and their like may be given.
    size
        (width, height) in pixels.
    cmap, opacity, clim
        Colours, opacity per reference length, and the values at which the colormap begins and ends, as for
        `TransferFunction.from_colormap`; by the samples' histogram unless given.
    transfer_function
        Takes the place of these three.
    shading, lights, material
        Without `lights` one light over the viewer's shoulder, or none where `shading` is False.
    background
        Behind the picture: red, green, blue, a name such as "white", or "#rrggbb"; transparent unless given.
    mode, iso_value, slice_spacing, sampling, reference_length, opacity_stop, preintegration, filter
        As for `Scene`. Without `iso_value` a surface is put where the histogram parts things from background; without
        `clim` its colour is that at 7/10 of the colormap. What a mode does not use is told to the log.
    gradient, clip, gradient_opacity, shadows, ambient_occlusion
        As for `Scene`.
    depth_cue
        As for `Scene`; or "auto" for one that fades to black, by 4/5, over the depths that the fields take.
    camera
        Takes the place of the options that follow.
    direction, up
        World direction of the view, (0, 0, −1) unless given, and what is up in the picture, (0, 1, 0) unless given;
        three numbers, or an axis such as "x" or "-z".
    azimuth, elevation
        Degrees by which the eye goes round `up` to the right, and then towards `up`; 25 and 20 unless given, 0 and 0
        where `direction` is given.
    zoom
        Enlargement.
    target
        World point in the middle of the picture; the middle of the field unless given.
    projection, fov_y, margin
        As for `Camera.fit`: "orthographic" or "perspective", vertical angle in degrees, margin around the field.
    renderer
        Takes the place of the options that follow.
    backend, device, precision, tagging, packing, effects, allow_inexact, threads, max_error, max_seconds
        As for `Renderer`.
    outputs, progress
        As for `Renderer.render`.
    spacing, origin, lattice, radius, falloff, normalization, w0, prefilter, nan
        As for `RegularField`; for arrays and files.
    shape, dtype, offset, name, grid, scalar, particles, support, fit, neighbors, min_scale, log
        As for `sheetsplat.open`; for files.

    Raises
    ------
    Error
        What opening, `Scene`, `Camera.fit` and `Renderer` raise.
    """
    width, height = image_size(size)
    field_options = {
        "spacing": spacing,
        "origin": origin,
        "lattice": lattice,
        "radius": radius,
        "falloff": falloff,
        "normalization": normalization,
        "w0": w0,
        "prefilter": prefilter or None,
        "nan": nan,
        "shape": shape,
        "dtype": dtype,
        "offset": offset,
        "name": name,
        "grid": grid,
        "scalar": scalar,
        "particles": particles,
        "support": support,
        "fit": fit,
        "neighbors": neighbors,
        "min_scale": min_scale,
        "log": log or None,
    }
    look: dict[str, Any] = {
        "transfer_function": transfer_function,
        "cmap": cmap,
        "opacity": opacity,
        "clim": clim,
        "mode": mode,
        "iso_value": iso_value,
        "shading": shading,
        "lights": lights,
        "material": material,
        "background": background,
        "slice_spacing": slice_spacing,
        "sampling": sampling,
        "reference_length": reference_length,
        "opacity_stop": opacity_stop,
        "preintegration": preintegration,
        "filter": filter,
        "gradient": gradient,
        "clip": clip,
        "gradient_opacity": gradient_opacity,
        "depth_cue": depth_cue,
        "shadows": shadows,
        "ambient_occlusion": ambient_occlusion,
    }
    if isinstance(data, Scene):
        _refuse_beside_a_scene({**look, **field_options})
        scene = data
    else:
        given = {option: value for option, value in look.items() if value is not None}
        fields = to_fields(Path(data) if isinstance(data, str) else data, **field_options)  # type: ignore[arg-type]
        shown_in = choice("render: mode", mode or _suggested(data, given).get("mode", "composite"), MODES)
        # Not lit, not stopped, not integrated: that is how it is anyway where the mode does not look at it.
        asked = [option for option, value in given.items() if value is not False]
        outputs = names("Renderer: outputs", outputs, OUTPUTS)  # type: ignore[assignment]
        ignored = advice.unused(shown_in, [*asked, *outputs])
        if ignored:
            _log.warning("mode %s does not use these options: %s", shown_in, ", ".join(ignored))
        if depth_cue == "auto":
            # Known when the camera is.
            del given["depth_cue"]
        goals = (max_error, max_seconds) if renderer is None else (renderer.max_error, renderer.max_seconds)
        free = any(goal is not None for goal in goals)
        scene = compose_scene(fields, **{**_suggested(data, given), **given}, spacing_is_free=free)
        if scene.mode == "isosurface":
            _log.info("%s", surface_text(scene))
    if camera is None:
        camera = compose_camera(
            scene,
            (width, height),
            direction=direction,
            up=up,
            azimuth=azimuth,
            elevation=elevation,
            zoom=zoom,
            target=target,
            projection=projection,
            fov_y=fov_y,
            margin=margin,
        )
    if depth_cue == "auto":
        scene = scene.replace(depth_cue=fitting_depth_cue(scene, camera))
    if renderer is None:
        renderer = Renderer(
            backend,
            device=device,
            precision=precision,
            tagging=tagging,
            packing=packing,
            effects=effects,
            allow_inexact=allow_inexact,
            threads=threads,
            max_error=max_error,
            max_seconds=max_seconds,
        )
    return renderer.render(scene, camera, size=(width, height), outputs=outputs, progress=progress)

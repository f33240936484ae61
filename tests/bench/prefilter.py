"""Marschner and Lobb's signal, unlit, against its formula: kernels, trilinear, prefilter; decibels and time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

import sheetsplat as ss
from bench.measure import (
    Floats,
    attempt,
    clock,
    composited,
    decibels,
    device_of,
    forget_peak,
    in_new_process,
    rays,
    renderer_for,
    resident,
    rms,
    time_frames,
    usable_processors,
)
from bench.pictures import keep
from bench.report import Goal, Options, Report, Row, columns, environment
from sheetsplat import datasets
from sheetsplat.ripple import lattice_ripple

#: Goal of the prefilter with radius 2.5 and falloff 7, at the full size.
WANTED_DB = 65.0
_EDGE = 128
_PIXELS = 200
# Values below the first are invisible, and rays end above the last but one: no ray meets the border of the volume,
# where sums of kernels fall to 0 and the formula does not.
POINTS = (
    (0.30, 0.1, 0.2, 0.9, 0.0),
    (0.45, 0.2, 0.8, 0.3, 0.2),
    (0.60, 0.9, 0.9, 0.1, 0.3),
    (1.00, 0.9, 0.2, 0.1, 0.3),
)
# Oblique, so that rays pass samples at many distances; the picture stays inside the volume.
_EYE = (0.6, 0.9, 3.0)
_HEIGHT = 1.3
_DEPTH = 1.0

_KERNELS = ((2.0, 5.0), (2.5, 7.0), (3.0, 8.0))

#: Goals of the solution for the coefficients, nanoseconds a sample on all processors.
WANTED_NS = {"cartesian": 40.0, "bcc": 80.0}
_SOLVED_EDGES = (128, 256)

#: Rows that can be run alone.
ROWS = ("trilinear", "plain", "threshold", "prefilter", "bcc", "bcc prefilter", "solution")


def solution(edge: int, radius: float, falloff: float, lattice: Any) -> Row:
    """Return the cost of the coefficients of noise, for `in_new_process`.

    ``ns`` is the time of all threads over samples and processors, which other load hardly changes; ``bytes`` the peak
    of memory over the caller's array and the samples that the field keeps, for each sample.
    """
    values = np.random.default_rng(1).random((edge, edge, edge), np.float32)
    options: dict[str, Any] = {"radius": radius, "falloff": falloff, "lattice": lattice}
    ss.RegularField(values[:32, :32, :32], prefilter=True, **options)
    _, _, without = clock(lambda: ss.RegularField(values, **options))
    before = resident()
    forget_peak()
    field, _, spent = clock(lambda: ss.RegularField(values, prefilter=True, **options))
    return {
        "ns": 1e9 * (spent - without) / values.size / usable_processors(),
        "bytes": (resident("VmHWM") - before) / values.size - values.itemsize,
        "residual": field.prefilter_residual,
    }


def flat_picture(
    rho: Callable[[Floats], NDArray[Any]],
    points: Any,
    camera: ss.Camera,
    size: tuple[int, int],
    *,
    middle: float,
    half: float,
    spacing: float,
    length: float,
) -> Floats:
    """Return the picture (h, w, 4) of a scalar given at every point, unlit, by an orthographic camera.

    Sections 1, 3, 4 and 6 of the conventions with A_stop = 1, point sampling, no field at all.

    Parameters
    ----------
    rho
        The scalar at points (..., 3) in the world.
    points
        Of the transfer function.
    camera, size
        The view.
    middle, half
        Depth of t_c (conventions, section 3), and the depth that slices cover on each side of it.
    spacing, length
        Distance of slices and reference length.
    """
    starts, ahead = rays(camera, size)
    table = ss.TransferFunction(list(points))
    count = math.ceil(half / spacing)
    depths = (middle + (n + 0.5) * spacing for n in range(-count, count))
    slices = ((table.at(rho(starts + depth * ahead)), spacing / length) for depth in depths)
    return composited(slices, starts.shape[:2])


def view() -> ss.Camera:
    """Return the camera of the measurement."""
    return ss.Camera.orthographic(_EYE, (0.0, 0.0, 0.0), height=_HEIGHT)


def expected_picture(
    rho: Callable[[Floats], NDArray[Any]], size: tuple[int, int], spacing: float, centre: Any = (0.0, 0.0, 0.0)
) -> Floats:
    """Return the picture of a scalar given at every point; `spacing` of samples, `centre` of their box."""
    camera = view()
    ahead = np.subtract(camera.target, camera.eye)
    ahead /= np.linalg.norm(ahead)
    middle = float(np.subtract(centre, camera.eye) @ ahead)
    return flat_picture(rho, POINTS, camera, size, middle=middle, half=_DEPTH, spacing=spacing / 2.0, length=spacing)


def scene_of(field: ss.RegularField, spacing: float) -> ss.Scene:
    """Return the scene of the measurement; `spacing` of the Cartesian samples."""
    return ss.Scene(field, list(POINTS), slice_spacing=spacing / 2.0, reference_length=spacing, opacity_stop=1.0)


def _signal(at: Floats) -> Floats:
    return datasets.marschner_lobb_value(at[..., 0], at[..., 1], at[..., 2])


def _figures(picture: NDArray[Any], expected: Floats) -> Row:
    distance = picture.astype(np.float64) - expected
    rmse = rms(distance)
    return {"db": decibels(rmse), "rmse": rmse, "maximum": float(np.abs(distance).max())}


def _trilinear(volume: datasets.Dataset, size: tuple[int, int], expected: Floats) -> Row:
    """Return the figures of trilinear interpolation at the very points of the slices."""
    spacing = volume.spacing[0]

    def rho(at: Floats) -> Floats:
        index = ((at - np.asarray(volume.origin)) / spacing)[..., ::-1]
        found = ndimage.map_coordinates(volume.values, np.moveaxis(index, -1, 0), np.float64, order=1)
        return np.asarray(found)

    picture, spent, _ = clock(lambda: expected_picture(rho, size, spacing))
    return {**_figures(picture, expected), "remark": f"NumPy, {spent:.1f} s"}


def run(options: Options) -> Report:
    """Measure every reconstruction."""
    edge = options.edge(_EDGE)
    size = (options.edge(_PIXELS), options.edge(_PIXELS))
    volume = datasets.marschner_lobb(edge)
    spacing = volume.spacing[0]
    expected = expected_picture(_signal, size, spacing)
    rows: list[Row] = []
    if options.wants("trilinear"):
        options.say("trilinear")
        rows.append({"row": "trilinear", **_trilinear(volume, size, expected)})
    groups: list[tuple[str, datasets.Dataset, dict[str, Any]]] = [
        ("plain", volume, {}),
        ("threshold", volume, {"normalization": "threshold"}),
        ("prefilter", volume, {"prefilter": True}),
    ]
    if options.wants("bcc") or options.wants("bcc prefilter"):
        body = datasets.marschner_lobb(edge, lattice="bcc")
        groups += [("bcc", body, {}), ("bcc prefilter", body, {"prefilter": True})]

    def kernels(name: str, data: datasets.Dataset, settings: dict[str, Any], compared: Floats) -> Row:
        """Return the figures of a field of kernels, with the times of making it and of a frame."""
        field, made, _ = clock(lambda: data.field(**settings))
        cameras = [view()] * options.views
        timing, picture = time_frames(renderer_for(options), scene_of(field, spacing), cameras, size)
        keep(options, picture, "marschner_lobb", f"{name} {settings['radius']:g} {settings['falloff']:g}")
        return {
            **_figures(picture.rgba, compared),
            "field_ms": 1000.0 * made,
            "wall_ms": 1000.0 * timing.wall,
            "ripple": lattice_ripple(lattice=data.lattice, **settings).peak,  # type: ignore[arg-type]
            "residual": field.prefilter_residual,
        }

    reached = math.nan
    for name, data, settings in groups:
        if not options.wants(name):
            continue
        lower, upper = data.field().centre_bounds
        compared = expected_picture(_signal, size, spacing, 0.5 * np.add(lower, upper)) if "bcc" in name else expected
        for radius, falloff in _KERNELS:
            options.say(f"{name}, radius {radius:g}, falloff {falloff:g}")
            chosen = {"radius": radius, "falloff": falloff, **settings}
            row: Row = {"row": name, "radius": radius, "falloff": falloff}
            row |= attempt(partial(kernels, name, data, chosen, compared))
            rows.append(row)
            if (name, radius) == ("prefilter", 2.5):
                reached = row.get("db", math.nan)
    goals = []
    if not math.isnan(reached):
        goals = [Goal("prefilter (2.5, 7)", reached, WANTED_DB, "dB", least=True)]
    for size_of, lattice, (radius, falloff) in itertools.product(_SOLVED_EDGES, WANTED_NS, _KERNELS):
        if not options.wants("solution"):
            continue
        solved = options.edge(size_of)
        name = f"{lattice}, {solved}^3"
        options.say(f"solution, {name}, radius {radius:g}, falloff {falloff:g}")
        chosen = {"edge": solved, "radius": radius, "falloff": falloff, "lattice": lattice}
        found = attempt(partial(in_new_process, solution, **chosen))
        rows.append({"row": name, "radius": radius, "falloff": falloff, **found})
        if "ns" in found and radius < _KERNELS[-1][0]:
            goals.append(Goal(f"{name}, ({radius:g}, {falloff:g})", found["ns"], WANTED_NS[lattice], "ns"))
    return Report(
        name="prefilter",
        title=f"Marschner-Lobb {edge}^3, flat, {size[0]}x{size[1]}, slices half a sample apart, against its formula",
        columns=columns(
            "row=reconstruction, radius, falloff, db=dB, rmse, maximum, field_ms=field ms, wall_ms=frame ms, "
            "ripple=ripple peak, residual, ns=ns a sample, bytes=bytes a sample, remark"
        ),
        rows=rows,
        goals=goals,
        notes=[
            "dB: 20 log10 (1 / RMSE) over premultiplied RGBA; the formula is composited at the same slices, so that "
            "only the reconstruction differs.",
            f"field ms: from samples to field, including the solution for the coefficients. frame ms: median of "
            f"{options.views}.",
            "ns a sample: the solution for the coefficients of noise alone, time of all threads over samples and "
            "processors. bytes a sample: coefficients and what is needed on the way.",
            "The BCC lattices have 1 / sqrt(2) of the samples; opacities are per the Cartesian distance.",
        ],
        environment=environment(device_of(renderer_for(options))),
    )

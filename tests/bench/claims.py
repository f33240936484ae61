"""The papers' claims on quality, measured again.

[NM05] Neophytou and Mueller 2005, [NM06] Neophytou and Mueller 2006, [MC98] Mueller and Crawfis 1998.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.claims_axis import axis_aligned
from bench.lab import lab_renderer
from bench.measure import Floats, Timing, attempt, clock, difference, orthographic, renderer_for, rms
from bench.pictures import keep, make_sheet
from bench.report import Options, Report, Row, columns
from sheetsplat import datasets
from sheetsplat.fields import Field

#: Claims that can be measured alone.
ROWS = ("slabs", "bits", "shading", "borders", "popping")

_PIXELS = 256
_LOUDER = 8.0

# Contact sheet of each claim: rows of names of pictures.
_SHEETS: dict[str, list[list[tuple[str, ...]]]] = {
    "slabs": [
        [
            ("slabs", "composite", "converged"),
            ("slabs", "composite", "slices", "3"),
            ("slabs", "composite", "slabs", "3"),
        ]
    ],
    "bits": [[("bits", "lit", name) for name in ("reference", "uint8", "float16")]],
    "shading": [[("shading", name, zoom) for name in ("finer", "after", "before")] for zoom in ("1", "8")],
    "borders": [[("borders", name) for name in ("max(1, w)", "max(0.01, w)", "max(0.01, w), ghost points")]],
    "popping": [[("popping", name) for name in ("axis-aligned, corrected", "image-aligned, 1 apart")]],
}


def _timed(renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> tuple[ss.Image, float]:
    """Return a picture and the time of a second frame, ms."""
    renderer.render(scene, camera, size=size)
    timing = Timing()
    return timing.frame(renderer, scene, camera, size), 1000.0 * timing.wall


def _distance(picture: ss.Image, expected: ss.Image, spent: float) -> Row:
    apart = difference(picture, expected)
    return {"rmse": apart["rmse"], "maximum": apart["maximum"], "wall_ms": spent}


def _camera(field: Field, height: float) -> ss.Camera:
    """Return an oblique view of a field's middle, `height` world units high."""
    low, high = (np.asarray(corner) for corner in field.centre_bounds)
    reach = float(np.linalg.norm(high - low))
    return orthographic(0.5 * (low + high), (0.42, 0.37, 0.83), reach, height)


# Slices against slabs


def _slabs(options: Options) -> Iterator[Row]:
    """Yield distances from the picture of very thin slices, for slices and slabs of growing distance."""
    edge = options.edge(64)
    volume = datasets.tubes(edge)
    field = volume.field()
    size = (options.edge(_PIXELS),) * 2
    camera = _camera(field, 0.8 * edge)
    renderer = renderer_for(options)

    def scene(spacing: float, sampling: Any, mode: Any) -> ss.Scene:
        return ss.Scene(
            field,
            volume.transfer_function(),
            slice_spacing=spacing,
            sampling=sampling,
            reference_length=1.0,
            opacity_stop=1.0,
            mode=mode,
        )

    for mode in ("composite", "xray"):
        converged = renderer.render(scene(0.0625, "point", mode), camera, size=size)
        keep(options, converged, "slabs", mode, "converged")
        for spacing in (0.5, 1.0, 2.0, 3.0):
            for sampling, name in (("point", "slices"), ("slab", "slabs")):
                options.say(f"slabs: {name}, {spacing:g} apart, {mode}")
                picture, spent = _timed(renderer, scene(spacing, sampling, mode), camera, size)
                keep(options, picture, "slabs", mode, name, f"{spacing:g}")
                # Distances of scalars are relative to the largest.
                unit = max(1.0, float(converged.pixels.max()))
                score = rings(picture.pixels, converged.pixels) / unit
                row: Row = {"row": name, "at": f"{mode}, {spacing:g} apart", "score": score}
                yield row | _distance(picture, converged, spent)


def rings(picture: NDArray[Any], smooth: NDArray[Any]) -> float:
    """Return the RMS step between neighbouring pixels of a difference, which measures rings but no constant offset."""
    apart = picture.astype(np.float64) - smooth
    along, down = np.diff(apart, axis=1), np.diff(apart, axis=0)
    return math.sqrt(0.5 * (rms(along) ** 2 + rms(down) ** 2))


# Formats of the sheets


def _bits(options: Options) -> Iterator[Row]:
    """Yield distances from the reference for sheets of 8, 16 and 32 bits, lit and unlit."""
    edge = options.edge(64)
    volume = datasets.noisy_ball(edge)
    size = (options.edge(128),) * 2
    camera = _camera(volume.field(), 1.2 * edge)
    exact = ss.Renderer("reference")
    for name, lights in (("unlit", ()), ("lit", (ss.Light((-0.3, 0.4, 1.0)),))):
        scene = volume.scene(lights=lights)
        expected = exact.render(scene, camera, size=size)
        keep(options, expected, "bits", name, "reference")
        for precision in ("uint8", "float16", "float32"):
            options.say(f"bits: {precision}, {name}")

            def one(
                name: str = name, precision: str = precision, scene: ss.Scene = scene, expected: ss.Image = expected
            ) -> Row:
                renderer = renderer_for(options.on("gl"), precision=precision, allow_inexact=True)
                picture, spent = _timed(renderer, scene, camera, size)
                keep(options, picture, "bits", name, precision)
                return _distance(picture, expected, spent)

            yield {"row": precision, "at": name, **attempt(one)}


# Shading before and after splatting


def _shading(options: Options) -> Iterator[Row]:
    """Yield distances from the picture of a volume twice as fine, for shading before and after the sum."""
    edge = options.edge(48)
    size = (options.edge(128),) * 2
    # Scalars are divided by the weights, so that lights show no weave; pre-shaded colours cannot be.
    fine = _shells(2 * edge)
    coarse = {"after": _shells(edge), "before": _shells(edge, "lattice")}
    for zoom in (1.0, 4.0, 8.0):
        camera = ss.Camera.orthographic((0.9, 0.8, 3.0), (0.18, 0.16, 0.6), height=2.4 / zoom)
        expected = renderer_for(options).render(_shell_scene(fine, 2.0 / edge), camera, size=size)
        keep(options, expected, "shading", "finer", f"{zoom:g}")
        for name, comparators in (("after", ()), ("before", ("preshaded",))):
            options.say(f"shading: {name} the sum, zoom {zoom:g}")

            def one(
                name: str = name,
                zoom: float = zoom,
                comparators: tuple[str, ...] = comparators,
                camera: ss.Camera = camera,
                expected: ss.Image = expected,
            ) -> Row:
                renderer = lab_renderer(options.on("gl"), *comparators)
                picture, spent = _timed(renderer, _shell_scene(coarse[name], 2.0 / edge), camera, size)
                keep(options, picture, "shading", name, f"{zoom:g}")
                score = sharpness(picture.rgba) / sharpness(expected.rgba)
                return _distance(picture, expected, spent) | {"score": score}

            yield {"row": f"{name} the sum", "at": f"zoom {zoom:g}", **attempt(one)}


def _shells(count: int, normalization: Any = "threshold") -> ss.RegularField:
    """Return a ball in [-1, 1]^3 whose values rise to the middle, with waves on them; 0 outside, as in the papers."""
    spacing = 2.0 / count
    x = spacing * (np.arange(count) + 0.5) - 1.0
    radius = np.sqrt(x**2 + x[:, None] ** 2 + x[:, None, None] ** 2)
    waves = np.cos(9.0 * x) * np.cos(8.0 * x[:, None]) * np.cos(7.0 * x[:, None, None])
    values = np.clip(1.2 - radius + 0.06 * waves, 0.0, 1.0).astype(np.float32)
    place: dict[str, Any] = {"spacing": (spacing,) * 3, "origin": (float(x[0]),) * 3}
    return ss.RegularField(values, normalization=normalization, boundary="zero", **place)


def _shell_scene(field: ss.RegularField, length: float) -> ss.Scene:
    """Return a scene of thin coloured shells; `length`: the reference length and twice the distance of slices."""
    points = [
        (0.35, 0.9, 0.3, 0.1, 0.0),
        (0.43, 0.9, 0.3, 0.1, 0.3),
        (0.51, 0.9, 0.3, 0.1, 0.0),
        (0.60, 0.1, 0.4, 0.9, 0.0),
        (0.68, 0.1, 0.4, 0.9, 0.6),
        (1.00, 0.1, 0.9, 0.4, 0.9),
    ]
    return ss.Scene(
        field,
        points,
        slice_spacing=0.5 * length,
        reference_length=length,
        lights=[ss.Light((-0.3, 0.4, 1.0))],
        material=ss.Material(ambient=0.3, diffuse=0.8, specular=0.3, shininess=20, two_sided=True),
    )


def sharpness(picture: NDArray[Any]) -> float:
    """Return the RMS step between neighbouring pixels."""
    values = picture.astype(np.float64)
    return math.hypot(rms(np.diff(values, axis=1)), rms(np.diff(values, axis=0)))


# Borders of scattered data


def _borders(options: Options) -> Iterator[Row]:
    """Yield the error of the mean inside, and how steeply it ends outside, for four borders."""
    count = max(200, round(4000 * options.scale**3))
    size = (options.edge(192),) * 2
    rng = np.random.default_rng(2006)
    places = rng.normal(size=(count, 3))
    places *= (rng.random(count) ** (1 / 3) / np.linalg.norm(places, axis=1))[:, None]
    radius = 3.2 / count ** (1 / 3)

    def known(at: Floats) -> Floats:
        return np.asarray(0.7 + 0.3 * at[..., 0])

    probes = rng.normal(size=(2000, 3))
    probes *= (0.85 * rng.random(2000) ** (1 / 3) / np.linalg.norm(probes, axis=1))[:, None]
    outward = rng.normal(size=(100, 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    steps = np.linspace(0.8, 1.0 + 2.5 * radius, 600)
    for name, w0, ghosts in (
        ("max(1, w)", 1.0, False),
        ("max(0.01, w)", 0.01, False),
        ("max(0.01, w), ghost points", 0.01, True),
        ("max(1, w), ghost points", 1.0, True),
    ):
        options.say(f"borders: {name}")
        field = ss.EllipsoidField(places, radius, values=known(places), w0=w0)
        if ghosts:
            field = field.with_ghost_points()
        inside = field.at(probes) - known(probes)
        falls = np.abs(np.diff(np.stack([field.at(steps[:, None] * way) for way in outward]), axis=1))
        scene = ss.Scene(field, [(0.0, 0.2, 0.3, 0.8, 0.0), (0.3, 0.2, 0.8, 0.5, 0.05), (1.0, 1.0, 0.6, 0.2, 0.3)])
        camera = ss.Camera.orthographic((1.0, 1.5, 4.0), (0.0, 0.0, 0.0), height=2.6)
        picture, spent = _timed(renderer_for(options), scene, camera, size)
        keep(options, picture, "borders", name)
        yield {
            "row": name,
            "at": f"{field.size:,} kernels",
            "rmse": rms(inside),
            "maximum": float(np.abs(inside).max()),
            # Steepest descent of each ray, per semi-axis, averaged over the rays: 1 is a fall to 0 over one semi-axis.
            "score": float(falls.max(axis=1).mean() / (steps[1] - steps[0]) * radius),
            "wall_ms": spent,
        }


# Popping


def _popping(options: Options) -> Iterator[Row]:
    """Yield the largest change between frames of a rotation, and its ratio to the median change."""
    edge = options.edge(48)
    size = (options.edge(96),) * 2
    volume = datasets.noisy_ball(edge)
    table = ss.TransferFunction([(30.0, 0.1, 0.3, 0.9, 0.0), (90.0, 0.9, 0.8, 0.2, 0.15), (200.0, 1.0, 0.3, 0.1, 0.6)])
    samples = volume.values.astype(np.float32)
    field = ss.RegularField(samples)
    renderer = renderer_for(options)
    middle = 0.5 * (edge - 1)
    angles = np.arange(30.0, 60.0 + 1e-9, 0.25)

    cameras = [
        orthographic((middle,) * 3, (4.0 * math.sin(angle), 0.4, 4.0 * math.cos(angle)), edge, 1.2 * edge)
        for angle in np.radians(angles)
    ]

    def aligned(spacing: float, camera: ss.Camera) -> NDArray[Any]:
        scene = ss.Scene(field, table, slice_spacing=spacing, reference_length=1.0, opacity_stop=1.0)
        return renderer.render(scene, camera, size=size).rgba

    ways: list[tuple[str, Callable[[ss.Camera], NDArray[Any]]]] = [
        ("axis-aligned, uncorrected", partial(axis_aligned, samples, table, size=size, corrected=False)),
        ("axis-aligned, corrected", partial(axis_aligned, samples, table, size=size, corrected=True)),
        ("image-aligned, 1 apart", partial(aligned, 1.0)),
        ("image-aligned, 0.5 apart", partial(aligned, 0.5)),
    ]
    for name, draw in ways:
        options.say(f"popping: {name}")
        frames, spent, _ = clock(lambda draw=draw: [draw(camera) for camera in cameras])  # type: ignore[misc]
        changes = [rms_change(*pair) for pair in zip(frames, frames[1:], strict=False)]
        worst = int(np.argmax(changes))
        for n in (worst, worst + 1):
            keep(options, frames[n], "popping", name, f"{angles[n]:g}")
        # Grey is no change; changes are amplified.
        change = _LOUDER * (frames[worst + 1] - frames[worst])[..., :3].mean(axis=2, keepdims=True)
        keep(options, 0.5 * np.ones(4) + change * np.array([1.0, 1.0, 1.0, 0.0]) + [0, 0, 0, 0.5], "popping", name)
        yield {
            "row": name,
            "at": f"{angles[worst]:g} to {angles[worst + 1]:g} degrees",
            "maximum": max(float(np.abs(b - a).max()) for a, b in zip(frames, frames[1:], strict=False)),
            "score": changes[worst],
            "ratio": changes[worst] / float(np.median(changes)),
            "wall_ms": 1000.0 * spent / len(frames),
        }


def rms_change(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the RMS difference of two frames."""
    return rms(second.astype(np.float64) - first)


_CLAIMS: dict[str, Callable[[Options], Iterator[Row]]] = {
    "slabs": _slabs,
    "bits": _bits,
    "shading": _shading,
    "borders": _borders,
    "popping": _popping,
}


def run(options: Options) -> Report:
    """Measure every claim that is wanted."""
    rows: list[Row] = []
    for claim in ROWS:
        if options.wants(claim):
            rows += ({"claim": claim, **row} for row in _CLAIMS[claim](options))
            make_sheet(options, f"sheet-{claim}", _SHEETS[claim])
    return Report(
        name="claims",
        title="The papers' claims on quality",
        columns=columns("claim, row=setting, at, rmse, maximum, score, ratio=over median, wall_ms, remark"),
        rows=rows,
        notes=[
            "slabs: tubes, unlit, against slices 1/16 sample apart; score: RMS step between neighbouring pixels of "
            "the difference, which measures rings ([NM05], [MC98]).",
            "bits: a noisy ball against the float64 reference, formats of OpenGL's sheet buffers ([NM05]).",
            "shading: thin lit shells against samples twice as fine; score: sharpness over that of the finer ones "
            "([NM05]).",
            "borders: a ball of random spheres whose scalar is a ramp; rmse and maximum inside, score: how steeply the "
            "scalar ends outside, per semi-axis ([NM06]).",
            "popping: a noisy ball turned by 0.25 degrees a frame; score: largest RMS change from one frame to the "
            "next; over median: that over the usual change ([MC98]).",
        ],
    )

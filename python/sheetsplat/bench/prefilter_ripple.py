"""The ripple of kernels on lattices, its cures, and what it looks like in lit close-ups."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from sheetsplat.bench._measure import device_of, renderer_for, time_frames
from sheetsplat.bench._report import Options, Report, Row, environment
from sheetsplat.bench.claims_sheets import make_sheet
from sheetsplat.ripple import Ripple, lattice_ripple

_KERNELS = ((2.0, 8.0), (2.0, 5.0), (2.5, 7.0), (3.0, 8.0))
_WAYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("lattice", {}),
    ("threshold", {"normalization": "threshold"}),
    ("prefilter", {"prefilter": True}),
)
_SMOOTH = {"radius": 3.0, "falloff": 8.0, "normalization": "threshold"}
# Samples along an edge of the body's volume, and the share of it that is seen.
_EDGE = 32
_SHARE = 0.4
_COLUMNS = {
    "lattice": "lattice",
    "radius": "radius",
    "falloff": "falloff",
    "row": "sums",
    "peak": "flat: peak",
    "rms": "flat: rms",
    "slope": "flat: gradient",
    "ramp": "ramp: slope",
    "weave": "weave",
    "cost": "frame, x",
    "remark": "remark",
}

#: Lattices that can be run alone.
ROWS = ("cartesian", "bcc")


def close_up(lattice: str, settings: dict[str, Any], spacing: float = 1.0) -> tuple[ss.Scene, ss.Camera]:
    """Return a near view of a soft, lit body of one value with rounded edges.

    A sample is two dozen pixels of 300 wide, and whatever is not smooth there is the lattice's. `spacing` of samples;
    the body stays what it is.
    """
    count = round((_EDGE - 1) / spacing) + 1
    if lattice == "bcc":
        from sheetsplat.bcc import BccLattice

        grid = BccLattice.matching((count,) * 3, (spacing,) * 3)
        values = np.empty(grid.shape)
        for k in range(grid.shape[0]):
            x, y, z = grid.layer(k)
            values[k] = _body(x, y[:, None], z)
        place: dict[str, Any] = {"spacing": (grid.a,) * 3, "origin": grid.origin, "lattice": "bcc"}
    else:
        n = spacing * np.arange(float(count))
        values = _body(n, n[:, None], n[:, None, None])
        place = {"spacing": (spacing,) * 3}
    field = ss.RegularField(values, **place, **settings)
    scene = ss.Scene(
        field,
        [(0.02, 0.9, 0.6, 0.3, 0.0), (0.5, 0.9, 0.6, 0.3, 0.02), (1.1, 1.0, 0.9, 0.7, 0.25)],
        slice_spacing=0.25,
        reference_length=1.0,
        lights=[ss.Light((-0.4, 0.5, 1.0))],
        material=ss.Material(ambient=0.3, diffuse=0.8, specular=0.3, shininess=20, two_sided=True),
    )
    middle = 0.5 * (_EDGE - 1)
    camera = ss.Camera.orthographic(
        (middle + 18.0, middle + 24.0, middle + 60.0), (middle, middle, middle), height=_SHARE * _EDGE
    )
    return scene, camera


def _body(x: Any, y: Any, z: Any) -> NDArray[np.float64]:
    """Return 1 inside a ball of about half the edge, falling softly to 0 outside."""
    middle = 0.5 * (_EDGE - 1)
    distance = np.sqrt((x - middle) ** 2 + (y - middle) ** 2 + (z - middle) ** 2)
    share = np.clip((0.47 * _EDGE - distance) / (0.2 * _EDGE), 0.0, 1.0)
    return np.asarray(share * share * share * (10.0 - 15.0 * share + 6.0 * share * share))


def weave_of(picture: NDArray[Any], smooth: NDArray[Any], pixels: float) -> float:
    """Return the RMS of what is finer than a sample, `pixels` wide, in the brightness that a picture has too much."""
    from scipy import ndimage  # type: ignore[import-untyped]

    light = (picture.astype(np.float64) - smooth)[..., :3].mean(axis=2)
    fine = light - ndimage.gaussian_filter(light, pixels)
    # The body's limb is where the smoothing of kernels shows, in every corner of the picture.
    border = fine.shape[0] // 5
    return math.sqrt(float(np.mean(fine[border : len(fine) - border, border : len(fine) - border] ** 2)))


def figures(found: Ripple) -> Row:
    """Return the columns of a ripple."""
    return {"peak": found.peak, "rms": found.rms, "slope": found.slope, "ramp": found.ramp}


def run(options: Options) -> Report:
    """Work out the ripple of every kernel and every cure, and look at it."""
    rows: list[Row] = []
    renderer = renderer_for(options)
    size = (min(options.size),) * 2
    # Of the same body in samples half as far apart, whose sums do not ripple.
    smooth = renderer.render(*close_up("cartesian", _SMOOTH, 0.5), size=size)
    options.keep(smooth, "weave", "none")
    for lattice in ROWS:
        if not options.wants(lattice):
            continue
        first = math.nan
        for radius, falloff in _KERNELS:
            for name, way in _WAYS:
                options.say(f"{lattice}, radius {radius:g}, falloff {falloff:g}, {name}")
                settings = {"radius": radius, "falloff": falloff, **way}
                row: Row = {"lattice": lattice, "radius": radius, "falloff": falloff, "row": name}
                row |= figures(lattice_ripple(lattice=lattice, **settings))  # type: ignore[arg-type]
                scene, camera = close_up(lattice, settings)
                timing = time_frames(renderer, scene, [camera] * options.views, size)
                options.keep(timing.picture, "weave", lattice, f"{radius:g} {falloff:g}", name)
                row["weave"] = weave_of(timing.picture.rgba, smooth.rgba, size[1] / (_SHARE * _EDGE))
                if (radius, falloff, name) == (2.0, 5.0, "lattice"):
                    first = timing.wall
                row["wall"] = timing.wall
                rows.append(row)
        for row in rows:
            if row["lattice"] == lattice:
                row["cost"] = row["wall"] / first
        shown = [("2 5", "lattice"), ("3 8", "lattice"), ("2 5", "prefilter"), ("2 5", "threshold")]
        make_sheet(options.pictures, f"sheet-weave-{lattice}", [[("weave", lattice, *one) for one in shown]])
    return Report(
        name="ripple",
        title=f"Ripple of sums on a lattice, and the weave of a lit close-up at {size[0]}x{size[1]}",
        columns=_COLUMNS,
        rows=rows,
        notes=[
            "flat: all samples are 1; largest and RMS difference from 1, and RMS length of the gradient per sample "
            "distance. ramp: samples rise by 1 a sample distance; RMS difference of the slope from 1.",
            "weave: RMS of what is finer than a sample in the brightness of a lit close-up of a soft body, "
            "less a picture of the body in finer samples. frame, x: its time over that of radius 2, falloff 5.",
        ],
        environment=environment(device_of(renderer)),
    )

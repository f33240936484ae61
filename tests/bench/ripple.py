"""Ripple of sums of kernels on lattices, what reduces it, and how lit close-ups show it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

import sheetsplat as ss
from bench.measure import device_of, renderer_for, rms, time_frames
from bench.pictures import keep, make_sheet
from bench.report import Options, Report, Row, columns, environment
from sheetsplat.bcc import BccLattice
from sheetsplat.ripple import lattice_ripple

_KERNELS = ((2.0, 8.0), (2.0, 5.0), (2.5, 7.0), (3.0, 8.0))
_WAYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("lattice", {}),
    ("threshold", {"normalization": "threshold"}),
    ("prefilter", {"prefilter": True}),
)
SMOOTH = {"radius": 3.0, "falloff": 8.0, "normalization": "threshold"}
# Samples along an edge of the body's volume, and the visible share of the edge.
_EDGE = 32
_SHARE = 0.4
#: Lattices that can be run alone.
ROWS = ("cartesian", "bcc")


def close_up(lattice: str, settings: dict[str, Any], spacing: float = 1.0) -> tuple[ss.Scene, ss.Camera]:
    """Return a close view of a smooth, lit body of value 1 with soft edges.

    A sample is about two dozen of 300 pixels wide; what is not smooth there comes from the lattice. `spacing`: distance
    of the samples of the same body.
    """
    count = round((_EDGE - 1) / spacing) + 1
    if lattice == "bcc":
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
    """Return the RMS of what is finer than a sample, `pixels` wide, in the excess brightness of a picture."""
    light = (picture.astype(np.float64) - smooth)[..., :3].mean(axis=2)
    fine = light - ndimage.gaussian_filter(light, pixels)
    # At the body's limb, in every corner of the picture, the smoothing of kernels shows instead.
    border = fine.shape[0] // 5
    return rms(fine[border : len(fine) - border, border : len(fine) - border])


def run(options: Options) -> Report:
    """Compute the ripple for every kernel and normalisation, and draw it."""
    rows: list[Row] = []
    renderer = renderer_for(options)
    size = (min(options.size),) * 2
    # The same body in samples half as far apart, whose sums do not ripple.
    smooth = renderer.render(*close_up("cartesian", SMOOTH, 0.5), size=size)
    keep(options, smooth, "weave", "none")
    for lattice in ROWS:
        if not options.wants(lattice):
            continue
        first = math.nan
        for radius, falloff in _KERNELS:
            for name, way in _WAYS:
                options.say(f"{lattice}, radius {radius:g}, falloff {falloff:g}, {name}")
                settings = {"radius": radius, "falloff": falloff, **way}
                row: Row = {"lattice": lattice, "radius": radius, "falloff": falloff, "row": name}
                found = lattice_ripple(lattice=lattice, **settings)  # type: ignore[arg-type]
                row |= {figure: getattr(found, figure) for figure in ("peak", "rms", "slope", "ramp")}
                scene, camera = close_up(lattice, settings)
                timing, picture = time_frames(renderer, scene, [camera] * options.views, size)
                keep(options, picture, "weave", lattice, f"{radius:g} {falloff:g}", name)
                row["weave"] = weave_of(picture.rgba, smooth.rgba, size[1] / (_SHARE * _EDGE))
                if (radius, falloff, name) == (2.0, 5.0, "lattice"):
                    first = timing.wall
                row["wall"] = timing.wall
                rows.append(row)
        for row in rows:
            if row["lattice"] == lattice:
                row["cost"] = row["wall"] / first
        shown = [("2 5", "lattice"), ("3 8", "lattice"), ("2 5", "prefilter"), ("2 5", "threshold")]
        make_sheet(options, f"sheet-weave-{lattice}", [[("weave", lattice, *one) for one in shown]])
    return Report(
        name="ripple",
        title=f"Ripple of sums on a lattice, and the weave of a lit close-up at {size[0]}x{size[1]}",
        columns=columns(
            "lattice, radius, falloff, row=sums, peak=flat: peak, rms=flat: rms, slope=flat: gradient, "
            "ramp=ramp: slope, weave, cost=frame time over (2; 5), remark"
        ),
        rows=rows,
        notes=[
            "flat: all samples are 1; largest and RMS difference from 1, and RMS length of the gradient per sample "
            "distance. ramp: samples rise by 1 a sample distance; RMS difference of the slope from 1.",
            "weave: RMS of what is finer than a sample in the brightness of a lit close-up of a soft body, "
            "less a picture of the body in finer samples. frame, x: its time over that of radius 2, falloff 5.",
        ],
        environment=environment(device_of(renderer)),
    )

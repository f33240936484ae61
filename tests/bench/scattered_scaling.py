"""How time and memory grow with the number of scattered kernels, up to ten million."""

from __future__ import annotations

from bench.growth import Spheres, radius_for
from bench.measure import device_of, exponent, renderer_for
from bench.report import Goal, Options, Report, Row, columns, environment

_COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
_SIZE = (200, 200)
_OVERLAP = 6.0
_EDGE = 128.0
_POINTS = ((0.0, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.02), (1.0, 1.0, 0.8, 0.2, 0.1))


def run(options: Options) -> Report:
    """Draw growing numbers of spheres, each in a new process."""
    size = (min(_SIZE[0], options.size[0]), min(_SIZE[1], options.size[1]))
    views = min(3, options.views)
    rows: list[Row] = []
    for count in sorted({max(100, round(count * options.scale**3)) for count in _COUNTS}):
        options.say(f"{count:,} kernels")
        radius = radius_for(_OVERLAP, _EDGE, count)
        row = Spheres(
            count=count,
            box=(_EDGE, _EDGE, _EDGE),
            radius=radius,
            few_radius=4.0 * radius,
            points=_POINTS,
            settings={},
            angles=[(0.6 + 0.3 * view, 0.4) for view in range(1 + views)],
            height=1.25 * _EDGE,
            size=size,
            backend=options.backend,
        ).measure()
        row |= {
            "row": count,
            "radius": radius,
            "us_a_kernel": 1e3 * row["cpu_ms"] / count,
            "kept": row["kept"] / count,
            "resident": 1e-6 * row["peak_field"],
            "per_kernel": row["peak_field"] / count,
        }
        rows.append(row)
    upper = rows[-2:]
    goals = []
    if options.scale == 1.0:
        goals.append(Goal("memory over the caller's arrays for ten million", rows[-1]["per_kernel"], 100.0, "bytes"))
        goals.append(Goal("exponent of the time of a frame over the last decade", exponent(upper, "row"), 1.1))
    return Report(
        name="scattered_scaling",
        title=f"Spheres that overlap {_OVERLAP:g} times everywhere, shaded, at {size[0]}x{size[1]}",
        columns=columns(
            "row=kernels, radius, slice_spacing=ds, slices, splats, field_ms=field ms, first_ms=first frame ms, "
            "index_ms=grid ms, wall_ms=further ms, cpu_ms, view_ms=view ms, vertices_ms=records ms, "
            "us_a_kernel=cpu us a kernel, kept=kept bytes a kernel, resident=peak over arrays MB, "
            "per_kernel=bytes a kernel"
        ),
        rows=rows,
        notes=[
            f"Each in a new process. A further frame: medians over {views} other views, at the default "
            "slice distance, which follows the kernels' size.",
            f"cpu time of a further frame grows with the kernels to the power {exponent(rows, 'row'):.2f} over all "
            f"rows, {exponent(upper, 'row'):.2f} between the last two; the elapsed time of the first frame "
            f"{exponent(upper, 'row', 'first_ms'):.2f}.",
            "bytes a kernel: peak resident memory over that before the field was made, when the caller's float64 "
            "arrays, the context and its programs exist; it includes the field's own copy. kept: field, grid and view "
            "that remain. Some MB do not depend on the number.",
        ],
        goals=goals,
        environment=environment(device_of(renderer_for(options))),
    )

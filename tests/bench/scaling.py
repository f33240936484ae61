"""How the time of a frame grows with the number of kernels and with the number of pixels."""

from __future__ import annotations

from bench.measure import device_of, exponent, orbit, renderer_for, time_frames
from bench.report import Options, Report, Row, columns, environment
from sheetsplat import datasets

_EDGES = (32, 48, 64, 96, 128, 160, 192)
_SIZES = (100, 200, 400, 800, 1600)


def run(options: Options) -> Report:
    """Time the noisy ball at growing numbers of samples, and at growing sizes of the picture."""
    renderer = renderer_for(options)

    def measure(series: str, edge: int, size: tuple[int, int]) -> Row:
        options.say(f"{series}: {edge}^3 at {size[0]}x{size[1]}")
        scene = datasets.noisy_ball(edge).scene()
        timing, _ = time_frames(renderer, scene, orbit(scene.fields[0], options.views), size)
        pixels = size[0] * size[1]
        row: Row = {"row": series, "edge": edge, "pixels": pixels} | timing.row("view")
        row["ns_a_kernel"] = 1e9 * timing.cpu / max(row["kernels_drawn"], 1)
        row["ns_a_pixel"] = 1e9 * timing.cpu / max(row["slices"] * pixels, 1)
        return row

    edges = sorted({options.edge(edge) for edge in _EDGES})
    kernels = [measure("kernels", edge, options.size) for edge in edges]
    sizes = sorted({max(8, round(size * options.scale)) for size in _SIZES})
    pixels = [measure("pixels", options.edge(64), (size, size)) for size in sizes]

    def upper(rows: list[Row]) -> list[Row]:
        return rows[len(rows) // 2 :] if len(rows) > 3 else rows

    return Report(
        name="scaling",
        title="Time of a frame of the noisy ball, shaded",
        columns=columns(
            "row=series, edge, kernels_drawn, pixels, slices, wall_ms, cpu_ms, view_ms=bucketing ms, "
            "ns_a_kernel=cpu ns a kernel, ns_a_pixel=cpu ns a pixel and slice"
        ),
        rows=kernels + pixels,
        notes=[
            options.views_note,
            "The picture always shows the whole volume: with more kernels each is smaller, and slices are more.",
            "In the upper half of each series cpu time grows with the kernels to the power "
            f"{exponent(upper(kernels), 'kernels_drawn'):.2f} and with the pixels to the power "
            f"{exponent(upper(pixels), 'pixels'):.2f}.",
        ],
        environment=environment(device_of(renderer)),
    )

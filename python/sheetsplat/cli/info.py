"""sheetsplat info."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from sheetsplat.cli.options import apply, array_shape, as_json, common, file_options
from sheetsplat.cli.output import report_json

_PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
_BAR = 40


def survey(path: Path, options: dict[str, Any], bins: int) -> dict[str, Any]:
    """Return what is in a file: sizes, ranges, histogram, memory, and the look that a picture of it would get."""
    from sheetsplat import automatic
    from sheetsplat.fields import RegularField, as_samples
    from sheetsplat.io import read_volume

    shape = array_shape(options["shape"])
    volume = read_volume(
        path,
        shape=shape,  # type: ignore[arg-type]
        dtype=options["dtype"],
        offset=options["offset"] or 0,
        name=options["name"],
    )
    samples = as_samples(volume.values)
    finite = samples[np.isfinite(samples)] if samples.dtype.kind == "f" else samples.reshape(-1)
    report: dict[str, Any] = {
        "file": str(path),
        "format": volume.format,
        "samples": list(samples.shape[::-1]),
        "type": str(volume.values.dtype.name),
        "kept_as": samples.dtype.name,
        "spacing": list(volume.spacing),
        "origin": list(volume.origin),
        "extent": [gap * (count - 1) for gap, count in zip(volume.spacing, samples.shape[::-1], strict=True)],
        "memory_bytes": samples.nbytes,
        "nan": int(np.isnan(samples).sum()) if samples.dtype.kind == "f" else 0,
        "infinite": int(np.isinf(samples).sum()) if samples.dtype.kind == "f" else 0,
        **volume.details,
    }
    if finite.size:
        counts, edges = np.histogram(finite, bins=bins)
        report |= {
            "minimum": float(finite.min()),
            "maximum": float(finite.max()),
            "mean": float(finite.mean(dtype=np.float64)),
            "deviation": float(finite.std(dtype=np.float64)),
            "percentiles": dict(zip(map(str, _PERCENTILES), np.percentile(finite, _PERCENTILES).tolist(), strict=True)),
            "histogram": {"edges": edges.tolist(), "counts": counts.tolist()},
        }
        if not report["infinite"]:
            look = automatic.choose([RegularField(samples, nan="skip")])
            report |= {"clim": list(look.clim), "surface": look.surface}
    return report


def _table(report: dict[str, Any]) -> str:
    def numbers(name: str) -> str:
        return ", ".join(f"{value:g}" for value in report[name])

    rows = [
        ("file", report["file"]),
        ("format", report["format"] + (f", {report['content']}" if "content" in report else "")),
        ("samples", " x ".join(map(str, report["samples"])) + f" (x, y, z), {report['type']}"),
        ("spacing", numbers("spacing")),
        ("origin", numbers("origin")),
        ("extent", numbers("extent")),
        ("memory", f"{report['memory_bytes'] / 1e6:.1f} MB as {report['kept_as']}"),
    ]
    if report["nan"] or report["infinite"]:
        rows.append(("not finite", f"{report['nan']} NaN, {report['infinite']} infinite"))
    if "minimum" in report:
        percentiles = ", ".join(f"{name} %: {value:g}" for name, value in report["percentiles"].items())
        rows += [
            ("range", f"{report['minimum']:g} to {report['maximum']:g}"),
            ("mean", f"{report['mean']:g}, deviation {report['deviation']:g}"),
            ("percentiles", percentiles),
        ]
    if "clim" in report:
        rows.append(("shown", f"{report['clim'][0]:g} to {report['clim'][1]:g}, unless told otherwise"))
    lines = [f"{name:<12}{text}" for name, text in rows]
    if "histogram" in report:
        counts, edges = report["histogram"]["counts"], report["histogram"]["edges"]
        labels = [f"{edge:g}" for edge in edges[:-1]]
        width = max(map(len, labels))
        # By the logarithm: background is thousands of times more than anything else in most volumes.
        top = np.log1p(max(counts))
        lines += ["", "histogram (logarithmic)"]
        for label, count in zip(labels, counts, strict=True):
            lines.append(f"{label:>{width}}  {'#' * round(_BAR * np.log1p(count) / top):<{_BAR}} {count}")
    return "\n".join(lines)


@click.command("info")
@click.argument("file", type=click.Path(path_type=Path))
@apply(file_options)
@click.option("--bins", type=click.IntRange(1, 4096), default=16, show_default=True, help="Of the histogram.")
@as_json
@common
def command(file: Path, bins: int, as_json: bool, quiet: bool, **options: Any) -> None:
    """Show sizes, ranges, histogram and memory of the volume FILE."""
    report = survey(file, options, bins)
    if as_json:
        report_json(report)
    else:
        click.echo(_table(report))

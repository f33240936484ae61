"""sheetsplat info."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from sheetsplat.cli.info_labels import labels_of, lines_of_labels, row_of_labels
from sheetsplat.cli.options import apply, as_json, common, options_of, single
from sheetsplat.cli.output import report, report_json
from sheetsplat.cli.scene import file_options
from sheetsplat.options.data import FileOptions, KernelOptions, PlacementOptions

if TYPE_CHECKING:
    from sheetsplat.fields import EllipsoidField
    from sheetsplat.look.histogram import Look
    from sheetsplat.quantity import Quantity

_PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
_BAR = 40
# Number of samples per block; percentiles use at most `_ENOUGH` samples.
_BLOCK = 1 << 20
_ENOUGH = 4_000_000
_LARGEST = float(np.finfo(np.float64).max)


def _extent(shape: tuple[int, ...], spacing: Any, lattice: str) -> list[float]:
    """Return the distances along x, y, z from the first kernel's centre to the last one's."""
    nk, nj, ni = shape
    if lattice == "bcc":
        # Odd layers are shifted by half a cube.
        shift, edge = 0.5 * (nk > 1), spacing[0]
        return [(ni - 1 + shift) * edge, (nj - 1 + shift) * edge, 0.5 * (nk - 1) * edge]
    return [gap * (count - 1) for gap, count in zip(spacing, (ni, nj, nk), strict=True)]


def _blocks(flat: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    """Yield the finite samples as float64, block by block."""
    for start in range(0, flat.size, _BLOCK):
        block = flat[start : start + _BLOCK].astype(np.float64)
        yield block if flat.dtype.kind != "f" else block[np.isfinite(block)]


def _edges(low: float, high: float, bins: int) -> NDArray[np.float64]:
    if not low < high:
        half = max(0.5, 1e-3 * abs(low))
        low, high = max(low - half, -_LARGEST), min(high + half, _LARGEST)
    # Unlike low + share * (high - low), this does not overflow for the largest numbers.
    share = np.linspace(0.0, 1.0, bins + 1)
    edges: NDArray[np.float64] = low * (1.0 - share) + high * share
    return edges


def _stride(count: int) -> int:
    """Return the step of a regular subset of about `_ENOUGH`; odd, so that columns differ from row to row."""
    return 1 if count <= _ENOUGH else (-(-count // _ENOUGH) | 1)


def _percentiles(flat: NDArray[Any]) -> list[float]:
    """Return percentiles of the finite samples, of a regular subset where there are more than `_ENOUGH`."""
    picked = np.concatenate(list(_blocks(flat[:: _stride(flat.size)])))
    # Differences of the largest numbers must not overflow; scaling by a power of two is exact.
    scale = 4.0 if picked.size and float(np.abs(picked).max()) > 1e307 else 1.0
    picked /= scale
    found: list[float] = (np.percentile(picked, _PERCENTILES, overwrite_input=True) * scale).tolist()
    return found


def _statistics(flat: NDArray[Any], bins: int) -> dict[str, Any]:
    """Return counts, range, moments, percentiles and histogram, without a copy of all samples."""
    count, low, high, missing = 0, math.inf, -math.inf, 0
    for block in _blocks(flat):
        count += block.size
        low, high = float(block.min(initial=low)), float(block.max(initial=high))
    if count < flat.size:
        pieces = (flat[start : start + _BLOCK] for start in range(0, flat.size, _BLOCK))
        missing = sum(int(np.isnan(piece).sum()) for piece in pieces)
    report: dict[str, Any] = {"nan": missing, "infinite": flat.size - count - missing}
    if not count:
        return report
    # Squares of the largest numbers overflow and those of the smallest underflow, unless they are scaled; scaling by a
    # power of two is exact.
    unit = math.ldexp(1.0, math.frexp(max(abs(low), abs(high)))[1] - 1)
    mean = sum(float((block / unit).sum()) for block in _blocks(flat)) / count
    edges = _edges(low, high, bins)
    counts = np.zeros(bins, dtype=np.int64)
    squares = 0.0
    for block in _blocks(flat):
        # The last bin includes its upper edge, as in NumPy.
        counts += np.bincount(np.searchsorted(edges[1:-1], block, side="right"), minlength=bins)
        block /= unit
        block -= mean
        squares += float(np.square(block, out=block).sum())
    return report | {
        "minimum": low,
        "maximum": high,
        "mean": min(max(mean * unit, low), high),
        "deviation": math.sqrt(squares / count) * unit,
        "percentiles": dict(zip(map(str, _PERCENTILES), _percentiles(flat), strict=True)),
        "histogram": {"edges": edges.tolist(), "counts": counts.tolist()},
    }


def _aspects(field: EllipsoidField) -> NDArray[np.float64]:
    """Return the percentiles 50, 99 and 100 of the ratios of the longest to the shortest semi-axis."""
    if field.isotropic or not field.size:
        return np.ones(3)
    blocks = (field.scales[start : start + _BLOCK] for start in range(0, field.size, _BLOCK))
    aspects = np.concatenate([block.max(axis=1) / block.min(axis=1) for block in blocks])
    found: NDArray[np.float64] = np.percentile(aspects, (50, 99, 100), overwrite_input=True)
    return found


def describe(field: EllipsoidField, bins: int, log: object = None) -> dict[str, Any]:
    """Return the properties of a field of ellipsoids: counts, bounds, sizes, ranges, histogram, memory, look.

    `log` is the option of this name; None: a picture chooses.
    """
    from sheetsplat.look import automatic
    from sheetsplat.look.decades import in_decades

    known = slice(0, field.size - field.ghosts)
    report: dict[str, Any] = {
        "kernels": field.size,
        "kind": "spheres" if field.isotropic else "ellipsoids",
        "bounds": [list(corner) for corner in field.bounds] if field.size else [],
        "scales": list(field.scale_range),
        "weights": list(field.weight_range),
        "normalization": field.normalization,
        "w0": field.w0,
        "falloff": field.falloff,
        "slice_spacing": field.default_slice_spacing,
        "memory_bytes": field.memory,
        "periodic": None if field.periodic is None else [list(corner) for corner in field.periodic],
        "images": field.images,
        **_statistics(field.values[known], bins),
    }
    if field.size:
        report["median_scale"] = float(np.median(field.scales[:: _stride(field.size)]))
        report["aspect"] = dict(zip(("median", "99 %", "largest"), _aspects(field).tolist(), strict=True))
        shown = in_decades([field], {}, log)[0]
        report |= _shown(automatic.choose([shown]), shown.quantity)
    return report


def _shown(look: Look, quantity: Quantity) -> dict[str, Any]:
    """Return the automatic look as a picture shows it; its limits are those of the scalar, also of its logarithm."""
    limits = [quantity.scalar(value) for value in (*look.clim, look.surface)]
    found: dict[str, Any] = {"clim": limits[:2], "surface": limits[2]}
    if quantity.floor is not None:
        found["log"] = {"floor": quantity.floor, "clim": list(look.clim), "surface": look.surface}
    return found


def survey(path: Path, options: dict[str, Any], bins: int) -> dict[str, Any]:
    """Return the properties of a file: sizes, ranges, histogram, memory, and its automatic look."""
    from sheetsplat.fields import Lattice, RegularField, as_samples
    from sheetsplat.io.axes import directions, placement
    from sheetsplat.io.kernels import logarithm
    from sheetsplat.io.opening import arrays, kind_of, open_scattered, read_regular
    from sheetsplat.look.decades import floor_of_samples
    from sheetsplat.look.histogram import choose_for

    given = {name: value for name, value in file_options(options).items() if value or isinstance(value, str)}
    given |= {name: options[name] for name in ("step", "labels") if options[name] is not None}
    kind = kind_of(path, given)
    known = arrays(path, given)
    if known.names and known.shown is None and not {"name", "scalar"} & given.keys():
        return {"file": str(path), "format": kind.name, "arrays": list(known.names)}
    if kind.scattered:
        data, field = open_scattered(path, given)
        told = {"points": len(data.points), "scalar": data.scalar, "scalars": list(data.scalars)}
        what = {"file": str(path), "format": data.format, **told, "details": data.details}
        return {**what, **describe(field, bins, options["log"])}
    # Of several channels the numbers are those of the first one.
    volume, *others = volumes = read_regular(path, given)
    samples = as_samples(volume.values if volume.values.ndim == 3 else RegularField(volume.values).values)
    lattice: Lattice = options["lattice"] or "cartesian"
    # A field of one sample checks where samples lie without a copy of all of them.
    placed = RegularField(np.zeros_like(samples[:1, :1, :1]), lattice=lattice, **placement(volume, given))
    numbers = _statistics(samples.reshape(-1), bins)
    report: dict[str, Any] = {
        "file": str(path),
        "format": volume.format,
        "samples": list(samples.shape[::-1]),
        "type": str(volume.values.dtype.name),
        **({"arrays": list(known.names)} if len(known.names) > 1 else {}),
        **({"channels": [one.channel.name for one in (volume, *others)]} if others else {}),
        **({"colors": volume.values.shape[3]} if volume.values.ndim > 3 else {}),
        **labels_of(volumes, given),
        "kept_as": samples.dtype.name,
        "lattice": lattice,
        "spacing": list(placed.spacing),
        "length_unit": volume.quantity.length_unit,
        "origin": list(placed.origin),
        "extent": _extent(samples.shape, placed.spacing, lattice),
        "memory_bytes": samples.nbytes,
        **({} if placed.axes is None else {"axes": directions(placed.axes)}),
        **numbers,
        **volume.details,
    }
    if "minimum" in report and not report["infinite"] and "labels" not in report:
        quantity = volume.quantity
        floor = floor_of_samples(samples) if options["log"] is None and quantity.floor is None else None
        if floor is not None:
            quantity = replace(quantity, floor=floor)
            samples = logarithm(samples.astype(np.float64), quantity.name or "the samples", floor)
        report |= _shown(choose_for(samples, decades=quantity.floor is not None), quantity)
    return report


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{value:g}" for value in numbers)


def _rows_of_arrays(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [("arrays", f"{', '.join(report['arrays'])}; choose with --name")] if "arrays" in report else []


def _regular_rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    colors = {3: ", red, green, blue", 4: ", red, green, blue, opacity"}[report["colors"]] if "colors" in report else ""
    channels = report.get("channels", ())
    return [
        *_rows_of_arrays(report),
        ("samples", " x ".join(map(str, report["samples"])) + f" (x, y, z), {report['type']}{colors}"),
        *(
            [("channels", f"{', '.join(channels)}; what follows is of the first: choose with --name")]
            if channels
            else []
        ),
        *row_of_labels(report),
        ("lattice", report["lattice"]),
        ("spacing", f"{_listed(report['spacing'])} {report['length_unit']}".rstrip()),
        ("origin", _listed(report["origin"])),
        ("extent", _listed(report["extent"])),
        *((name, report[name]) for name in ("axes", "mirrored", "converted") if name in report),
        ("memory", f"{report['memory_bytes'] / 1e6:.1f} MB as {report['kept_as']}"),
    ]


def _scattered_rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    thin, long = report["scales"]
    rows = [
        ("points", str(report["points"])),
        ("scalar", f"{report['scalar']}, of: {', '.join(report['scalars'])}"),
        *report["details"].items(),
        ("kernels", f"{report['kernels']} {report['kind']}"),
    ]
    if report["kernels"]:
        aspect = ", ".join(f"{name} {value:.3g}" for name, value in report["aspect"].items())
        rows += [
            ("bounds", " to ".join(f"({_listed(corner)})" for corner in report["bounds"])),
            ("semi-axes", f"{thin:g} to {long:g}, median {report['median_scale']:g}"),
            ("aspect", aspect),
            ("weights", " to ".join(f"{weight:g}" for weight in report["weights"])),
        ]
    if report["periodic"]:
        box = " to ".join(f"({_listed(corner)})" for corner in report["periodic"])
        rows.append(("periodic", f"{box}, with {report['images']} images of kernels"))
    w0 = f", w0 {report['w0']:g}" if report["normalization"] == "threshold" else ""
    return [
        *rows,
        ("sums", f"normalization {report['normalization']}{w0}, falloff {report['falloff']:g}"),
        ("slices", f"{report['slice_spacing']:g} apart by default"),
        ("memory", f"{report['memory_bytes'] / 1e6:.1f} MB"),
    ]


def _table(report: dict[str, Any]) -> list[str]:
    rows = [
        ("file", report["file"]),
        ("format", report["format"] + (f", {report['content']}" if "content" in report else "")),
    ]
    if "nan" not in report:
        # One of them must be chosen.
        return [f"{name:<12}{text}" for name, text in (*rows, *_rows_of_arrays(report))]
    rows += _scattered_rows(report) if "kernels" in report else _regular_rows(report)
    if report["nan"] or report["infinite"]:
        rows.append(("not finite", f"{report['nan']} NaN, {report['infinite']} infinite"))
    if "minimum" in report:
        rows.append(("range", f"{report['minimum']:g} to {report['maximum']:g}"))
    if "minimum" in report and "labels" not in report:
        percentiles = ", ".join(f"{name} %: {value:g}" for name, value in report["percentiles"].items())
        rows += [("mean", f"{report['mean']:g}, deviation {report['deviation']:g}"), ("percentiles", percentiles)]
    if "clim" in report:
        low, high = report["clim"]
        rows.append(("shown", f"{low:g} to {high:g} by default"))
        if "log" in report:
            first, last = report["log"]["clim"]
            text = f"log10({report.get('scalar', 'value')} / {report['log']['floor']:g}) from {first:g} to {last:g}"
            rows[-1] = ("shown", f"{text}, that is {low:g} to {high:g}, by default")
    lines = [f"{name:<12}{text}" for name, text in rows]
    if "labels" in report:
        lines += ["", *lines_of_labels(report)]
    elif "histogram" in report:
        counts, edges = report["histogram"]["counts"], report["histogram"]["edges"]
        labels = [f"{edge:g}" for edge in edges[:-1]]
        width = max(map(len, labels))
        # Logarithmic: in most volumes background has thousands of times more samples than anything else.
        top = np.log1p(max(counts))
        lines += ["", "histogram (logarithmic)"]
        for label, count in zip(labels, counts, strict=True):
            lines.append(f"{label:>{width}}  {'#' * round(_BAR * np.log1p(count) / top):<{_BAR}} {count}")
    return lines


@click.command("info")
@click.argument("file", type=click.Path(path_type=Path))
@apply([*options_of(FileOptions, PlacementOptions), *single(KernelOptions, "nan", "labels")])
@click.option("--bins", type=click.IntRange(1, 4096), default=16, show_default=True, help="Of the histogram.")
@as_json
@common
def command(file: Path, bins: int, as_json: bool, quiet: bool, **options: Any) -> None:
    """Show sizes, ranges, histogram and memory of the FILE, a volume or scattered data.

    Of a volume whose samples are labels it lists these, with names, colours and numbers of samples.
    """
    found = survey(file, options, bins)
    if as_json:
        report_json(found)
    else:
        report(*_table(found))

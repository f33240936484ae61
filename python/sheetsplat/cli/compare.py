"""sheetsplat compare."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sheetsplat.cli.options import as_json, common
from sheetsplat.cli.output import check_outputs, report, report_json, say

_PATH = click.Path(path_type=Path)


@click.command("compare")
@click.argument("picture", type=_PATH)
@click.argument("reference", type=_PATH)
@click.option("--max-rmse", type=float, help="Largest root mean square error that passes.")
@click.option("--max-p999", type=float, help="Largest 99.9th percentile that passes.")
@click.option("--max", "max_maximum", type=float, help="Largest maximum difference that passes.")
@click.option("--max-flip", type=float, help="Largest mean FLIP that passes.")
@click.option(
    "--difference",
    type=_PATH,
    help="Write the absolute difference as a picture: .exr, .npy, or .png, where the largest is white "
    "unless --scale is given.",
)
@click.option("--scale", type=click.FloatRange(min=0, min_open=True), help="Factor of --difference.")
@as_json
@common
def command(
    picture: Path,
    reference: Path,
    max_rmse: float | None,
    max_p999: float | None,
    max_maximum: float | None,
    max_flip: float | None,
    difference: Path | None,
    scale: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compare PICTURE with REFERENCE: .png, .exr or .npy of one size.

    Distances are over premultiplied RGBA; scalars are divided by the reference's largest value where that is above 1.
    Exit code 1 where one is above its bound.
    """
    if scale is not None and difference is None:
        raise click.UsageError("--scale is for --difference, which is missing")
    if difference is not None:
        check_outputs([difference], [picture, reference])
    from sheetsplat import compare
    from sheetsplat.io import pictures

    first, second = pictures.read_picture(picture), pictures.read_picture(reference)
    distances = compare.compare(first, second)
    factor = None
    if difference is not None:
        factor = pictures.save_difference(first, second, difference, scale)
    bounds = {"rmse": max_rmse, "p99_9": max_p999, "maximum": max_maximum, "flip": max_flip}
    # NaN is above every bound.
    above = [name for name, bound in bounds.items() if bound is not None and not distances[name] <= bound]
    if as_json:
        report_json({**distances, "bounds": bounds, "above": above, "difference_scale": factor})
    else:
        for name, title in (("rmse", "RMSE"), ("p99_9", "P99.9"), ("maximum", "maximum"), ("flip", "FLIP")):
            limit = bounds[name]
            note = "" if limit is None else f"  {'above' if name in above else 'within'} {limit:g}"
            report(f"{title:<8} {distances[name]:.6g}{note}")
        if factor is not None:
            report(f"{difference}: the difference times {factor:.6g}")
    if above:
        say(f"{picture} differs from {reference} by more than allowed: {', '.join(above)}", quiet=quiet)
        sys.exit(1)

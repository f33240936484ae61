"""sheetsplat encode."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import apply, as_json, common, options_of
from sheetsplat.cli.output import check_outputs, progress_bar, report, report_json
from sheetsplat.cli.scene import file_options
from sheetsplat.options.data import FileOptions, KernelOptions, PlacementOptions

_RATIO = 64.0
# Bytes of a sample as float32, of which ratios are counted.
_SAMPLE = 4


@click.command("encode", cls=GroupedCommand)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The file to write, .ssk.")
@click.option(
    "--ratio",
    type=click.FloatRange(min=1),
    help=f"Bytes of the samples as float32 over bytes of the file.  [default: {_RATIO:g}]",
)
@click.option("--kernels", type=click.IntRange(min=1), help="Most kernels.")
@click.option(
    "--max-error",
    type=click.FloatRange(min=0, min_open=True),
    help="Bound of the error at every sample, units of the data.",
)
@apply(options_of(FileOptions, PlacementOptions, KernelOptions))
@as_json
@common
def command(
    file: Path,
    output: Path,
    ratio: float | None,
    kernels: int | None,
    max_error: float | None,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Encode the volume in FILE as few kernels, with a bound of the error: a .ssk file that render and view open.

    One of --ratio, --kernels and --max-error.
    """
    if sum(one is not None for one in (ratio, kernels, max_error)) > 1:
        raise click.UsageError("give one of --ratio, --kernels and --max-error")
    check_outputs([output], [file])
    if output.suffix != ".ssk":
        raise click.UsageError(f"-o {output} does not end with .ssk")
    from sheetsplat.api import to_fields
    from sheetsplat.encode.encoding import encode, only_field

    data = only_field(to_fields(file, **file_options(options)))
    asked: dict[str, Any] = {"kernels": kernels, "max_error": max_error}
    if kernels is None and max_error is None:
        asked["bytes"] = _SAMPLE * data.size / (ratio or _RATIO)
    begun = time.perf_counter()
    with progress_bar("encoding", quiet=quiet) as told:
        progress = None if told is None else lambda share: told(share) is not False
        field = encode(data, progress=progress, **asked)
    field.save(output)
    bound, size = field.bound, output.stat().st_size
    assert bound is not None
    found = {
        "bytes": size,
        "ratio": _SAMPLE * data.size / size,
        "kernels": field.size,
        "max_error": bound.max,
        "rms_error": bound.rms,
        "percentiles": dict(zip(("50", "90", "99", "99.9"), bound.percentiles, strict=True)),
        "seconds": time.perf_counter() - begun,
    }
    if as_json:
        report_json(found)
        return
    if not quiet:
        report(
            f"{output}: {size} bytes, 1/{found['ratio']:.0f} of the samples as float32, {field.size} kernels",
            f"error at the samples: at most {bound.max:.4g}, root mean square {bound.rms:.4g}",
        )

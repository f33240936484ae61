"""sheetsplat demo."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from sheetsplat.backends import Backend
from sheetsplat.cli.options import apply, as_json, common, single
from sheetsplat.cli.output import progress_bar, report, report_json, say
from sheetsplat.cli.types import param_type
from sheetsplat.effects import Clip
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererOptions
from sheetsplat.options.values import Numbers

# Brighter colours than the data sets suggest, whose pictures are compared with one another: the options of `render`.
_LOOKS: dict[str, dict[str, Any]] = {
    "marschner_lobb": {
        "mode": "isosurface",
        "iso_value": 0.5,
        "cmap": ("#1f6fb0", "#f4c95d"),
        "clim": (0.0, 0.5),
        "elevation": 40.0,
        "target": (0.0, 0.0, 0.15),
        "zoom": 1.05,
    },
    "noisy_ball": {
        "cmap": ("#2b50b8", "#37b8c4", "#f7dd7a", "#f0682f"),
        "clim": (80.0, 200.0),
        "opacity": ((60.0, 0.0), (80.0, 0.3), (200.0, 0.6)),
        # Half of it: what is inside shows.
        "clip": Clip(planes=[((-1.0, -1.0, 0.0), -127.0)]),
    },
    "tubes": {
        "cmap": ("#7a1238", "#d8343c", "#fb8b4c", "#ffe9c0"),
        "clim": (60.0, 200.0),
        "opacity": ((60.0, 0.0), (130.0, 0.6), (200.0, 0.8)),
    },
}


@click.command("demo")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default="sheetsplat-demo.png",
    show_default=True,
    help="The picture: .png, .jpg, .tif, .webp, .pdf, .svg, .exr or .npy. All but the last two get a colour bar.",
)
@click.option(
    "--dataset", type=click.Choice(tuple(_LOOKS)), default="tubes", show_default=True, help="Generated data set."
)
@apply(single(QualityOptions, "quality"))
@click.option(
    "--size",
    type=param_type(Numbers("WxH", 2, whole=True, square=True)),
    default="800x800",
    show_default=True,
    help="Width and height in pixels, without the colour bar; one number: square.",
)
@apply(single(RendererOptions, "backend", "threads"))
@as_json
@common
def command(
    output: Path,
    dataset: str,
    quality: str,
    size: tuple[int, int],
    backend: Backend,
    threads: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Render a generated data set, and print the path of the picture."""
    from sheetsplat import datasets
    from sheetsplat.api import render
    from sheetsplat.errors import Unsupported
    from sheetsplat.io import pictures
    from sheetsplat.renderer import Renderer

    pictures.check_suffix(output, (*pictures.FIGURES, *pictures.SUFFIXES))
    pictures.check_folder(output)
    # Unusable settings must fail before data is generated.
    renderer = Renderer(backend, threads=threads)
    began = time.perf_counter()
    say(f"making {dataset} ...", quiet=quiet)
    data = datasets.DATASETS[dataset]()
    with progress_bar(dataset, quiet=quiet) as progress:
        options: Any = {**_LOOKS[dataset], "quality": quality, "progress": progress}
        image = render(data, renderer=renderer, size=size, **options)
    suffix, figure = output.suffix.lower(), None
    try:
        if suffix in pictures.VECTORS:
            image.save_figure(output, axes=False)
        elif suffix not in pictures.FLOATS:
            figure = image.annotated(axes=False)
    except Unsupported as missing:
        if suffix in pictures.VECTORS:
            raise
        say(f"no colour bar: {missing.advice}", quiet=quiet)
    if figure is None and suffix not in pictures.VECTORS:
        image.save(output)
    elif figure is not None:
        pictures.save_raster(np.asarray(figure), output, image.recipe.to_json())
    seconds = time.perf_counter() - began
    if as_json:
        made = {"output": str(output.resolve()), "dataset": dataset, "seconds": seconds}
        report_json({**made, "plan": image.plan.to_dict(), "stats": image.stats})
    else:
        report(str(output.resolve()))
    plan = image.plan
    say(
        f"rendered {dataset} by {plan.backend}{f' on {plan.device}' if plan.device else ''} in {seconds:.1f} s",
        quiet=quiet,
    )

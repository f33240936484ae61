"""sheetsplat demo."""

from __future__ import annotations

import time
from pathlib import Path

import click

from sheetsplat.backends import Backend
from sheetsplat.cli.options import apply, as_json, common, single
from sheetsplat.cli.output import progress_bar, report, report_json, say
from sheetsplat.options.picture import PictureOptions
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererOptions

_DATASETS = ("marschner_lobb", "noisy_ball", "tubes")


@click.command("demo")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default="sheetsplat-demo.png",
    show_default=True,
    help="The picture: .png, .jpg, .tif, .webp, .exr or .npy.",
)
@click.option("--dataset", type=click.Choice(_DATASETS), default="tubes", show_default=True, help="Generated data set.")
@apply(single(QualityOptions, "quality"))
@apply(single(PictureOptions, "size"))
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
    from sheetsplat._checks import image_size
    from sheetsplat.choose.picture import scene_of_quality
    from sheetsplat.framing import compose_camera
    from sheetsplat.io import pictures
    from sheetsplat.renderer import Renderer

    pictures.check_suffix(output)
    pictures.check_folder(output)
    # Unusable settings must fail before data is generated.
    renderer = Renderer(backend, threads=threads)
    began = time.perf_counter()
    say(f"making {dataset} ...", quiet=quiet)
    own = datasets.DATASETS[dataset]().scene()
    camera = compose_camera(own, image_size(size))
    scene = scene_of_quality(own, quality, camera, image_size(size))
    with progress_bar(dataset, quiet=quiet) as progress:
        image = renderer.render(scene, camera, size=image_size(size), progress=progress)
    image.save(output)
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

"""The page python/docs/hard-cases.md. In tests/python:

python -m hard_cases.page --table     writes the page
python -m hard_cases.page NAME...     prints the figures of cases whose names contain one of these
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from scene_parts import build

import sheetsplat as ss

from . import CASES, PROPERTIES, Case, Refused, fault, measure, renderer_of, scene_of

PAGE = Path(__file__).resolve().parents[3] / "python" / "docs" / "hard-cases.md"
BACKENDS = ("gl", "cpu")


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _outcome_text(one: Case) -> str:
    texts = []
    for backend in BACKENDS:
        outcome = one.outcome_on(backend)
        texts.append(f"`{outcome.kind.__name__}`" if isinstance(outcome, Refused) else outcome)
    return texts[0] if texts[0] == texts[1] else "; ".join(f"{b}: {t}" for b, t in zip(BACKENDS, texts, strict=True))


def table() -> str:
    """Measure everything and return the page."""
    lines = [INTRODUCTION]
    devices = {}
    for backend in BACKENDS:
        scene, camera, size = build(ss, scene_of("one_kernel"))
        devices[backend] = renderer_of(backend).plan(scene, camera, size=size).device
    lines.append(f"Measured on: gl {devices['gl']}; cpu {devices['cpu']}.\n")
    for group in dict.fromkeys(one.group for one in CASES.values()):
        lines += [f"## {TITLES[group]}\n", _row("case", "what it is", "outcome", "gl", "cpu"), "|---|---|---|---|---|"]
        for name, one in CASES.items():
            if one.group != group:
                continue
            figures = []
            for backend in BACKENDS:
                found = measure(name, backend)
                wrong = fault(one.outcome_on(backend), found)
                if wrong:
                    print(f"{name} on {backend}: {wrong}", file=sys.stderr)
                figures.append(f"**{found}**" if wrong else str(found))
            lines.append(_row(f"`{name}`", one.words, _outcome_text(one), *figures))
        lines.append("")
    lines += [
        "## Several pictures\n",
        _row("case", "what it is", "outcome", "gl", "cpu"),
        "|---|---|---|---|---|",
    ]
    for name, promise in PROPERTIES.items():
        figures = []
        for backend in BACKENDS:
            text, wrong = promise.check(backend)
            if wrong:
                print(f"{name} on {backend}: {wrong}", file=sys.stderr)
            figures.append(f"**{text}**" if wrong else text)
        lines.append(_row(f"`{name}`", promise.words, promise.outcome, *figures))
    lines += ["", PROMISE, _row("field", "option", *BACKENDS), "|---|---|---|---|"]
    import quality.test_frame_to_frame as turning

    for kind, way in turning.SCENES:
        figures = [f"{turning.beyond(backend, kind, way):.1e}" for backend in BACKENDS]
        lines.append(_row(kind, way, *figures))
    return "\n".join(lines) + "\n" + CLOSING


TITLES = {
    "shape": "Shapes and sizes",
    "place": "Places and units of length",
    "sums": "Sums, values and weights",
    "size": "Smaller than pixels and slices",
    "camera": "Cameras",
    "opacity": "Opacity and transfer functions",
    "slices": "Many slices",
    "picture": "Pictures",
    "field": "Fields",
    "light": "Light",
}

INTRODUCTION = """# Hard cases

Scenes that are hard to render accurately, and the errors that each backend was measured to have. The scenes and their
expected outcomes are in `tests/python/hard_cases/`; `test_hard_cases.py` tests each backend against them.
`python -m hard_cases.page --table` in `tests/python` makes this page.

Figures are RMSE / largest difference from the float64 reference, in premultiplied RGBA, over all pixels that are not
ambiguous ([conventions](conventions.md), section 9); the number of ambiguous pixels is given where there are any. The
outcomes:

- *within section 9*: RMSE at most 2·10⁻⁵ and P99.9 at most 2·10⁻⁴ for scenes that meet the condition in the first row
  of the bounds in that section, 10⁻⁴ and 10⁻³ for all others;
- *transparent, exactly*: nothing can be seen, and every number of the picture is exactly 0; its figure is 0;
- the name of an error: the scene is refused with that error, which says what was found, what was wanted and what to do.

*float64* marks figures of scenes for which the plan chose float64, because float32 would not keep the bound. `auto`
takes the first backend that draws the case. A figure in bold would be a fault of the program: the outcome was missed.
"""

PROMISE = """## From frame to frame

With A_stop = 1, a transfer function without steps whose opacity at 0 is 0, and no kernels cut by the near plane, the
picture that conventions.md defines is a continuous function of the view, because the contributions of slices, sections
and kernels fall to 0 at their ends. It therefore has a derivative with respect to the angle (except at kinks), and
every backend keeps this bound:

> When the view is rotated by δ = 0.01°, no pixel changes by more than δ times the largest analytic derivative between
> the two views, plus 2·10⁻⁴.

The tests check a stricter bound: the change of every pixel is equal to the reference's change between the same two
views within 2·10⁻⁴ (the smaller P99.9 of section 9, here for all pixels). So no pixel jumps where samples change their
buckets or their order, where slices begin and end, where kernels are culled or where the plan changes.
`test_frame_to_frame.py` rotates seven fields through views along an axis, along the diagonals of a face
and of the cube, half a step off an axis, and others. A second test makes the angle twenty times smaller and checks that
the reference's own change becomes smaller too, which a jump would not. The largest difference of the two changes:
"""

CLOSING = """
A picture may jump, so that single pixels differ from the reference by more, where the transfer function has steps, in
mode isosurface, where opacity at 0 is above 0, and where A_stop is below 1.

## A picture of 20,000 × 20,000

`sheetsplat.tiles.render_tiles` draws a picture of an orthographic camera tile by tile into an .npy file; every tile has
the slices of the whole picture. `./run bench huge` draws 20,000 × 20,000 pixels (6.4 GB) and compares 64 windows of it
with the reference; 32 of them lie across borders of tiles, and 16 of these at corners of tiles. On two shared cores
this took 67 s and at most 195 MB of memory; RMSE was at most 7.0·10⁻⁷, the largest difference 3.0·10⁻⁶. A perspective
camera is refused, because the parts of its picture would need an off-axis projection.

## Random tests

`test_fuzz_scenes.py` generates scenes with the library Hypothesis (fields, cameras, transfer functions,
effects, settings) and compares each backend with the reference: the scene as it is, with its kernels reordered or each
split into two that share the weight, in another unit of length, translated, and in tiles of any size.
`test_fuzz_readers.py` damages valid files of 67 kinds: a reader must return a field or raise an error of
the package, within 256 MB and 20 s. `./run fuzz` does so with any number of files, scenes and long runs
([reliability.md](reliability.md)).
`tests/python/fuzz_readers.py` is guided by the coverage of the readers' code (atheris).
"""


def main(arguments: list[str]) -> None:
    """Print figures, or write the table."""
    if "--table" in arguments:
        PAGE.write_text(table(), encoding="utf-8")
        return
    wanted = [one for one in arguments if not one.startswith("-")]
    for name, one in CASES.items():
        if wanted and not any(part in name for part in wanted):
            continue
        texts = []
        for backend in BACKENDS:
            began = time.perf_counter()
            found = measure(name, backend)
            wrong = fault(one.outcome_on(backend), found)
            seconds = time.perf_counter() - began
            texts.append(f"{backend} {found} {seconds:.1f}s" + (f"  WRONG {wrong}" if wrong else ""))
        print(name, "|", " | ".join(texts), flush=True)
    for name, promise in PROPERTIES.items():
        if wanted and not any(part in name for part in wanted):
            continue
        for backend in BACKENDS:
            began = time.perf_counter()
            print(name, "|", backend, *promise.check(backend), f"{time.perf_counter() - began:.1f}s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

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
        "## Beside single pictures\n",
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
    lines += ["", PROMISE, _row("field", "way", *BACKENDS), "|---|---|---|---|"]
    import test_frame_to_frame as turning

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

Every case has its outcome written down beside its scene, in `tests/python/hard_cases/`, and
`tests/python/test_hard_cases.py` holds each backend to it. `python -m hard_cases.page --table` in `tests/python`
makes this page.

Figures are RMSE / largest difference from the float64 reference, premultiplied RGBA, over all pixels that are not
ambiguous ([conventions](conventions.md), section 9; where pixels were left out, their number stands beside). "within
section 9": RMSE at most 2·10⁻⁵ and P99.9 at most 2·10⁻⁴ for gentle scenes, 10⁻⁴ and 10⁻³ for all others. An outcome
that names an error is a clear refusal, which says what was found, what was wanted and what to do. float64: the plan
chose it by itself, as float32 would not keep the bound. `auto` takes the first backend that draws the case. 0: nothing
can be seen, and every number is exactly 0. A figure in bold would be a fault: the bound missed without an
error.
"""

PROMISE = """## From frame to frame

With A_stop = 1, a transfer function without steps whose opacity at 0 is 0, and no near plane among kernels, the picture
of the definition is a continuous function of the view: slices, sections and supports end at 0. So it has a derivative
by the angle (but for kinks), and this is promised of every backend:

> When the view is turned by δ = 0.01°, no pixel changes by more than δ times the largest analytic derivative on the
> way, once, plus 2·10⁻⁴.

What is kept is sharper: the change of every pixel is the reference's change between the same two views, within
2·10⁻⁴ (section 9's P99.9 for gentle scenes; here it holds for all pixels). So nothing pops where samples change their
buckets or their order, where slices begin and end, where kernels are culled or the plan changes.
`tests/python/test_frame_to_frame.py` turns seven fields through views along an axis, along the diagonals of a face and
of the body, half a step off an axis, and others; a second test makes the angle twenty times smaller and sees the
reference's own change shrink along, which a jump would not. Largest difference of the two changes:
"""

CLOSING = """
Pictures jump, and so may be off at single pixels, where the transfer function has steps, in mode isosurface, where
opacity at 0 is above 0, and where A_stop is below 1.

## A picture of 20,000 × 20,000

`sheetsplat.tiles.render_tiles` draws a picture of an orthographic camera tile by tile into an .npy file; every tile has
the slices of the whole picture. `./run bench huge` draws 20,000 × 20,000 pixels (6.4 GB) and
compares 64 windows with the reference, 32 of them across borders of tiles and 16 of these at their corners. On two
shared cores: 67 s, a peak of 195 MB, RMSE at most 7.0·10⁻⁷, largest difference 3.0·10⁻⁶. A perspective picture cannot
be drawn in parts, because its parts would need an off-axis projection: that is an error.

## Random tests

`tests/python/test_fuzz_scenes.py` draws scenes by hypothesis (fields, cameras, transfer functions, effects, settings)
and compares each backend with the reference: as they are, with kernels reordered or split into two that share the
weight, in another unit of length, at another place and in tiles of any size. `tests/python/test_fuzz_readers.py`
damages valid files of 33 kinds: a reader must answer with a field or an error of the package, within 256 MB and 20 s.
`SHEETSPLAT_FUZZ=2000` draws more, anew each time. `tests/python/fuzz_readers.py` follows the readers' branches
(atheris).
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

"""The programs of python/examples: run in this process, at any size, and their pictures.

The documentation, the tests and the stored pictures all run programs by `run`. The pictures in python/docs/gallery, and
the page gallery.md, which shows them, are made again by
``python python/docs/_tools/example_programs.py [NAME ... | --page]``.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import sheetsplat as ss

DOCS = Path(__file__).resolve().parents[1]
FOLDER = DOCS.parent / "examples"
STORED = DOCS / "gallery"
# Factor of the sizes of pictures that are stored and compared.
SMALL = 0.5
# Programs whose pictures depend on how long something takes.
TIMED = ("accuracy_ladder", "progressive")
# Width in pixels of stored pictures.
WIDTH = 320

# Every program, in the order of the page.
SECTIONS: dict[str, tuple[str, ...]] = {
    "First steps": ("first_picture", "looks", "cameras", "plan", "quality_words"),
    "Data": (
        "volume_files",
        "lattices",
        "ellipsoids",
        "scattered_points",
        "finite_elements",
        "mesh_and_particles",
        "particle_table",
        "gaussian_splats",
        "solid_mesh",
        "mixed_scene",
        "own_transfer_functions",
        "decades",
        "data_in_bricks",
    ),
    "Effects and modes": (
        "isosurface_shadows",
        "nested_surfaces",
        "projections",
        "clipping",
        "depth_and_boundaries",
        "preintegration",
        "small_kernels",
    ),
    "Figures": ("annotated_figure", "figure_of_panels", "picking", "made_again", "large_picture"),
    "Films and the viewer": ("turntable", "time_series", "camera_path", "viewer"),
    "Accuracy": ("accuracy_ladder", "error_map", "given_error", "how_exact", "progressive"),
    "Other libraries and C++": (
        "xarray_climate",
        "dask_volume",
        "pyvista_grids",
        "pyvista_composite",
        "beside_pyvista",
        "cpp_program",
    ),
    "The papers": (
        "paper_2005_sheets",
        "paper_2005_lattices",
        "paper_2005_transparency",
        "paper_2006_slicing",
        "paper_2006_irregular",
        "paper_2006_train",
    ),
}


@dataclass(frozen=True)
class Example:
    """One program.

    Attributes
    ----------
    name
        Its file without the suffix; the picture that it writes has the same name.
    title, text
        First line and paragraphs of its docstring.
    source
        Its code without the docstring.
    """

    name: str
    title: str
    text: str
    source: str

    @property
    def path(self) -> Path:
        """The program."""
        return FOLDER / f"{self.name}.py"

    @property
    def picture(self) -> Path:
        """The stored picture."""
        return STORED / f"{self.name}.jpg"

    @classmethod
    def read(cls, name: str) -> Example:
        """Return the program of that name."""
        code = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        title, _, text = (ast.get_docstring(ast.parse(code)) or "").partition("\n")
        _, _, source = code.partition('"""')[2].partition('"""\n')
        return cls(name, title.strip().rstrip("."), text.strip(), source.strip() + "\n")


def all_examples() -> Iterator[tuple[str, Example]]:
    """Yield every program with the title of its section, in the order of the page."""
    for section, names in SECTIONS.items():
        for name in names:
            yield section, Example.read(name)


class _Scaled(ast.NodeTransformer):
    """Multiplies the numbers of ``SIZE = (width, height)``."""

    def __init__(self, factor: float) -> None:
        self.factor = factor
        self.count = 0

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:  # noqa: N802
        """Change the assignment to SIZE."""
        if [target.id for target in node.targets if isinstance(target, ast.Name)] == ["SIZE"]:
            width, height = ast.literal_eval(node.value)
            size = (round(self.factor * width), round(self.factor * height))
            node.value = ast.copy_location(ast.Constant(size), node.value)
            self.count += 1
        return node


@contextlib.contextmanager
def _figures_of(folder: Path) -> Iterator[None]:
    """Draw figures of matplotlib without a display, and close those that a program leaves open."""
    os.environ.setdefault("MPLBACKEND", "agg")
    before = set(sys.modules)
    with contextlib.chdir(folder):
        try:
            yield
        finally:
            if "matplotlib.pyplot" in sys.modules or "matplotlib.pyplot" in before:
                sys.modules["matplotlib.pyplot"].close("all")


def run(example: Example, folder: Path, factor: float = 1.0) -> str:
    """Run a program in a folder, where its files appear, and return what it prints.

    Parameters
    ----------
    example
        The program.
    folder
        An empty folder.
    factor
        Factor of the picture size, SIZE, that the program states.

    Raises
    ------
    PictureWarning
        Where a picture is not what its program promises: warnings of the package are errors here.
    """
    tree = ast.parse(example.path.read_text(encoding="utf-8"), filename=str(example.path))
    scaled = _Scaled(factor)
    tree = scaled.visit(tree)
    if scaled.count != 1:
        raise ValueError(f"{example.path} states SIZE {scaled.count} times; it must do so once")
    printed = io.StringIO()
    space = {"__name__": "__main__", "__file__": str(example.path)}
    with _figures_of(folder), warnings.catch_warnings(), contextlib.redirect_stdout(printed):
        warnings.simplefilter("error", ss.PictureWarning)
        exec(compile(tree, str(example.path), "exec"), space)
    return printed.getvalue()


def on_paper(picture: Image.Image) -> Image.Image:
    """Return a picture as it looks on white paper, at most WIDTH pixels wide."""
    shown = picture.convert("RGBA")
    paper = Image.new("RGBA", shown.size, "white")
    paper.alpha_composite(shown)
    paper.thumbnail((WIDTH, 2 * WIDTH), Image.Resampling.LANCZOS)
    return paper.convert("RGB")


def small_picture(example: Example, folder: Path) -> Image.Image:
    """Run a program at the size of the stored pictures, and return its picture on white paper."""
    run(example, folder, SMALL)
    with Image.open(folder / f"{example.name}.png") as picture:
        return on_paper(picture)


def difference(picture: Image.Image, stored: Image.Image) -> float:
    """Return the root mean square difference of two pictures over the contrast (standard deviation) of the second.

    Infinite where their sizes differ by more than 2 pixels, as labels of a figure may.
    """
    if max(abs(one - two) for one, two in zip(picture.size, stored.size, strict=True)) > 2:
        return float("inf")
    first, second = (_levels(one.resize(stored.size)) for one in (picture, stored))
    return float(np.sqrt(np.mean((first - second) ** 2)) / max(second.std(), 1.0))


def _levels(picture: Image.Image) -> NDArray[np.float64]:
    return np.asarray(picture, dtype=np.float64)


def page() -> str:
    """Return the page gallery.md."""
    lines = [
        "# Gallery",
        "",
        "Short programs, each with its picture; they are in `python/examples`. Each makes its own data, takes a second",
        "or two, and writes its files into the current folder.",
        "",
    ]
    for section, names in SECTIONS.items():
        lines += [f"## {section}", "", "| | |", "|---|---|"]
        for name in names:
            example = Example.read(name)
            text = " ".join(example.text.split())
            lines.append(
                f"| ![{example.title}](gallery/{name}.jpg) | **[{example.title}](../examples/{name}.py)**<br>{text} |"
            )
        lines.append("")
    return "\n".join(lines)


def main(names: list[str]) -> None:
    """Make the page again, and the stored pictures: those that are named, or all; with --page none."""
    everything = [name for group in SECTIONS.values() for name in group]
    for name in [] if names == ["--page"] else names or everything:
        example = Example.read(name)
        with tempfile.TemporaryDirectory() as folder:
            small_picture(example, Path(folder)).save(example.picture, quality=92, subsampling=0)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

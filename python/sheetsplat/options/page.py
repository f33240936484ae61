"""The reference page of all options: ``python -m sheetsplat.options.page`` prints it."""

from __future__ import annotations

from sheetsplat.options.bricks import BrickOptions, ClusterOptions
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import MODES, Option, definitions, in_python
from sheetsplat.options.data import FileOptions, KernelOptions, PlacementOptions
from sheetsplat.options.figure import FigureOptions
from sheetsplat.options.film import BetweenOptions, FilmOptions, TurnOptions
from sheetsplat.options.look import TransferOptions
from sheetsplat.options.picture import ObjectOptions, PictureOptions
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import BackendOptions, RendererLimits, RendererSettings
from sheetsplat.options.scene import EffectOptions, LightOptions, ModeOptions, SamplingOptions
from sheetsplat.options.spelling import flags

_ABOUT = """\
# Options

Every option of `sheetsplat.render` and of the commands `sheetsplat render`, `plan` and `accuracy`. `Scene` takes
those of mode, sampling, effects and light; `Renderer` those of the renderer; `sheetsplat.open` those of files,
positions and kernels. [usage.md](usage.md) explains how the options work together, [conventions.md](conventions.md)
what they do to the picture.

An option with modes in its last column has a meaning in these modes only: the command line refuses it in others, and
`sheetsplat.render` logs a warning, or raises an error where the scene itself does not allow it.

`sheetsplat.turntable` and `sheetsplat.animate` take all of them but `outputs` and `progress`, and those of films.
Those of figures are of `Image.annotated`, `Image.save_figure`, `Image.to_axes`, and of `sheetsplat render --figure`.

This page is made from the definitions in `sheetsplat/options`:
`python -m sheetsplat.options.page > python/docs/options.md`.
"""
_COLUMNS = ("option", "command line", "type", "default", "meaning", "modes")
#: Titles of groups of options, in the order of the page.
GROUPS: tuple[tuple[str, tuple[type, ...]], ...] = (
    ("Picture", (QualityOptions, PictureOptions)),
    ("Colours and opacity", (TransferOptions,)),
    ("Mode", (ModeOptions,)),
    ("Sampling", (SamplingOptions,)),
    ("Effects", (EffectOptions,)),
    ("Light", (LightOptions,)),
    ("Camera", (CameraOptions,)),
    ("Renderer", (BackendOptions, RendererSettings)),
    ("Renderer, in its constructor only", (RendererLimits,)),
    ("Objects in place of options", (ObjectOptions,)),
    ("Files", (FileOptions,)),
    ("Positions of samples", (PlacementOptions,)),
    ("Kernels", (KernelOptions,)),
    ("Figures", (FigureOptions,)),
    ("Data in bricks", (BrickOptions, ClusterOptions)),
    ("Films", (FilmOptions,)),
    ("Turntables", (TurnOptions,)),
    ("Time series", (BetweenOptions,)),
)


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


def _row(option: Option) -> str:
    spelt = ", ".join(_code(flags(option.name, one)) for one in option.spellings)
    modes = "" if option.modes == MODES else ", ".join(option.modes)
    default = in_python(option.default_text(chooses=True))
    cells = (_code(option.name), spelt, option.type_text, default, in_python(option.help), modes)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def page() -> str:
    """Return the page as Markdown."""
    lines = [_ABOUT]
    for title, groups in GROUPS:
        lines += [f"## {title}", "", f"| {' | '.join(_COLUMNS)} |", "|---" * len(_COLUMNS) + "|"]
        lines += [_row(option) for group in groups for option in definitions(group).values()]
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    print(page(), end="")

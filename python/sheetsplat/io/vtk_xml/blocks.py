"""Files that name others, one of which is shown: blocks (.vtm), series (.pvd). Only files beside them are opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from sheetsplat._checks import shown
from sheetsplat.errors import option_ref
from sheetsplat.io import formats
from sheetsplat.io.checks import beside, chosen_step, listed, printable, unreadable
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.document import parse_tree

_BLOCKS, _SERIES = "vtkMultiBlockDataSet", "Collection"
_MOST_BLOCKS = 10_000


@dataclass(frozen=True)
class _Block:
    """A data set: its name, with those of the blocks around it; its file; and the time, as a series has it."""

    name: str
    file: str
    time: str


class _Contents:
    """The data sets that a file names, and whether they are times of a series."""

    def __init__(self, source: Source) -> None:
        root, path = parse_tree(source), source.path
        kind = root.get("type")
        if root.tag != "VTKFile" or kind not in (_BLOCKS, _SERIES):
            raise unreadable(path, f"<{shown(root.tag)[1:-1]}>", f"a VTK file of type {_BLOCKS} or {_SERIES}")
        self.is_series = kind == _SERIES
        self.blocks: list[_Block] = []
        # Those that are left, the next one last, each with the names of the blocks around it.
        left: list[tuple[Element, tuple[str, ...]]] = [(one, ()) for part in reversed(root) for one in reversed(part)]
        while left:
            one, around = left.pop()
            names = (*around, printable(one.get("name")) or printable(one.get("index")) or one.tag)
            if one.tag == "DataSet" and one.get("file"):
                if len(self.blocks) >= _MOST_BLOCKS:
                    raise unreadable(path, f"more than {_MOST_BLOCKS} blocks", "fewer")
                time = printable(one.get("timestep"))
                self.blocks.append(_Block("/".join(names), one.get("file", ""), time))
            left += [(inner, names) for inner in reversed(one)]


def _files(source: Source, contents: _Contents) -> list[Path]:
    """Return the file of each time of a series, in the order of the file."""
    times: dict[str, list[str]] = {}
    for one in contents.blocks:
        times.setdefault(one.time, []).append(one.file)
    several = next((time for time, files in times.items() if len(files) > 1), None)
    if several is not None:
        found = f"{len(times[several])} parts at time {shown(several)}"
        raise unreadable(source.path, found, "one file for each time", "save each time as one file")
    return [beside(source.path, files[0]) for files in times.values()]


def _chosen(source: Source, step: int | None) -> Path:
    """Return the file of a time, of the only block, or of that which FILE:/name names; InvalidInput without one."""
    contents = _Contents(source)
    if contents.is_series:
        files = _files(source, contents)
        return files[chosen_step(source.path, len(files), step)]
    if step is not None:
        raise unreadable(source.path, option_ref("step") + " for blocks", "it for time series (.pvd)", option="step")
    wanted = source.inner.strip("/")
    names = [one.name for one in contents.blocks]
    found = [one for one in contents.blocks if one.name == wanted] if wanted else contents.blocks
    if len(found) != 1:
        advice = f"choose one: {source.path.name}:/{names[0]}" if names else ""
        about = f"{len(found)} blocks called {shown(wanted)}" if wanted else f"{len(found)} blocks"
        raise unreadable(source.path, f"{about}; blocks: {listed(names)}", "one", advice)
    return beside(source.path, found[0].file)


def kind_of(source: Source) -> str:
    """Return the name of the format of the block that is shown, or of the first time."""
    contents = _Contents(source)
    files = _files(source, contents) if contents.is_series else []
    with Source(files[0] if files else _chosen(source, None)) as block:
        if formats.names_blocks(block):
            raise unreadable(source.path, f"{block.path.name}, which names files itself", "a data set in its own file")
        return formats.format_of(block).name


def steps(source: Source, name: str | None = None) -> list[Path]:
    """Return the file of each time of a series; of blocks none."""
    contents = _Contents(source)
    return _files(source, contents) if contents.is_series else []


def read(source: Source, step: int | None = None, **options: object) -> Volume | Scattered:
    """Read the only block, or that which FILE:/name names (its index where it has no name), as its format says.

    Of a time series `step` is the number of the time, from 0 on.

    Raises InvalidInput where there is none or more than one, and for files outside the folder of this one.
    """
    path = _chosen(source, step)
    with Source(path) as block:
        own = formats.format_of(block)
        if own.name not in formats.OF_BLOCKS:
            raise unreadable(source.path, f"a block of format {own.name}", ", ".join(formats.OF_BLOCKS))
        data: Volume | Scattered = own.read(block, **options)
        return data

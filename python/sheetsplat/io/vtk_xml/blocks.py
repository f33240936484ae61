"""Blocks (.vtm): a file that names other files, of which one is shown. Only files of its own folder are opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sheetsplat._checks import shown
from sheetsplat.io import formats
from sheetsplat.io.checks import beside, listed, printable, unreadable
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.document import GuardedParser

_KIND = "vtkMultiBlockDataSet"
_CHUNK = 1 << 20
_MOST_BLOCKS = 10_000


@dataclass(frozen=True)
class _Block:
    """A data set: its name, with those of the blocks around it, and its file."""

    name: str
    file: str


class _Parser(GuardedParser):
    """Parser of the elements Block, Piece and DataSet."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._names: list[str] = []
        self.blocks: list[_Block] = []

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Take the names of blocks and the files of data sets."""
        depth = len(self._stack)
        if depth == 0 and (name != "VTKFile" or attributes.get("type") != _KIND):
            raise unreadable(self._path, f"<{shown(name)[1:-1]}>", f"a VTK file of type {_KIND}")
        own = printable(attributes.get("name")) or printable(attributes.get("index")) or name
        del self._names[depth:]
        self._names.append(own)
        if name == "DataSet" and attributes.get("file"):
            if len(self.blocks) >= _MOST_BLOCKS:
                raise unreadable(self._path, f"more than {_MOST_BLOCKS} blocks", "fewer")
            self.blocks.append(_Block("/".join(self._names[2:]), attributes["file"]))


def _chosen(source: Source) -> Path:
    """Return the file of the only block, or of that which FILE:/name names; InvalidInput unless there is one."""
    parser = _Parser(source.path)
    source.stream.seek(0)
    while piece := source.stream.read(_CHUNK):
        parser.feed(piece)
    parser.feed(b"", True)
    wanted = source.inner.strip("/")
    names = [one.name for one in parser.blocks]
    found = [one for one in parser.blocks if one.name == wanted] if wanted else parser.blocks
    if len(found) != 1:
        advice = f"choose one: {source.path.name}:/{names[0]}" if names else ""
        about = f"{len(found)} blocks called {shown(wanted)}" if wanted else f"{len(found)} blocks"
        raise unreadable(source.path, f"{about}; blocks: {listed(names)}", "one", advice)
    return beside(source.path, found[0].file)


def kind_of(source: Source) -> str:
    """Return the name of the format of the block that is shown."""
    with Source(_chosen(source)) as block:
        return formats.format_of(block).name


def read(source: Source, **options: object) -> Volume | Scattered:
    """Read the only block, or that which FILE:/name names (its index where it has no name), as its format says.

    Raises InvalidInput where there is none or more than one, and for files outside the folder of this one.
    """
    path = _chosen(source)
    with Source(path) as block:
        own = formats.format_of(block)
        if own.name not in formats.OF_BLOCKS:
            raise unreadable(source.path, f"a block of format {own.name}", ", ".join(formats.OF_BLOCKS))
        data: Volume | Scattered = own.read(block, **options)
        return data

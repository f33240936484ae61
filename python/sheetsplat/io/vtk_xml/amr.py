"""Overlapping AMR in files (.vthb), which name an image for each block. Only files beside them are opened."""

from __future__ import annotations

from sheetsplat.io import amr
from sheetsplat.io.checks import beside, natural, unreadable
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml import images
from sheetsplat.io.vtk_xml.document import parse_tree

KIND = "vtkOverlappingAMR"
_MOST_BLOCKS, _MOST_LEVELS = 100_000, 64


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read the cells that no finer level covers; see `amr.scattered`.

    Raises InvalidInput for damaged files, and for files outside the folder of this one.
    """
    path, root = source.path, parse_tree(source)
    tree = root.find(KIND)
    if root.get("type") != KIND or tree is None:
        raise unreadable(path, f"a VTK file of type {root.get('type')}", KIND)
    levels: dict[int, list[Volume]] = {}
    count = 0
    for level in tree.findall("Block"):
        number = natural(path, "level", level.get("level", ""))
        if number >= _MOST_LEVELS:
            raise unreadable(path, f"level {number}", f"levels below {_MOST_LEVELS}")
        for one in level.findall("DataSet"):
            # Blocks of other processes may have no file.
            if not one.get("file"):
                continue
            count += 1
            if count > _MOST_BLOCKS:
                raise unreadable(path, f"more than {_MOST_BLOCKS} blocks", "fewer")
            with Source(beside(path, one.get("file", ""))) as block:
                levels.setdefault(number, []).append(images.read(block, scalar))
    return amr.scattered(path, [levels[number] for number in sorted(levels)], "vtk amr")

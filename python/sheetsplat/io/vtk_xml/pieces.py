"""The pieces of a file: its own, or those of the files beside it that a parallel one (.pvti, .pvtu …) names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from sheetsplat._checks import shown
from sheetsplat.io.checks import beside, unreadable
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_grids import Picked
from sheetsplat.io.vtk_xml.arrays import ArrayReader, pick_scalar
from sheetsplat.io.vtk_xml.document import PARALLEL, parse_document


class Pieces:
    """The pieces of a file, each with what reads its arrays; of several files one is open at a time.

    The constructor raises InvalidInput for files that a parallel one names twice, or that lie outside its folder; so
    what is read is bounded by what is stored.

    Attributes
    ----------
    path
        The file that was opened.
    kind
        Of the data set: "ImageData" for .vti and .pvti.
    data
        The element of that kind.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._document = parse_document(source)
        self.path, self.kind, self.data = source.path, self._document.kind, self._document.data
        self._files = []
        if self._document.is_parallel:
            self._files = [beside(source.path, piece.get("Source", "")) for piece in self._document.pieces]
            twice = [one for one, count in Counter(self._files).items() if count > 1]
            if twice:
                raise unreadable(source.path, f"two pieces in {shown(twice[0].name)}", "a file for each piece")

    def pick_scalar(self, scalar: str | None) -> Picked:
        """Return the scalar to show: that with this name, or the active one, or the first."""
        if self._document.is_parallel:
            return pick_scalar(self.path, self.data, scalar, PARALLEL)
        return pick_scalar(self.path, self._document.pieces[0], scalar)

    def __iter__(self) -> Iterator[tuple[ArrayReader, Element]]:
        """Yield each piece; InvalidInput for files of another kind."""
        if not self._document.is_parallel:
            reader = ArrayReader(self._source, self._document)
            yield from ((reader, piece) for piece in self._document.pieces)
        for path in self._files:
            with Source(path) as part:
                document = parse_document(part)
                if document.data.tag != self.kind:
                    raise unreadable(
                        path, f"a VTK file of type {document.data.tag}", f"{self.kind}, as {self.path} says"
                    )
                reader = ArrayReader(part, document)
                for piece in document.pieces:
                    piece.attrib.setdefault("Extent", document.data.get("WholeExtent", ""))
                    yield reader, piece

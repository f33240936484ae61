"""Readers of volumes and scattered data, and writers of pictures.

Files are not trusted: nothing is unpickled, sizes are checked before memory is taken, and what is unpacked is bounded
by what the header says. `formats` lists the formats; `opening` reads files of any of them.
"""

from sheetsplat.io.formats import Format
from sheetsplat.io.kernels import field_of
from sheetsplat.io.names import Names
from sheetsplat.io.opening import arrays, read_scattered, read_volume
from sheetsplat.io.records import Channel, Packing, Scattered, Volume
from sheetsplat.io.source import Folder, Source
from sheetsplat.io.tables import save_npz

__all__ = [
    "Channel",
    "Folder",
    "Format",
    "Names",
    "Packing",
    "Scattered",
    "Source",
    "Volume",
    "arrays",
    "field_of",
    "read_scattered",
    "read_volume",
    "save_npz",
]

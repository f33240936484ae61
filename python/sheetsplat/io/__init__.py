"""Readers of volumes and scattered data, and writers of pictures.

Files are not trusted: nothing is unpickled, sizes are judged before memory is taken, and what is unpacked is bounded by
what the header says.
"""

from sheetsplat.io.scattered import Scattered, field_of, read_scattered
from sheetsplat.io.tables import save_npz
from sheetsplat.io.volume import SCATTERED, Volume, find_format, read_volume

__all__ = [
    "SCATTERED",
    "Scattered",
    "Volume",
    "field_of",
    "find_format",
    "read_scattered",
    "read_volume",
    "save_npz",
]

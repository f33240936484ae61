"""Readers of volumes and writers of pictures.

Files are not trusted: nothing is unpickled, sizes are judged before memory is taken, and what is unpacked is bounded by
what the header says.
"""

from sheetsplat.io.volume import Volume, read_volume

__all__ = ["Volume", "read_volume"]

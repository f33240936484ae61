"""What ``data.sheetsplat`` offers, whatever library the data are of."""

from __future__ import annotations

from typing import Any, Unpack

from sheetsplat import api
from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.image import Image
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.picture import RenderOptions


class Accessor:
    """Pictures and fields of the data that it belongs to.

    Parameters
    ----------
    data
        The data, anything that `sheetsplat.render` takes.
    """

    def __init__(self, data: Any) -> None:
        self._data = data

    def render(self, **options: Unpack[RenderOptions]) -> Image:
        """Return a picture of the data: `sheetsplat.render` with the same options and errors."""
        return api.render(self._data, **options)

    def field(
        self, **options: Unpack[OpenOptions]
    ) -> RegularField | EllipsoidField | list[RegularField | EllipsoidField]:
        """Return the field of the data: `sheetsplat.open` with the same options and errors."""
        return api.open(self._data, **options)

"""Slice planes: which planes through the data a picture shows, and their colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sheetsplat._checks import Triple, Vector, convert, measurable, number, parts, shown, triple
from sheetsplat._values import OfArguments
from sheetsplat.errors import Error, complain, unusable
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.transfer import Colormap

ORTHOGONAL = "orthogonal"
#: Options of `sheetsplat.render` with the colours of planes that have none of their own.
OF_PLANES = ("slice_cmap", "slice_clim")
#: Colormap of planes unless given.
PLANE_CMAP = "gray"
_MOST = 64


def _normal(what: str, value: object) -> Triple:
    normal = triple(what, value)
    if not all(map(math.isfinite, normal)) or not any(normal):
        raise complain(unusable(what), shown(normal), "a finite normal of a length above 0")
    return measurable(what, normal, "divide it, and the plane's offset with it, by its length")


def _offset(what: str, value: object) -> float | None:
    offset = None if value is None else number(what, value)
    if offset is not None and not math.isfinite(offset):
        raise complain(unusable(what), f"{offset:g}", "a finite number")
    return offset


def _point(what: str, value: object) -> Triple | None:
    point = None if value is None else triple(what, value)
    if point is not None and not all(map(math.isfinite, point)):
        raise complain(unusable(what), shown(point), "three finite numbers")
    return point


@dataclass(frozen=True)
class SlicePlane(OfArguments):
    """An opaque plane through the data that shows their values. Conventions, section 10.

    Parameters
    ----------
    normal
        At a right angle to the plane; any length but 0.
    offset
        The plane has the points x with normal · x = offset, as those of `Clip`. World units times the normal's length.
    point
        In place of `offset`: a point of the plane, world units; kept as the offset. Without both the plane goes through
        the middle of the data.
    cmap
        As for `TransferFunction.from_colormap`, without opacities; kept as a name, or as a tuple of rows. Labels have
        their own colours; those without one have the colormap's first. None: that of `slice_cmap` of
        `sheetsplat.render`, else gray.
    clim
        Values of the data at which the colormap begins and ends, also where their logarithms are shown. None: those of
        `slice_clim` of `sheetsplat.render`, else the least and the largest value.

    Raises
    ------
    InvalidInput
        For anything but finite numbers, a normal of length 0, an offset and a point at once, unknown colormaps, and
        limits that do not rise.

    Examples
    --------
    >>> plane = ss.SlicePlane((0, 0, 1), cmap="viridis")
    >>> image = ss.render(values, slice_planes=plane, size=(32, 32))
    >>> float(image.rgba[..., 3].max())
    1.0
    """

    normal: Vector
    offset: float | None = None
    point: Vector | None = None
    cmap: Colormap | None = None
    clim: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, normal=_normal, offset=_offset, point=_point)
        if self.point is not None:
            if self.offset is not None:
                raise complain("SlicePlane: offset and point cannot be used together", "both", "one of them")
            across = math.fsum(one * other for one, other in zip(self.normal, self.point, strict=True))
            convert(self, offset=lambda what, _: _offset(what, across), point=lambda *_: None)
        try:
            colors = ScalarColors(PLANE_CMAP if self.cmap is None else self.cmap, self.clim)
        except Error as error:
            told = error.complaint
            raise type(error)("SlicePlane: its colours cannot be used", told.found, told.wanted, told.advice) from None
        convert(self, cmap=lambda _, given: None if given is None else colors.cmap, clim=lambda *_: colors.clim)

    @property
    def colors(self) -> ScalarColors:
        """Its colormap, and its limits, which may be left open."""
        return ScalarColors(PLANE_CMAP if self.cmap is None else self.cmap, self.clim)


def with_colors(
    planes: Sequence[SlicePlane], cmap: Colormap | None, clim: Sequence[float] | None
) -> tuple[SlicePlane, ...]:
    """Return planes with a colormap and limits where they have none of their own; None: these stay open.

    Raises
    ------
    InvalidInput
        As `SlicePlane`.
    """
    return tuple(
        replace(
            one,
            cmap=cmap if one.cmap is None else one.cmap,
            clim=clim if one.clim is None else one.clim,
        )
        for one in planes
    )


def slice_planes_of(what: str, value: object) -> tuple[SlicePlane, ...]:
    """Return slice planes: of one plane, a sequence of them, None, or the word for three through the middle."""
    if value is None or isinstance(value, SlicePlane):
        return () if value is None else (value,)
    wanted = f'a SlicePlane, a sequence of them, or "{ORTHOGONAL}"'
    if isinstance(value, str) and value == ORTHOGONAL:
        return SlicePlane((1, 0, 0)), SlicePlane((0, 1, 0)), SlicePlane((0, 0, 1))
    found = parts(what, value, wanted, _MOST)
    if len(found) > _MOST:
        raise complain(unusable(what), f"more than {_MOST} planes", "fewer")
    for one in found:
        if not isinstance(one, SlicePlane):
            raise complain(unusable(what), shown(one), wanted)
    return tuple(found)

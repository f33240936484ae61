"""Transfer functions: scalar to colour and opacity. Conventions, section 4 (Classification)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import STRONGEST, choice, color, nearest_names, number, numbers, parts, shown, strength
from sheetsplat.errors import complain, unusable
from sheetsplat.opacity_words import PRESETS, opacities_of

Floats = NDArray[np.float64]
# A name of the cmap package, names of colours, a table (N, 3 or 4), or a function of numbers in [0, 1] that gives such
# rows.
Colormap = str | Sequence[str] | ArrayLike | Callable[[Floats], ArrayLike]
# A word, one opacity, opacities spread evenly over clim, or pairs (value, opacity).
Opacity = str | float | Sequence[float] | Sequence[tuple[float, float]] | NDArray[Any]

# Number of samples of a named colormap or of a function; tables of 8 bits have as many entries.
_COLORS = 256


def _table(values: Any, what: str, wanted: str) -> Floats:
    table = numbers(what, values, wanted)
    _memory.require(table.size * np.dtype(np.float64).itemsize, f"a copy of {what}")
    scale = 255.0 if np.asarray(values).dtype == np.uint8 else 1.0
    return table.astype(np.float64) / scale


def color_rows(cmap: Colormap) -> Floats:
    """Return rows r, g, b, a at equal distances over [0, 1]."""
    wanted = "a name of the cmap package, rows (N, 3) or (N, 4) of numbers in [0, 1], or a function that gives them"
    names = cmap.split(",") if isinstance(cmap, str) and ("," in cmap or cmap.startswith("#")) else cmap
    if isinstance(names, list | tuple) and names and all(isinstance(one, str) for one in names):
        rows = np.asarray([color("the colormap's colour", one) for one in names])
    elif isinstance(cmap, str):
        import cmap as cmap_package

        # It warns of every name that two collections have, viridis not among them; without a handler of the
        # application's own this would be printed.
        log = logging.getLogger("cmap")
        if not log.handlers:
            log.addHandler(logging.NullHandler())
        try:
            rows = np.asarray(cmap_package.Colormap(cmap).lut(_COLORS), dtype=np.float64)
        except (ValueError, TypeError, KeyError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise complain(
                unusable("cmap"),
                f"{cmap!r} ({reason})",
                "a name of the cmap package",
                nearest_names(cmap, cmap_package.Catalog().unique_keys()) or 'try "viridis" or "gray"',
            ) from None
    elif callable(cmap):
        rows = _table(cmap(np.linspace(0.0, 1.0, _COLORS)), "the colormap's result", wanted)
    else:
        rows = _table(cmap, "cmap", wanted)
    if rows.ndim != 2 or rows.shape[1] not in (3, 4) or len(rows) < 1:
        raise complain(unusable("cmap"), f"an array of shape {rows.shape}", wanted)
    if not np.all((rows >= 0) & (rows <= 1)):
        raise complain(unusable("cmap"), "numbers outside [0, 1]", wanted, "divide tables of 8 bits by 255")
    if len(rows) == 1:
        rows = np.repeat(rows, 2, axis=0)
    if rows.shape[1] == 3:
        rows = np.column_stack([rows, np.ones(len(rows))])
    return rows


def color_limits(clim: Sequence[float], *, positive: bool = False, what: str = "clim") -> tuple[float, float]:
    """Return the two numbers at which a colormap begins and ends, or InvalidInput; `positive`: for a logarithm."""
    wanted = "two numbers, the lower one first"
    limits = parts(what, clim, wanted, 2)
    if len(limits) != 2:
        raise complain(unusable(what), shown(clim), wanted)
    low, high = number(what, limits[0]), number(what, limits[1])
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise complain(unusable(what), f"({low:g}, {high:g})", "two finite numbers, the lower one first")
    if positive and not low > 0:
        raise complain(unusable(what), f"({low:g}, {high:g}) for a logarithmic scale", "two numbers above 0")
    return low, high


def _opacities(opacity: Opacity, low: float, high: float) -> Floats:
    """Return rows value, opacity; values may repeat (a step) but never fall."""
    wanted = "a number in [0, 1], a sequence of them (spread evenly over clim), or pairs (value, opacity)"
    if isinstance(opacity, str):
        return opacities_of(opacity, low, high)
    table = _table(opacity, "opacity", wanted)
    if table.ndim == 0:
        table = np.array([[low, float(table)], [high, float(table)]])
    elif table.ndim == 1 and len(table) >= 1:
        spread = np.repeat(table, 2) if len(table) == 1 else table
        table = np.column_stack([np.linspace(low, high, len(spread)), spread])
    elif table.ndim != 2 or table.shape[1] != 2 or not len(table):
        raise complain(unusable("opacity"), f"an array of shape {table.shape}", wanted)
    if not np.all(np.isfinite(table)) or not np.all((table[:, 1] >= 0) & (table[:, 1] <= 1)):
        raise complain(unusable("opacity"), shown(opacity), wanted)
    if np.any(np.diff(table[:, 0]) < 0):
        raise complain(unusable("opacity"), "values that decrease", "pairs sorted by value")
    return table


def _two_sided(values: Floats, at: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Return the limits of a piecewise linear function from the left and from the right at `values`."""
    columns = heights.reshape(len(at), -1)
    left = np.empty((len(values), columns.shape[1]))
    right = np.empty_like(left)
    for row, value in enumerate(values):
        first, last = np.searchsorted(at, value, "left"), np.searchsorted(at, value, "right")
        if first < last:
            left[row], right[row] = columns[first], columns[last - 1]
        elif first == 0:
            left[row] = right[row] = columns[0]
        elif first == len(at):
            left[row] = right[row] = columns[-1]
        else:
            share = (value - at[first - 1]) / (at[first] - at[first - 1])
            left[row] = right[row] = (1 - share) * columns[first - 1] + share * columns[first]
    return left, right


class TransferFunction:
    """Scalar to colour and opacity: linear between points, clamped beyond the first and the last. Immutable.

    Parameters
    ----------
    points
        Rows (value, r, g, b, opacity) with values that do not fall; of two points at one value the later one holds from
        there on. Colours are not multiplied by the opacity; the opacity is per reference length, in [0, 1].

    Raises
    ------
    InvalidInput
        For no points, values that fall, numbers that are not finite, opacities outside [0, 1].

    Examples
    --------
    >>> fire = ss.TransferFunction.from_colormap("inferno", opacity=[(0, 0), (1, 0.5)], clim=(0, 1))
    >>> fire.v_min, fire.v_max
    (0.0, 1.0)
    """

    __slots__ = ("least", "native")
    #: Least value of the data that the limits were chosen for, where colour bars begin; None for given limits.
    least: float | None

    def __init__(self, points: ArrayLike) -> None:
        wanted = "rows of five numbers: value, r, g, b, opacity"
        found = numbers("TransferFunction: points", points, wanted)
        if found.size == 0:
            found = found.reshape(0, 5)
        if found.ndim != 2 or found.shape[1] != 5:
            raise complain("TransferFunction: the points cannot be used", f"an array of shape {found.shape}", wanted)
        rows = found.astype(np.float64, copy=False)
        for strong in rows[:, 1:4][np.abs(rows[:, 1:4]) > STRONGEST][:1].tolist():
            strength("TransferFunction: a colour", strong)
        self.native, self.least = _sheetsplat.TransferFunction(np.ascontiguousarray(rows)), None

    @classmethod
    def from_colormap(
        cls, cmap: Colormap = "viridis", opacity: Opacity = (0.0, 1.0), clim: Sequence[float] = (0.0, 1.0)
    ) -> TransferFunction:
        """Return a transfer function with the colours of a colormap.

        Parameters
        ----------
        cmap
            A name that the cmap package knows ("viridis", "gray", "matlab:jet" …), names of colours spread evenly
            ("black,orange,white", or a list of them), a table of shape (N, 3) or (N, 4) in
            [0, 1] (or uint8), or a function that gives such rows for an array of numbers in [0, 1]. A fourth column
            multiplies the opacity.
        opacity
            Per reference length: one number, a sequence spread evenly over `clim`, pairs (value, opacity), or a word:
            linear, geom, sigmoid, sigmoid_3 … sigmoid_20, each also with _r (falling), foreground, isolayers:N.
        clim
            The two values at which the colormap begins and ends.

        Raises
        ------
        InvalidInput
            For unknown names, other shapes, and numbers outside their range.
        """
        low, high = color_limits(clim)
        colors = color_rows(cmap)
        return cls._joined(np.linspace(low, high, len(colors)), colors, _opacities(opacity, low, high))

    @classmethod
    def from_curves(cls, colors: ArrayLike, opacities: ArrayLike) -> TransferFunction:
        """Return a transfer function whose colours and opacities are linear between points of their own.

        Parameters
        ----------
        colors
            Rows (value, r, g, b) with values that do not fall, (N, 4).
        opacities
            Rows (value, opacity) with values that do not fall, (M, 2); opacities per reference length, in [0, 1].

        Raises
        ------
        InvalidInput
            For other shapes, values that fall, numbers that are not finite or outside their range.
        """
        both = []
        for what, given, columns in (("colors", colors, 4), ("opacities", opacities, 2)):
            wanted = f"rows of {columns} numbers, the first of which do not fall"
            found = numbers(f"TransferFunction.from_curves: {what}", given, wanted)
            flat = found.ndim != 2 or found.shape[1] != columns or not len(found)
            rows = np.empty((0, columns)) if flat else found.astype(np.float64, copy=False)
            if flat or not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) < 0):
                raise complain(unusable(f"TransferFunction.from_curves: {what}"), shown(given), wanted)
            both.append(rows)
        return cls._joined(both[0][:, 0], np.column_stack([both[0][:, 1:], np.ones(len(both[0]))]), both[1])

    @classmethod
    def _joined(cls, color_at: Floats, colors: Floats, opacities: Floats) -> TransferFunction:
        """Return the function of rows r, g, b, factor of the opacity, at values, and of rows value, opacity."""
        values = np.unique(np.concatenate([color_at, opacities[:, 0]]))
        color_left, color_right = _two_sided(values, color_at, colors)
        opacity_left, opacity_right = _two_sided(values, opacities[:, 0], opacities[:, 1])
        left = np.column_stack([values, color_left[:, :3], opacity_left * color_left[:, 3:]])
        right = np.column_stack([values, color_right[:, :3], opacity_right * color_right[:, 3:]])
        steps = np.any(left != right, axis=1)
        both = np.concatenate([left[:, None], right[:, None]], axis=1)
        keep = np.column_stack([steps, np.ones(len(values), bool)])
        return cls(both[keep])

    @classmethod
    def preset(cls, name: str) -> TransferFunction:
        """Return a transfer function for CT in Hounsfield units: "ct_bone", "ct_muscle" or "ct_lung".

        Its opacities suit a reference length of about a millimetre.

        Raises
        ------
        InvalidInput
            For other names.
        """
        return cls(PRESETS[choice("transfer_function", name, tuple(PRESETS))])

    @property
    def points(self) -> Floats:
        """The points, float64 (N, 5): value, r, g, b, opacity."""
        return self.native.points

    @property
    def v_min(self) -> float:
        """Value of the first point."""
        return self.native.v_min

    @property
    def v_max(self) -> float:
        """Value of the last point."""
        return self.native.v_max

    def with_least(self, least: float | None) -> TransferFunction:
        """Return the same function with another `least`, which does not count for equality."""
        made = TransferFunction.__new__(TransferFunction)
        made.native, made.least = self.native, least
        return made

    @property
    def max_opacity(self) -> float:
        """Largest opacity anywhere."""
        return self.native.max_opacity

    def at(self, values: ArrayLike) -> Floats:
        """Return r, g, b and opacity at each value: float64, the shape of `values` and one more axis of 4."""
        array = numbers("TransferFunction.at: values", values, "numbers").astype(np.float64, copy=False)
        rows = self.native.at(np.ascontiguousarray(array.ravel()))
        return rows[:, 1:].reshape(*array.shape, 4)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the points."""
        return _of_points, (self.points, self.least)

    def __eq__(self, other: object) -> bool:
        """Return whether the points are the same."""
        return np.array_equal(self.points, other.points) if isinstance(other, TransferFunction) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash of the number of points and of their range."""
        return hash((len(self.points), self.v_min, self.v_max, self.max_opacity))

    def __repr__(self) -> str:
        """Return a short description."""
        return (
            f"TransferFunction({len(self.points)} points, {self.v_min:g} to {self.v_max:g}, "
            f"opacity up to {self.max_opacity:g})"
        )


def _of_points(points: Floats, least: float | None) -> TransferFunction:
    """Return the function of what `TransferFunction.__reduce__` gave."""
    return TransferFunction(points).with_least(least)

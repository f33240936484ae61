"""The steps of a time series: files, data in memory, a time axis of an array, or what a function returns."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sheetsplat._checks import attribute, shown, suffix_of
from sheetsplat._objects import kind_of_object
from sheetsplat.describe.scene_file import SUFFIX, SceneFile
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields import Field
from sheetsplat.io.opening import time_steps
from sheetsplat.io.xarray_data import time_axis
from sheetsplat.options.film import MOST_FRAMES
from sheetsplat.scene import Scene

_WANTED = "a sequence of files or data, an array (t, k, j, i), a DataArray with a time axis, or a function"


class Steps:
    """Data by the number of the step; each is made when it is asked for, and the first one is kept."""

    def __init__(self, count: int, get: Callable[[int], Any], *, is_series: bool = True) -> None:
        self._count, self._get = count, get
        self.is_series = is_series

    @classmethod
    def of_function(cls, function: Callable[[int], Any], first: Any, count: int) -> Steps:
        """Return the steps of a function, whose first result is known."""
        return cls(count, lambda number: first if number == 0 else function(number))

    def __len__(self) -> int:
        """Return the number of steps."""
        return self._count

    def __getitem__(self, number: int) -> Any:
        """Return the data of a step."""
        return self._get(number)

    def path(self, number: int) -> Path | None:
        """Return the file of a step, absolute, where it is one; functions are not asked."""
        return None

    def options(self, number: int) -> dict[str, Any]:
        """Return the options of `sheetsplat.open` that choose a step of its file."""
        return {}


class _Listed(Steps):
    """Steps that are known beforehand."""

    def __init__(self, data: Sequence[Any], *, is_series: bool = True) -> None:
        super().__init__(len(data), data.__getitem__, is_series=is_series)

    def path(self, number: int) -> Path | None:
        one = self[number]
        return Path(os.path.abspath(one)) if isinstance(one, str | os.PathLike) else None


class _OfFile(Steps):
    """The time steps of one file, by the path and the options that choose each."""

    def __init__(self, chosen: Sequence[tuple[Path, dict[str, Any]]]) -> None:
        super().__init__(len(chosen), lambda number: chosen[number][0])
        self._chosen = chosen

    def path(self, number: int) -> Path:
        return Path(os.path.abspath(self._chosen[number][0]))

    def options(self, number: int) -> dict[str, Any]:
        return self._chosen[number][1]


def steps_of(data: Any, options: Mapping[str, Any]) -> Steps:
    """Return the steps of anything but a function; `options`: those of `sheetsplat.open` that were given."""
    if isinstance(data, str | os.PathLike) and suffix_of(data) != SUFFIX:
        chosen = time_steps(data, {name: one for name, one in options.items() if one is not None})
        if len(chosen) > 1:
            return _OfFile(chosen)
    if isinstance(data, str | os.PathLike | Field | Scene | SceneFile):
        return _Listed([data], is_series=False)
    kind = kind_of_object(data)
    if kind is not None and kind.name in ("the DataArray", "the Dataset"):
        return _of_xarray(data, options.get("scalar"))
    if kind is None and isinstance(data, list | tuple):
        if not data:
            advice = "check the pattern of names that made the list"
            raise complain("the film cannot be made", f"an empty {type(data).__name__}", "at least one step", advice)
        return _Listed(data)
    sizes = attribute(data, "ndim")
    if sizes == 4:
        array = data
        return Steps(len(array), lambda number: array[number])
    if kind is not None or isinstance(sizes, int) or callable(attribute(data, "field")):
        return _Listed([data], is_series=False)
    try:
        found = list(itertools.islice(data, MOST_FRAMES + 1))
    except Exception:  # Objects of others raise whatever they like.
        raise complain("the film cannot be made", f"{type(data).__name__}, {shown(data)}", _WANTED) from None
    if len(found) > MOST_FRAMES:
        raise complain("the film cannot be made", f"more than {MOST_FRAMES} steps", "fewer")
    return _Listed(found)


def _of_xarray(data: Any, scalar: str | None) -> Steps:
    """Return the steps along the time axis of a DataArray, or of a variable of a Dataset."""
    if not hasattr(data, "dims") or hasattr(data, "data_vars"):
        known = [name for name, one in data.data_vars.items() if one.ndim >= 3]
        chosen = scalar if scalar is not None else known[0] if len(known) == 1 else None
        if chosen not in data.data_vars:
            found = ", ".join(map(str, known)) or "no variable of three dimensions"
            raise complain(
                "the film cannot be made of the Dataset", found, "one of them", "pass " + option_ref("scalar", "...")
            )
        data = data[chosen]
    if data.ndim <= 3:
        return _Listed([data], is_series=False)
    axis = time_axis(data)
    if axis is None and data.ndim == 4:
        axis = data.dims[0]
    if axis is None:
        sizes = ", ".join(f"{name} {size}" for name, size in data.sizes.items())
        raise complain(
            "the film cannot be made of the DataArray",
            sizes,
            "a dimension named time",
            "rename one, .rename(d0='time')",
        )
    return Steps(data.sizes[axis], lambda number: data.isel({axis: number}))

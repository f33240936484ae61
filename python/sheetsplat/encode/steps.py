"""The coarsest steps of packed ellipsoids with which the field is as exact as is asked.

The mean square error of ρ is about the sum of what each column of each layer contributes, and each contribution grows
with the square of the step. Fewest bytes for one sum of errors are where a byte less costs the same error everywhere:
where each part has a share of the error in proportion to the bytes that half a step would cost. Both are measured, by
rounding one part at a time, and the whole is tried until it meets what is asked.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import number, whole
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import EllipsoidField, Field
from sheetsplat.look.decades import floor_of, logarithmic

from .columns import bits_of
from .ellipsoids import CELLS, MOST_LAYERS, Frame, Rows, Steps, columns_of, layers_of, pack, rows_of
from .sampling import Points, sample_points
from .shapes import coordinates

_PARTS = tuple(field.name for field in fields(Steps))
_ARRAYS = {"place": ("centers",), "shape": ("scales", "rotations"), "value": ("values",), "weight": ("weights",)}
# Layers, and the kernels below which there is one.
_LAYERS, _FEW = 4, 512
_ROUNDS = 2
# Steps of the first trial: places in shares of the smallest semi-axes, values in shares of their range.
_FIRST = {"place": 1.0 / 32.0, "shape": 1.0 / 256.0, "value": 1.0 / 2048.0, "weight": 1.0 / 32.0}
# Whole numbers of values and shapes stay below this; steps below the least have no float64 as their inverse.
_LARGEST_NUMBER, _LEAST_STEP = 2.0**50, 1e-290
# Sixteenths of an octave by which all steps are changed at first until the error is met, and at most.
_OCTAVE, _STRIDE, _MOST = 16, 16, 320
# Where two strides leave so much of the error, finer steps are bytes for nothing.
_NO_GAIN = 0.7


@dataclass(frozen=True)
class Packed:
    """Bytes of a field's kernels.

    Attributes
    ----------
    data
        What `unpack` reads.
    decibels
        Of ρ against the field itself at the points that steps were tried at: 20 log10(range / RMSE).
    steps
        Of each layer.
    """

    data: bytes
    decibels: float
    steps: tuple[Steps, ...]


def rows_of_field(field: EllipsoidField) -> Rows:
    """Return the arrays of a field."""
    return Rows(field.centers, field.scales, field.rotations, field.values, field.weights)


class _Seen:
    """What a field shows at points, as it is or in decades above a floor."""

    def __init__(self, field: EllipsoidField, points: list[Points], floor: float | None) -> None:
        self._floor = floor
        exact = [self._form(field).at(one.at) for one in points]
        self._exact = list(zip(exact, points, strict=True))
        found = np.concatenate(exact)
        self.range = float(np.ptp(found)) or float(np.abs(found).max(initial=0.0)) or 1.0

    def _form(self, field: EllipsoidField) -> Field:
        return field if self._floor is None else logarithmic(field, self._floor)

    def errors(self, made: EllipsoidField) -> list[float]:
        """Return the mean square errors of another field over the squared range, at each set of points."""
        form = self._form(made)
        return [
            float(points.shares @ np.square((form.at(points.at) - one) / self.range)) for one, points in self._exact
        ]


class _Trial:
    """A field, its values at points, and its layers."""

    def __init__(self, field: EllipsoidField, layers: int, points: int, seed: int) -> None:
        self.field, self.rows = field, rows_of_field(field)
        # Values of many decades are rounded by their logarithms, and measured as they are and as pictures show them.
        floor = floor_of(field) if field.value_range[0] > 0.0 else None
        self.frame = Frame.of(self.rows, logarithms=floor is not None)
        self.layers = layers_of(self.rows, layers)
        drawn = sample_points(field, points, seed)
        thinned = [one.thinned() for one in drawn]
        forms = [None] if floor is None else [None, floor]
        self.seen, self.glanced = ([_Seen(field, some, one) for one in forms] for some in (drawn, thinned))
        self.parts = [name for name in _PARTS if name != "weight" or self.rows.weights is not None]

    def errors(self, steps: list[Steps], only: tuple[int, str] | None = None) -> list[float]:
        """Return the mean square errors over the squared range, at each set of points.

        `only`: one part of one layer is rounded, all others stay exact.
        """
        changed = {name: np.array(value) for name, value in vars(self.rows).items() if value is not None}
        for layer, (chosen, own) in enumerate(zip(self.layers, steps, strict=True)):
            if only is not None and only[0] != layer:
                continue
            rounded = self._rounded(layer, own)
            for name in _PARTS if only is None else (only[1],):
                for array in _ARRAYS[name]:
                    if array in changed:
                        changed[array][chosen] = getattr(rounded, array)
        arrays = [changed.get(name) for name in ("centers", "scales", "rotations", "values", "weights")]
        made = self.field.with_rows(*arrays, value_range=self.field.value_range)  # type: ignore[arg-type]
        return [error for one in (self.seen if only is None else self.glanced) for error in one.errors(made)]

    def _columns(self, layer: int, steps: Steps) -> list[NDArray[np.int64]]:
        return columns_of(self.rows.of(self.layers[layer]), self.frame, steps)

    def _rounded(self, layer: int, steps: Steps) -> Rows:
        return rows_of(self._columns(layer, steps), self.rows.coordinates, self.frame, steps)

    def bits(self, layer: int, steps: Steps) -> dict[str, float]:
        """Return about how many bits the parts of a layer take."""
        columns = self._columns(layer, steps)
        order = np.argsort(columns[0], kind="stable")
        bits = [bits_of(column[order]) for column in columns]
        kind = self.rows.coordinates
        found = {"place": bits[0], "shape": sum(bits[1 : kind + 1]), "value": bits[kind + 1]}
        return found | ({"weight": bits[kind + 2]} if len(bits) > kind + 2 else {})

    def first(self) -> list[Steps]:
        """Return the steps of the first trial."""
        scales, made = self.rows.scales, []
        for chosen in self.layers:
            size = float(np.percentile(scales[chosen].reshape(len(chosen), -1).min(axis=1), 10))
            values = float(np.ptp(np.log(self.rows.values))) if self.frame.logarithms else self.seen[0].range
            units = {"place": size, "value": values or 1.0}
            made.append(Steps(**{name: Steps.nearest(_FIRST[name] * units.get(name, 1.0)) for name in _PARTS}))
        return made

    def allowed(self, steps: list[Steps]) -> list[Steps]:
        """Return steps whose numbers fit: places have at most 21 bits an axis, all others 50."""
        rows = self.rows
        values = np.log(rows.values) if self.frame.logarithms else rows.values
        largest = {"value": values, "shape": coordinates(rows.scales, rows.rotations)}
        limits = {name: float(np.abs(array).max()) / _LARGEST_NUMBER for name, array in largest.items()}
        limits["place"] = 1.01 * float(np.ptp(rows.centers, axis=0).max()) / CELLS
        least = {name: -Steps.nearest(1.0 / limit) for name, limit in limits.items() if limit > _LEAST_STEP}
        return [replace(own, **{name: max(getattr(own, name), n) for name, n in least.items()}) for own in steps]


def _balanced(trial: _Trial, steps: list[Steps], wanted: float) -> list[Steps]:
    """Return steps whose errors are in proportion to the bytes that smaller ones would cost."""
    slopes, errors = {}, {}
    for layer, own in enumerate(steps):
        bits, finer = (trial.bits(layer, one) for one in (own, *trial.allowed([_shifted(own, -_OCTAVE)])))
        for name in trial.parts:
            slopes[layer, name] = max(finer[name] - bits[name], 0.0)
            errors[layer, name] = sum(trial.errors(steps, (layer, name)))
    total = sum(slopes.values()) or 1.0
    found = []
    for layer, own in enumerate(steps):
        changes = {}
        for name in trial.parts:
            share, error = wanted * slopes[layer, name] / total, errors[layer, name]
            if share > 0.0 and error > 0.0:
                change = Steps.nearest(float(np.sqrt(share / error)))
                changes[name] = getattr(own, name) + int(np.clip(change, -_MOST // 4, _MOST // 4))
        found.append(replace(own, **changes))
    return found


def _shifted(steps: Steps, by: int) -> Steps:
    return Steps(**{name: getattr(steps, name) + by for name in _PARTS})


def packed(
    field: EllipsoidField, decibels: float = 70.0, *, seed: int = 0, layers: int | None = None, points: int = 50_000
) -> Packed:
    """Return the fewest bytes of a field's kernels that keep ρ, at random points, to so many decibels.

    Where rounding cannot be that fine, as with places far from their origin, the bytes of the finest steps are
    returned: `Packed.decibels` says what they reach.

    Parameters
    ----------
    field
        With at least one kernel.
    decibels
        20 log10(range of ρ / RMSE), at points of the box and at points within kernels (`sample_points`); of values of
        many decades also of their logarithms. At other points it may be a few decibels less where the field ends
        abruptly, as with a small w0.
    seed
        Of the points.
    layers
        How many, at most 16; 4 unless given, 1 of few kernels, and 1 for the normalisation "lattice".
    points
        How many of each kind.

    Raises
    ------
    InvalidInput
        For an empty field, for decibels that are no number above 0, and for other numbers of layers.
    """
    asked = number("packed: decibels", decibels)
    if not 0.0 < asked <= 300.0:
        raise complain(unusable("packed: decibels"), f"{asked:g}", "a number above 0, at most 300")
    if layers is not None and not 1 <= whole("packed: layers", layers) <= MOST_LAYERS:
        raise complain(unusable("packed: layers"), str(layers), f"1 to {MOST_LAYERS}")
    if not field.size:
        raise complain("ellipsoids cannot be packed", "a field without kernels", "at least one")
    # (Kernels of "lattice" have one volume, and so one step.)
    most = 1 if field.normalization == "lattice" else layers or (_LAYERS if field.size >= _FEW else 1)
    trial = _Trial(field, min(most, field.size), points, seed)
    wanted = float(10.0 ** (-asked / 10.0))
    steps = trial.allowed(trial.first())
    for _ in range(_ROUNDS):
        steps = trial.allowed(_balanced(trial, steps, wanted))
    # The largest common change with which the error is met: by strides, then by halves.
    tried: dict[int, float] = {}

    def error(by: int) -> float:
        if by not in tried:
            tried[by] = max(trial.errors(trial.allowed([_shifted(own, by) for own in steps])))
        return tried[by]

    by = 0
    while error(by) > wanted and by > -_MOST and not error(by) > _NO_GAIN * error(by + 2 * _STRIDE):
        by -= _STRIDE
    while error(by + _STRIDE) <= wanted and by < _MOST:
        by += _STRIDE
    stride = _STRIDE // 2
    while stride:
        by += stride if error(by + stride) <= wanted else 0
        stride //= 2
    found = tuple(trial.allowed([_shifted(own, by) for own in steps]))
    reached = -10.0 * float(np.log10(max(error(by), 1e-30)))
    return Packed(pack(trial.rows, found, logarithms=trial.frame.logarithms), reached, found)

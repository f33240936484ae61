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
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import frames

from .columns import bits_of
from .ellipsoids import CELLS, MOST_LAYERS, Rows, Steps, columns_of, layers_of, origin_of, pack, rows_of
from .shapes import Floats, coordinates

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
# Times that points in the whole box are drawn until as many lie where they count.
_DRAWS, _RARE = 16, 1000
# Share of the usual sum of weights.
_USUAL = 0.01
# One point of so many is enough to see what a part contributes.
_THINNED = 4


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


@dataclass(frozen=True, eq=False)
class Points:
    """Points at which errors are measured, and how much each counts: world positions (M, 3), and shares of 1 (M,)."""

    at: Floats
    shares: Floats

    @staticmethod
    def of(at: Floats, weights: Floats) -> Points:
        """Return points by weights of any sum."""
        return Points(at, weights / weights.sum())

    def thinned(self) -> Points:
        """Return some of the points."""
        return Points.of(self.at[::_THINNED], self.shares[::_THINNED])


def sample_points(field: EllipsoidField, count: int, seed: int) -> list[Points]:
    """Return two sets of points: random ones within kernels, and random ones in the whole box.

    Where values are divided by weights, points count where the sum of weights is above w0, or above a share of what it
    usually is, if that is less: in the sliver below, at the rim of the outermost kernels, the scalar jumps to the base
    and would hide all other errors. Of the second set points just inside the rim, where errors are rare and large, are
    drawn more densely than others. The set is left out where points that count are rare.
    """
    random = np.random.default_rng(seed)
    low, high = np.array(field.bounds)
    chosen = random.integers(0, field.size, count)
    within = random.normal(size=(count, 3))
    within *= (random.random(count) ** (1.0 / 3.0) / np.linalg.norm(within, axis=1))[:, None]
    within *= field.scales[chosen, None] if field.scales.ndim == 1 else field.scales[chosen]
    if field.rotations is not None:
        within = np.einsum("nij,nj->ni", frames(field.rotations[chosen]), within)
    within += field.centers[chosen]
    sums = field.weight_at(within)
    least = min(field.w0, _USUAL * float(np.median(sums))) if field.normalization == "threshold" else 0.0
    near = within[sums > least]
    found = []
    inner, draws = 0, 0
    for draw in range(1, _DRAWS + 1):
        points = low + (high - low) * random.random((count, 3))
        sums = field.weight_at(points)
        counted = (sums > least) & ((sums < 2.0 * least) | (inner < count))
        rim = sums[counted] < 2.0 * least
        found.append((points[counted], rim))
        if inner < count:
            inner, draws = inner + int((~rim).sum()), draw
    every, rims = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    box = Points.of(every, np.where(rims, draws / _DRAWS, 1.0)) if len(every) > min(count, _RARE) else None
    return [one for one in (Points.of(near, np.ones(len(near))) if len(near) else None, box) if one is not None]


class _Trial:
    """A field, its values at points, and its layers."""

    def __init__(self, field: EllipsoidField, layers: int, points: int, seed: int) -> None:
        self.field, self.rows = field, rows_of_field(field)
        self.origin, self.layers = origin_of(self.rows), layers_of(self.rows, layers)
        drawn = sample_points(field, points, seed)
        self.exact = [(field.at(one.at), one) for one in drawn]
        found = np.concatenate([exact for exact, _ in self.exact])
        self.range = float(np.ptp(found)) or float(np.abs(found).max(initial=0.0)) or 1.0
        thinned = [one.thinned() for one in drawn]
        self.thinned = [(field.at(one.at), one) for one in thinned]
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
        pairs = self.exact if only is None else self.thinned
        return [float(points.shares @ np.square((made.at(points.at) - exact) / self.range)) for exact, points in pairs]

    def _columns(self, layer: int, steps: Steps) -> list[NDArray[np.int64]]:
        return columns_of(self.rows.of(self.layers[layer]), self.origin, steps)

    def _rounded(self, layer: int, steps: Steps) -> Rows:
        return rows_of(self._columns(layer, steps), self.rows.coordinates, self.origin, steps)

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
            units = {"place": size, "value": self.range}
            made.append(Steps(**{name: Steps.nearest(_FIRST[name] * units.get(name, 1.0)) for name in _PARTS}))
        return made

    def allowed(self, steps: list[Steps]) -> list[Steps]:
        """Return steps whose numbers fit: places have at most 21 bits an axis, all others 50."""
        rows = self.rows
        largest = {"value": rows.values, "shape": coordinates(rows.scales, rows.rotations)}
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
        20 log10(range of ρ / RMSE), at points of the box and at points within kernels.
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
    while error(by) > wanted and by > -_MOST:
        by -= _STRIDE
    while error(by + _STRIDE) <= wanted and by < _MOST:
        by += _STRIDE
    stride = _STRIDE // 2
    while stride:
        by += stride if error(by + stride) <= wanted else 0
        stride //= 2
    found = tuple(trial.allowed([_shifted(own, by) for own in steps]))
    reached = -10.0 * float(np.log10(max(error(by), 1e-30)))
    return Packed(pack(trial.rows, found), reached, found)

"""Resampling of Cartesian volumes to the body-centred cubic (BCC) lattice.

A BCC lattice of edge ``a`` is two cubic lattices of edge ``a``, the second in the middles of the first's cubes, so each
sample stands for a^3 / 2. Signals whose spectrum ends at a sphere need only 1/sqrt(2) of the samples of a Cartesian
lattice of distance ``h`` there (Theussl, Moeller & Groeller 2001): a^3 / 2 = sqrt(2) h^3, that is a = sqrt(2) h. So
256^3 becomes 181 x 181 x 362 (x, y, z), as in Neophytou & Mueller 2005, table 1.

Every layer of a BCC lattice is a square grid, so resampling is three products with small matrices, layer by layer.
Before that, frequencies that the new lattice cannot represent are removed from the cosine spectrum: its pass band, a
rhombic dodecahedron, cuts the corners off that of the old lattice, a cube; frequencies left there would alias.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory
from sheetsplat._checks import as_array, attribute, choice, optional_number, shown, triple, truth
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import RegularField

Vector = tuple[float, float, float]

#: Interpolation methods; the first is the default of `resample_to_bcc`.
METHODS = ("quintic", "cubic", "fourier", "linear", "nearest")
_DEGREES = {"quintic": 5, "cubic": 3, "linear": 1, "nearest": 0}
# Half the width of the edge of the pass band, relative to the band. Narrower edges ring, wider ones blur.
_ROLL_OFF = 0.12
# Values computed at once, in bytes of float32.
_CHUNK_BYTES = 16 << 20
# Beyond this many of a volume's longest edge, a cell of a lattice has no sample of the volume.
_LARGEST_CELL = 100.0


class LatticeSamples(Protocol):
    """Samples with their positions: a field or a data set. Attributes as those of `sheetsplat.RegularField`."""

    @property
    def values(self) -> NDArray[Any]: ...  # noqa: D102
    @property
    def spacing(self) -> Vector: ...  # noqa: D102
    @property
    def origin(self) -> Vector: ...  # noqa: D102
    @property
    def lattice(self) -> str: ...  # noqa: D102


@dataclass(frozen=True)
class BccLattice:
    """Where the samples of a BCC lattice are.

    Sample (i, j, k) is at ``origin + ((i + h) a, (j + h) a, k a / 2)``, h being 1/2 in odd layers k and 0 in even ones.

    Attributes
    ----------
    shape
        Number of samples along k, j, i.
    a
        Edge of the cubes.
    origin
        World position of sample (0, 0, 0).
    """

    shape: tuple[int, int, int]
    a: float
    origin: Vector

    @classmethod
    def matching(
        cls,
        shape: Sequence[int],
        spacing: Sequence[float],
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        a: float | None = None,
    ) -> BccLattice:
        """Return the lattice of equal quality for a Cartesian volume, with the same centre.

        Parameters
        ----------
        shape
            Samples of the volume along k, j, i.
        spacing
            Its distances along x, y, z; positive.
        origin
            World position of its sample (0, 0, 0).
        a
            Edge of the new lattice; sqrt(2) times the cube root of the volume per sample unless given, so that
            1/sqrt(2) of the samples remain whatever the spacing is.
        """
        failed = "the BCC lattice cannot be laid out"
        if len(shape) != 3 or min(shape) < 1:
            raise complain(failed, f"a volume of shape {tuple(shape)}", "three numbers of samples, each at least 1")
        if len(spacing) != 3 or not all(math.isfinite(d) and d > 0.0 for d in spacing):
            raise complain(failed, f"spacing {tuple(spacing)}", "three positive, finite numbers")
        if len(origin) != 3 or not all(math.isfinite(o) for o in origin):
            raise complain(failed, f"origin {tuple(origin)}", "three finite numbers")
        if a is None:
            a = math.sqrt(2.0) * math.prod(spacing) ** (1.0 / 3.0)
        if not (math.isfinite(a) and a > 0.0):
            raise complain(failed, f"an edge a of {a}", "a positive, finite number")
        filled = [count * distance / a for count, distance in zip(shape[::-1], spacing, strict=True)]
        if not math.prod(max(1.0, f) for f in filled) < 2.0**40:
            raise complain(failed, f"{math.prod(filled):.3g} cubes", f"at most {2**40}", "give a larger edge a")
        # Per axis x, y, z: as many cubes as fill the samples' boxes, which reach half a distance beyond the outer
        # samples.
        cubes = [max(1, round(f)) for f in filled]
        # A row of cubes with both its layers is (cubes - 1/2) a long; it is centred.
        start = [
            o + 0.5 * (count - 1) * distance - 0.5 * (number - 0.5) * a
            for o, count, distance, number in zip(origin, shape[::-1], spacing, cubes, strict=True)
        ]
        return cls((2 * cubes[2], cubes[1], cubes[0]), a, (start[0], start[1], start[2]))

    @property
    def sample_distance(self) -> float:
        """The Cartesian distance of equal quality, a / sqrt(2)."""
        return self.a / math.sqrt(2.0)

    def layer(self, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """World coordinates of layer `k`: those of its columns (x), of its rows (y), and its z."""
        half = 0.5 * (k % 2)
        x = self.origin[0] + (np.arange(self.shape[2], dtype=np.float64) + half) * self.a
        y = self.origin[1] + (np.arange(self.shape[1], dtype=np.float64) + half) * self.a
        return x, y, self.origin[2] + 0.5 * k * self.a


@dataclass(frozen=True, eq=False)
class BccVolume:
    """A volume on a BCC lattice.

    Attributes
    ----------
    values
        Samples, indexed ``[k, j, i]``.
    lattice
        Where they are.
    """

    values: NDArray[Any]
    lattice: BccLattice

    @property
    def spacing(self) -> Vector:
        """Three times a, as :class:`sheetsplat.RegularField` takes it."""
        return (self.lattice.a,) * 3

    @property
    def origin(self) -> Vector:
        """World position of sample (0, 0, 0)."""
        return self.lattice.origin

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """World-aligned box around all supports, as :attr:`sheetsplat.RegularField.bounds`."""
        return self.field().bounds

    def __repr__(self) -> str:
        """Return a short description."""
        nk, nj, ni = self.values.shape
        return f"BccVolume({ni} x {nj} x {nk} {self.values.dtype.name}, a {self.lattice.a:g}, origin {self.origin})"

    def field(self, **options: Any) -> RegularField:
        """Return the volume as a field of kernels; `options` are those of :class:`sheetsplat.RegularField`."""
        arguments: dict[str, Any] = {"spacing": self.spacing, "origin": self.origin, "lattice": "bcc"}
        return RegularField(self.values, **{**arguments, **options})


def resample_to_bcc(
    values: ArrayLike | LatticeSamples,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    *,
    a: float | None = None,
    method: str = "quintic",
    band_limit: bool = True,
    dtype: Any = None,
) -> BccVolume:
    """Return a Cartesian volume on the BCC lattice of equal quality, with 1/sqrt(2) of its samples.

    The volume is continued beyond its border by mirroring, the mirror half a sample outside. Arithmetic is float32;
    beside the volume and the result about twice the volume in float32 is needed at a time.

    Parameters
    ----------
    values
        Samples, indexed ``[k, j, i]``, real and finite; or a Cartesian field or data set, which has the next two.
    spacing
        World units between samples along x, y, z, 1 unless given. They may differ: the result has equal distances.
    origin
        World position of sample (0, 0, 0), which is there unless given.
    a
        Edge of the BCC lattice, if another one is wanted (see :meth:`BccLattice.matching`).
    method
        ``"quintic"`` or ``"cubic"``: interpolating B-splines of that degree. ``"fourier"``: all waves of the volume,
        exact for what it can hold, but a sharp edge rings far. ``"linear"``; ``"nearest"`` (a means of comparison).
    band_limit
        Remove the frequencies that the new lattice cannot represent; not for ``"linear"`` and ``"nearest"``.
    dtype
        Type of the result; that of `values` unless given. Whole numbers are rounded and kept within the type's range.

    Returns
    -------
    BccVolume
        With ``field()`` for drawing.

    Examples
    --------
    >>> bcc = ss.resample_to_bcc(np.random.default_rng(1).random((16, 16, 16)))
    >>> bcc.field().lattice
    'bcc'
    """
    failed = "the volume cannot be resampled to a BCC lattice"
    if all(attribute(values, name) is not None for name in ("values", "spacing", "origin", "lattice")):
        placed = cast(LatticeSamples, values)
        if placed.lattice != "cartesian":
            raise complain(failed, f"a volume on the lattice {shown(placed.lattice)}", "one on a Cartesian lattice")
        if attribute(values, "axes") is not None:
            raise complain(failed, "a volume with axes of its own", "one whose axes are the world's")
        spacing = placed.spacing if spacing is None else spacing
        origin = placed.origin if origin is None else origin
        values = placed.values
    spacing = (1.0, 1.0, 1.0) if spacing is None else triple("resample_to_bcc: spacing", spacing)
    origin = (0.0, 0.0, 0.0) if origin is None else triple("resample_to_bcc: origin", origin)
    a = optional_number("resample_to_bcc: a", a)
    samples = as_array(failed, values, "samples along k, j and i")
    if samples.ndim != 3 or samples.size == 0:
        raise complain(failed, f"shape {samples.shape}", "samples along k, j and i, at least one along each")
    if samples.dtype.kind not in "buif":
        raise complain(failed, f"samples of type {samples.dtype}", "real numbers")
    choice("resample_to_bcc: method", method, METHODS)
    truth("resample_to_bcc: band_limit", band_limit)
    own = np.dtype(np.uint8) if samples.dtype.kind == "b" else samples.dtype
    try:
        wanted = own if dtype is None else np.dtype(dtype)
    except Exception:  # Objects of others raise whatever they like.
        raise complain(failed, f"a result of type {shown(dtype)}", "whole or floating-point numbers") from None
    if wanted.kind not in "uif":
        raise complain(failed, f"a result of type {wanted}", "whole or floating-point numbers")
    lattice = BccLattice.matching(samples.shape, spacing, origin, a)
    largest = max(count * step for count, step in zip(reversed(samples.shape), spacing, strict=True))
    if lattice.a > _LARGEST_CELL * largest:
        wanted_a = f"at most {_LARGEST_CELL:g} times the volume's longest edge, {largest:g}"
        raise complain(unusable("resample_to_bcc: a"), f"{lattice.a:g}", wanted_a)
    _memory.require(2 * samples.size * np.dtype(np.float32).itemsize, "the volume on a BCC lattice")

    weights = [_matrix(method, samples.shape[2 - c], _positions(lattice, c, spacing, origin)) for c in range(3)]
    # Values are filtered relative to the middle of their range, so that float32 loses nothing of a large offset.
    middle = 0.5 * float(samples.min()) + 0.5 * float(samples.max())
    coefficients = _coefficients(samples, middle, method, band_limit, lattice, spacing)
    result = np.empty(lattice.shape, wanted)
    for parity in (0, 1):
        columns, rows = weights[0][parity], weights[1][parity]
        for layers, depth in _chunks(weights[2][0][parity::2], parity, samples.shape):
            made = _along(1, rows, _along(2, columns, _along(0, depth, coefficients)))
            result[layers] = _as_type(made, middle, wanted)
    return BccVolume(result, lattice)


def _positions(
    lattice: BccLattice, axis: int, spacing: Sequence[float], origin: Sequence[float]
) -> list[NDArray[np.float64]]:
    """Where the new samples are along an axis (0: x), in old samples: for even and odd layers; z: for all layers."""
    first = (lattice.origin[axis] - origin[axis]) / spacing[axis]
    step = lattice.a / spacing[axis]
    count = lattice.shape[2 - axis]
    if axis == 2:
        return [first + 0.5 * step * np.arange(count, dtype=np.float64)]
    return [first + step * (np.arange(count, dtype=np.float64) + half) for half in (0.0, 0.5)]


def _matrix(method: str, count: int, positions: list[NDArray[np.float64]]) -> list[Any]:
    """Return the weights of `count` coefficients at positions, (positions, count) each; most of splines are 0."""
    if method == "fourier":
        wanted = sum(map(len, positions)) * count * np.dtype(np.float32).itemsize
        _memory.require(2 * wanted, f"the waves along an axis of {count} samples")
        waves = np.pi / count * np.arange(count)
        return [np.cos((p[:, None] + 0.5) * waves).astype(np.float32) for p in positions]
    return [_spline_matrix(_DEGREES[method], count, p) for p in positions]


def _spline_matrix(degree: int, count: int, positions: NDArray[np.float64]) -> Any:
    """Return the weights of `count` coefficients, mirrored beyond the border, at each position."""
    from scipy import sparse  # type: ignore[import-untyped]

    first = np.floor(positions - 0.5 * (degree - 1)).astype(np.int64)
    index = first + np.arange(degree + 1)[:, None]
    weights = _b_spline(degree, positions - index)
    folded = index % (2 * count)
    places = np.broadcast_to(np.arange(len(positions)), index.shape), np.minimum(folded, 2 * count - 1 - folded)
    found = sparse.coo_array((weights.ravel(), tuple(map(np.ravel, places))), (len(positions), count))
    return found.tocsr().astype(np.float32)


def _along(axis: int, matrix: Any, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the product of a matrix with an array along one of its axes."""
    first = np.moveaxis(values, axis, 0)
    made = matrix @ first.reshape(len(first), -1)
    return np.asarray(np.moveaxis(made.reshape(-1, *first.shape[1:]), 0, axis))


def _b_spline(degree: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the central B-spline of a degree (de Boor's recursion on the half-open support)."""
    if degree == 0:
        return np.asarray(((x >= -0.5) & (x < 0.5)).astype(np.float64))
    middle = 0.5 * (degree + 1)
    left = (middle + x) * _b_spline(degree - 1, x + 0.5)
    right = (middle - x) * _b_spline(degree - 1, x - 0.5)
    return np.asarray((left + right) / degree)


def _coefficients(
    samples: NDArray[Any],
    middle: float,
    method: str,
    band_limit: bool,
    lattice: BccLattice,
    spacing: Sequence[float],
) -> NDArray[np.float32]:
    """Return what the matrices are applied to: samples, spline coefficients or cosine amplitudes, float32."""
    single = np.empty(samples.shape, np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(samples)):
            single[k] = np.subtract(samples[k], middle, dtype=np.float64)
    if not np.isfinite(single).all():
        raise complain(
            "the volume cannot be resampled to a BCC lattice",
            "samples that are not finite in float32",
            "finite samples",
            "replace them first, for example with numpy.nan_to_num",
        )
    if method in ("linear", "nearest"):
        return single
    from scipy import fft

    spectrum: NDArray[np.float32] = fft.dctn(single, type=2, overwrite_x=True)
    del single
    # Waves per world unit, times pi: their phase over one old sample is waves * spacing.
    waves = [np.pi * np.arange(n) / (n * d) for n, d in zip(samples.shape, spacing[::-1], strict=True)]
    gains = [np.ones(n) for n in samples.shape]
    if method == "fourier":
        # dctn sums 2 s cos(...): undo it here, since the inverse is summed by the matrices.
        for gain in gains:
            gain /= len(gain)
            gain[0] *= 0.5
    else:
        offsets = np.arange(-(_DEGREES[method] // 2), _DEGREES[method] // 2 + 1)
        taps = _b_spline(_DEGREES[method], offsets.astype(np.float64))
        for axis, distance in enumerate(spacing[::-1]):
            gains[axis] /= (taps * np.cos(offsets * (waves[axis] * distance)[:, None])).sum(axis=1)
    plane = (gains[1][:, None] * gains[2]).astype(np.float32)
    for k in range(len(spectrum)):
        spectrum[k] *= plane * np.float32(gains[0][k])
        if band_limit:
            spectrum[k] *= _pass_band(waves[0][k], waves[1][:, None], waves[2][None, :], lattice.a)
    if method == "fourier":
        return spectrum
    return np.asarray(fft.idctn(spectrum, type=2, overwrite_x=True))


def _pass_band(z: float, y: NDArray[np.float64], x: NDArray[np.float64], a: float) -> NDArray[np.float32]:
    """Return 1 inside the rhombic dodecahedron of a BCC lattice's frequencies, 0 outside, a smooth step at its faces.

    Its faces are |x| + |y| = 2 pi / a and likewise for the other pairs. All frequencies are at least 0.
    """
    largest = np.maximum(np.maximum(x, y), z)
    second = x + y + z - largest - np.minimum(np.minimum(x, y), z)
    share = (largest + second) * (a / (2.0 * np.pi))
    ramp = np.clip((share - (1.0 - _ROLL_OFF)) / (2.0 * _ROLL_OFF), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * ramp), dtype=np.float32)


def _chunks(depth: Any, parity: int, shape: tuple[int, ...]) -> Iterator[tuple[slice, Any]]:
    """Yield groups of layers of one parity: which layers of the result, and their weights."""
    step = max(1, _CHUNK_BYTES // (4 * shape[1] * shape[2]))
    for start in range(0, depth.shape[0], step):
        part = depth[start : start + step]
        yield slice(parity + 2 * start, parity + 2 * (start + part.shape[0]), 2), part


def _as_type(values: NDArray[np.float32], middle: float, dtype: np.dtype[Any]) -> NDArray[Any]:
    # float32 holds neither the limits nor all values of wide types.
    made = values.astype(np.float64) + middle if dtype.itemsize > 2 else values + np.float32(middle)
    if dtype.kind == "f":
        return np.asarray(made.astype(dtype))
    limits = np.iinfo(dtype)
    return np.asarray(np.clip(np.rint(made), limits.min, limits.max).astype(dtype))


__all__ = ["METHODS", "BccLattice", "BccVolume", "resample_to_bcc"]

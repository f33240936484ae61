"""Volumes whose samples are no values: labels, which name things, and colours. Conventions, section 4."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.errors import complain, option_ref
from sheetsplat.notices import warn

#: Most labels that are told apart in one field.
MOST_LABELS = 256
# Layers, and samples of a label, that are looked at together; what stands for a sample that is missing is no label.
_LAYERS, _AT_ONCE, _MISSING = 16, 1000, 60


def require_labels(values: NDArray[Any], **options: Any) -> None:
    """Raise InvalidInput for samples that are no labels, and for options that mix them."""
    if values.dtype.kind == "f" and not np.array_equal(values, np.round(values), equal_nan=True):
        wrong = values[values != np.round(values)]
        found = f"{float(wrong[~np.isnan(wrong)][0]):g}"
        raise complain("RegularField: labels cannot be used", found, "whole numbers", "leave out labels=True")
    for name, (value, plain) in options.items():
        if value != plain:
            raise complain(
                "RegularField: labels cannot be used",
                option_ref(name, str(value).lower() if isinstance(value, bool) else str(value)),
                f"{name} as it is unless given: labels are not added up",
                "leave it out",
                option=name,
            )


def counts_of_labels(values: NDArray[Any]) -> dict[int, int]:
    """Return how many samples each label has, from the least label on."""
    if values.dtype.kind in "ui" and values.dtype.itemsize <= 2:
        least = int(np.iinfo(values.dtype).min)
        table = np.zeros(2 ** (8 * values.dtype.itemsize), np.int64)
        for layer in values:
            table += np.bincount(layer.ravel().astype(np.int64) - least, minlength=len(table))
        ranks = np.flatnonzero(table)
        found, counts = ranks + least, table[ranks]
    else:
        _memory.require(2 * values.nbytes, "the labels of a volume")
        known = values[~np.isnan(values)] if values.dtype.kind == "f" else values
        found, counts = np.unique(known, return_counts=True)
    return {int(one): int(count) for one, count in zip(found, counts, strict=True)}


def labels_in(values: NDArray[Any]) -> tuple[int, ...]:
    """Return the labels among samples, from the least one on. InvalidInput for more than are told apart."""
    return told_apart(counts_of_labels(values))


def told_apart(labels: Iterable[int]) -> tuple[int, ...]:
    """Return labels, or raise InvalidInput for more than are told apart."""
    found = tuple(labels)
    if len(found) > MOST_LABELS:
        raise complain(
            "labels cannot be told apart",
            f"{len(found)} labels",
            f"at most {MOST_LABELS}",
            "merge labels, cut out a part of the volume, or pass " + option_ref("labels", "false"),
            option="labels",
        )
    return found


def nowhere_largest(
    values: NDArray[Any], labels: Iterable[int], radius: float, falloff: float, *, mirrored: bool
) -> tuple[int, ...]:
    """Return which labels weigh, at none of their samples, more than each other label there: they are not seen.

    Labels with four samples in a square are none of them; others are looked at sample by sample.

    Parameters
    ----------
    values
        The samples, [k, j, i].
    labels
        Those that are looked at.
    radius, falloff
        Of the kernel, in sample distances.
    mirrored
        Whether samples are mirrored beyond the outermost ones, as where a volume has a domain.
    """
    left = set(labels)
    for first in range(0, len(values), _LAYERS):
        slab = values[first : first + _LAYERS + 1]
        if slab.dtype.kind == "f":
            slab = np.nan_to_num(slab, nan=2.0**_MISSING).astype(np.int64)
        for axis in range(3):
            if left:
                found = _squares(np.moveaxis(slab, axis, 0))
                left -= set(np.unique(found[np.isin(found, np.array(sorted(left)))]).tolist())
    kernel = _kernel(radius, falloff)
    return tuple(one for one in sorted(left) if not _is_seen(values, one, kernel, mirrored=mirrored))


def _squares(layers: NDArray[Any]) -> NDArray[Any]:
    """Return the label of each square of four samples of one label in layers."""
    corner, *others = (layers[:, j : j - 1 or None, i : i - 1 or None] for j in (0, 1) for i in (0, 1))
    solid = corner == others[0]
    for one in others[1:]:
        solid &= corner == one
    found: NDArray[Any] = corner[solid]
    return found


def _kernel(radius: float, falloff: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the steps from a sample to those whose kernels reach it, (N, 3), and their weights, (N,)."""
    reach = math.ceil(radius)
    steps = np.mgrid[3 * (slice(-reach, reach + 1),)].reshape(3, -1).T
    squares = (steps**2).sum(axis=1) / radius**2
    near = squares < 1.0
    return steps[near], np.exp(-falloff * squares[near]) - math.exp(-falloff)


def _is_seen(
    values: NDArray[Any], label: int, kernel: tuple[NDArray[np.int64], NDArray[np.float64]], *, mirrored: bool
) -> bool:
    """Return whether a label weighs more than each other one at some sample of its own."""
    steps, weights = kernel
    reach = int(steps.max(initial=0))
    places = [np.pad(np.arange(count), reach, mode="reflect") for count in values.shape]
    at = np.argwhere(values == label)
    for first in range(0, len(at), _AT_ONCE):
        near = at[first : first + _AT_ONCE, None] + steps
        around = values[tuple(place[near[..., axis] + reach] for axis, place in enumerate(places))]
        counted = weights if mirrored else weights * ((near >= 0) & (near < values.shape)).all(axis=2)
        own = ((around == label) * counted).sum(axis=1)
        others = [one for one in np.unique(around).tolist() if one != label and not math.isnan(one)]
        largest = [((around == one) * counted).sum(axis=1) for one in others]
        if (own > np.max(largest, axis=0, initial=0.0)).any():
            return True
    return False


def split_colors(values: Any) -> tuple[Any, NDArray[Any] | None]:
    """Return the scalars of samples of colours, float32, and the colours; of anything else itself, and None.

    Raises
    ------
    InvalidInput
        For colours beyond 0 to 1.
    OutOfMemory
        Where the scalars do not fit.
    """
    if not isinstance(values, np.ndarray) or values.ndim != 4 or values.shape[-1] not in (3, 4) or not values.size:
        return values, None
    integers = values.dtype in (np.uint8, np.uint16)
    low, high = values.min(), values.max()
    if not integers and not (values.dtype.kind == "f" and low >= 0.0 and high <= 1.0):
        finite = bool(np.isfinite(low) and np.isfinite(high))
        found = f"from {low:g} to {high:g}" if finite else "some of them not finite"
        raise complain(
            "RegularField: colours cannot be used",
            f"{values.shape[-1]} components of type {values.dtype}, {found}",
            "uint8, uint16, or numbers from 0 to 1",
            "choose one component, or " + ("divide by the largest" if finite else "replace them by 0"),
        )
    _memory.require(4 * values[..., 0].size * 2, "the opacities of colours")
    full = float(np.iinfo(values.dtype).max) if integers else 1.0
    shares = (0.0, 0.0, 0.0, 1.0) if values.shape[-1] == 4 else _LUMINANCE
    scalars = np.zeros(values.shape[:3], np.float32)
    for channel, share in enumerate(shares):
        if share:
            scalars += np.float32(share / full) * values[..., channel].astype(np.float32)
    colors = np.array(values[..., :3])
    colors.flags.writeable = False
    return scalars, colors


# Of linear red, green and blue.
_LUMINANCE = (0.2126, 0.7152, 0.0722)


def with_labels(values: Any, options: Mapping[str, Any], *, stated: bool = False) -> dict[str, Any]:
    """Return options of a volume that say whether its samples are labels, where nobody said.

    They are where their file states it, or where they look like that.
    """
    given = {name: one for name, one in options.items() if name != "labels" or one is not None}
    open_ = is_open(given)
    samples = isinstance(values, np.ndarray) and values.ndim == 3 and values.size > 0 and values.dtype.kind in "iuf"
    if open_ and samples and stated and values.dtype.kind == "f" and not np.array_equal(values, np.round(values)):
        warn_of_halves()
        stated = open_ = False
    return {**given, "labels": True} if open_ and samples and (stated or look_like_labels(values)) else given


def is_open(options: Mapping[str, Any]) -> bool:
    """Return whether options of a volume that were given leave it open whether samples are labels."""
    return not options.keys() & {"labels", "normalization", "w0", "prefilter", "base", "radius", "falloff"}


def warn_of_halves() -> None:
    """Warn of a file that states labels and has other numbers."""
    warn("the file states labels, but has numbers that are not whole: they are shown as values")


class Looks(NamedTuple):
    """How whole numbers lie in a volume, as far as some layers of it show.

    Attributes
    ----------
    numbers
        Which there are; none where samples are no whole numbers, or too many.
    regions
        Whether they are regions of one number each.
    jumps
        Whether beside regions lie others that are not the next ones.
    """

    numbers: tuple[int, ...] = ()
    regions: bool = False
    jumps: bool = False


def look_like_labels(values: NDArray[Any]) -> bool:
    """Return whether samples are labels by all that can be seen: few whole numbers between which there is nothing.

    These are regions of one number each, beside which others lie that are not the next ones: what is measured goes
    through the numbers between.
    """
    looks = looks_of(values)
    return len(looks.numbers) >= _LEAST_KINDS and looks.regions and looks.jumps


def looks_of(values: NDArray[Any]) -> Looks:
    """Return how the whole numbers of a volume lie, of its shape (nk, nj, ni)."""
    seen = values[:: -(-values.shape[0] // _LAYERS)]
    # (Most volumes show in one layer that they are none.)
    ranks: NDArray[np.int64]
    counts: NDArray[np.int64]
    least = 0
    for part in (seen[len(seen) // 2], seen):
        whole = part.dtype.kind in "ui" or (bool(np.isfinite(part).all()) and np.array_equal(part, np.round(part)))
        if not whole or max(abs(float(part.max())), abs(float(part.min()))) > _WIDEST:
            return Looks()
        least = int(part.min())
        ranks = part.astype(np.int64) - least
        if int(ranks.max()) > _WIDEST_TABLE:
            return Looks()
        counts = np.bincount(ranks.ravel())
        if np.count_nonzero(counts) > _MOST_KINDS:
            return Looks()
    numbers = tuple((np.flatnonzero(counts) + least).tolist())
    in_order: NDArray[np.int64] = np.cumsum((counts > 0).astype(np.int64))[ranks]
    # What has the most frequent number is taken for what is around things.
    inside: NDArray[np.bool_] = ranks != int(counts.argmax())
    pairs = [_pairs(in_order, inside, axis) for axis in (1, 2)]
    steps, beside = (np.concatenate(one) for one in zip(*pairs, strict=True))
    borders = steps[beside] > 0
    if not borders.any():
        return Looks(numbers)
    regions = bool(borders.mean() <= _MOST_BORDERS)
    return Looks(numbers, regions, bool((steps > 1).sum() >= _LEAST_JUMPS * (steps > 0).sum()))


def _pairs(numbers: NDArray[np.int64], inside: NDArray[np.bool_], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return how far neighbours along an axis differ, and whether one of them is inside."""
    rest, most = np.arange(1, numbers.shape[axis]), np.arange(numbers.shape[axis] - 1)
    beside = np.take(inside, rest, axis) | np.take(inside, most, axis)
    return np.abs(np.diff(numbers, axis=axis)).ravel(), beside.ravel()


# Layers of a volume that are looked at; few and many labels; what float64 and a table hold.
_LAYERS = 16
_LEAST_KINDS, _MOST_KINDS = 3, 64
_WIDEST, _WIDEST_TABLE = 2.0**53, 2**20
# Of neighbours in things or beside them, the share that differ; of these the share with a number between them.
_MOST_BORDERS, _LEAST_JUMPS = 0.5, 0.2

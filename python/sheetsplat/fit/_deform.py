"""Free-form deformation (Sederberg & Parry 1986) of kernels by a lattice of control points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import shown, triple
from sheetsplat.errors import complain, option_ref, unusable

from ._kernels import Floats, Kernels, quaternions, require_kernels
from ._points import count_of, numbers, shown_place

_WHAT = "fit.free_form_deformation"
_MOST = 64
_CHUNK = 1 << 14


def _knots(count: int, degree: int) -> Floats:
    inside = np.linspace(0.0, 1.0, count - degree + 1)
    return np.concatenate([np.zeros(degree), inside, np.ones(degree)])


def _degrees(shape: Sequence[int], degree: int | None) -> tuple[int, ...]:
    if degree is None:
        return tuple(count - 1 for count in shape)
    wanted = count_of(_WHAT, "degree", degree, 1, _MOST)
    return tuple(min(wanted, count - 1) for count in shape)


def _box(box: object, what: str) -> tuple[Floats, Floats]:
    try:
        given = list(box)  # type: ignore[call-overload]
    except TypeError:
        given = []
    if isinstance(box, str) or len(given) != 2:
        raise complain(unusable(f"{what}: box"), shown(box), "two corners, ((x0, y0, z0), (x1, y1, z1))")
    lower, upper = (np.array(triple(f"{what}: box", corner)) for corner in given)
    if not (np.isfinite(lower).all() and np.isfinite(upper).all() and (lower < upper).all()):
        raise complain(unusable(f"{what}: box"), shown(box), "a lower and an upper corner with room between them")
    return lower, upper


def control_lattice(box: object, shape: Sequence[int], *, degree: int | None = None) -> Floats:
    """Return the control points of the identity, (l, m, n, 3).

    Parameters
    ----------
    box
        Lower and upper corner, world units.
    shape
        Numbers of control points along x, y, z, each from 2 to 64.
    degree
        As for :func:`free_form_deformation`; positions of control points depend on it.

    Examples
    --------
    >>> ss.fit.control_lattice(((0, 0, 0), (1, 1, 1)), (2, 2, 2)).shape
    (2, 2, 2, 3)
    """
    what = "fit.control_lattice"
    lower, upper = _box(box, what)
    try:
        given = list(shape)
    except TypeError:
        given = []
    if len(given) != 3:
        raise complain(unusable(f"{what}: shape"), shown(shape), "three whole numbers")
    counts = [count_of(what, "shape", one, 2, _MOST) for one in given]
    lines = []
    for count, one, low, high in zip(counts, _degrees(counts, degree), lower, upper, strict=True):
        knots = _knots(count, one)
        # With control points at these means of knots a B-spline is the identity.
        greville = np.array([knots[i + 1 : i + one + 1].mean() for i in range(count)])
        lines.append(low + (high - low) * greville)
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)


def free_form_deformation(
    kernels: Kernels, control_points: ArrayLike, *, box: object = None, degree: int | None = None
) -> Kernels:
    """Return kernels that a lattice of control points has moved, turned and stretched.

    The map is the tensor product of Bernstein polynomials (Sederberg & Parry 1986) or of B-splines with clamped, evenly
    spaced knots. It is applied to centres; shape matrices are multiplied by its derivative at the centre and factored
    by singular values. Values and weights stay the same.

    Parameters
    ----------
    kernels
        What a fit has returned.
    control_points
        World positions, (l, m, n, 3), from 2 to 64 along x, y, z. :func:`control_lattice` returns the identity's.
    box
        Lower and upper corner of the undeformed lattice; of the box of all centres unless given.
    degree
        Degree of B-splines, reduced along each axis to the number of control points less 1; None: Bernstein
        polynomials, which have that degree.

    Returns
    -------
    Kernels
        In the same order, with rotations.

    Raises
    ------
    InvalidInput
        For centres outside the box, maps that fold space over (the first such centre is named), arrays of wrong shape,
        and numbers that are not finite.

    Examples
    --------
    >>> kernels = ss.fit.nearest(np.random.default_rng(1).random((50, 3)), np.ones(50))
    >>> lattice = ss.fit.control_lattice(((0, 0, 0), (1, 1, 1)), (2, 2, 2))
    >>> lattice[..., 0] *= 2  # stretch along x
    >>> stretched = ss.fit.free_form_deformation(kernels, lattice, box=((0, 0, 0), (1, 1, 1)))
    >>> bool(np.allclose(stretched.centers[:, 0], 2 * kernels.centers[:, 0]))
    True
    """
    from scipy.interpolate import BSpline  # type: ignore[import-untyped]

    require_kernels(kernels, f"{_WHAT}: kernels")
    control = numbers(_WHAT, control_points, "control_points").astype(np.float64)
    if control.ndim != 4 or control.shape[3] != 3 or not all(2 <= size <= _MOST for size in control.shape[:3]):
        raise complain(
            unusable(f"{_WHAT}: control_points"),
            f"an array of shape {control.shape}",
            f"shape (l, m, n, 3), each of the first three from 2 to {_MOST}",
            "start from fit.control_lattice(box, shape)",
        )
    if not np.isfinite(control).all():
        first = tuple(int(part) for part in np.argwhere(~np.isfinite(control))[0])
        raise complain(unusable(f"{_WHAT}: control_points"), f"{control[first]:g} at {first}", "finite numbers")
    if not len(kernels):
        raise complain(unusable(f"{_WHAT}: kernels"), "no kernel", "at least one")
    if box is None:
        lower, upper = kernels.centers.min(axis=0), kernels.centers.max(axis=0)
        # The box of kernels in a plane has no volume.
        room = np.where(upper > lower, 0.0, max(float((upper - lower).max()), 1.0) * 0.5)
        lower, upper = lower - room, upper + room
    else:
        lower, upper = _box(box, _WHAT)
    unit = (kernels.centers - lower) / (upper - lower)
    outside = ((unit < -1e-12) | (unit > 1.0 + 1e-12)).any(axis=1)
    if outside.any():
        raise complain(
            f"{_WHAT}: the box cannot be used",
            f"{int(outside.sum())} centres outside it, the first at {shown_place(kernels.centers[np.argmax(outside)])}",
            "a box around all centres",
            "leave out " + option_ref("box") + " for theirs",
        )
    unit = np.clip(unit, 0.0, 1.0)
    shape = control.shape[:3]
    splines: list[Any] = [
        BSpline(_knots(count, one), np.eye(count), one)
        for count, one in zip(shape, _degrees(shape, degree), strict=True)
    ]
    derivatives = [spline.derivative() for spline in splines]
    centers = np.empty_like(kernels.centers)
    jacobian = np.empty((len(kernels), 3, 3))
    for start in range(0, len(kernels), _CHUNK):
        some = slice(start, start + _CHUNK)
        weights = [spline(unit[some, axis]) for axis, spline in enumerate(splines)]
        centers[some] = _mapped(weights, control)
        for axis, slopes in enumerate(derivatives):
            slope = slopes(unit[some, axis])
            jacobian[some, :, axis] = _mapped([*weights[:axis], slope, *weights[axis + 1 :]], control)
    jacobian /= upper - lower
    size = np.linalg.det(jacobian)
    folded = ~(size > 0.0)
    if folded.any():
        raise complain(
            unusable(f"{_WHAT}: control_points"),
            f"a map that folds space over at {int(folded.sum())} centres, the first at "
            + shown_place(kernels.centers[np.argmax(folded)]),
            "a map that keeps the orientation",
            "move control points by less than their distance",
        )
    axes, scales, _ = np.linalg.svd(jacobian @ kernels.shapes())
    # (A box that is bent is none.)
    return replace(kernels, centers=centers, scales=scales, rotations=quaternions(axes), periodic=None)


def _mapped(weights: list[NDArray[Any]], control: Floats) -> Floats:
    """Return sums over the control points with weights along each axis, (N, 3)."""
    x, y, z = weights
    planes = np.tensordot(x, control, axes=(1, 0))
    lines = np.einsum("nj,njkc->nkc", y, planes)
    return np.asarray(np.einsum("nk,nkc->nc", z, lines))

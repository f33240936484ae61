"""Semi-axes of kernels that are given as covariances or as frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import shown
from sheetsplat.errors import complain, option_ref

Floats = NDArray[np.float64]

# Matrices that are factored at once; 1 MB of each array.
_BLOCK = 1 << 14
# Relative to the largest entry: far above the rounding of float32, far below that of matrices which are no covariance.
_SYMMETRY = 1e-5
_POSITIVE = 1e-6
_ORTHOGONAL = 1e-3


def _first(bad: Any, start: int) -> int:
    """Return the index of the first kernel of a block that is bad."""
    return start + int(np.flatnonzero(bad)[0])


def _refuse_infinite(what: str, matrices: Floats, start: int) -> None:
    bad = ~(np.abs(matrices) <= 1e200).all(axis=(1, 2))
    if bad.any():
        n = _first(bad, start)
        raise complain(
            f"EllipsoidField: a {what} cannot be used",
            f"{shown(matrices[n - start].tolist())}, the {what} of kernel {n}",
            "finite numbers of at most 1e200",
        )


def _of_covariances(covariances: Floats, start: int, *, flat: bool) -> tuple[Floats, Floats]:
    """Return variances (N, 3), at least 0, and axes as columns (N, 3, 3); `flat` ones have variances of 0."""
    _refuse_infinite("covariance", covariances, start)
    largest = np.abs(covariances).max(axis=(1, 2))
    turned = covariances.transpose(0, 2, 1)
    lean = np.abs(covariances - turned).max(axis=(1, 2))
    bad = lean > _SYMMETRY * largest
    if bad.any():
        n = _first(bad, start)
        raise complain(
            "EllipsoidField: a covariance cannot be used",
            f"the matrix of kernel {n}, whose two halves differ by {lean[n - start]:g}",
            "symmetric matrices",
            "for semi-axes as columns use EllipsoidField.from_frames",
        )
    variances, axes = np.linalg.eigh(0.5 * (covariances + turned))
    # A variance of 0 may be slightly negative by rounding.
    rounding = 4.0 * np.finfo(np.float64).eps * largest[:, np.newaxis]
    bad = ((variances < -_POSITIVE * largest[:, np.newaxis]) | ((variances <= rounding) & (not flat))).any(axis=1)
    if bad.any():
        n = _first(bad, start)
        least = float(variances[n - start].min())
        is_flat = least >= -_POSITIVE * largest[n - start]
        raise complain(
            "EllipsoidField: a covariance cannot be used",
            f"the matrix of kernel {n}, whose smallest variance is {least:g}",
            "positive definite matrices",
            "pass " + option_ref("min_scale", "...") + ", which gives flat kernels a thickness"
            if is_flat
            else "remove or correct that kernel",
        )
    return np.where(variances <= rounding, 0.0, variances), axes


def _of_frames(frames: Floats, start: int, *, flat: bool) -> tuple[Floats, Floats]:
    """Return the lengths of the columns (N, 3), and orthogonal matrices of their directions (N, 3, 3)."""
    _refuse_infinite("frame", frames, start)
    # Scaled by each column's largest entry, so that no square over- or underflows.
    largest = np.abs(frames).max(axis=1)
    unit = frames / np.where(largest > 0.0, largest, 1.0)[:, np.newaxis, :]
    norms = np.linalg.norm(unit, axis=1)
    lengths: Floats = largest * norms
    missing = lengths == 0.0
    if missing.any() and not flat:
        n = _first(missing.any(axis=1), start)
        raise complain(
            "EllipsoidField: a kernel has no thickness",
            f"a semi-axis of length 0 of kernel {n}",
            "semi-axes above 0",
            "pass " + option_ref("min_scale", "...") + ", to which shorter semi-axes are raised",
        )
    unit /= np.where(missing, 1.0, norms)[:, np.newaxis, :]
    cosines = np.abs(unit.transpose(0, 2, 1) @ unit) * (1.0 - np.eye(3))
    lean = cosines.max(axis=(1, 2))
    bad = lean > _ORTHOGONAL
    if bad.any():
        n = _first(bad, start)
        raise complain(
            "EllipsoidField: a frame cannot be used",
            f"columns of frame {n} with a cosine of {lean[n - start]:g} between them",
            "cosines of at most 1e-3",
            "use EllipsoidField.from_covariances with M Mᵀ / (2 falloff)",
        )
    some = missing.any(axis=1)
    if some.any():
        # Missing directions are chosen at right angles to the others.
        left, _, right = np.linalg.svd(unit[some])
        unit[some] = left @ right
    return lengths, unit


def _by_blocks(
    factor: Callable[..., tuple[Floats, Floats]], what: str, matrices: NDArray[Any], flat: bool
) -> tuple[Floats, Floats]:
    """Return lengths (N, 3), and quaternions (N, 4) of the axes that belong to them."""
    _memory.require(8 * 7 * len(matrices), f"the axes of {len(matrices)} {what}", "use fewer kernels at a time")
    lengths, rotations = np.empty((len(matrices), 3)), np.empty((len(matrices), 4))
    for start in range(0, len(matrices), _BLOCK):
        part = slice(start, start + _BLOCK)
        lengths[part], axes = factor(matrices[part].astype(np.float64), start, flat=flat)
        rotations[part] = _sheetsplat.nearest_rotations(axes)
    return lengths, rotations


def axes_of_covariances(covariances: NDArray[Any], *, flat: bool) -> tuple[Floats, Floats]:
    """Return the standard deviations (N, 3) of covariances (N, 3, 3) along their axes, and these as quaternions (N, 4).

    Covariances are symmetric to within 1e-5 of their largest entry, and positive definite; `flat`: variances may be 0
    within rounding. InvalidInput, with the index of the first one, for others.
    """
    variances, rotations = _by_blocks(_of_covariances, "covariances", covariances, flat)
    return np.sqrt(variances), rotations


def axes_of_frames(frames: NDArray[Any], *, flat: bool) -> tuple[Floats, Floats]:
    """Return the lengths (N, 3) of the columns of frames (N, 3, 3), and their directions as quaternions (N, 4).

    Columns are at right angles; `flat`: lengths may be 0. InvalidInput, with the index of the first one, for others.
    """
    return _by_blocks(_of_frames, "frames", frames, flat)


def frames(rotations: Floats) -> Floats:
    """Return the matrices, (N, 3, 3), of unit quaternions w, x, y, z."""
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

    if not len(rotations):
        return np.empty((0, 3, 3))
    return np.asarray(Rotation.from_quat(rotations[:, [1, 2, 3, 0]]).as_matrix(), dtype=np.float64)

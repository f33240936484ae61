"""What pictures of sums along rays lose between pixels and slices without the filter: told, and in their error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sheetsplat.camera import Camera
from sheetsplat.errors import option_ref
from sheetsplat.image import ErrorEstimate
from sheetsplat.modes import TRAITS
from sheetsplat.notices import is_muted, warn
from sheetsplat.options.scene import MOST_SAMPLES
from sheetsplat.quality.thin import (
    LEAST_LOST,
    LEAST_WRONG,
    MOST_MEANS,
    coarse_lattice,
    lost_mass,
    sampled_sums,
    samples_for_ends,
)
from sheetsplat.scene import Scene
from sheetsplat.supersampling import fine_size

#: The cause in an error's budget.
CAUSE = "mass between pixels and slices"
# Samples a pixel along each axis for means of kernels.
_OF_MEANS = 4
# Longest side, in samples, of a picture of several samples a pixel that one with fewer is compared with.
_LONGEST = 3200
# Pictures that lack so many times the samples across a volume that ends with a jump are warned of.
_FEW = 2
# From such a pixel on, in samples of a volume, sums over pixels are wrong by the waves of the data.
_WIDE = 2.0


def keeping(scene: Scene, camera: Camera, size: tuple[int, int]) -> Scene | None:
    """Return the scene that keeps the mass where a picture is expected to lose some, None elsewhere.

    With the filter; where means of kernels are shown, or volumes end with a jump, with more samples a pixel.
    """
    if not TRAITS[scene.mode].adds or not any(one.size for one in scene.fields):
        return None
    count = min(MOST_SAMPLES, max(1, _LONGEST // max(size)), samples_for_ends(scene, camera, size))
    if count > scene.supersampling:
        ended = scene.sketch(supersampling=count)
        return keeping(ended, camera, size) or ended
    if scene.filter is not None:
        return None
    fine = fine_size(size, scene.supersampling)
    if coarse_lattice(scene, camera, fine):
        return scene.sketch(filter="ewa")
    sums = sampled_sums(scene, camera, fine)
    if sums.means <= MOST_MEANS:
        return scene.sketch(filter="ewa") if sums.lose_mass else None
    count = min(_OF_MEANS, _LONGEST // max(size))
    return scene.sketch(supersampling=count) if sums.wrong >= LEAST_WRONG and count > scene.supersampling else None


def with_lost(found: ErrorEstimate, drawn: NDArray[np.float32], kept: NDArray[np.float32]) -> ErrorEstimate:
    """Return an estimate with what a picture of scalars lacks of one that keeps the mass.

    That is the root mean square difference, divided by the largest value kept where that is above 1, or the share of
    the sum that is lost or gained, if that is more.
    """
    one, other = (np.nan_to_num(scalar.astype(np.float64)) for scalar in (drawn, kept))
    squares = np.square((one - other) / max(1.0, float(np.abs(other).max(initial=0.0))))
    mean = float(squares.mean()) if squares.size else 0.0
    if mean <= 0.0:
        return found
    share = abs(float((one - other).sum())) / max(float(np.abs(other).sum()), 1e-300)
    squares *= max(1.0, min(share, 1.0) ** 2 / mean)
    part, total = float(np.sqrt(squares.mean())), np.square(found.map.astype(np.float64)) + squares
    return ErrorEstimate(
        float(np.hypot(found.rmse, part)), found.budget | {CAUSE: part}, np.sqrt(total).astype(np.float32)
    )


def warn_of_lost(scene: Scene, camera: Camera, size: tuple[int, int]) -> None:
    """Warn of mass that a picture of sums does not show, or shows too often."""
    if is_muted() or keeping(scene, camera, size) is None:
        return
    fine = fine_size(size, scene.supersampling)
    lost = lost_mass(scene, camera, fine)
    advice = option_ref("filter", "ewa") + " keeps it"
    if abs(lost) >= LEAST_LOST:
        share = f"{100.0 * (1.0 - lost):.3g} % of the mass of its kernels"
        warn(f"the picture shows {share}: many are smaller than a few pixels or slices; " + advice)
    elif (count := samples_for_ends(scene, camera, size)) > _FEW * scene.supersampling:
        warn(
            "volumes that end are few samples wide: the picture may not have their mass; "
            + option_ref("supersampling", str(min(count, MOST_SAMPLES)))
            + " comes nearer"
        )
    elif wide := coarse_lattice(scene, camera, fine, _WIDE):
        warn(f"{wide}: the picture may not have the mass of the volume; " + advice)
    elif sampled_sums(scene, camera, fine).means > MOST_MEANS:
        warn(
            "means of kernels smaller than a few pixels are shown: their sums may be wrong; "
            + option_ref("supersampling", str(_OF_MEANS))
            + " makes it less"
        )

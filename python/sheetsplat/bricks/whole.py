"""What all bricks of a field take from the whole, so that their pictures fit together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sheetsplat._checks import Bounds
from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.camera import Camera
from sheetsplat.fields import EllipsoidField


@dataclass(frozen=True)
class Whole:
    """Facts of a whole field.

    Attributes
    ----------
    centres
        World-aligned box of all kernel centres: the depth of its middle anchors the slices. Samples that are left out
        (NaN) do not count.
    supports
        Boxes that together hold all supports, those of mirrored samples included: one of a lattice, one of each brick
        of scattered kernels.
    value_range
        Smallest and largest factor of a kernel, offset by the base: samples, or coefficients of a prefiltered
        lattice, or values.
    default_slice_spacing
        Distance of slices, and reference length, unless given; world units.
    largest_reach
        Largest semi-axis of any kernel, world units.
    falloff
        k of the kernels.
    is_mean
        Whether the scalar is a weighted mean of values, and of the base where few weights add up.
    base
        The offset of values.
    lattice
        The lattice; None for scattered kernels.
    box
        The periodic box of scattered kernels; None without one.
    """

    centres: Bounds
    supports: tuple[Bounds, ...]
    value_range: tuple[float, float]
    default_slice_spacing: float
    largest_reach: float
    falloff: float = 8.0
    is_mean: bool = False
    base: float = 0.0
    lattice: LatticeSpec | None = None
    box: Bounds | None = None

    @classmethod
    def of_lattice(cls, lattice: LatticeSpec, value_range: tuple[float, float], centres: Bounds) -> Whole:
        """Return the facts of a lattice.

        Parameters
        ----------
        lattice
            The lattice.
        value_range
            As above; that of the samples bounds nothing where there is a prefilter, but a rough one does.
        centres
            The box of the samples that are there: some may be NaN and left out.
        """
        return cls(
            centres=centres,
            supports=(lattice.supports(centres),),
            value_range=value_range,
            default_slice_spacing=lattice.default_slice_spacing,
            largest_reach=lattice.longest,
            falloff=lattice.falloff,
            base=lattice.base,
            lattice=lattice,
        )

    @property
    def domain(self) -> Bounds | None:
        """Where the field ends, in the coordinates of cells; None: nowhere."""
        return self.box if self.lattice is None else self.lattice.domain

    @property
    def is_filled(self) -> bool:
        """Whether kernels reach every point of the domain."""
        return self.lattice is not None and self.lattice.fills

    @classmethod
    def of_bricks(cls, field: EllipsoidField, supports: tuple[Bounds, ...], longest: float) -> Whole:
        """Return the facts of scattered kernels.

        Parameters
        ----------
        field
            The kernels; of those in bricks no arrays are asked for.
        supports
            The boxes around the supports of the kernels of each brick.
        longest
            Largest semi-axis of all kernels, world units.
        """
        return cls(
            centres=field.centre_bounds,
            supports=supports,
            value_range=(field.value_range[0] - field.base, field.value_range[1] - field.base),
            default_slice_spacing=field.default_slice_spacing,
            largest_reach=longest,
            falloff=field.falloff,
            is_mean=field.normalization == "threshold",
            base=field.base,
            box=field.domain,
        )

    def depths(self, camera: Camera, widening: float = 0.0) -> tuple[float, float]:
        """Return the nearest and the farthest depth that kernels reach: exact for lattices, else bounds.

        Parameters
        ----------
        camera
            The camera.
        widening
            What the filter adds to the kernels' extent along the view, squares added; world units.
        """
        eye, back = np.asarray(camera.eye), np.asarray(camera.world_axes()[2])
        if self.lattice is not None:
            half = math.hypot(self.lattice.half_extent(back), widening)
            behind, ahead = self.lattice.reach_along(self.centres, eye, back)
            return -ahead - half, -behind + half
        boxes, half = np.asarray(self.supports), widening
        # The corner of each box that is nearest to the viewer, and the farthest.
        near = np.where(back > 0, boxes[:, 1], boxes[:, 0]) - eye
        far = np.where(back > 0, boxes[:, 0], boxes[:, 1]) - eye
        return float(-(near @ back).max()) - half, float(-(far @ back).min()) + half

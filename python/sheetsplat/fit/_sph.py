"""Particles of smoothed particle hydrodynamics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from sheetsplat._checks import choice
from sheetsplat.errors import complain, option_ref, unusable
from sheetsplat.fields import NanPolicy, Periodic, periodic_box

from ._kernels import Floats, Kernels, profile, unit_mass
from ._points import places, positive, refuse_entries, scalars, usable

_WHAT = "fit.sph"


def _truncated(edge: float, power: int, distance: Floats) -> Floats:
    return np.asarray(np.maximum(edge - distance, 0.0) ** power)


def _cubic(q: Floats) -> Floats:
    return (_truncated(2.0, 3, q) - 4.0 * _truncated(1.0, 3, q)) / (4.0 * math.pi)


def _quartic(q: Floats) -> Floats:
    return (_truncated(2.5, 4, q) - 5.0 * _truncated(1.5, 4, q) + 10.0 * _truncated(0.5, 4, q)) / (20.0 * math.pi)


def _quintic(q: Floats) -> Floats:
    return (_truncated(3.0, 5, q) - 6.0 * _truncated(2.0, 5, q) + 15.0 * _truncated(1.0, 5, q)) / (120.0 * math.pi)


def _wendland_c2(q: Floats) -> Floats:
    return 21.0 / (16.0 * math.pi) * _truncated(1.0, 4, 0.5 * q) * (2.0 * q + 1.0)


def _wendland_c4(q: Floats) -> Floats:
    return 495.0 / (256.0 * math.pi) * _truncated(1.0, 6, 0.5 * q) * (35.0 / 12.0 * q**2 + 3.0 * q + 1.0)


def _wendland_c6(q: Floats) -> Floats:
    poly = 4.0 * q**3 + 6.25 * q**2 + 4.0 * q + 1.0
    return 1365.0 / (512.0 * math.pi) * _truncated(1.0, 8, 0.5 * q) * poly


@dataclass(frozen=True)
class SphKernel:
    """An SPH kernel w and the lowered Gaussian that is closest to it.

    w(q) has unit mass over space, q the distance in smoothing lengths h. The Gaussian is A g(q / radius), with g the
    profile of `falloff` (conventions, section 2): of those of unit mass the one with the least mean square difference
    from w over space.

    Attributes
    ----------
    name
    support
        Radius of w's support, in h.
    falloff
        k of the closest Gaussian.
    radius
        Radius of its support, in h.
    l2_error
        Root mean square of the difference over space, over that of w.
    max_error
        Largest difference, over w(0).
    formula
        w(q), for arrays of q >= 0.

    Examples
    --------
    >>> spline = ss.fit.SPH_KERNELS["cubic_spline"]
    >>> float(spline(np.array([0.0]))[0]) > float(spline(np.array([1.0]))[0])
    True
    """

    name: str
    support: float
    falloff: float
    radius: float
    l2_error: float
    max_error: float
    formula: Callable[[Floats], Floats] = field(repr=False, compare=False)

    def __call__(self, q: ArrayLike) -> Floats:
        """Return w(q) of the SPH kernel itself."""
        return np.asarray(self.formula(np.asarray(q, dtype=np.float64)))

    @property
    def amplitude(self) -> float:
        """The A of the closest Gaussian, by the mass of g."""
        return 1.0 / (unit_mass(self.falloff) * self.radius**3)

    def gaussian(self, q: ArrayLike) -> Floats:
        """Return A g(q / radius), the kernel that is drawn instead of w."""
        scaled = np.asarray(q, dtype=np.float64) / self.radius
        return np.asarray(self.amplitude * profile(scaled**2, self.falloff))


_KERNELS = (
    SphKernel("cubic_spline", 2.0, 4.133066, 1.748606, 0.0136, 0.0174, _cubic),
    SphKernel("quartic_spline", 2.5, 4.572642, 2.025555, 0.0132, 0.0194, _quartic),
    SphKernel("quintic_spline", 3.0, 4.908064, 2.279188, 0.0121, 0.0171, _quintic),
    SphKernel("wendland_c2", 2.0, 4.671162, 1.705910, 0.0114, 0.0419, _wendland_c2),
    SphKernel("wendland_c4", 2.0, 5.033140, 1.526002, 0.0073, 0.0059, _wendland_c4),
    SphKernel("wendland_c6", 2.0, 5.320488, 1.398544, 0.0076, 0.0040, _wendland_c6),
)
#: The kernels by name. Formulas: Monaghan & Lattanzio 1985 (cubic), Price 2012 (quartic, quintic), Dehnen & Aly 2012
#: (Wendland), with h so that the cubic spline and Wendland's functions end at 2 h.
SPH_KERNELS: Mapping[str, SphKernel] = MappingProxyType({kernel.name: kernel for kernel in _KERNELS})


def sph(
    points: ArrayLike,
    values: ArrayLike,
    smoothing_lengths: ArrayLike,
    *,
    kernel: str = "cubic_spline",
    support: float | None = None,
    masses: ArrayLike | None = None,
    densities: ArrayLike | None = None,
    min_scale: float | None = None,
    periodic: Periodic = None,
    nan: NanPolicy = "error",
) -> Kernels:
    """Return a sphere for each SPH particle, with the lowered Gaussian of :class:`SphKernel`.

    With masses and densities D is the SPH interpolant, sum of (m / density) f w: a weight is m / density over h^3 times
    the amplitude of the Gaussian, and W is about 1 where particles tile space. With normalization "threshold" and w0 =
    1 the scalar is that interpolant where W is at most 1, as at the edges of the data, and elsewhere the weighted mean
    of the particles; `sheetsplat.render` integrates the interpolant in mode xray, which keeps masses. Without masses
    and densities weights are 1, and W is about the number of particles within a support.

    Parameters
    ----------
    points
        World positions, (N, 3). Particles at one position are not merged.
    values
        One for each particle.
    smoothing_lengths
        One for each particle, world units, above 0; with `min_scale` at least 0.
    kernel
        Name of the SPH kernel, one of :data:`SPH_KERNELS`.
    support
        Radius of the SPH kernel's support in smoothing lengths of the data; that of the kernel unless given. 1: the
        lengths are the supports' radii.
    masses, densities
        One for each particle, both or neither; densities above 0, masses at least 0. Only their quotients count.
    min_scale
        World units: smaller radii of the Gaussians' supports, also those of 0, are raised to it. Weights follow from
        the raised ones, so that particles keep their masses.
    periodic
        A box ((x0, y0, z0), (x1, y1, z1)), world units, in which kernels wrap, as for
        :class:`sheetsplat.EllipsoidField`.
    nan
        What a particle is that has a number which is not finite: "error", or "skip", which leaves it out, with a
        `PictureWarning`.

    Returns
    -------
    Kernels
        In the order of the particles, with the falloff of the SPH kernel's Gaussian.

    Raises
    ------
    InvalidInput
        For arrays whose sizes disagree, numbers that are not finite (the first is named) unless these particles are
        left out, lengths or densities that are
        not above 0, no particle, and masses without densities.

    Examples
    --------
    >>> points = np.random.default_rng(1).random((50, 3))
    >>> kernels = ss.fit.sph(points, np.ones(50), np.full(50, 0.2))
    >>> len(kernels.centers)
    50
    """
    chosen = SPH_KERNELS[choice(f"{_WHAT}: kernel", kernel, tuple(SPH_KERNELS))]
    columns = {"points": points, "values": values, "smoothing_lengths": smoothing_lengths}
    given = usable(_WHAT, nan, **columns, masses=masses, densities=densities)
    at, masses, densities = places(_WHAT, given["points"]), given["masses"], given["densities"]
    count = len(at)
    if not count:
        raise complain(f"{_WHAT}: the points cannot be used", "no particle", "at least one")
    data = scalars(_WHAT, given["values"], "values", count)
    lengths = scalars(_WHAT, given["smoothing_lengths"], "smoothing_lengths", count)
    reach = chosen.support if support is None else positive(_WHAT, "support", support)
    if min_scale is None:
        advice = "remove these entries, or pass " + option_ref("min_scale", "...") + ", to which radii of 0 are raised"
        refuse_entries(_WHAT, "smoothing_lengths", lengths, ~(lengths > 0.0), "numbers above 0", advice)
    else:
        least = positive(_WHAT, "min_scale", min_scale) * chosen.support / (chosen.radius * reach)
        # A negative length is a mistake in the data, which a lower limit must not hide.
        refuse_entries(_WHAT, "smoothing_lengths", lengths, lengths < 0.0, "numbers of at least 0")
        lengths = np.maximum(lengths, least)
    # h of the kernel's formula.
    scaled = lengths * (reach / chosen.support)
    weights = None
    if (masses is None) != (densities is None):
        raise complain(
            f"{_WHAT}: the weights cannot be computed",
            f"{'masses' if densities is None else 'densities'} alone",
            "masses and densities, or neither",
            "give both, or leave both out for a weight of 1 each",
        )
    if masses is not None and densities is not None:
        mass = scalars(_WHAT, masses, "masses", count)
        refuse_entries(_WHAT, "masses", mass, mass < 0.0, "numbers of at least 0")
        if not mass.any():
            raise complain(unusable(f"{_WHAT}: masses"), "masses that are all 0", "at least one above 0")
        density = scalars(_WHAT, densities, "densities", count)
        refuse_entries(_WHAT, "densities", density, ~(density > 0.0), "numbers above 0")
        with np.errstate(all="ignore"):
            weights = chosen.amplitude * mass / density / scaled**3
        wrong = ~np.isfinite(weights)
        if wrong.any():
            first = int(np.argmax(wrong))
            raise complain(
                f"{_WHAT}: the weights cannot be computed",
                f"mass {mass[first]:g}, density {density[first]:g}, length {lengths[first]:g} of entry {first}, "
                "whose weight is beyond float64",
                "volumes that fit these lengths",
                "use one system of units",
            )
    return Kernels(
        centers=at,
        scales=chosen.radius * scaled,
        values=data,
        weights=weights,
        falloff=chosen.falloff,
        report={"points": count, "kernel": chosen.name},
        periodic=periodic_box(_WHAT, periodic),
        keeps_mass=weights is not None,
    )

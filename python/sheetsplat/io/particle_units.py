"""Units of particles in HDF5 files with the layout of Gadget, and how they scale with a and h.

What the datasets state is taken first: attributes of SWIFT ("U_L exponent" …), of AREPO and Gadget-4 (to_cgs,
length_scaling …), of EAGLE (CGSConversionFactor …). Else the units in the header (GIZMO, SWIFT, AREPO) with the
dimensions that a dataset of this name has in Gadget. Numbers stay as they are in the file: nothing is converted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np

from sheetsplat.io.hdf5_access import attribute

_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
# Names of units by their size in cgs units; those of codes differ in the fourth digit.
_LENGTHS = {"Mpc": 3.0857e24, "kpc": 3.0857e21, "pc": 3.0857e18, "au": 1.49598e13, "km": 1e5, "m": 1e2, "cm": 1.0}
_MASSES = {"10¹⁰ M☉": 1.9886e43, "M☉": 1.9886e33, "kg": 1e3, "g": 1.0}
_SPEEDS = {"km/s": 1e5, "m/s": 1e2, "cm/s": 1.0}
_SAME = 2e-3
_ROUNDED = 1e-2
_FACTORS = ("Conversion factor to CGS (not including cosmological corrections)", "to_cgs", "CGSConversionFactor")
_SIZES = {
    "length": ("UnitLength_in_cm", "UnitLength_In_CGS", "Unit length in cgs (U_L)"),
    "mass": ("UnitMass_in_g", "UnitMass_In_CGS", "Unit mass in cgs (U_M)"),
    "speed": ("UnitVelocity_in_cm_per_s", "UnitVelocity_In_CGS"),
}
#: Groups that say something about all particles.
HOMES = ("Units", "Header", "Parameters", "Cosmology")


@dataclass(frozen=True)
class Unit:
    """A unit: its size in cgs units, its dimensions, and the powers of a and h that make numbers of it physical."""

    size: float = 1.0
    cm: float = 0.0
    g: float = 0.0
    s: float = 0.0
    kelvin: float = 0.0
    a: float = 0.0
    h: float = 0.0

    def text(self) -> str:
        """Return the unit as colour bars and axes show it: "ckpc/h", "6.77e-22 g cm⁻³ h² a⁻³"."""
        dimensions = (self.cm, self.g, self.s, self.kelvin)
        if not any(dimensions):
            return ""
        named: dict[tuple[float, ...], dict[str, float]] = {
            (1, 0, 0, 0): _LENGTHS,
            (0, 1, 0, 0): _MASSES,
            (1, 0, -1, 0): _SPEEDS,
            (0, 0, 0, 1): {"K": 1.0},
        }
        sizes = named.get(dimensions, {})
        name = next((one for one, size in sizes.items() if abs(self.size / size - 1) < _SAME), None)
        a, h = self.a, self.h
        if name is not None:
            if sizes is _LENGTHS and a == 1:
                # As simulations write comoving lengths.
                name, a = "c" + name, 0.0
            if h == -1:
                name, h = name + "/h", 0.0
            parts = [name]
        else:
            parts = [] if self.size == 1 else [f"{self.size:.4g}"]
            parts += [_power(unit, power) for unit, power in zip(("g", "cm", "s", "K"),
                      (self.g, self.cm, self.s, self.kelvin), strict=True)]  # fmt: skip
        return " ".join(part for part in (*parts, _power("h", h), _power("a", a)) if part)


# Dimensions and powers of a and h of what Gadget writes, in comoving runs.
_LENGTH = Unit(cm=1, a=1, h=-1)
_USUAL = {
    **dict.fromkeys(("Coordinates", "Position", "Positions"), _LENGTH),
    **dict.fromkeys(("SmoothingLength", "SmoothingLengths", "Hsml"), _LENGTH),
    **dict.fromkeys(("Masses", "Mass"), Unit(g=1, h=-1)),
    **dict.fromkeys(("Density", "Densities"), Unit(cm=-3, g=1, a=-3, h=2)),
    **dict.fromkeys(("Velocities", "Velocity"), Unit(cm=1, s=-1, a=0.5)),
    **dict.fromkeys(("InternalEnergy", "InternalEnergies"), Unit(cm=2, s=-2)),
    **dict.fromkeys(("Temperature", "Temperatures"), Unit(kelvin=1)),
}


def _power(name: str, power: float) -> str:
    if power == 0:
        return ""
    if power == 1:
        return name
    return name + (str(int(power)).translate(_SUPERSCRIPTS) if power == int(power) else f"^{power:g}")


def number(one: Any, *names: str) -> float | None:
    """Return the first of these attributes that is a finite number, None where there is none."""
    for name in names:
        found = attribute(one, name)
        if found is None or np.asarray(found).dtype.kind not in "iuf" or np.asarray(found).size == 0:
            continue
        value = float(np.asarray(found).reshape(-1)[0])
        if math.isfinite(value):
            return value
    return None


def header(homes: dict[str, Any]) -> dict[str, float]:
    """Return what the header says: a, h, redshift and files, and sizes of units in cgs, where they are there."""
    told: dict[str, float] = {}
    for key, names in (
        ("redshift", ("Redshift",)),
        ("a", ("Scale-factor",)),
        ("h", ("HubbleParam", "h")),
        ("files", ("NumFilesPerSnapshot",)),
        *_SIZES.items(),
    ):
        for home in homes.values():
            found = number(home, *names)
            if found is not None and found >= 0 and key not in told:
                told[key] = found
    time = number(homes["Header"], "Time") if "Header" in homes else None
    shift = told.get("redshift")
    if "a" not in told and time is not None and shift is not None and abs(time * (1 + shift) - 1) < 1e-3:
        # In runs without cosmology Time is a time.
        told["a"] = time
    return told


def box(homes: dict[str, Any]) -> tuple[float, float, float] | None:
    """Return the sides of the box, from 0 on, 0 along axes that do not wrap; None where there is none."""
    for home in homes.values():
        found = np.asarray(attribute(home, "BoxSize"))
        if found.dtype.kind in "iuf" and found.size in (1, 3) and np.isfinite(found).all() and (found >= 0).all():
            x, y, z = np.broadcast_to(found.reshape(-1), 3).astype(np.float64).tolist()
            return (x, y, z) if max(x, y, z) > 0 else None
    return None


def homes_of(groups: dict[str, Any]) -> dict[str, Any]:
    """Return the groups that say something about all particles."""
    return {name: groups[name] for name in HOMES if isinstance(groups.get(name), h5py.Group)}


def volume_factor(mass: Unit | None, density: Unit | None, length: Unit | None, told: dict[str, float]) -> float:
    """Return what quotients of masses and densities must be multiplied by to be volumes in the unit of length, cubed.

    1 where units are not known, and where they fit to within the digits that codes give them with.
    """
    if mass is None or density is None or length is None:
        return 1.0
    factor = mass.size / density.size / length.size**3
    for base, powers in (
        (told.get("a"), (mass.a, density.a, length.a)),
        (told.get("h"), (mass.h, density.h, length.h)),
    ):
        power = powers[0] - powers[1] - 3.0 * powers[2]
        if power:
            factor *= (base or 1.0) ** power
    return factor if 0.0 < factor < math.inf and abs(factor - 1.0) > _ROUNDED else 1.0


def unit_of(dataset: Any, name: str, told: dict[str, float]) -> Unit | None:
    """Return the unit of a dataset, None where the file does not say."""
    usual = _USUAL.get(name)
    size = number(dataset, *_FACTORS)
    a = number(dataset, "a-scale exponent", "a_scaling", "aexp-scale-exponent")
    h = number(dataset, "h-scale exponent", "h_scaling", "h-scale-exponent")
    if size is not None and size > 0:
        scales = {"a": a or 0.0, "h": h or 0.0}
        lengths = number(dataset, "U_L exponent")
        if lengths is not None:
            powers = [number(dataset, f"U_{one} exponent") or 0.0 for one in ("M", "t", "T")]
            return Unit(size, lengths, *powers, **scales)
        lengths = number(dataset, "length_scaling")
        if lengths is not None:
            mass, speed = (number(dataset, f"{one}_scaling") or 0.0 for one in ("mass", "velocity"))
            return Unit(size, lengths + speed, mass, 0.0 - speed, 0.0, **scales)
        return None if usual is None else replace(usual, size=size, **scales)
    if usual is None:
        return None
    # Physical numbers, unless the run is comoving.
    if not ("a" in told and told["a"] < 1 and told.get("h", 0) > 0):
        usual = replace(usual, a=0.0, h=0.0)
    if usual.kelvin:
        return usual
    length, mass, speed = (told.get(one, 0.0) for one in ("length", "mass", "speed"))
    # A time is a length over a speed, so that powers of seconds are powers of speed.
    needed = [size for size, power in ((length, usual.cm + usual.s), (mass, usual.g), (speed, usual.s)) if power]
    if not needed or min(needed) <= 0:
        return None
    try:
        size = math.prod(
            base**power
            for base, power in ((length, usual.cm + usual.s), (mass, usual.g), (speed, 0.0 - usual.s))
            if power
        )
    except OverflowError:
        return None
    return replace(usual, size=size) if 0 < size < math.inf else None

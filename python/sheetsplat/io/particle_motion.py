"""How particles of a snapshot move: their numbers, velocities and the time, from HDF5 files with Gadget's layout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import complain
from sheetsplat.io import particle_units
from sheetsplat.io.checks import listed, unreadable
from sheetsplat.io.hdf5_access import checked
from sheetsplat.io.records import Floats
from sheetsplat.io.source import Source, hdf5_start, opened
from sheetsplat.io.sph_hdf5 import group_of, homes_of

_IDS = ("ParticleIDs", "ParticleID", "ID", "IDs")
_VELOCITIES = ("Velocities", "Velocity")
_MATTER = ("Omega0", "Omega_Matter", "Omega_m")
_LAMBDA = ("OmegaLambda", "Omega_Lambda", "Omega_lambda")
# 100 km/s/Mpc, 1/s.
_HUBBLE = 1e7 / 3.0856775814913673e24
_NODES = 64


@dataclass(frozen=True)
class Motion:
    """The motion of the particles of a file, in the order of its rows.

    Attributes
    ----------
    ids
        Numbers of the particles, (N,).
    velocities
        Their velocities, (N, 3), world units in a unit of time.
    time
        When it was, in that unit: of the file, or of cosmological runs in seconds since the beginning.
    unit
        Of the time: "s", or empty where it is not known.
    """

    ids: NDArray[Any]
    velocities: Floats
    time: float
    unit: str = ""


def read_motion(path: Path, particles: str | None = None) -> Motion:
    """Return how the particles of a group move; `particles` as for `sph_hdf5.read`.

    Raises
    ------
    InvalidInput
        For files of another format, and where numbers, velocities, the time or units that cosmology needs are missing.
    """
    with opened(path) as source:
        if not isinstance(source, Source) or hdf5_start(source) is None:
            found, wanted = "a file without particles that have numbers and velocities", "an HDF5 snapshot"
            raise complain(f"{path} has no motion", found, wanted)
        with h5py.File(checked(source), "r") as file:
            return _of_file(path, file, particles)


def _of_file(path: Path, file: Any, particles: str | None) -> Motion:
    group = group_of(path, file, particles)
    names = [group.first(known) for known in (_IDS, _VELOCITIES)]
    if names[0] is None or names[1] is None:
        wanted = f"{_IDS[0]} and {_VELOCITIES[0]}"
        raise unreadable(path, f"{group.name} with {listed(group.names)}", wanted)
    homes = homes_of(path, file)
    told = particle_units.header(homes)
    time = next((found for one in homes.values() if (found := particle_units.number(one, "Time")) is not None), None)
    velocities = group.read(names[1]).astype(np.float64)
    if velocities.ndim != 2 or velocities.shape[1] != 3:
        raise unreadable(path, f"{group.name}/{names[1]} of shape {velocities.shape}", "(N, 3)")
    unit = ""
    cosmology = [next(_numbers(homes, known), 0.0) for known in (_MATTER, _LAMBDA)]
    if "a" in told and told.get("h", 0.0) > 0.0 and cosmology[0] > 0.0:
        units = group.unit(group.place, told), group.unit(names[1], told)
        if units[0] is None or units[1] is None:
            raise unreadable(path, "a cosmological run without units of length and velocity", "both, in its header")
        a, h = told["a"], told["h"]
        sizes = [one.size * a**one.a * h**one.h for one in units if one is not None]
        velocities *= sizes[1] / sizes[0]
        time, unit = age(a, h, cosmology[0], cosmology[1]), "s"
    elif time is None:
        raise unreadable(path, "no time in its header", "Header with an attribute Time")
    return Motion(group.read(names[0]).reshape(-1), velocities, time, unit)


def _numbers(homes: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return (found for one in homes.values() if (found := particle_units.number(one, *names)) is not None)


def age(a: float, h: float, matter: float, dark_energy: float) -> float:
    """Return the seconds from the beginning to a scale factor: the integral of da / (a H) of matter, curvature and Λ.

    In u = a^(3/2) what is integrated is smooth, also at the beginning.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    end = a**1.5
    at = (0.5 * end * (nodes + 1.0)) ** (2.0 / 3.0)
    density = matter + (1.0 - matter - dark_energy) * at + dark_energy * at**3
    if not (density > 0.0).all():
        return math.nan
    return float(2.0 / 3.0 * 0.5 * end * (weights / np.sqrt(density)).sum() / (h * _HUBBLE))

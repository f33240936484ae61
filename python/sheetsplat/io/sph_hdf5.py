"""Particles of smoothed-particle hydrodynamics in HDF5 files with the layout of Gadget: groups PartType0 … PartType5.

Names of Arepo, GIZMO and SWIFT are also known; units are those of `particle_units`. Links to other files, external
storage and virtual datasets are refused.
"""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple, shown
from sheetsplat.errors import option_ref
from sheetsplat.fields import Wrapping, periodic_box
from sheetsplat.io import particle_units
from sheetsplat.io.checks import listed, require_rows, unreadable
from sheetsplat.io.hdf5_access import checked, inside, read_dataset
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.source import Source

_DEFAULT = "PartType0"
_PLACE = ("Coordinates", "Position", "Positions")
_SMOOTHING = ("SmoothingLength", "SmoothingLengths", "Hsml")
_MASS = ("Masses", "Mass")
_DENSITY = ("Density", "Densities")
_MOST_DATASETS = 1000
# Radii of supports in smoothing lengths: Gadget, Arepo and GIZMO; SWIFT (cubic spline); Gasoline and ChaNGa.
_SUPPORTS = (1.0, 1.825742, 2.0)
_PROBES = 64
# How far outside of the box particles may lie, in its sides, and rows that are looked at together for that.
_OUTSIDE = 1e-6
_ROWS = 1 << 20
# Of more particles the support is not searched for where they are read in parts.
_MOST_SEARCHED = 4_000_000
# Types by the names that people give them.
_TYPES = {"gas": 0, "dark_matter": 1, "dm": 1, "disk": 2, "bulge": 3, "stars": 4, "star": 4, "black_holes": 5, "bh": 5}
_VOLUME = ("Volume", "Volumes")
# Supports of cells of a moving mesh, which have no smoothing lengths, in radii of spheres with their volumes: a sphere
# of 2.5 radii holds 16 cells.
_CELL_SUPPORT = 2.5
# Largest relative error of densities, for kernels of another shape and the same width.
_AGREEMENT = 0.1

_log = logging.getLogger("sheetsplat")


class _Group:
    """A group of particles: its datasets of numbers, that of the positions, and the number of particles.

    `rows`: the first particle that is read, and the one behind the last; None: all.
    """

    def __init__(self, path: Path, group: Any, name: str, rows: tuple[int, int] | None = None) -> None:
        self._path, self._group, self.name, self._rows = path, group, name, rows
        self._datasets: dict[str, Any] = {}
        names = list(group)
        if len(names) > _MOST_DATASETS:
            raise unreadable(path, f"{len(names)} entries in {name}", f"at most {_MOST_DATASETS}")
        for one in names:
            entry = inside(path, group, one)
            if isinstance(entry, h5py.Dataset) and entry.dtype.kind in "iuf" and entry.ndim in (1, 2):
                self._datasets[one] = entry
        place = self.first(_PLACE)
        if place is None:
            raise unreadable(path, f"{name} with {listed(names)}", "a dataset Coordinates of numbers")
        if self._datasets[place].ndim != 2 or self._datasets[place].shape[1] != 3:
            raise unreadable(path, f"{name}/{place} of shape {self._datasets[place].shape}", "(N, 3)")
        self.place = place
        self.count = int(self._datasets[place].shape[0])

    @property
    def size(self) -> int:
        """Number of particles that are read."""
        return self.count if self._rows is None else self._rows[1] - self._rows[0]

    @property
    def is_whole(self) -> bool:
        """Whether all particles are read."""
        return self._rows is None

    def first(self, names: tuple[str, ...]) -> str | None:
        return next((name for name in names if name in self._datasets), None)

    def has(self, name: str) -> bool:
        """Return whether there is a dataset of numbers of this name."""
        return name in self._datasets

    def unit(self, name: str, told: dict[str, float]) -> particle_units.Unit | None:
        """Return the unit of a dataset, or of what a table of the header has; None where it is not known."""
        return particle_units.unit_of(self._datasets.get(name, self._group), name, told)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the datasets of numbers."""
        return tuple(self._datasets)

    def widths(self) -> dict[str, int]:
        """Return the number of columns of every dataset with a row for each particle, except the positions."""
        return {
            name: 1 if one.ndim == 1 else int(one.shape[1])
            for name, one in self._datasets.items()
            if name != self.place and one.shape[0] == self.count and (one.ndim == 1 or one.shape[1] > 0)
        }

    def read(self, name: str, rows: tuple[int, int] | None = None) -> NDArray[Any]:
        """Return a dataset, or some of its rows, after a check of its size against its stored bytes."""
        one, what = self._datasets[name], f"{self.name}/{name}"
        if one.shape[0] != self.count:
            wanted = f"{self.count}, as {self.name}/{self.place} has"
            raise unreadable(self._path, f"{what} of {one.shape[0]} rows", wanted)
        rows = self._rows if rows is None else rows
        count = self.count if rows is None else rows[1] - rows[0]
        # For the dataset, and float64 of it.
        return read_dataset(self._path, one, what, 8 * count * math.prod(one.shape[1:]), rows)

    def column(self, names: tuple[str, ...]) -> Floats | None:
        """Return the first of these datasets that exists, as float64; None where it has several columns."""
        name = self.first(names)
        if name is None or self._datasets[name].ndim != 1:
            return None
        return self.read(name).astype(np.float64)


def _mass_table(path: Path, file: Any, name: str) -> float:
    """Return the common mass of all particles of a group, 0 where the file has none."""
    header = inside(path, file, "Header")
    if header is None:
        return 0.0
    try:
        table = np.asarray(header.attrs["MassTable"], dtype=np.float64).reshape(-1)
        mass = float(table[int(name.removeprefix("PartType"))])
    except (KeyError, ValueError, IndexError, TypeError):
        return 0.0
    return mass if math.isfinite(mass) and mass > 0 else 0.0


def find_support(
    points: Floats, lengths: Floats, masses: Floats, densities: Floats, box: Bounds | None = None
) -> tuple[float | None, float]:
    """Return the support's radius in smoothing lengths (None: unknown), and the error of densities computed with it.

    A smoothing length is the radius of the kernel's support in some programs and half of it in others. Each factor is
    tried on a few particles: density_i = Σ_j m_j W(|x_i − x_j|; support_i) with the cubic spline. The error is the
    median of |log(density / density of the file)|. `box`: a periodic one.
    """
    from scipy.spatial import cKDTree  # type: ignore[import-untyped]

    from sheetsplat.fit import SPH_KERNELS

    wrapping = Wrapping(box)
    known = np.isfinite(points).all(axis=1) & np.isfinite(masses)
    points, lengths, masses, densities = (one[known] for one in (points, lengths, masses, densities))
    # Kernels much larger than the data overflow the tree's sums of squares.
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    usable = np.flatnonzero((lengths > 0) & (lengths < 10.0 * size) & (densities > 0) & (masses > 0))
    if usable.size < 2 or not 1e-100 < size < 1e100:
        return None, math.inf
    probes = usable[np.linspace(0, usable.size - 1, min(_PROBES, usable.size)).astype(np.intp)]
    if box is not None:
        # A tree of a box counts from its lower corner.
        points = wrapping.wrapped(points) - box[0]
    tree = cKDTree(points, boxsize=None if box is None else wrapping.sides)
    errors = []
    for factor in _SUPPORTS:
        found = []
        for probe in probes:
            reach = factor * lengths[probe]
            near = np.asarray(tree.query_ball_point(points[probe], reach), dtype=np.intp)
            share = np.linalg.norm(wrapping.apart(points[near] - points[probe]), axis=1) / reach
            kernel = 8.0 * SPH_KERNELS["cubic_spline"](2.0 * share)
            density = float((masses[near] * kernel).sum()) / reach**3
            found.append(abs(math.log(density / densities[probe])) if density > 0 else math.inf)
        errors.append(float(np.median(found)))
    best = int(np.argmin(errors))
    return (_SUPPORTS[best] if errors[best] < _AGREEMENT else None), errors[best]


def read(
    source: Source,
    scalar: str | None = None,
    particles: str | None = None,
    support: float | None = None,
    rows: tuple[int, int] | None = None,
) -> Scattered:
    """Read particles of one group.

    Parameters
    ----------
    source
    scalar
        A dataset of the group, the length of a vector's rows, or one column of it (Velocities_x); "Density" unless
        given, else "Masses", which may be in the table of the header.
    particles
        The group, or gas, dark_matter, stars, black_holes …; PartType0, the gas, unless given.
    support
        Radius of the kernels' supports in smoothing lengths of the file. Unless given, the one that gives the densities
        of the file (`find_support`), else 1, as in Gadget. For cells of a moving mesh (Arepo, TNG), which have none: in
        radii of spheres with the volumes of the cells, masses over densities; 2.5 unless given.

    Raises
    ------
    InvalidInput
        For damaged files, missing groups or datasets, and datasets of other lengths or larger than what is stored.
    """
    with h5py.File(checked(source), "r") as file:
        group = group_of(source.path, file, particles, rows)
        return _read_group(source.path, file, group, scalar, support)


def locate(
    source: Source, particles: str | None = None, support: float | None = None
) -> tuple[int, float | None, Bounds | None]:
    """Return the number of particles of a group, the support that `read` takes for parts of it, and the periodic box.

    Where the support is found by the densities, it is found of all particles, which are read for it; InvalidInput where
    they are too many.
    """
    path = source.path
    with h5py.File(checked(source), "r") as file:
        group = group_of(path, file, particles)
        box = _periodic(path, particle_units.box(homes_of(path, file)), group)
        return group.count, _located(path, file, group, support, box), box


def _located(path: Path, file: Any, group: _Group, support: float | None, box: Bounds | None) -> float | None:
    """Return the support that `read` takes for parts of a group."""
    lengths = group.first(_SMOOTHING)
    mass = _mass_table(path, file, group.name)
    if support is not None or lengths is None or group.first(_DENSITY) is None:
        return support
    if group.first(_MASS) is None and not mass > 0:
        return support
    if group.count > _MOST_SEARCHED:
        raise unreadable(
            path,
            f"{group.count} particles, no radius of kernels in smoothing lengths",
            "it: 1 of Gadget, Arepo and GIZMO, 1.825742 of SWIFT, 2 of Gasoline and ChaNGa",
            "pass " + option_ref("support", "1"),
        )
    columns = [group.column(names) for names in (_SMOOTHING, _MASS, _DENSITY)]
    sizes, masses, densities = columns[0], columns[1], columns[2]
    masses = np.full(group.count, mass) if masses is None else masses
    if sizes is None or densities is None:
        return support
    return find_support(group.read(group.place).astype(np.float64), sizes, masses, densities, box)[0]


def _periodic(path: Path, sides: Triple | None, group: _Group) -> Bounds | None:
    """Return the box in which the particles of a group wrap: that of the file, unless some lie outside of it."""
    if sides is None:
        return None
    margin = _OUTSIDE * np.asarray(sides)
    for first in range(0, group.count, _ROWS):
        places = group.read(group.place, (first, min(first + _ROWS, group.count))).astype(np.float64)
        # (NaN is not outside.)
        if ((places < -margin) | (places > sides + margin))[:, margin > 0].any():
            return None
    return periodic_box(str(path), ((0.0, 0.0, 0.0), sides))


def group_of(path: Path, file: Any, particles: str | None, rows: tuple[int, int] | None = None) -> _Group:
    """Return a group of particles, PartType0 unless named. InvalidInput where there is none."""
    name = _DEFAULT if particles is None else particles
    group = inside(path, file, name)
    number = _TYPES.get(name.lower().replace(" ", "_").replace("-", "_"))
    if group is None and number is not None:
        name = f"PartType{number}"
        group = inside(path, file, name)
    if not isinstance(group, h5py.Group) or group == file:
        groups = [one for one in file if one != "Header"]
        found = f"no group {shown(name)}, but {listed(groups) or 'nothing'}"
        wanted = "particles in a group PartType0, or the name of another one"
        raise unreadable(path, found, wanted, "pass " + option_ref("particles", "..."))
    return _Group(path, group, name, rows)


def homes_of(path: Path, file: Any) -> dict[str, Any]:
    """Return the groups of a file that say something about all particles."""
    found = {name: inside(path, file, name) for name in file if name in particle_units.HOMES}
    return particle_units.homes_of(found)


def _about(told: dict[str, float]) -> dict[str, str]:
    """Return what the header says, as texts."""
    texts = {"a": "scale factor", "h": "h", "redshift": "redshift"}
    about = {text: f"{told[key]:g}" for key, text in texts.items() if told.get(key)}
    if told.get("files", 1) > 1:
        about["part"] = f"one file of {told['files']:g} of a snapshot"
    return about


def _read_group(path: Path, file: Any, group: _Group, scalar: str | None, support: float | None) -> Scattered:
    name = group.name
    require_rows(path, group.size)
    widths = group.widths()
    share = _mass_table(path, file, name)
    if share > 0 and group.first(_MASS) is None and "Masses" not in widths:
        # In a table for all particles of a group.
        widths["Masses"] = 1
    if scalar is None and widths and not widths.keys() & {*_DENSITY, *_MASS}:
        raise unreadable(
            path,
            f"no densities or masses in {name}, but {listed(tell_names(scalar_names(widths)))}",
            "the name of what is to be shown",
            "pass " + option_ref("scalar", "..."),
            option="scalar",
        )
    chosen, base, column = choose_scalar(path, scalar, (*_DENSITY, *_MASS), widths)
    points = group.read(group.place).astype(np.float64)
    masses, densities = group.column(_MASS), group.column(_DENSITY)
    if masses is None and share > 0:
        masses = np.full(group.size, share)
    of_table = base == "Masses" and not group.has(base)
    values = np.full(group.size, share) if of_table else column_of(group.read(base), column)
    lengths = group.column(_SMOOTHING)
    homes = homes_of(path, file)
    told, sides = particle_units.header(homes), particle_units.box(homes)
    details = {"particles": name, **_about(told)}
    box = _periodic(path, sides, group) if group.is_whole else None
    if sides is not None:
        outside = ", not periodic: particles lie outside of it" if group.is_whole else ""
        details["box"] = " x ".join(f"{side:g}" for side in sides) + (", periodic" if box else outside)
    shown, length = group.unit(base, told), group.unit(group.place, told)
    if masses is not None and densities is not None:
        mass, density = (group.unit(group.first(names) or names[0], told) for names in (_MASS, _DENSITY))
        masses *= particle_units.volume_factor(mass, density, length, told)
    if "part" in details and group.is_whole:
        _log.warning("this is %s: the others are not read", details["part"])
    if lengths is None and (masses is None or densities is None) and (volumes := group.column(_VOLUME)) is not None:
        masses, densities = volumes, np.ones(group.size)
    if lengths is None and masses is not None and densities is not None:
        if densities.min() <= 0 or masses.min() <= 0:
            raise unreadable(path, f"masses or densities of 0 or less in {name}", "cells with a volume")
        share = _CELL_SUPPORT if support is None else support
        lengths = share * np.cbrt(0.75 / math.pi * masses / densities)
        details["support"] = f"{share:g} radii of spheres with the volumes of the cells"
    elif lengths is not None:
        if support is None and masses is not None and densities is not None and group.is_whole:
            support, error = find_support(points, lengths, masses, densities, box)
            details["support"] = (
                "1 smoothing length, as in Gadget; the densities of the file fit no known kernel"
                if support is None
                else f"{support:g} smoothing lengths, which gives the densities of the file to {100 * error:.2g} %"
            )
            _log.info("%s: the support of a kernel is %s", path, details["support"])
        lengths = lengths * (1.0 if support is None else support)
    return Scattered(
        points,
        values,
        chosen,
        "hdf5, particles",
        scalar_names(widths),
        supports=lengths,
        particles=True,
        masses=masses,
        densities=densities,
        details=details,
        unit="" if shown is None else shown.text(),
        length_unit="" if length is None else length.text(),
        periodic=box,
    )

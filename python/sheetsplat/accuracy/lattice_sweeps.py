"""The settings of the knobs that are about lattices: lattice, kernel, prefilter."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from sheetsplat.accuracy.knobs import Base, Setting, call_text
from sheetsplat.errors import InvalidInput, Unsupported, complain
from sheetsplat.fields import Field, RegularField
from sheetsplat.ripple import lattice_constant, lattice_ripple
from sheetsplat.scene import Scene

# Edges of BCC lattices, relative to the one of equal quality.
_EDGES = (1.25, 1.0, 0.9, 0.8)
# Radius in sample distances, and falloff.
KERNELS = ((2.0, 5.0), (2.5, 7.0), (3.0, 8.0))
# Of the field through the samples that lattices are judged by.
BEST_KERNEL = KERNELS[1]


def _lattice_of(base: Base) -> RegularField:
    (one,) = base.scene.fields
    assert isinstance(one, RegularField)
    return one


def no_lattice(base: Base) -> str:
    """Return why a scene has no lattice to vary, or an empty text."""
    fields = base.scene.fields
    return "" if len(fields) == 1 and isinstance(fields[0], RegularField) else "for scenes of one regular field"


def _kernel_text(one: RegularField) -> str:
    name = "Cartesian" if one.lattice == "cartesian" else "BCC"
    return f"{name} ({one.radius:g}, {one.falloff:g}){', prefiltered' if one.prefilter else ''}"


def _way(one: RegularField) -> str:
    return "prefilter" if one.prefilter else one.normalization


def _lattice(base: Base) -> Iterator[Setting]:
    one = _lattice_of(base)
    yield Setting(f"{_kernel_text(one)}, as given", current=True, series=one.lattice, ripple=_ripple_of(one))
    if one.lattice != "cartesian":
        yield Setting("Cartesian", reason="a BCC lattice is not resampled to a Cartesian one")
        return
    for edge in _EDGES:
        yield Setting(
            f"BCC, {edge**-3 / math.sqrt(2):.2f} of the samples",
            {"field": partial(_resampled, one, edge)},
            f"resample_to_bcc(field, a={edge:g} × the edge of equal quality)",
            series="bcc",
            ripple=_ripple("bcc", one.radius, one.falloff, _way(one), one.w0),
        )


def _resampled(one: RegularField, edge: float) -> Field:
    from sheetsplat.bcc import BccLattice, resample_to_bcc

    if one.nan == "skip":
        raise complain("the volume is not resampled", "a field that skips NaN", "samples everywhere", kind=Unsupported)
    a = edge * BccLattice.matching(one.shape, one.spacing, one.origin).a
    options = {name: getattr(one, name) for name in ("radius", "falloff", "normalization", "w0", "prefilter")}
    dtype = np.float64 if one.values.dtype == np.float64 else np.float32
    return resample_to_bcc(one, a=a, dtype=dtype).field(**options)


def _kernel(base: Base) -> Iterator[Setting]:
    one = _lattice_of(base)
    ways = {"lattice": "", "threshold": "by weights"}
    now = (one.radius, one.falloff, _way(one))
    if now[:2] not in KERNELS or now[2] not in ways:
        yield Setting("as given", current=True, ripple=_ripple_of(one))
    for (way, series), (radius, falloff) in itertools.product(ways.items(), KERNELS):
        options: dict[str, Any] = {"radius": radius, "falloff": falloff, "normalization": way}
        if one.prefilter:
            options["prefilter"] = False
        if way == "threshold" and way != one.normalization:
            # Low enough that only the border of the volume falls below it.
            options["w0"] = 0.5 * lattice_constant(radius, falloff, "bcc" if one.lattice == "bcc" else "cartesian")
        yield Setting(
            f"({radius:g}, {falloff:g})" + (f", {series}" if series else ""),
            {"field": partial(one.replace, **options)},
            call_text("RegularField", options),
            series=series,
            current=(radius, falloff, way) == now,
            ripple=_ripple(one.lattice, radius, falloff, way, float(options.get("w0", one.w0))),
        )


def _prefilter(base: Base) -> Iterator[Setting]:
    one = _lattice_of(base)
    now = (one.radius, one.falloff) if one.prefilter else None
    is_listed = now is None or now in KERNELS
    yield Setting(
        "as given" if is_listed else _kernel_text(one),
        current=True,
        series="" if is_listed else "prefiltered",
        ripple=_ripple_of(one),
    )
    for radius, falloff in KERNELS:
        if (radius, falloff) != now:
            yield Setting(
                f"({radius:g}, {falloff:g}), prefiltered",
                {"field": partial(_prefiltered, one, radius, falloff)},
                call_text("RegularField", {"radius": radius, "falloff": falloff, "prefilter": True}),
                series="prefiltered",
                ripple=_ripple(one.lattice, radius, falloff, "prefilter"),
                is_truth=(radius, falloff) == BEST_KERNEL,
            )


SWEEPS: dict[str, Callable[[Base], Iterator[Setting]]] = {
    "lattice": _lattice,
    "kernel": _kernel,
    "prefilter": _prefilter,
}


def _prefiltered(one: RegularField, radius: float, falloff: float) -> RegularField:
    """Return a field whose sum passes through the samples of another one."""
    return one.replace(radius=radius, falloff=falloff, normalization="lattice", prefilter=True)


def interpolating(base: Base) -> Scene:
    """Return the scene of the field that passes through the samples, by which lattices are judged."""
    return base.scene.replace(field=_prefiltered(_lattice_of(base), *BEST_KERNEL))


def _ripple_of(one: RegularField) -> tuple[float, float] | None:
    return _ripple(one.lattice, one.radius, one.falloff, _way(one), one.w0)


def _ripple(lattice: str, radius: float, falloff: float, way: str, w0: float = 1.0) -> tuple[float, float] | None:
    """Return root mean square and peak of the ripple; `way` is the normalisation, or "prefilter". None: not known."""
    prefilter = way == "prefilter"
    options: dict[str, Any] = {"normalization": "none" if prefilter else way, "w0": w0, "prefilter": prefilter}
    try:
        found = lattice_ripple(radius, falloff, lattice=lattice, **options)  # type: ignore[arg-type]
    except InvalidInput:
        return None
    return found.rms, found.peak

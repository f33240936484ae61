"""The settings of the knobs that are about lattices: lattice, kernel, prefilter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from sheetsplat.accuracy.knobs import INTERPOLATED, Base, Setting, call_text
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


def regular(one: RegularField, **changes: Any) -> RegularField:
    """Return a regular field with some options changed."""
    names = ("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "nan")
    options: dict[str, Any] = {name: getattr(one, name) for name in names}
    if getattr(one, "prefilter", False):
        options["prefilter"] = True
    return RegularField(one.values, **{**options, **changes})


def _one_lattice(base: Base) -> RegularField | None:
    fields = base.scene.fields
    return fields[0] if len(fields) == 1 and isinstance(fields[0], RegularField) else None


_NO_LATTICE = "for scenes of one regular field"


def _kernel_text(one: RegularField) -> str:
    name = "Cartesian" if one.lattice == "cartesian" else "BCC"
    filtered = ", prefiltered" if getattr(one, "prefilter", False) else ""
    return f"{name} ({one.radius:g}, {one.falloff:g}){filtered}"


def lattice(base: Base) -> Iterator[Setting]:
    """Yield the settings of the knob "lattice"."""
    one = _one_lattice(base)
    if one is None:
        yield Setting("lattice", "Cartesian, BCC", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    yield Setting(
        "lattice",
        f"{_kernel_text(one)}, as given",
        "",
        lambda: base.scene,
        truth=INTERPOLATED,
        current=True,
        series=one.lattice,
        ripple=ripple_of(one),
    )
    if one.lattice != "cartesian":
        yield Setting(
            "lattice", "Cartesian", truth=INTERPOLATED, reason="a BCC lattice is not resampled to a Cartesian one"
        )
        return
    for edge in _EDGES:
        yield Setting(
            "lattice",
            f"BCC, {edge**-3 / math.sqrt(2):.2f} of the samples",
            f"resample_to_bcc(field, a={edge:g} × the edge of equal quality)",
            lambda edge=edge: base.replace(field=_resampled(one, edge)),  # type: ignore[misc]
            truth=INTERPOLATED,
            series="bcc",
            ripple=_ripple("bcc", one.radius, one.falloff, _way(one), one.w0),
        )


def _resampled(one: RegularField, edge: float) -> Field:
    from sheetsplat.bcc import BccLattice, resample_to_bcc

    if one.nan == "skip":
        raise complain("the volume is not resampled", "a field that skips NaN", "samples everywhere", kind=Unsupported)
    a = edge * BccLattice.matching(one.shape, one.spacing, one.origin).a
    options: dict[str, Any] = {name: getattr(one, name) for name in ("radius", "falloff", "normalization", "w0")}
    if getattr(one, "prefilter", False):
        options["prefilter"] = True
        del options["normalization"]
    dtype = np.float64 if one.values.dtype == np.float64 else np.float32
    return resample_to_bcc(one, a=a, dtype=dtype).field(**options)


def kernel(base: Base) -> Iterator[Setting]:
    """Yield the settings of the knob "kernel"."""
    one = _one_lattice(base)
    if one is None:
        yield Setting("kernel", "radius, falloff", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    ways = {"lattice": "", "threshold": ", by weights"}
    now = (one.radius, one.falloff, _way(one))
    if (one.radius, one.falloff) not in KERNELS or now[2] not in ways:
        yield Setting(
            "kernel", "as given", "", lambda: base.scene, truth=INTERPOLATED, current=True, ripple=ripple_of(one)
        )
    for way, words in ways.items():
        for radius, falloff in KERNELS:
            options: dict[str, Any] = {"radius": radius, "falloff": falloff, "normalization": way}
            if getattr(one, "prefilter", False):
                options["prefilter"] = False
            if way == "threshold" and way != one.normalization:
                # Low enough that only the border of the volume falls below it.
                options["w0"] = 0.5 * lattice_constant(radius, falloff, "bcc" if one.lattice == "bcc" else "cartesian")
            yield Setting(
                "kernel",
                f"({radius:g}, {falloff:g}){words}",
                call_text("RegularField", options),
                lambda options=options: base.replace(field=regular(one, **options)),  # type: ignore[misc]
                truth=INTERPOLATED,
                series="by weights" if way == "threshold" else "",
                current=(radius, falloff, way) == now,
                ripple=_ripple(one.lattice, radius, falloff, way, float(options.get("w0", one.w0))),
            )


def _way(one: RegularField) -> str:
    return "prefilter" if getattr(one, "prefilter", False) else one.normalization


def prefilter(base: Base) -> Iterator[Setting]:
    """Yield the settings of the knob "prefilter"."""
    one = _one_lattice(base)
    if one is None:
        yield Setting("prefilter", "on", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    now = (one.radius, one.falloff) if getattr(one, "prefilter", False) else None
    yield Setting(
        "prefilter",
        "as given" if now in KERNELS or now is None else _kernel_text(one),
        "",
        lambda: base.scene,
        truth=INTERPOLATED,
        current=True,
        series="" if now is None or now in KERNELS else "prefiltered",
        ripple=ripple_of(one),
    )
    for radius, falloff in KERNELS:
        if (radius, falloff) == now:
            continue
        options = {"radius": radius, "falloff": falloff, "prefilter": True}
        yield Setting(
            "prefilter",
            f"({radius:g}, {falloff:g}), prefiltered",
            call_text("RegularField", options),
            lambda radius=radius, falloff=falloff: base.replace(  # type: ignore[misc]
                field=prefiltered(one, radius, falloff)
            ),
            truth=INTERPOLATED,
            ripple=_ripple(one.lattice, radius, falloff, "prefilter"),
            series="prefiltered",
            is_truth=(radius, falloff) == BEST_KERNEL,
        )


def prefiltered(one: RegularField, radius: float, falloff: float) -> RegularField:
    """Return a field whose sum passes through the samples of another one."""
    return regular(one, radius=radius, falloff=falloff, normalization="lattice", prefilter=True)


def interpolating(base: Base) -> Scene:
    """Return the scene of the field that passes through the samples, by which lattices are judged."""
    one = _one_lattice(base)
    if one is None:
        raise complain("there is no lattice to judge by", f"{len(base.scene.fields)} fields", "one regular field")
    return base.replace(field=prefiltered(one, *BEST_KERNEL))


def ripple_of(one: RegularField) -> tuple[float, float] | None:
    """Return the ripple of a field's kernels."""
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

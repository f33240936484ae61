"""The knobs and their rungs: what is changed in a scene, and what the reference draws of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.camera import Camera
from sheetsplat.errors import InvalidInput, Unsupported, complain
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.ripple import lattice_constant, lattice_ripple
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

# Against which picture a rung is measured.
CONVERGED = "converged"
SLICES = "slices"
INTERPOLATED = "interpolated"
GIVEN = "given"

#: Every knob and what it trades for time, in the order of the report.
KNOBS: dict[str, str] = {
    "slice_spacing": "distance of slices",
    "classification": "points, slabs, or the intervals between slices, at several distances of slices",
    "gradient": "differences of sheets, or the kernels' own derivatives",
    "cut_off": "where a kernel's Gaussian, of the same width, is cut off",
    "precision": "numbers of the sheets, on every backend",
    "table_size": "points of the transfer function, evenly spaced",
    "opacity_stop": "opacity at which a pixel is done",
    "filter": "widening of kernels smaller than a pixel or a slice distance",
    "image_scale": "pixels drawn, before the picture is enlarged",
    "lattice": "samples on a Cartesian or a body-centred cubic lattice",
    "kernel": "radius, falloff and normalisation of a lattice's kernels",
    "prefilter": "coefficients by which a lattice's sum passes through its samples",
}

_SPACINGS = (4.0, 2.0, 1.0, 0.5, 0.25)
_CUTS = (0.9, 0.8, 0.7, 0.6, 0.5)
_PRECISIONS = (
    *(("gl", precision) for precision in ("uint8", "float16", "float32")),
    *(("cpu", precision) for precision in ("float32", "float64")),
)
_TABLES = (16, 64, 256, 1024, 4096)
_STOPS = (0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)
_SCALES = (2, 4)
# Edges of BCC lattices, relative to the one of equal quality.
_EDGES = (1.25, 1.0, 0.9, 0.8)
# Radius in sample distances, and falloff.
KERNELS = ((2.0, 5.0), (2.5, 7.0), (3.0, 8.0))
# Of the field through the samples that lattices are judged by.
BEST_KERNEL = KERNELS[1]


@dataclass(frozen=True)
class Base:
    """What is varied: a scene whose distances are said, its camera, and the renderer's settings."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    backend: str
    precision: str
    settings: dict[str, Any]

    def replace(self, **changes: Any) -> Scene:
        """Return the scene with some options changed."""
        return self.scene.replace(**changes)


@dataclass(frozen=True)
class Rung:
    """One setting of one knob.

    Attributes
    ----------
    knob, setting
        Its names.
    how
        What to write in Python to have it.
    make
        Returns the scene that is drawn.
    judge
        Returns the scene that the reference draws, where that is another one: tables and cut-offs are arithmetic.
    settings
        Of the renderer, beside those of the base.
    scale
        By which the picture is smaller than it is shown.
    truth
        Which picture the error is measured against.
    current
        It is what the scene says already.
    reason
        Why it cannot be had, where that is known from the start.
    ripple
        Of a constant field: root mean square and largest, relative.
    is_truth
        It is the field that lattices are held against.
    """

    knob: str
    setting: str
    how: str = ""
    make: Callable[[], Scene] | None = None
    judge: Callable[[], Scene] | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    scale: int = 1
    truth: str = CONVERGED
    current: bool = False
    reason: str = ""
    ripple: tuple[float, float] | None = None
    is_truth: bool = False

    def gradient(self, base: Base) -> str:
        """Return the kind of gradients that it is drawn with."""
        named = self.setting.split(",")[0] if self.knob == "gradient" else ""
        now: str = base.scene.options["gradient"]
        return named if named in ("sheets", "analytic") else now


def rungs(base: Base, knob: str) -> list[Rung]:
    """Return the rungs of one knob, those that cannot be had with their reason."""
    return list(_RUNGS[knob](base))


def _times(factor: float) -> str:
    """Return a factor of the distance of slices in words."""
    return f"Δs × {factor:g}" if factor >= 1 else f"Δs / {1 / factor:g}"


def _without(base: Base, *modes: str) -> str:
    mode = base.scene.mode
    return f"says nothing in mode {mode}" if mode in modes else ""


def _slice_spacing(base: Base) -> Iterator[Rung]:
    for factor in _SPACINGS:
        spacing = factor * base.scene.slice_spacing
        yield Rung(
            "slice_spacing",
            _times(factor),
            f"Scene(slice_spacing={spacing:.6g})",
            lambda spacing=spacing: base.replace(slice_spacing=spacing),  # type: ignore[misc]
            current=factor == 1.0,
        )


_CLASSES: dict[str, dict[str, Any]] = {
    "point": {"sampling": "point", "preintegration": False},
    "slab": {"sampling": "slab", "preintegration": False},
    "pre-integrated": {"sampling": "point", "preintegration": True},
    "second order": {"sampling": "point", "preintegration": "second_order"},
}


def _classification(base: Base) -> Iterator[Rung]:
    given = base.scene.options
    now = {name: given[name] for name in ("sampling", "preintegration")}
    known = {name: changes for name, changes in _CLASSES.items() if changes == now}
    names = list(known) or ["as given"]
    yield Rung("classification", names[0], _call("Scene", now), lambda: base.scene, current=True)
    for name, changes in _CLASSES.items():
        if name in known:
            continue
        if changes["preintegration"] and base.scene.mode != "composite":
            yield Rung("classification", name, reason=f"says nothing in mode {base.scene.mode}")
            continue
        for factor in _SPACINGS[:-1]:
            spacing = factor * base.scene.slice_spacing
            options = {**changes, "slice_spacing": spacing}
            yield Rung(
                "classification",
                name if factor == 1.0 else f"{name}, {_times(factor)}",
                _call("Scene", changes if factor == 1.0 else options),
                lambda options=options: base.replace(**options),  # type: ignore[misc]
            )


def _gradient(base: Base) -> Iterator[Rung]:
    reason = _without(base, "xray", "mip")
    if not reason and not calls_for_gradients(base.scene):
        reason = "nothing in the scene calls for gradients"
    if reason:
        yield Rung("gradient", "sheets, analytic", reason=reason)
        return
    now = base.scene.options["gradient"]
    yield Rung("gradient", now, f"Scene(gradient={now!r})", lambda: base.scene, current=True)
    other = "analytic" if now == "sheets" else "sheets"
    for factor in _SPACINGS[1:-1]:
        options: dict[str, Any] = {"gradient": other}
        if factor != 1.0:
            options["slice_spacing"] = factor * base.scene.slice_spacing
        yield Rung(
            "gradient",
            other if factor == 1.0 else f"{other}, {_times(factor)}",
            _call("Scene", options),
            lambda options=options: base.replace(**options),  # type: ignore[misc]
        )


def calls_for_gradients(scene: Scene) -> bool:
    """Return whether anything in a scene's picture looks at gradients."""
    lit = bool(scene.lights) or scene.options["gradient_opacity"] is not None
    return lit and scene.mode in ("composite", "isosurface")


def _cut_off(base: Base) -> Iterator[Rung]:
    yield Rung("cut_off", "as given", "", lambda: base.scene, current=True)
    for cut in _CUTS:
        yield Rung(
            "cut_off",
            f"support × {cut:g}",
            f"radius or scales × {cut:g}, falloff × {cut * cut:.3g}",
            lambda cut=cut: base.replace(field=[cut_off(one, cut) for one in base.scene.fields]),  # type: ignore[misc]
            lambda: base.scene,
        )


def cut_off(one: Field, cut: float) -> Field:
    """Return a field of the same Gaussians whose supports are `cut` times as large."""
    if isinstance(one, RegularField):
        return regular(one, radius=one.radius * cut, falloff=one.falloff * cut**2)
    if isinstance(one, EllipsoidField):
        return EllipsoidField(
            one.centers,
            one.scales * cut,
            one.rotations,
            one.values,
            weights=one.weights,
            normalization=one.normalization,  # type: ignore[arg-type]
            w0=one.w0,
            falloff=one.falloff * cut**2,
            cell_volume=one.cell_volume,
        )
    raise complain("the kernels cannot be cut off", type(one).__name__, "a regular or a scattered field")


def regular(one: RegularField, **changes: Any) -> RegularField:
    """Return a regular field with some options changed."""
    names = ("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "nan")
    options: dict[str, Any] = {name: getattr(one, name) for name in names}
    if getattr(one, "prefilter", False):
        options["prefilter"] = True
    return RegularField(one.values, **{**options, **changes})


def _precision(base: Base) -> Iterator[Rung]:
    there = (base.backend, base.precision)
    choices = _PRECISIONS if there in _PRECISIONS else (*_PRECISIONS, there)
    for backend, precision in choices:
        settings = {"backend": backend, "precision": precision, "allow_inexact": True}
        yield Rung(
            "precision",
            f"{backend} {precision}",
            _call("Renderer", settings if (backend, precision) != there else {"backend": backend}),
            lambda: base.scene,
            settings=settings,
            current=(backend, precision) == there,
        )


def _table_size(base: Base) -> Iterator[Rung]:
    reason = _without(base, "xray", "mip", "isosurface")
    if reason:
        yield Rung("table_size", "points", reason=reason)
        return
    points = len(base.scene.transfer_function.points)
    yield Rung("table_size", f"as given, {points} points", "", lambda: base.scene, current=True)
    for count in _TABLES:
        yield Rung(
            "table_size",
            f"{count} points",
            f"TransferFunction of {count} points, evenly spaced",
            lambda count=count: base.replace(  # type: ignore[misc]
                transfer_function=table(base.scene.transfer_function, count)
            ),
            lambda: base.scene,
        )


def table(function: TransferFunction, count: int) -> TransferFunction:
    """Return the transfer function that goes through `count` evenly spaced points of another one."""
    if not function.v_min < function.v_max:
        raise complain(
            "the transfer function cannot be made a table", f"{len(function.points)} point", "two values that differ"
        )
    values = np.linspace(function.v_min, function.v_max, count)
    return TransferFunction(np.column_stack([values, function.at(values)]))


def _opacity_stop(base: Base) -> Iterator[Rung]:
    reason = _without(base, "xray", "mip", "isosurface")
    if reason:
        yield Rung("opacity_stop", "A_stop", reason=reason)
        return
    now = float(base.scene.options["opacity_stop"])
    for stop in sorted({*_STOPS, now}):
        yield Rung(
            "opacity_stop",
            "1, never" if stop == 1.0 else f"{stop:g}",
            f"Scene(opacity_stop={stop:g})",
            lambda stop=stop: base.replace(opacity_stop=stop),  # type: ignore[misc]
            current=stop == now,
        )


def _filter(base: Base) -> Iterator[Rung]:
    for name in (None, "ewa"):
        yield Rung(
            "filter",
            name or "none",
            f"Scene(filter={name!r})",
            lambda name=name: base.replace(filter=name),  # type: ignore[misc]
            current=base.scene.filter == name,
        )


def _image_scale(base: Base) -> Iterator[Rung]:
    yield Rung("image_scale", "1", f"size={base.size}", lambda: base.scene, current=True)
    for scale in _SCALES:
        small = smaller(base.size, scale)
        reason = "" if min(small) >= 2 else f"the picture would have {small[0]} x {small[1]} pixels"
        yield Rung(
            "image_scale",
            f"1/{scale}",
            f"size={small}, enlarged bilinearly",
            lambda: base.scene,
            scale=scale,
            reason=reason,
        )


def smaller(size: tuple[int, int], scale: int) -> tuple[int, int]:
    """Return the size of a picture drawn smaller."""
    return max(1, round(size[0] / scale)), max(1, round(size[1] / scale))


def enlarge(picture: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a picture (h, w) or (h, w, 4) at another size, bilinearly; what it shows is as high as before.

    Beyond the outermost pixels' centres their values hold.
    """
    height, width = picture.shape[:2]
    # World units per pixel follow from the height alone, so both axes have the factor of the rows.
    factor = height / size[1]
    taken = picture.astype(np.float64)
    for axis, (count, wanted) in enumerate(((height, size[1]), (width, size[0]))):
        at = np.clip((np.arange(wanted) + 0.5 - 0.5 * wanted) * factor + 0.5 * count - 0.5, 0.0, count - 1.0)
        low = np.minimum(at.astype(np.int64), max(0, count - 2))
        share = (at - low).reshape([-1 if axis == a else 1 for a in range(taken.ndim)])
        high = np.minimum(low + 1, count - 1)
        taken = (1.0 - share) * np.take(taken, low, axis) + share * np.take(taken, high, axis)
    return taken.astype(np.float32)


def _one_lattice(base: Base) -> RegularField | None:
    fields = base.scene.fields
    return fields[0] if len(fields) == 1 and isinstance(fields[0], RegularField) else None


_NO_LATTICE = "for scenes of one regular field"


def _kernel_text(one: RegularField) -> str:
    name = "Cartesian" if one.lattice == "cartesian" else "BCC"
    filtered = ", prefiltered" if getattr(one, "prefilter", False) else ""
    return f"{name} ({one.radius:g}, {one.falloff:g}){filtered}"


def _lattice(base: Base) -> Iterator[Rung]:
    one = _one_lattice(base)
    if one is None:
        yield Rung("lattice", "Cartesian, BCC", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    yield Rung(
        "lattice",
        f"{_kernel_text(one)}, as given",
        "",
        lambda: base.scene,
        truth=INTERPOLATED,
        current=True,
        ripple=ripple_of(one),
    )
    if one.lattice != "cartesian":
        yield Rung(
            "lattice", "Cartesian", truth=INTERPOLATED, reason="a BCC lattice is not resampled to a Cartesian one"
        )
        return
    for edge in _EDGES:
        yield Rung(
            "lattice",
            f"BCC, {edge**-3 / math.sqrt(2):.2f} of the samples",
            f"resample_to_bcc(field, a={edge:g} × the edge of equal quality)",
            lambda edge=edge: base.replace(field=_resampled(one, edge)),  # type: ignore[misc]
            truth=INTERPOLATED,
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


def _kernel(base: Base) -> Iterator[Rung]:
    one = _one_lattice(base)
    if one is None:
        yield Rung("kernel", "radius, falloff", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    ways = {"lattice": "", "threshold": ", by weights"}
    now = (one.radius, one.falloff, _way(one))
    if (one.radius, one.falloff) not in KERNELS or now[2] not in ways:
        yield Rung(
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
            yield Rung(
                "kernel",
                f"({radius:g}, {falloff:g}){words}",
                _call("RegularField", options),
                lambda options=options: base.replace(field=regular(one, **options)),  # type: ignore[misc]
                truth=INTERPOLATED,
                current=(radius, falloff, way) == now,
                ripple=_ripple(one.lattice, radius, falloff, way, float(options.get("w0", one.w0))),
            )


def _way(one: RegularField) -> str:
    return "prefilter" if getattr(one, "prefilter", False) else one.normalization


def _prefilter(base: Base) -> Iterator[Rung]:
    one = _one_lattice(base)
    if one is None:
        yield Rung("prefilter", "on", truth=INTERPOLATED, reason=_NO_LATTICE)
        return
    now = (one.radius, one.falloff) if getattr(one, "prefilter", False) else None
    yield Rung(
        "prefilter",
        "as given" if now in KERNELS or now is None else _kernel_text(one),
        "",
        lambda: base.scene,
        truth=INTERPOLATED,
        current=True,
        ripple=ripple_of(one),
    )
    for radius, falloff in KERNELS:
        if (radius, falloff) == now:
            continue
        options = {"radius": radius, "falloff": falloff, "prefilter": True}
        yield Rung(
            "prefilter",
            f"({radius:g}, {falloff:g}), prefiltered",
            _call("RegularField", options),
            lambda radius=radius, falloff=falloff: base.replace(  # type: ignore[misc]
                field=prefiltered(one, radius, falloff)
            ),
            truth=INTERPOLATED,
            ripple=_ripple(one.lattice, radius, falloff, "prefilter"),
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


def _call(name: str, options: dict[str, Any]) -> str:
    parts = [f"{key}={value:.6g}" if isinstance(value, float) else f"{key}={value!r}" for key, value in options.items()]
    return f"{name}({', '.join(parts)})"


_RUNGS: dict[str, Callable[[Base], Iterator[Rung]]] = {
    "slice_spacing": _slice_spacing,
    "classification": _classification,
    "gradient": _gradient,
    "cut_off": _cut_off,
    "precision": _precision,
    "table_size": _table_size,
    "opacity_stop": _opacity_stop,
    "filter": _filter,
    "image_scale": _image_scale,
    "lattice": _lattice,
    "kernel": _kernel,
    "prefilter": _prefilter,
}

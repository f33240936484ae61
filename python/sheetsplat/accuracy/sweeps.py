"""The settings of each knob; those about lattices are in `lattice_sweeps`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.accuracy import lattice_sweeps
from sheetsplat.accuracy.knobs import BEST, CONVERGED, INTERPOLATED, Base, Setting, call_text
from sheetsplat.backends import BACKEND_TRAITS
from sheetsplat.choose.picture import scene_of_quality
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.modes import TRAITS
from sheetsplat.options.picture import unused
from sheetsplat.options.quality import QUALITIES
from sheetsplat.options.scene import calls_for_gradients
from sheetsplat.transfer import TransferFunction

_SPACINGS = (4.0, 2.0, 1.0, 0.5, 0.25)
_CUTS = (0.9, 0.8, 0.7, 0.6, 0.5)
_PRECISIONS = tuple(
    (one.name, precision) for one in BACKEND_TRAITS.values() if not one.defines for precision in one.precisions
)
_TABLES = (16, 64, 256, 1024, 4096)
_STOPS = (0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)
_SCALES = (2, 4)


def sweep(base: Base, knob: str) -> list[Setting]:
    """Return the settings of one knob; those that are not available have a reason."""
    title, excluded = _CONDITIONS.get(knob, ("", None))
    reason = "" if excluded is None else excluded(base)
    settings = [Setting(title, reason=reason)] if reason else _SWEEPS[knob](base)
    truth = BEST if knob == "quality" else INTERPOLATED if knob in lattice_sweeps.SWEEPS else CONVERGED
    return [replace(setting, knob=knob, truth=truth) for setting in settings]


def _times(factor: float) -> str:
    """Return a factor of the distance of slices in words."""
    return f"Δs × {factor:g}" if factor >= 1 else f"Δs / {1 / factor:g}"


def _unused(option: str, base: Base) -> str:
    """Return why an option has no effect in the scene's mode, or an empty text."""
    mode = base.scene.mode
    return f"not used in mode {mode}" if unused(mode, [option]) else ""


def _no_stop(base: Base) -> str:
    """Return why the opacity at which pixels are finished has no effect, or an empty text."""
    # An opaque surface finishes a pixel whatever the stop is.
    opaque = TRAITS[base.scene.mode].shows_surfaces and all(opacity == 1.0 for _, opacity in base.scene.surfaces)
    return "not used in mode isosurface" if opaque else _unused("opacity_stop", base)


def _no_gradients(base: Base) -> str:
    """Return why gradients have no effect, or an empty text."""
    needless = "" if calls_for_gradients(base.scene.options) else "nothing in the scene uses gradients"
    return _unused("gradient", base) or needless


def _spaced(base: Base, factor: float) -> dict[str, float]:
    return {"slice_spacing": factor * base.scene.slice_spacing}


def _at_spacings(base: Base, name: str, changes: dict[str, Any], factors: Sequence[float]) -> Iterator[Setting]:
    """Yield the settings with some changes at several distances of slices."""
    for factor in factors:
        if factor == 1.0:
            yield Setting(name, changes, series=name)
        else:
            yield Setting(f"{name}, {_times(factor)}", {**changes, **_spaced(base, factor)}, series=name)


def _quality(base: Base) -> Iterator[Setting]:
    now = base.scene.quality
    for name in QUALITIES:
        yield Setting(
            name,
            how=call_text("render", {"quality": name}),
            whole=partial(scene_of_quality, base.scene, name, base.camera, base.size),
            series="quality",
            current=now is not None and now.name == name and not any(one.given for one in now.settings),
        )


def _slice_spacing(base: Base) -> Iterator[Setting]:
    for factor in _SPACINGS:
        yield Setting(_times(factor), _spaced(base, factor), current=factor == 1.0)


_CLASSES: dict[str, dict[str, Any]] = {
    "point": {"sampling": "point", "preintegration": False},
    "slab": {"sampling": "slab", "preintegration": False},
    "pre-integrated": {"sampling": "point", "preintegration": True},
    "second order": {"sampling": "point", "preintegration": "second_order"},
}


def _classification(base: Base) -> Iterator[Setting]:
    now = {name: base.scene.options[name] for name in ("sampling", "preintegration")}
    known = next((name for name, changes in _CLASSES.items() if changes == now), "as given")
    yield Setting(known, now, current=True, series=known)
    for name, changes in _CLASSES.items():
        reason = _unused("preintegration", base) if changes["preintegration"] else ""
        if reason and name != known:
            yield Setting(name, reason=reason)
        elif name != known:
            yield from _at_spacings(base, name, changes, _SPACINGS[:-1])


def _gradient(base: Base) -> Iterator[Setting]:
    now = base.scene.options["gradient"]
    yield Setting(now, {"gradient": now}, current=True, series=now)
    other = "analytic" if now == "sheets" else "sheets"
    yield from _at_spacings(base, other, {"gradient": other}, _SPACINGS[1:-1])


def _cut_off(base: Base) -> Iterator[Setting]:
    yield Setting("as given", current=True)
    for cut in _CUTS:
        yield Setting(
            f"support × {cut:g}",
            {"field": partial(_cut_offs, base, cut)},
            f"radius or scales × {cut:g}, falloff × {cut * cut:.3g}",
            judged_as_given=True,
        )


def _cut_offs(base: Base, cut: float) -> list[list[Field]]:
    return [[cut_off(one, cut) for one in group] for group in base.scene.groups]


def cut_off(one: Field, cut: float) -> Field:
    """Return a field of the same Gaussians whose supports are `cut` times as large."""
    if isinstance(one, RegularField):
        return one.replace(radius=one.radius * cut, falloff=one.falloff * cut**2)
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
            base=one.base,
        )
    raise complain("the kernels cannot be cut off", type(one).__name__, "a regular or a scattered field")


def _precision(base: Base) -> Iterator[Setting]:
    there = (base.backend, base.precision)
    for backend, precision in _PRECISIONS if there in _PRECISIONS else (*_PRECISIONS, there):
        settings = {"backend": backend, "precision": precision, "allow_inexact": True}
        current = (backend, precision) == there
        how = call_text("Renderer", {"backend": backend} if current else settings)
        yield Setting(f"{backend} {precision}", how=how, renderer=settings, current=current)


def _table_size(base: Base) -> Iterator[Setting]:
    functions = base.scene.transfer_functions
    most = max(len(function.points) for function in functions)
    yield Setting(f"as given, {most} points", current=True)
    for count in _TABLES:
        yield Setting(
            f"{count} points",
            {"transfer_function": partial(_tables, base, count)},
            f"TransferFunction of {count} points, evenly spaced",
            judged_as_given=True,
        )


def _tables(base: Base, count: int) -> list[TransferFunction]:
    return [table(function, count) for function in base.scene.transfer_functions]


def table(function: TransferFunction, count: int) -> TransferFunction:
    """Return the transfer function that goes through `count` evenly spaced points of another one."""
    if not function.v_min < function.v_max:
        raise complain(
            "the transfer function cannot be made a table", f"{len(function.points)} point", "two values that differ"
        )
    values = np.linspace(function.v_min, function.v_max, count)
    return TransferFunction(np.column_stack([values, function.at(values)]))


def _opacity_stop(base: Base) -> Iterator[Setting]:
    now = float(base.scene.options["opacity_stop"])
    for stop in sorted({*_STOPS, now}):
        yield Setting("1, never" if stop == 1.0 else f"{stop:g}", {"opacity_stop": stop}, current=stop == now)


def _filter(base: Base) -> Iterator[Setting]:
    for name in (None, "ewa"):
        yield Setting(name or "none", {"filter": name}, current=base.scene.filter == name)


def _image_scale(base: Base) -> Iterator[Setting]:
    yield Setting("1", how=f"size={base.size}", current=True)
    for scale in _SCALES:
        small = smaller(base.size, scale)
        reason = "" if min(small) >= 2 else f"the picture would have {small[0]} x {small[1]} pixels"
        yield Setting(f"1/{scale}", how=f"size={small}, enlarged bilinearly", scale=scale, reason=reason)


def smaller(size: tuple[int, int], scale: int) -> tuple[int, int]:
    """Return the size of a picture drawn smaller."""
    return max(1, round(size[0] / scale)), max(1, round(size[1] / scale))


def enlarge(picture: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a picture (h, w) or (h, w, 4) at another size, bilinearly; its height in world units stays the same.

    Values are constant beyond the centres of the outermost pixels.
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


_SWEEPS: dict[str, Callable[[Base], Iterator[Setting]]] = {
    "quality": _quality,
    "slice_spacing": _slice_spacing,
    "classification": _classification,
    "gradient": _gradient,
    "cut_off": _cut_off,
    "precision": _precision,
    "table_size": _table_size,
    "opacity_stop": _opacity_stop,
    "filter": _filter,
    "image_scale": _image_scale,
    **lattice_sweeps.SWEEPS,
}
# Knobs that some scenes do not have: the name of their only row there, and why it is not measured.
_CONDITIONS: dict[str, tuple[str, Callable[[Base], str]]] = {
    "gradient": ("sheets, analytic", _no_gradients),
    "table_size": ("points", partial(_unused, "opacity")),
    "opacity_stop": ("A_stop", _no_stop),
    "lattice": ("Cartesian, BCC", lattice_sweeps.no_lattice),
    "kernel": ("radius, falloff", lattice_sweeps.no_lattice),
    "prefilter": ("on", lattice_sweeps.no_lattice),
}

"""The settings of each knob; those about lattices are in `lattice_sweeps`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.accuracy import lattice_sweeps
from sheetsplat.accuracy.knobs import Base, Setting, call_text, calls_for_gradients
from sheetsplat.accuracy.lattice_sweeps import regular
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.options.picture import unused
from sheetsplat.transfer import TransferFunction

_SPACINGS = (4.0, 2.0, 1.0, 0.5, 0.25)
_CUTS = (0.9, 0.8, 0.7, 0.6, 0.5)
_PRECISIONS = (
    *(("gl", precision) for precision in ("uint8", "float16", "float32")),
    *(("cpu", precision) for precision in ("float32", "float64")),
)
_TABLES = (16, 64, 256, 1024, 4096)
_STOPS = (0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)
_SCALES = (2, 4)


def sweep(base: Base, knob: str) -> list[Setting]:
    """Return the settings of one knob; those that are not available have a reason."""
    return list(_SWEEPS[knob](base))


def _times(factor: float) -> str:
    """Return a factor of the distance of slices in words."""
    return f"Δs × {factor:g}" if factor >= 1 else f"Δs / {1 / factor:g}"


def _unused(base: Base, option: str) -> str:
    """Return why an option has no effect in the scene's mode, or an empty text."""
    mode = base.scene.mode
    return f"not used in mode {mode}" if unused(mode, [option]) else ""


def _slice_spacing(base: Base) -> Iterator[Setting]:
    for factor in _SPACINGS:
        spacing = factor * base.scene.slice_spacing
        yield Setting(
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


def _classification(base: Base) -> Iterator[Setting]:
    given = base.scene.options
    now = {name: given[name] for name in ("sampling", "preintegration")}
    known = {name: changes for name, changes in _CLASSES.items() if changes == now}
    names = list(known) or ["as given"]
    yield Setting(
        "classification", names[0], call_text("Scene", now), lambda: base.scene, current=True, series=names[0]
    )
    for name, changes in _CLASSES.items():
        if name in known:
            continue
        reason = _unused(base, "preintegration") if changes["preintegration"] else ""
        if reason:
            yield Setting("classification", name, reason=reason)
            continue
        for factor in _SPACINGS[:-1]:
            spacing = factor * base.scene.slice_spacing
            options = {**changes, "slice_spacing": spacing}
            yield Setting(
                "classification",
                name if factor == 1.0 else f"{name}, {_times(factor)}",
                call_text("Scene", changes if factor == 1.0 else options),
                lambda options=options: base.replace(**options),  # type: ignore[misc]
                series=name,
            )


def _gradient(base: Base) -> Iterator[Setting]:
    reason = _unused(base, "gradient")
    if not reason and not calls_for_gradients(base.scene):
        reason = "nothing in the scene uses gradients"
    if reason:
        yield Setting("gradient", "sheets, analytic", reason=reason)
        return
    now = base.scene.options["gradient"]
    yield Setting("gradient", now, f"Scene(gradient={now!r})", lambda: base.scene, current=True, series=now)
    other = "analytic" if now == "sheets" else "sheets"
    for factor in _SPACINGS[1:-1]:
        options: dict[str, Any] = {"gradient": other}
        if factor != 1.0:
            options["slice_spacing"] = factor * base.scene.slice_spacing
        yield Setting(
            "gradient",
            other if factor == 1.0 else f"{other}, {_times(factor)}",
            call_text("Scene", options),
            lambda options=options: base.replace(**options),  # type: ignore[misc]
            series=other,
        )


def _cut_off(base: Base) -> Iterator[Setting]:
    yield Setting("cut_off", "as given", "", lambda: base.scene, current=True)
    for cut in _CUTS:
        yield Setting(
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


def _precision(base: Base) -> Iterator[Setting]:
    there = (base.backend, base.precision)
    choices = _PRECISIONS if there in _PRECISIONS else (*_PRECISIONS, there)
    for backend, precision in choices:
        settings = {"backend": backend, "precision": precision, "allow_inexact": True}
        yield Setting(
            "precision",
            f"{backend} {precision}",
            call_text("Renderer", settings if (backend, precision) != there else {"backend": backend}),
            lambda: base.scene,
            renderer=settings,
            current=(backend, precision) == there,
        )


def _table_size(base: Base) -> Iterator[Setting]:
    reason = _unused(base, "opacity")
    if reason:
        yield Setting("table_size", "points", reason=reason)
        return
    points = len(base.scene.transfer_function.points)
    yield Setting("table_size", f"as given, {points} points", "", lambda: base.scene, current=True)
    for count in _TABLES:
        yield Setting(
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


def _opacity_stop(base: Base) -> Iterator[Setting]:
    reason = _unused(base, "opacity_stop")
    if reason:
        yield Setting("opacity_stop", "A_stop", reason=reason)
        return
    now = float(base.scene.options["opacity_stop"])
    for stop in sorted({*_STOPS, now}):
        yield Setting(
            "opacity_stop",
            "1, never" if stop == 1.0 else f"{stop:g}",
            f"Scene(opacity_stop={stop:g})",
            lambda stop=stop: base.replace(opacity_stop=stop),  # type: ignore[misc]
            current=stop == now,
        )


def _filter(base: Base) -> Iterator[Setting]:
    for name in (None, "ewa"):
        yield Setting(
            "filter",
            name or "none",
            f"Scene(filter={name!r})",
            lambda name=name: base.replace(filter=name),  # type: ignore[misc]
            current=base.scene.filter == name,
        )


def _image_scale(base: Base) -> Iterator[Setting]:
    yield Setting("image_scale", "1", f"size={base.size}", lambda: base.scene, current=True)
    for scale in _SCALES:
        small = smaller(base.size, scale)
        reason = "" if min(small) >= 2 else f"the picture would have {small[0]} x {small[1]} pixels"
        yield Setting(
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


_SWEEPS: dict[str, Callable[[Base], Iterator[Setting]]] = {
    "slice_spacing": _slice_spacing,
    "classification": _classification,
    "gradient": _gradient,
    "cut_off": _cut_off,
    "precision": _precision,
    "table_size": _table_size,
    "opacity_stop": _opacity_stop,
    "filter": _filter,
    "image_scale": _image_scale,
    "lattice": lattice_sweeps.lattice,
    "kernel": lattice_sweeps.kernel,
    "prefilter": lattice_sweeps.prefilter,
}

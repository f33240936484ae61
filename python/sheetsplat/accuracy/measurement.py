"""The measurement of what accuracy costs in time."""

from __future__ import annotations

import math
import os
import platform
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sheetsplat._checks import check_progress, choice, image_size, instance, names, number, shown, whole
from sheetsplat.accuracy import measure
from sheetsplat.accuracy.knobs import (
    BEST,
    CLOCKS,
    CONVERGED,
    GIVEN,
    INTERPOLATED,
    KNOBS,
    SLICES,
    Base,
    Clock,
    Setting,
)
from sheetsplat.accuracy.lattice_sweeps import BEST_KERNEL, interpolating
from sheetsplat.accuracy.report import AccuracyReport, AccuracyRow, TruthText, front
from sheetsplat.accuracy.sweeps import sweep
from sheetsplat.backends import Backend
from sheetsplat.camera import Camera
from sheetsplat.choose.picture import scene_of_quality
from sheetsplat.errors import Cancelled, Error, complain, option_refs, unusable
from sheetsplat.image import Image, pixels_of
from sheetsplat.notices import muted
from sheetsplat.options.core import COLORED
from sheetsplat.options.renderer import Progress, unused_by
from sheetsplat.options.scene import calls_for_gradients
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

_FAILED = "accuracy: the measurement cannot be made"
_MOST_REPEATS = 1000
# Times and errors below this share of another are reported as less: repeated measurements vary.
_CLEARLY = 0.95
_THROUGH = f"the field through the samples (prefiltered, radius {BEST_KERNEL[0]:g}, falloff {BEST_KERNEL[1]:g})"
# Shares of the progress: converged pictures count as so many settings.
_WEIGHT = {CONVERGED: 6.0, SLICES: 6.0, INTERPOLATED: 0.5, BEST: 6.0}


def measure_accuracy(
    scene: Scene,
    camera: Camera,
    *,
    size: tuple[int, int],
    backend: Backend,
    knobs: Iterable[str] | str | None,
    repeats: int,
    reference_seconds: float,
    clock: Clock,
    truth: Image | ArrayLike | None,
    progress: Progress | None,
    settings: Mapping[str, Any],
) -> AccuracyReport:
    """Check the arguments of `sheetsplat.accuracy`, and measure."""
    instance("accuracy: scene", scene, Scene)
    instance("accuracy: camera", camera, Camera)
    wanted = tuple(KNOBS) if knobs is None else names("accuracy: knobs", knobs, tuple(KNOBS))
    wanted = tuple(name for name in KNOBS if name in wanted)
    if not wanted:
        raise complain(_FAILED, "no knobs", f"at least one of: {', '.join(KNOBS)}")
    count = whole("accuracy: repeats", repeats)
    if not 1 <= count <= _MOST_REPEATS:
        raise complain(unusable("accuracy: repeats"), str(count), f"a whole number from 1 to {_MOST_REPEATS}")
    budget = number("accuracy: reference_seconds", reference_seconds)
    if not (math.isfinite(budget) and budget >= 0.0):
        raise complain(unusable("accuracy: reference_seconds"), f"{budget:g}", "seconds, at least 0")
    choice("accuracy: clock", clock, CLOCKS)
    check_progress("accuracy", progress)
    pixels = image_size(size)
    base = _base(scene, camera, pixels, backend, settings)
    with muted():
        return _Session(base, count, budget, clock, progress).run(wanted, _given_truth(truth, base))


def _base(scene: Scene, camera: Camera, size: tuple[int, int], backend: Backend, settings: Mapping[str, Any]) -> Base:
    given = dict(settings)
    goals = [name for name in ("max_error", "max_seconds") if given.get(name) is not None]
    if goals:
        raise complain(
            _FAILED,
            option_refs(goals),
            "fixed settings",
            "leave it out: it chooses the settings that are varied here",
        )
    plan = Renderer(backend, **given).plan(scene, camera, size=size)
    # Given explicitly: their defaults would change with the field.
    pinned = scene.replace(slice_spacing=scene.slice_spacing, reference_length=scene.reference_length)
    return Base(pinned.with_quality(scene.quality), camera, size, plan.backend, plan.precision, given)


def _given_truth(truth: Image | ArrayLike | None, base: Base) -> measure.Truth | None:
    if truth is None:
        return None
    try:
        values = np.asarray(pixels_of(truth), dtype=np.float64)
    except Exception:  # Objects of others raise whatever they like.
        raise complain(unusable("accuracy: truth"), shown(truth), "a picture") from None
    expected: tuple[int, ...] = (base.size[1], base.size[0])
    if base.scene.mode in COLORED:
        expected += (4,)
    if values.shape != expected or not np.isfinite(values).all():
        found = f"shape {values.shape}" if values.shape != expected else "numbers that are not finite"
        raise complain(unusable("accuracy: truth"), found, f"finite numbers, shape {expected}")
    return measure.Truth(values, math.nan, math.nan, "the picture that was given")


class _Session:
    """One measurement, with the pictures that several settings share."""

    def __init__(self, base: Base, repeats: int, budget: float, clock: str, progress: Progress | None) -> None:
        self._base = base
        self._repeats = repeats
        self._clock = clock
        self._progress = progress
        self._judge = measure.Judge(base.scene, base.camera, base.size, budget)
        self._truths: dict[str, measure.Truth] = {}
        self._refused: dict[str, str] = {}
        self._renderers: dict[tuple[tuple[str, Any], ...], Renderer] = {}
        self._now: tuple[measure.Drawn, measure.Arithmetic] | None = None
        self._done, self._all, self._told = 0.0, 1.0, 0.0
        # Pictures with gradients by differences converge to another limit than those with analytic gradients.
        self._two_limits = calls_for_gradients(base.scene.options)

    def run(self, knobs: tuple[str, ...], given: measure.Truth | None) -> AccuracyReport:
        settings = [setting for knob in knobs for setting in sweep(self._base, knob)]
        if given is not None:
            settings = [replace(setting, truth=GIVEN) for setting in settings]
        truths = {setting.truth for setting in settings if not setting.reason and setting.truth != GIVEN}
        if CONVERGED in truths and self._two_limits:
            truths.add(SLICES)
        self._all = len(settings) + sum(_WEIGHT[name] for name in truths)
        if given is not None:
            self._truths = {GIVEN: given}
        measured: list[AccuracyRow] = []
        for knob in knobs:
            measured += [self._row(setting) for setting in settings if setting.knob == knob]
            self._time_again()
        rows = front([self._timed(row) for row in measured], self._clock)
        texts = tuple(TruthText(name, one.text, one.uncertainty, one.order) for name, one in self._truths.items())
        plan = self._renderer({}).plan(self._base.scene, self._base.camera, size=self._base.size)
        self._tell(1.0)
        return AccuracyReport(
            size=self._base.size,
            backend=plan.backend,
            precision=plan.precision,
            device=plan.device,
            slice_spacing=self._base.scene.slice_spacing,
            repeats=self._repeats,
            clock=self._clock,
            rows=rows,
            truths=texts,
            notes=_notes(rows, self._clock),
            environment=_environment(),
        )

    def _tell(self, share: float) -> object:
        # Drawing and comparing a setting both report a share, which must not decrease.
        self._told = max(self._told, min(1.0, share))
        return None if self._progress is None else self._progress(self._told)

    def _watch(self, weight: float) -> Callable[[float], object] | None:
        if self._progress is None:
            return None
        start, length = self._done / self._all, weight / self._all
        return lambda done: self._tell(start + length * done)

    def _step(self, weight: float) -> None:
        self._done += weight
        if self._tell(self._done / self._all) is False:
            raise complain("the measurement was stopped", kind=Cancelled)

    def _renderer(self, settings: Mapping[str, Any]) -> Renderer:
        options = {**self._base.settings, "backend": self._base.backend, **settings}
        if settings:
            # Settings that another backend has; this one would warn about them.
            for name in unused_by(options["backend"]):
                options.pop(name, None)
        key = tuple(sorted((name, repr(value)) for name, value in options.items()))
        if key not in self._renderers:
            self._renderers[key] = Renderer(**options)
        return self._renderers[key]

    def _truth(self, name: str, setting: Setting | None = None) -> measure.Truth:
        """Return the picture from which errors are measured, with as many samples a pixel as a setting of a quality."""
        if name in self._refused:
            raise complain(self._refused[name], kind=Error)
        base = self._base
        samples = base.scene.supersampling
        if setting is not None and name == BEST:
            samples = setting.scene(base).supersampling
        is_own = samples == base.scene.supersampling
        key = name if is_own else f"{name}, {samples} x {samples} samples a pixel"
        if key not in self._truths:
            try:
                watch = self._watch(_WEIGHT[name])
                if name == INTERPOLATED:
                    scene, what = interpolating(base), _THROUGH
                    found = measure.same_slices(scene, base.camera, base.size, base.settings, watch)
                else:
                    # Only gradients by differences have a limit of their own.
                    scene, what = base.scene, "the same field"
                    if name == SLICES:
                        scene = base.scene.replace(gradient="sheets")
                    elif name == BEST:
                        best = scene_of_quality(base.scene, "best", base.camera, base.size)
                        scene = base.scene.replace(field=_fields_of(best), supersampling=samples)
                        what = "the field of quality best"
                    found = measure.limit(scene, base.camera, base.size, base.settings, watch, analytic=name != SLICES)
            except Error as error:
                self._refused[name] = f"nothing to measure against: {_reason(error)}"
                raise complain(self._refused[name], kind=Error) from None
            is_first = not any(known.startswith(name) for known in self._truths)
            self._truths[key] = replace(found, text=f"{what}, {found.text}")
            if is_first:
                self._step(_WEIGHT[name])
        return self._truths[key]

    def _time_again(self) -> None:
        """Time the unchanged scene once more, so that its frames are spread over the whole measurement."""
        if self._now is not None:
            base, (drawn, arithmetic) = self._base, self._now
            more = measure.draw(self._renderer({}), base.scene, base.camera, base.size, repeats=1)
            drawn = replace(drawn, walls=drawn.walls + more.walls, cpus=drawn.cpus + more.cpus)
            self._now = drawn, arithmetic

    def _timed(self, row: AccuracyRow) -> AccuracyRow:
        """Return the row of the unchanged scene with the times of all its frames; other rows as they are."""
        if not (row.current and row.measured and self._now is not None):
            return row
        return replace(row, **_times(self._now[0]))

    def _row(self, setting: Setting) -> AccuracyRow:
        row = self._measured(setting)
        self._step(1.0)
        return row

    def _measured(self, setting: Setting) -> AccuracyRow:
        named: dict[str, Any] = {"knob": setting.knob, "setting": setting.name, "how": setting.code}
        named |= {"current": setting.current, "truth": setting.truth, "series": setting.series}
        named["is_truth"] = setting.is_truth and setting.truth == INTERPOLATED
        if setting.ripple is not None:
            named |= {"ripple_rms": setting.ripple[0], "ripple_maximum": setting.ripple[1]}
        if setting.reason:
            return AccuracyRow(**named, reason=setting.reason)
        try:
            truth = self._truth(setting.truth, setting)
            drawn, arithmetic = self._drawn(setting)
        except Error as error:
            return AccuracyRow(**named, reason=_reason(error))
        found: dict[str, Any] = measure.difference(drawn.values, truth.values)
        plan = drawn.picture.plan
        return AccuracyRow(
            **named,
            **_times(drawn),
            **found,
            **{f"arithmetic_{name}": value for name, value in vars(arithmetic).items()},
            slicing_rmse=self._slicing(setting, drawn, found["rmse"]),
            backend=plan.backend,
            precision=plan.precision,
            slices=plan.slices,
            kernels_drawn=round(drawn.picture.stats.get("kernels_drawn", 0.0)),
        )

    def _slicing(self, setting: Setting, drawn: measure.Drawn, error: float) -> float:
        """Return the distance from the limit of fine slices with the gradients of the setting's own kind."""
        if setting.truth != CONVERGED:
            return math.nan
        if not self._two_limits or setting.gradient(self._base) == "analytic":
            return error
        try:
            return measure.difference(drawn.values, self._truth(SLICES).values)["rmse"]
        except Error as error:
            _reason(error)
            return math.nan

    def _drawn(self, setting: Setting) -> tuple[measure.Drawn, measure.Arithmetic]:
        """Return the picture of a setting; the unchanged scene is drawn once for all knobs."""
        if setting.current and self._now is not None:
            return self._now
        base = self._base
        scene = setting.scene(base)
        # In the setting that the scene already has, nothing is forced.
        renderer = self._renderer({} if setting.current else setting.renderer)
        watch = self._watch(1.0)
        drawn = measure.draw(
            renderer, scene, base.camera, base.size, scale=setting.scale, repeats=self._repeats, watch=watch
        )
        expected = base.scene if setting.judged_as_given else scene
        try:
            arithmetic = self._judge.judge(renderer, scene, expected, drawn, setting.scale, watch)
        except Error as error:
            arithmetic = measure.Arithmetic(reason=_reason(error))
        if setting.current:
            self._now = drawn, arithmetic
        return drawn, arithmetic


def _fields_of(scene: Scene) -> Any:
    """Return the fields of a scene as `Scene` takes them beside its transfer functions."""
    return scene.groups if len(scene.groups) > 1 else scene.fields


def _times(drawn: measure.Drawn) -> dict[str, Any]:
    return {
        "seconds": statistics.median(drawn.walls),
        "cpu_seconds": statistics.median(drawn.cpus),
        "fastest": min(drawn.walls),
        "slowest": max(drawn.walls),
    }


def _reason(error: Error) -> str:
    """Return why a picture is missing, in one line; where the user stopped the measurement, raise the error again."""
    if isinstance(error, Cancelled):
        raise error
    return " ".join(str(error).split())


def _notes(rows: tuple[AccuracyRow, ...], clock: str) -> tuple[str, ...]:
    """Return conclusions from several rows."""
    notes = []
    lattices = [row for row in rows if row.knob == "lattice" and row.measured]
    here = next((row for row in lattices if row.current), None)
    others = sorted((row for row in lattices if not row.current), key=lambda row: row.rmse)
    if here is not None and others:  # none is measured for a BCC lattice
        equal = _at_error(others, here.rmse, clock)
        if equal is None:
            side = "less" if others[-1].rmse < here.rmse else "more"
            notes.append(
                f"BCC at equal error: not reached, each of its settings has {side} error than the Cartesian field"
            )
        else:
            seconds, kernels = equal
            notes.append(
                f"BCC at the Cartesian field's error ({here.rmse:.1e}): {seconds / here.time(clock):.2f} times its "
                f"time with {kernels / max(1, here.kernels_drawn):.2f} times its kernels (interpolated)"
            )
    same = [row for row in rows if row.measured and row.truth not in (INTERPOLATED, BEST)]
    now = next((row for row in same if row.current), None)
    better = [] if now is None else [row for row in same if _is_better(row, now, clock)]
    if now is not None and better:
        best = min(better, key=lambda row: row.rmse)
        notes.append(
            f"both faster and more accurate than now: {best.knob} {best.setting} "
            f"({best.time(clock) / now.time(clock):.2f} times the time, {best.rmse / now.rmse:.2g} times the error)"
        )
    return tuple(notes)


def _is_better(row: AccuracyRow, now: AccuracyRow, clock: str) -> bool:
    return row.time(clock) < _CLEARLY * now.time(clock) and row.rmse < _CLEARLY * now.rmse


def _at_error(rows: list[AccuracyRow], error: float, clock: str) -> tuple[float, float] | None:
    """Return seconds and kernels at an error, between two rows sorted by error; None outside of them."""
    for low, high in zip(rows, rows[1:], strict=False):
        if low.rmse <= error <= high.rmse and 0.0 < low.rmse < high.rmse:
            share = math.log(error / low.rmse) / math.log(high.rmse / low.rmse)
            seconds = low.time(clock) ** (1.0 - share) * high.time(clock) ** share
            kernels = max(1, low.kernels_drawn) ** (1.0 - share) * max(1, high.kernels_drawn) ** share
            return seconds, kernels
    return None


def _environment() -> dict[str, str]:
    from sheetsplat._sheetsplat import __version__

    return {
        "sheetsplat": __version__,
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "python": f"{platform.python_version()}, NumPy {np.__version__}",
    }

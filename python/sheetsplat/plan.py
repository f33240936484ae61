"""The plan of a rendering: which effects run for a scene, and why."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from sheetsplat import _sheetsplat
from sheetsplat._json import plain
from sheetsplat._time_left import about
from sheetsplat.backends import BACKEND_TRAITS

# Letters in a line of a short plan.
_COLUMNS = 100


@dataclass(frozen=True)
class Effect:
    """A step of rendering that a scene may or may not need.

    Attributes
    ----------
    name
        Its name in ``Renderer(effects={name: bool})``.
    on
        Whether it runs.
    reason
        One sentence: why it is on or off.
    forced
        True where the caller forced it.
    error
        Root mean square error that it is expected to add to the picture, its part of ``RenderPlan.error_budget``; 0
        where it adds none.
    cost_ms
        Milliseconds that it adds to this picture, or would add where it is off. None until `Renderer.measure_effects`
        has measured it, and where it cannot be switched.

    Examples
    --------
    >>> plan = ss.Renderer("cpu").plan(scene, camera, size=(32, 32))
    >>> [effect.on for effect in plan.effects if effect.name == "perspective"]
    [False]
    """

    name: str
    on: bool
    reason: str
    forced: bool
    error: float = 0.0
    cost_ms: float | None = None


@dataclass(frozen=True)
class QualitySetting:
    """One option that a quality may set, and its value.

    Attributes
    ----------
    option
        Its name.
    value
        Its value in this picture.
    reason
        Why, and what it costs.
    given
        True where the caller gave it, or the data have it already: the quality then did not change it.

    Examples
    --------
    >>> quality = ss.render(values, quality="best", size=(32, 32)).plan.quality
    >>> quality.of("opacity_stop").value
    0.999
    """

    option: str
    value: float | bool | str | None
    reason: str
    given: bool = False

    def __str__(self) -> str:
        """Return one line."""
        value = f"{self.value:.6g}" if isinstance(self.value, float) else repr(self.value)
        return f"{self.option}={value}: {self.reason}"


@dataclass(frozen=True)
class PictureQuality:
    """What the option `quality` of `sheetsplat.render` set.

    Attributes
    ----------
    name
        "draft", "good" or "best".
    settings
        Each option that it may set, with its value and the reason.

    Examples
    --------
    >>> ss.render(values, quality="draft", size=(32, 32)).plan.quality.name
    'draft'
    """

    name: str
    settings: tuple[QualitySetting, ...] = ()

    def of(self, option: str) -> QualitySetting:
        """Return the setting of an option. KeyError for one that no quality sets in this picture."""
        for setting in self.settings:
            if setting.option == option:
                return setting
        raise KeyError(option)

    def lines(self) -> list[str]:
        """Return the name, and a line for each setting."""
        return [self.name, *map(str, self.settings)]


@dataclass(frozen=True, repr=False)
class RenderPlan:
    """The effects that run for one scene, camera and size. ``print(plan)`` prints all of it, a notebook ten lines.

    Attributes
    ----------
    backend, precision, packing, tagging, path
        The choice for each.
    device
        Description of the device.
    size
        (width, height) in pixels.
    supersampling
        Samples a pixel along each axis.
    slice_spacing
        Distance of slices in world units.
    first_slice, slices
        Index n of the first slice, and the number of slices.
    first_depth
        Depth of the first slice, world units from the eye along the view direction.
    cut_by_near
        Whether slices that meet kernels are missing in front because of the near plane.
    memory
        Bytes in addition to the fields.
    effects
        Each effect with its reason.
    error_budget
        Root mean square distance from the float64 reference at the same slices that is expected from each cause,
        estimated from the scene alone and mostly too large. The errors of the distance of slices and of the opacity
        stop are not included: `Image.error` and the effect "settings for max_error" have them.
    expected_seconds
        About how long the picture takes, within a factor of three; None where that is not known: on a graphics
        processor, of data in bricks, and in the plan of a picture, which has its time in ``Image.stats``.
    picture_ms
        Median time of the picture in milliseconds where `Renderer.measure_effects` made this plan; else None.
    notes
        What is shown, where that is not the data as they are.
    quality
        What the option `quality` set; None for scenes that were not made by `sheetsplat.render` or the command line.

    Examples
    --------
    >>> plan = ss.Renderer("cpu").plan(scene, camera, size=(32, 32))
    >>> plan.backend, plan.has("classification"), plan.has("shadows")
    ('cpu', True, False)
    """

    backend: str
    precision: str
    packing: str
    tagging: str
    path: str
    device: str
    size: tuple[int, int]
    slice_spacing: float
    first_slice: int
    slices: int
    first_depth: float
    cut_by_near: bool
    memory: int
    effects: tuple[Effect, ...]
    error_budget: dict[str, float]
    picture_ms: float | None = None
    notes: tuple[str, ...] = ()
    quality: PictureQuality | None = None
    supersampling: int = 1
    expected_seconds: float | None = field(default=None, compare=False)

    @classmethod
    def of_native(
        cls,
        native: _sheetsplat.RenderPlan,
        notes: tuple[str, ...] = (),
        quality: PictureQuality | None = None,
        samples: int = 1,
    ) -> RenderPlan:
        """Return the plan of the native module, with notes on what is shown, and what a quality set.

        The native module draws samples x samples pixels for each one.
        """
        same = {one.name: getattr(native, one.name) for one in fields(cls) if hasattr(native, one.name)}
        effects = tuple(Effect(*parts) for parts in native.effects)
        width, height = native.size
        return cls(
            **{
                **same,
                "size": (width // samples, height // samples),
                "supersampling": samples,
                "effects": effects,
                "error_budget": dict(native.error_budget),
                "notes": notes,
                "quality": quality,
            }
        )

    @property
    def expected_error(self) -> float:
        """Root mean square distance from the reference that is expected from all causes together.

        It is the root of the sum of their squares, and also that of the errors of all effects.
        """
        return math.hypot(*self.error_budget.values())

    def has(self, effect: str) -> bool:
        """Return True where the effect exists and is on."""
        return any(one.on for one in self.effects if one.name == effect)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain dicts, lists, numbers and texts, ready for JSON."""
        report: dict[str, Any] = plain({**asdict(self), "expected_error": self.expected_error})
        return report

    def __repr__(self) -> str:
        """Return about ten lines, without reasons."""
        on = ", ".join(one.name + " (forced)" * one.forced for one in self.effects if one.on)
        off = ", ".join(f"{one.name} (forced)" for one in self.effects if one.forced and not one.on)
        rows = [
            ("backend", self.backend + (f", {self.device}" if self.device else "")),
            ("picture", f"{self.size[0]} x {self.size[1]} pixels{self._samples()}, {self.precision}"),
            ("slices", f"{self.slices}, {self.slice_spacing:g} apart"),
            ("memory", f"{self.memory / 1e6:.1f} MB beside the fields"),
            ("time", "" if self.expected_seconds is None else f"about {about(self.expected_seconds)}"),
            ("note", "; ".join(self.notes)),
            ("quality", "" if self.quality is None else self.quality.name),
            ("effects", on or "none"),
            ("off", off),
            ("error", f"{self.expected_error:.1e} expected, root mean square" if self.error_budget else ""),
        ]
        lines = []
        for name, text in rows:
            lines += [f"{'' if n else name:<9}{part}" for n, part in enumerate(_short(text))]
        return "\n".join([*lines, "print(plan) says why, and what is off"])

    def _repr_html_(self) -> str:
        """Return about ten lines for a notebook, which opens to the whole."""
        import html

        short, whole = html.escape(repr(self).rpartition("\n")[0]), html.escape(str(self))
        return f"<pre>{short}</pre><details><summary>the whole plan</summary><pre>{whole}</pre></details>"

    def __str__(self) -> str:
        """Return a table."""
        rows = [
            ("backend", self.backend + (f", {self.device}" if self.device else "")),
            ("precision", self.precision),
            ("packing", self.packing),
            ("tagging", self.tagging),
            *([("path", self.path)] if BACKEND_TRAITS[self.backend].ways else []),
            ("size", f"{self.size[0]} x {self.size[1]} pixels{self._samples()}"),
            ("slices", f"{self.slices}, {self.slice_spacing:g} apart, the first is n = {self.first_slice}"),
            ("memory", f"{self.memory / 1e6:.1f} MB beside the fields"),
        ]
        if self.expected_seconds is not None:
            rows.append(("time", f"about {about(self.expected_seconds)}"))
        lines = [f"{name:<11}{text}" for name, text in rows]
        lines += [f"{'note':<11}{note}" for note in self.notes]
        if self.quality is not None:
            lines += [f"{'' if n else 'quality':<11}{line}" for n, line in enumerate(self.quality.lines())]
        if self.picture_ms is not None:
            lines.append(f"{'picture':<11}{self.picture_ms:.3g} ms, median")
        lines += self._table()
        if self.error_budget:
            budget = self.error_budget | {"all together": self.expected_error}
            width = max(map(len, budget))
            away = "from the float64 reference at the same slices"
            lines += ["", f"error expected {away}, root mean square: an estimate, no bound"]
            lines += [f"{cause:<{width}}  {rmse:.2g}" for cause, rmse in budget.items()]
        return "\n".join(lines)

    def _samples(self) -> str:
        """Return how many samples a pixel has, where there are several."""
        return "" if self.supersampling == 1 else f", {self.supersampling} x {self.supersampling} samples each"

    def _table(self) -> list[str]:
        """Return the lines of the effects: name, on or off, expected error, cost where measured, reason."""
        if not self.effects:
            return []
        width = max(len(effect.name) for effect in self.effects)
        measured = self.picture_ms is not None
        cost = f"  {'ms':>7}" if measured else ""
        lines = ["", f"{'effect':<{width}}       {'error':>7}{cost}  why"]
        for effect in self.effects:
            error = f"{effect.error:.1e}" if effect.on and effect.error > 0 else "-"
            cost = f"  {_cost(effect):>7}" if measured else ""
            forced = " (forced)" if effect.forced else ""
            switch = "on " if effect.on else "off"
            lines.append(f"{effect.name:<{width}}  {switch}  {error:>7}{cost}  {effect.reason}{forced}")
        return lines


def _short(text: str) -> list[str]:
    """Return the lines of a text, two at most; none of an empty one."""
    import textwrap

    return textwrap.wrap(text, _COLUMNS, max_lines=2, placeholder=" …")


def _cost(effect: Effect) -> str:
    """Return milliseconds; in brackets for an effect that is off."""
    if effect.cost_ms is None:
        return "-"
    text = f"{effect.cost_ms:.2f}"
    return text if effect.on else f"({text})"

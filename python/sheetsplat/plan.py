"""What will run for a scene, and why, before it runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from sheetsplat import _sheetsplat


@dataclass(frozen=True)
class Effect:
    """Anything that a scene may or may not call for.

    Attributes
    ----------
    name
        What it is called in ``Renderer(effects={name: bool})``.
    on
        Whether it runs.
    reason
        One sentence: why it is on or off.
    forced
        True where the caller decided.
    """

    name: str
    on: bool
    reason: str
    forced: bool


@dataclass(frozen=True)
class RenderPlan:
    """What will run for one scene, camera and size. ``print(plan)`` gives a table.

    Attributes
    ----------
    backend, precision, packing, tagging
        What was chosen of each.
    device
        The machine, in words.
    size
        (width, height) in pixels.
    slice_spacing
        Distance of slices in world units.
    first_slice, slices
        Number n of the first slice, and how many follow.
    memory
        Bytes beside the fields, all stages at once.
    effects
        Each effect with its reason.
    error_budget
        Root mean square error that is expected of each cause: an estimate of the noise of sums in this precision, made
        from the scene alone. It is no bound, and a picture can be further from the reference; measure where it matters.
    """

    backend: str
    precision: str
    packing: str
    tagging: str
    device: str
    size: tuple[int, int]
    slice_spacing: float
    first_slice: int
    slices: int
    memory: int
    effects: tuple[Effect, ...]
    error_budget: dict[str, float]

    @classmethod
    def _of(cls, native: _sheetsplat.RenderPlan) -> RenderPlan:
        return cls(
            backend=native.backend,
            precision=native.precision,
            packing=native.packing,
            tagging=native.tagging,
            device=native.device,
            size=native.size,
            slice_spacing=native.slice_spacing,
            first_slice=native.first_slice,
            slices=native.slices,
            memory=native.memory,
            effects=tuple(Effect(*parts) for parts in native.effects),
            error_budget=dict(native.error_budget),
        )

    def has(self, effect: str) -> bool:
        """Return True where the effect exists and is on."""
        return any(one.on for one in self.effects if one.name == effect)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain dicts, lists, numbers and texts, ready for JSON."""
        plain = asdict(self)
        plain["size"] = list(self.size)
        plain["effects"] = [asdict(effect) for effect in self.effects]
        return plain

    def __str__(self) -> str:
        """Return a table."""
        rows = [
            ("backend", self.backend + (f", {self.device}" if self.device else "")),
            ("precision", self.precision),
            ("packing", self.packing),
            ("tagging", self.tagging),
            ("size", f"{self.size[0]} x {self.size[1]} pixels"),
            ("slices", f"{self.slices}, {self.slice_spacing:g} apart, the first is n = {self.first_slice}"),
            ("memory", f"{self.memory / 1e6:.1f} MB beside the fields"),
        ]
        lines = [f"{name:<11}{text}" for name, text in rows]
        if self.effects:
            width = max(len(effect.name) for effect in self.effects)
            lines += ["", f"{'effect':<{width}}      why"]
            for effect in self.effects:
                forced = " (forced)" if effect.forced else ""
                lines.append(f"{effect.name:<{width}}  {'on ' if effect.on else 'off'} {effect.reason}{forced}")
        if self.error_budget:
            width = max(map(len, self.error_budget))
            lines += ["", "error expected, root mean square: an estimate, no bound"]
            lines += [f"{cause:<{width}}  {rmse:.2g}" for cause, rmse in self.error_budget.items()]
        return "\n".join(lines)

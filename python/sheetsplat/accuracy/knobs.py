"""The knobs: what trades error for time, and what one setting of a knob changes in a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from sheetsplat.camera import Camera
from sheetsplat.scene import Scene

# The times that a measurement may report and compare.
Clock = Literal["wall", "cpu"]
CLOCKS: tuple[str, ...] = get_args(Clock)
# The picture from which the error of a setting is measured.
CONVERGED = "converged"
SLICES = "slices"
INTERPOLATED = "interpolated"
BEST = "best"
GIVEN = "given"

#: Every knob and what it trades for time, in the order of the report.
KNOBS: dict[str, str] = {
    "quality": "what the option quality of render sets",
    "slice_spacing": "distance of slices",
    "classification": "points, slabs, or the intervals between slices, at several distances of slices",
    "gradient": "differences of sheets, or the kernels' own derivatives",
    "cut_off": "where a kernel's Gaussian, of the same width, is cut off",
    "precision": "numbers of the sheets, on every backend",
    "table_size": "points of the transfer function, evenly spaced",
    "opacity_stop": "opacity at which a pixel is finished",
    "filter": "widening of kernels smaller than a pixel or a slice distance",
    "image_scale": "pixels drawn, before the picture is enlarged",
    "lattice": "samples on a Cartesian or a body-centred cubic lattice",
    "kernel": "radius, falloff and normalisation of a lattice's kernels",
    "prefilter": "coefficients by which a lattice's sum passes through its samples",
}


@dataclass(frozen=True)
class Base:
    """The scene that is varied, with explicit distances, its camera, and the options of the renderer."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    backend: str
    precision: str
    settings: dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """One setting of one knob.

    Attributes
    ----------
    name
        How it is called among the settings of its knob.
    changes
        Options of the scene that differ from the given one; a function is called for the value when it is needed.
    how
        What to write in Python to use it, where that does not follow from `changes`.
    series
        The line of the plot to which it belongs: the settings of one series differ in one number.
    current
        The scene has this setting already.
    reason
        Why it is not available, where that is known from the start.
    judged_as_given
        The reference draws the given scene: tables and cut-offs count as arithmetic errors.
    renderer
        Options of the renderer, in addition to those of the base.
    scale
        Factor by which the drawn picture is smaller than the shown one.
    whole
        Returns the scene that is drawn, where it is not the given one with some changes.
    ripple
        Of a constant field: root mean square and maximum, relative.
    is_truth
        It is the field from which the errors of lattices are measured.
    knob, truth
        The knob, and the picture from which the error is measured; set by `sheetsplat.accuracy.sweeps.sweep`.
    """

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    how: str = ""
    series: str = ""
    current: bool = False
    reason: str = ""
    judged_as_given: bool = False
    renderer: Mapping[str, Any] = field(default_factory=dict)
    scale: int = 1
    whole: Callable[[], Scene] | None = None
    ripple: tuple[float, float] | None = None
    is_truth: bool = False
    knob: str = ""
    truth: str = CONVERGED

    @property
    def code(self) -> str:
        """What to write in Python to use it; empty for the unchanged scene."""
        return self.how or (call_text("Scene", self.changes) if self.changes else "")

    def scene(self, base: Base) -> Scene:
        """Return the scene that is drawn: the given one itself where nothing differs."""
        if self.whole is not None and not self.current:
            return self.whole()
        if self.current or not self.changes:
            return base.scene
        return base.scene.replace(**{name: one() if callable(one) else one for name, one in self.changes.items()})

    def gradient(self, base: Base) -> str:
        """Return the kind of gradients with which it is drawn."""
        now: str = base.scene.options["gradient"]
        return self.series if self.knob == "gradient" and self.series else now


def call_text(name: str, options: Mapping[str, Any]) -> str:
    """Return a call as it is written in Python."""
    parts = [f"{key}={value:.6g}" if isinstance(value, float) else f"{key}={value!r}" for key, value in options.items()]
    return f"{name}({', '.join(parts)})"

"""Effects of a scene, alone and in pairs, and their times over the plain lit composite of the same field."""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.measure import Timing, attempt, away, clock
from bench.report import Row
from sheetsplat.camera import bounds_of
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.kernels import with_kernel
from sheetsplat.choose.picture import at_quality
from sheetsplat.fields import Field
from sheetsplat.framing import fitting_depth_cue
from sheetsplat.look import automatic
from sheetsplat.options.core import COLORED
from sheetsplat.options.picture import unused

#: Views of the orbit that are timed at most; further ones make the first frames.
VIEWS = 5
_VIEWS_OF_PAIR = 2
# Turns of the views about y and their rise, degrees: 13 apart, none of them along an axis.
_FIRST_TURN, _TURN, _RISE = 35.0, 13.0, 20.0
# Vertical angle of perspective cameras, degrees.
_FOV = 30.0
# What the effects' numbers are, as shares of the field: where the clip plane lies, the gradient below which opacity
# falls (of the transfer function's range over a reference length), the radius of ambient occlusion (of the diagonal).
_CLIPPED, _GRADIENT, _SURROUNDINGS = 0.3, 0.02, 0.02


@dataclass(frozen=True)
class Effect:
    """Something that a picture is asked for beyond the plain lit composite.

    Attributes
    ----------
    name
        Of the effect.
    options
        Options of :class:`sheetsplat.Scene` for a subject.
    wanted, wanted_first
        Largest time of a frame, and of the first one, over the plain frame that is aimed at; None: nothing is.
    settings
        Options of the renderer.
    perspective
        Whether the camera is perspective.
    quality
        Quality whose kernels, slices and opacity stop are taken.
    paired
        Whether it is timed together with other effects.
    beside
        Options that make of the plain scene what the effect is compared with; None: it is the plain scene.
    """

    name: str
    options: Callable[[Subject], Mapping[str, Any]] = lambda subject: {}
    wanted: float | None = None
    wanted_first: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    perspective: bool = False
    quality: str = ""
    paired: bool = True
    beside: Callable[[Subject], Mapping[str, Any]] | None = None


class Subject:
    """A field with its plain lit composite, and what effects need to know of it."""

    def __init__(self, name: str, title: str, base: ss.Scene) -> None:
        self.name = name
        self.title = title
        self.base = base
        self.lower, self.upper = (np.array(corner) for corner in bounds_of(base))
        self._kernels: dict[str, list[Field]] = {}

    @property
    def diagonal(self) -> float:
        """Diagonal of the box around all supports, world units."""
        return float(np.linalg.norm(self.upper - self.lower))

    @property
    def value_range(self) -> float:
        """Width of the transfer function's range."""
        function = self.base.transfer_function
        return float(function.v_max - function.v_min)

    @cached_property
    def surface(self) -> float:
        """Value that separates objects from background."""
        return automatic.choose(self.base.fields).surface

    def camera(self, view: int, *, perspective: bool = False) -> ss.Camera:
        """Return the camera of a view; both kinds show the same at the depth of the middle."""
        towards = away(math.radians(_FIRST_TURN + _TURN * view), math.radians(_RISE))
        camera = ss.Camera.fit(self.base, direction=tuple((-towards).tolist()))
        if not perspective:
            return camera
        centre = np.array(camera.target)
        distance = 0.5 * camera.height / math.tan(math.radians(0.5 * _FOV))
        return ss.Camera.perspective(centre + distance * towards, centre, fov_y=_FOV)

    def scene(self, effects: Sequence[Effect], size: tuple[int, int]) -> ss.Scene:
        """Return the scene with effects."""
        changes: dict[str, Any] = {}
        for effect in effects:
            changes |= effect.options(self)
        quality = next((effect.quality for effect in effects if effect.quality), "")
        if not quality:
            return self.base.replace(**changes)
        asked = Asked.of("bench", {"quality": quality})
        if quality not in self._kernels:
            self._kernels[quality] = [with_kernel(one, asked, made=False)[0] for one in self.base.fields]
        changes |= {"field": self._kernels[quality], "reference_length": self.base.reference_length}
        return at_quality(self.base.replace(**changes), asked, self.camera(0), size)[0]


def _clip(subject: Subject) -> Mapping[str, Any]:
    offset = float(subject.lower[2] + _CLIPPED * (subject.upper[2] - subject.lower[2]))
    return {"clip": ss.Clip(planes=[((0, 0, 1), offset)])}


def _faces(subject: Subject, *, lit: bool) -> Mapping[str, Any]:
    """Return the options of a cut whose faces are lit by their own direction, or by gradients."""
    return {**_clip(subject), "cut_faces": lit}


def _falling(subject: Subject) -> list[Field]:
    """Return the field as it falls to its base beyond its samples."""
    (one,) = subject.base.fields
    if not isinstance(one, ss.RegularField) or one.boundary != "edge":
        raise ss.Unsupported("the field has no boundary")
    return [one.replace(boundary="zero", base=one.base)]


def _boundary(name: str, mode: str) -> Effect:
    return Effect(
        name,
        lambda _: {"mode": mode},
        1.2,
        paired=False,
        beside=lambda subject: {"mode": mode, "field": _falling(subject)},
    )


#: What pictures are asked for, with the times over the plain frame that are aimed at.
EFFECTS: Mapping[str, Effect] = {
    effect.name: effect
    for effect in (
        Effect("perspective", wanted=1.3, perspective=True),
        Effect("xray", lambda _: {"mode": "xray"}, 1.5),
        Effect("mip", lambda _: {"mode": "mip"}, 1.5),
        Effect("minimum", lambda _: {"mode": "minimum"}, 1.5, paired=False),
        Effect("average", lambda _: {"mode": "average"}, 1.5, paired=False),
        Effect("isosurface", lambda subject: {"mode": "isosurface", "iso_value": subject.surface}),
        Effect("slab", lambda _: {"sampling": "slab"}, 3.0),
        Effect("preintegration", lambda _: {"preintegration": True}, 1.1),
        Effect("second order", lambda _: {"preintegration": "second_order"}, 2.0),
        Effect("ewa", lambda _: {"filter": "ewa"}, 2.0),
        Effect("shadows", lambda _: {"shadows": True}, 2.5),
        Effect(
            "occlusion",
            lambda subject: {"ambient_occlusion": ss.AmbientOcclusion(_SURROUNDINGS * subject.diagonal)},
            1.3,
            4.0,
        ),
        Effect("analytic", lambda _: {"gradient": "analytic"}, 1.5),
        Effect(
            "threshold",
            lambda subject: {"gradient_opacity": _GRADIENT * subject.value_range / subject.base.reference_length},
            1.5,
        ),
        Effect("clip", _clip, 1.5),
        Effect("cut faces", partial(_faces, lit=True), 1.2, paired=False, beside=partial(_faces, lit=False)),
        _boundary("boundary", "composite"),
        *(_boundary(f"boundary {mode}", mode) for mode in ("xray", "average", "mip")),
        Effect("depth cue", lambda subject: {"depth_cue": fitting_depth_cue(subject.base, subject.camera(0))}),
        Effect("float64", settings={"precision": "float64"}, wanted=2.2),
        Effect("good", quality="good", wanted=2.0),
        Effect("best", quality="best", wanted=6.0, paired=False),
    )
}


def _together(subject: Subject, both: Sequence[Effect]) -> bool:
    """Return whether effects can be had together: no option twice, and none that the mode or another one excludes."""
    options = [effect.options(subject) for effect in both]
    given = [name for one in options for name in one]
    mode = next((one["mode"] for one in options if "mode" in one), "composite")
    if len(set(given)) < len(given) or unused(mode, given) or sum(bool(effect.quality) for effect in both) > 1:
        return False
    try:
        subject.base.replace(**{name: value for one in options for name, value in one.items()})
    except ss.InvalidInput:
        return False
    return True


def pairs(subject: Subject, names: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of some effects that can be had together."""
    paired = [EFFECTS[name] for name in names if EFFECTS[name].paired]
    return [(a.name, b.name) for a, b in itertools.combinations(paired, 2) if _together(subject, (a, b))]


@dataclass(frozen=True)
class Conditions:
    """How frames are timed.

    Attributes
    ----------
    backend
        Backend that draws.
    size
        (width, height) of the pictures, pixels.
    views
        Number of views that are timed, at most `VIEWS`.
    seconds
        Processor time after which no further view of an effect is timed; the second number is that of a pair.
    settings
        Further options of all renderers.
    tell
        Called with a description of each row before it begins.
    """

    backend: str
    size: tuple[int, int]
    views: int = VIEWS
    seconds: tuple[float, float] = (6.0, 0.8)
    settings: Mapping[str, Any] = field(default_factory=dict)
    tell: Callable[[str], object] = lambda text: None

    def renderer(self, **settings: Any) -> ss.Renderer:
        """Return a renderer."""
        return ss.Renderer(**{"backend": self.backend, **self.settings, **settings})


def measure(
    subject: Subject, names: Sequence[str], conditions: Conditions, plain: ss.Renderer, *, frames: int, seconds: float
) -> Row:
    """Time the scene with effects and the plain one, frame by frame in turn.

    Parameters
    ----------
    subject
        What is drawn.
    names
        Of the effects, none for the plain scene against itself.
    conditions
        Backend and size.
    plain
        Renderer of the plain scene, which keeps its index from one call to the next; an effect that is compared with
        another scene has one of its own.
    frames
        Number of views that are timed, at most `VIEWS`.
    seconds
        No further view is timed after so many seconds of processor time; one always is.

    Returns
    -------
    Row
        ``ratio``: least processor time of a frame over that of the plain one. ``wall_ratio``: the same of elapsed
        times. ``first_ratio``: the first frame, by a renderer that has drawn the plain scene, over the plain one.
        ``ms`` and ``plain_ms``: the least processor times. ``frames``, ``slices``, ``precision``: as they were.
    """
    effects = [EFFECTS[name] for name in names]
    settings = {name: value for effect in effects for name, value in effect.settings.items()}
    perspective = any(effect.perspective for effect in effects)
    size = conditions.size
    began = time.process_time()
    scene = subject.scene(effects, size)
    renderer = conditions.renderer(**settings)
    base = subject.base
    for effect in effects:
        if effect.beside is not None:
            base, plain = base.replace(**effect.beside(subject)), conditions.renderer()
            plain.render(base, subject.camera(VIEWS), size=size)
    # The plain picture makes what does not depend on the effects: the index, and the threads.
    renderer.render(base, subject.camera(VIEWS), size=size)
    first_view = subject.camera(VIEWS + 1, perspective=perspective)
    picture, _, first = clock(lambda: renderer.render(scene, first_view, size=size))
    if scene.mode in COLORED and not np.any(picture.pixels):
        raise ss.Unsupported("the picture is empty")
    timing, beside = Timing(), Timing()
    for view in range(frames):
        beside.frame(plain, base, subject.camera(view), size)
        picture = timing.frame(renderer, scene, subject.camera(view, perspective=perspective), size)
        if time.process_time() - began > seconds:
            break
    least, plain_least = (min(shot.cpu for shot in one.shots) for one in (timing, beside))
    walls = [min(shot.wall for shot in one.shots) for one in (timing, beside)]
    return {
        "ratio": least / plain_least,
        "wall_ratio": walls[0] / walls[1],
        "first_ratio": first / plain_least,
        "ms": 1000.0 * least,
        "plain_ms": 1000.0 * plain_least,
        "frames": len(timing.shots),
        "slices": picture.plan.slices,
        "precision": picture.plan.precision,
    }


def timed(
    subject: Subject, names: Sequence[str], conditions: Conditions, plain: ss.Renderer, alone: Mapping[str, float]
) -> Row:
    """Return the row of an effect, or of several together; `alone`: the ratios of single effects."""
    conditions.tell(f"{subject.name}: {', '.join(names)}")
    single = len(names) == 1
    frames = conditions.views if single else min(_VIEWS_OF_PAIR, conditions.views)
    seconds = conditions.seconds[0 if single else 1]
    run = partial(measure, subject, names, conditions, plain, frames=frames, seconds=seconds)
    with warnings.catch_warnings():
        # Looks are not what is measured.
        warnings.simplefilter("ignore", ss.PictureWarning)
        found = attempt(run)
    row: Row = {"field": subject.name, "row": " + ".join(names), "effects": list(names), **found}
    return judged(row, names, alone) if "ratio" in row else row


def surface(subject: Subject, names: Sequence[str], conditions: Conditions, paired: Sequence[str]) -> list[Row]:
    """Return the rows of some effects on a field, and of the pairs of some of them."""
    plain = conditions.renderer()
    plain.render(subject.base, subject.camera(VIEWS), size=conditions.size)
    rows = [timed(subject, (name,), conditions, plain, {}) for name in names]
    alone = {row["effects"][0]: row["ratio"] for row in rows if "ratio" in row}
    both = pairs(subject, [name for name in paired if name in alone])
    return rows + [timed(subject, names, conditions, plain, alone) for names in both]


def judged(row: Row, names: Sequence[str], alone: Mapping[str, float]) -> Row:
    """Return a row with what was to be expected of it, and how far it is above that.

    A single effect is expected to take what is wanted, a pair the product of what its parts take `alone`; parts that
    take less than the plain frame count as 1.
    """
    if len(names) == 1:
        effect = EFFECTS[names[0]]
        above = [
            row[name] / wanted
            for name, wanted in (("ratio", effect.wanted), ("first_ratio", effect.wanted_first))
            if wanted is not None
        ]
        row = {**row, "expected": effect.wanted, "expected_first": effect.wanted_first}
        return {**row, "over": max(above)} if above else row
    if any(name not in alone for name in names):
        return row
    product = math.prod(max(1.0, alone[name]) for name in names)
    return {**row, "expected": product, "over": row["ratio"] / product}

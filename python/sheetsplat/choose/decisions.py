"""What was chosen for a picture: each thing with its value, why, and who decided on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sheetsplat.camera import Camera
from sheetsplat.options.core import checked, definitions, in_python
from sheetsplat.options.scene import SceneOptions
from sheetsplat.plan import PictureQuality, QualitySetting
from sheetsplat.scene import Scene

Who = Literal["caller", "data", "quality", "default"]
AS_GIVEN = "as given"


@dataclass(frozen=True)
class Decision:
    """One thing that was chosen.

    Attributes
    ----------
    option
        Its name, that of an option of `sheetsplat.render`.
    value
        What it is.
    reason
        Why.
    by
        Who decided: the caller, who gave it, or an object that has it, or a goal that decides on it; the data; the
        quality, by what it measured; or nobody: the default.
    """

    option: str
    value: Any
    reason: str
    by: Who


@dataclass(frozen=True)
class Decisions:
    """Everything that was chosen for a picture.

    Attributes
    ----------
    scene, camera
        What is drawn.
    made
        Each decision: the camera, the transfer function, and every option of a scene; of the kernels of several
        volumes one after the other.
    """

    scene: Scene
    camera: Camera
    made: tuple[Decision, ...]

    def of(self, option: str) -> Decision:
        """Return the decision on an option, of several the first. KeyError for what is none."""
        for one in self.made:
            if one.option == option:
                return one
        raise KeyError(option)


def applied(scene: Scene, made: Iterable[Decision]) -> Scene:
    """Return a scene with what was decided, where it has something else: a default stays one."""
    values = {name: one or "off" if name == "filter" else one for name, one in scene.options.items()}
    values["slice_spacing"] = scene.slice_spacing
    changes = {one.option: one.value for one in made if values.get(one.option) != one.value and one.option in values}
    return scene.sketch(**changes) if changes else scene


def of_quality(name: str, made: Iterable[Decision]) -> PictureQuality:
    """Return what a quality set, or could not, for plans."""
    settings = (QualitySetting(one.option, one.value, one.reason, one.by == "caller") for one in made)
    return PictureQuality(name, tuple(dict.fromkeys(settings)))


def of_look(scene: Scene, camera: Camera, given: Mapping[str, Any], but: Iterable[Decision]) -> tuple[Decision, ...]:
    """Return the decisions on the camera, the transfer function and the options of a scene but for some.

    `given`: the options that the caller gave.
    """
    colors = "colours and opacities by the values of the data"
    chosen = {"camera": (camera, "shows all that can be seen"), "transfer_function": (scene.transfer_function, colors)}
    found = [Decision(name, value, AS_GIVEN, "caller") if name in given else Decision(name, value, why, "data")
             for name, (value, why) in chosen.items()]  # fmt: skip
    others, defaults = {one.option for one in but}, checked("Scene", {}, SceneOptions)
    for name, defined in definitions(SceneOptions).items():
        value = scene.options[name]
        if name in given:
            found.append(Decision(name, value, AS_GIVEN, "caller"))
        elif value != defaults[name]:
            found.append(Decision(name, value, in_python(defined.default_text(chooses=True)), "data"))
        else:
            found.append(Decision(name, value, in_python(defined.unset) or "the default", "default"))
    return tuple(one for one in found if one.option not in others)

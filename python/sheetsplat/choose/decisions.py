"""What was chosen for a picture: each thing with its value, why, and who decided on it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
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
    now = {**scene.options, "slice_spacing": scene.slice_spacing, "filter": scene.filter or "off"}
    changes = {one.option: one.value for one in made if now[one.option] != one.value}
    return scene.sketch(**changes) if changes else scene


def of_quality(name: str, made: Iterable[Decision]) -> PictureQuality:
    """Return what a quality set, or could not, for plans."""
    settings = (QualitySetting(one.option, one.value, one.reason, one.by == "caller") for one in made)
    return PictureQuality(name, tuple(dict.fromkeys(settings)))


def of_look(scene: Scene, camera: Camera, given: Mapping[str, Any], but: Iterable[Decision]) -> Iterator[Decision]:
    """Yield the decisions on the camera, the transfer function and the options of a scene but for some.

    `given`: the options that the caller gave.
    """
    defined, defaults = definitions(SceneOptions), checked("Scene", {}, SceneOptions)
    values = {"camera": camera, "transfer_function": scene.transfer_function, **scene.options}
    own = {"camera": "shows all that can be seen", "transfer_function": "colours and opacities by the values shown"}
    for name in [name for name in values if all(name != one.option for one in but)]:
        if name in given:
            yield Decision(name, values[name], AS_GIVEN, "caller")
        elif name in own or values[name] != defaults[name]:
            reason = own.get(name) or in_python(defined[name].default_text(chooses=True))
            yield Decision(name, values[name], reason, "data")
        else:
            yield Decision(name, values[name], in_python(defined[name].unset) or "the default", "default")

"""`choose` decides on everything that nobody gave, in this order: fields, look, camera, slices, samples, filter."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sheetsplat._checks import Vector, instance, is_auto
from sheetsplat.camera import Camera
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.decisions import Decision, Decisions, applied, of_look, of_quality
from sheetsplat.choose.kernels import with_kernel
from sheetsplat.choose.look import compose_scene
from sheetsplat.choose.pixels import kernel_filter, opacity_stop, samples_for_light, supersampling
from sheetsplat.choose.slices import Size, error_of_light, slice_spacing, slices_more
from sheetsplat.fields import Field, RegularField
from sheetsplat.fields.regular import PLAIN_KERNEL
from sheetsplat.framing import compose_camera, fitting_depth_cue
from sheetsplat.look.decades import in_decades, with_log_scale
from sheetsplat.look.strays import without_strays
from sheetsplat.look.surface import surface_text
from sheetsplat.modes import TRAITS
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import definitions, pick, pick_given
from sheetsplat.options.picture import LookOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.quality.slicing import can_be_estimated
from sheetsplat.scene import Scene

_log = logging.getLogger("sheetsplat")
_DEFAULT_STOP: Any = definitions(SceneOptions)["opacity_stop"].default


def choose(
    fields: Sequence[Field],
    options: Mapping[str, Any],
    asked: Asked,
    size: Size,
    *,
    made: bool = False,
    suggested: Mapping[str, Any] | None = None,
    cue_color: Vector = (0.0, 0.0, 0.0),
) -> Decisions:
    """Return everything that is drawn of fields, each choice with its reason.

    Parameters
    ----------
    fields
        The data.
    options
        Those of `sheetsplat.render`, given or None.
    asked
        What they ask for.
    size
        (width, height) in pixels.
    made
        Whether the caller made the fields: what they settled stays.
    suggested
        Options of the look that the data suggest.
    cue_color
        To which a depth cue "auto" fades.
    """
    look: Mapping[str, Any] = {**(suggested or {}), **pick_given(LookOptions, options)}
    framed = options.get("camera") is None and options.get("target") is None
    log = options.get("log")
    look = with_log_scale(fields, look, log)
    usual = without_strays(in_decades(fields, look, log), look, framed=framed)
    with_kernels = [with_kernel(one, asked, made=made, mode=look.get("mode")) for one in usual]
    kernels = tuple(decision for _, decided in with_kernels for decision in decided)
    if isinstance(look.get("color_by"), Field):
        look = {**look, "color_by": with_kernel(look["color_by"], asked, made=made)[0]}
    # The camera decides on them.
    of_camera = ("filter", "depth_cue") if is_auto(look.get("depth_cue")) else ("filter",)
    given: Any = {name: value for name, value in look.items() if name not in of_camera}
    scene = compose_scene([field for field, _ in with_kernels], spacing_is_free=asked.free, **given)
    with _complaining_first(scene):
        camera = camera_of(applied(_measured(scene), [slice_spacing(_measured(scene), asked)]), size, options)
        if "depth_cue" in of_camera:
            scene = scene.sketch(depth_cue=fitting_depth_cue(scene, camera, cue_color))
        scene, set_ = at_quality(scene, asked, camera, size)
    decided = _decided(scene, camera, asked, (*kernels, *set_))
    for note in (*scene.notes, *([surface_text(scene)] if TRAITS[scene.mode].shows_surfaces else [])):
        _log.info("%s", note)
    return decided


def kept(scene: Scene, options: Mapping[str, Any], asked: Asked, size: Size) -> Decisions:
    """Return what is drawn of a scene that the caller made: all of it was given."""
    volumes = [one for one in scene.fields if isinstance(one, RegularField)]
    values: dict[str, Any] = {"slice_spacing": scene.slice_spacing, "filter": scene.filter or "off"}
    if volumes:
        values["prefilter"] = any(one.prefilter for one in volumes)
    if TRAITS[scene.mode].is_composited:
        values["opacity_stop"] = scene.options["opacity_stop"]
    values["supersampling"] = scene.supersampling
    set_ = tuple(Decision(name, value, "as the scene has it", "caller") for name, value in values.items())
    return _decided(scene, camera_of(scene, size, options), asked, set_)


def camera_of(scene: Scene, size: Size, options: Mapping[str, Any]) -> Camera:
    """Return the camera of a picture: the one that was given, else one that shows all that can be seen."""
    camera = options.get("camera")
    if camera is None:
        camera = compose_camera(scene, size, **pick(CameraOptions, options))
    instance("render: camera", camera, Camera)
    return camera


def fitted(scene: Scene, asked: Asked, camera: Camera, size: Size) -> Scene:
    """Return an x-ray that was chosen with the slices and samples that another camera or size calls for."""
    if not TRAITS[scene.mode].integrates or "supersampling" in asked:
        return scene
    made = applied(scene, [slice_spacing(scene, asked, (camera, size))])
    return applied(made, [supersampling(made, asked, camera, size)]).with_quality(scene.quality)


def scene_of_quality(scene: Scene, name: str, camera: Camera, size: Size) -> Scene:
    """Return what a scene would be at a quality: kernels of volumes, slices, opacity stop and filter anew."""
    asked = Asked.of("quality", {"quality": name})
    plain = [
        [with_kernel(_plain(one), asked, made=False, mode=scene.mode) for one in fields] for fields in scene.groups
    ]
    groups = [[field for field, _ in fields] for fields in plain]
    changes: dict[str, Any] = {"slice_spacing": _draft_spacing(scene), "reference_length": scene.reference_length}
    changes |= {"field": groups if len(groups) > 1 else groups[0], "opacity_stop": _DEFAULT_STOP, "filter": None}
    made, set_ = at_quality(scene.sketch(**changes, supersampling=1), asked, camera, size)
    kernels = [decision for fields in plain for _, decided in fields for decision in decided]
    return made.with_quality(of_quality(name, (*kernels, *set_)))


def at_quality(scene: Scene, asked: Asked, camera: Camera, size: Size) -> tuple[Scene, tuple[Decision, ...]]:
    """Return a scene with what the quality sets in a picture of it, and what that is."""
    seen = _measured(scene)
    light = error_of_light(seen, asked, camera, size)
    of_light = samples_for_light(seen, asked, light)
    of_slices = [slice_spacing(seen, asked, (camera, size), light, of_light.value)]
    if TRAITS[scene.mode].is_composited:
        of_slices.append(opacity_stop(scene, asked))
    sliced = applied(seen, of_slices)
    samples = supersampling(sliced, asked, camera, size, of_light)
    filtering = kernel_filter(applied(sliced, [samples]), asked, camera, size)
    set_ = (*of_slices, samples, filtering)
    return applied(scene, set_), set_


def _measured(scene: Scene) -> Scene:
    """Return the scene whose kernels decide on camera, slices and samples: of a weighted mean that of the weight."""
    return scene if scene.sums is None else scene.sums[1]


def _decided(scene: Scene, camera: Camera, asked: Asked, set_: tuple[Decision, ...]) -> Decisions:
    """Return decisions with the scene that they make: the one place where its native scene is made."""
    made = scene.with_quality(of_quality(asked.quality, set_))
    made.check()
    return Decisions(made, camera, (*set_, *of_look(made, camera, asked.given, set_)))


@contextlib.contextmanager
def _complaining_first(scene: Scene) -> Iterator[None]:
    """Raise what is wrong with a scene in place of what goes wrong while it is looked at."""
    try:
        yield
    except Exception:
        scene.check()
        raise


def _plain(field: Field) -> Field:
    """Return a volume with plain kernels; one that is divided in a way of its own, and any other field, as it is."""
    if not isinstance(field, RegularField) or not (field.prefilter or field.normalization == "lattice"):
        return field
    return field.replace(radius=PLAIN_KERNEL[0], falloff=PLAIN_KERNEL[1], normalization="lattice", prefilter=False)


def _draft_spacing(scene: Scene) -> float | None:
    """Return the distance of slices of a draft; None: that of the fields."""
    if can_be_estimated(scene) or scene.quality is None:
        return None
    set_by = next((one for one in scene.quality.settings if one.option == "slice_spacing"), None)
    if set_by is None or set_by.given:
        return None
    return scene.slice_spacing * slices_more(Asked(scene.quality.name, {}).level, scene)

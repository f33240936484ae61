"""The look of a picture: its transfer function, surface, lights and colours, from fields and the options given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, TypeGuard, Unpack

import numpy as np

from sheetsplat._checks import truth
from sheetsplat.choose.slices import spacing_of_data
from sheetsplat.effects import AmbientOcclusion
from sheetsplat.errors import complain, option_ref, option_refs
from sheetsplat.fields import EllipsoidField, Field, RegularField, joined_bounds
from sheetsplat.labels import LabelColors
from sheetsplat.light import Light, Material
from sheetsplat.look import automatic
from sheetsplat.look.channel_light import adds_light
from sheetsplat.look.histogram import Look
from sheetsplat.look.strays import COARSE, kernel_spacing
from sheetsplat.look.surface import range_of, surface_limits
from sheetsplat.look.visible import corners_of
from sheetsplat.look.weighted import is_weighted, sums_of
from sheetsplat.modes import TRAITS
from sheetsplat.notices import warn
from sheetsplat.options.core import COLORED, COMPOSITE, MODES, SURFACES, check_names, pick_given
from sheetsplat.options.look import DEFAULT_CMAP
from sheetsplat.options.picture import LookOptions
from sheetsplat.options.scene import SceneOptions, iso_value_of
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.scene import Scene
from sheetsplat.slice_planes import slice_planes_of, with_colors
from sheetsplat.transfer import TransferFunction

# Percentiles of coordinates between which most centres lie, and the share of the whole extent below which the others
# are far away.
_MOST_CENTRES = (0.5, 99.5)
_FAR_APART = 0.25
# Slices by which the faces of a sphere may lie beside it.
_MOST_ASIDE = 2.0
# Radius of ambient occlusion, of the diagonal of the data.
_SURROUNDINGS = 0.04
# With one of them a picture of equal samples is what was asked for.
_SAY_WHAT_IS_MEANT = ("transfer_function", "opacity", "clim", "iso_value", "scalar_colors")
# One light over the viewer's left shoulder; with the specular share it shows the shape of smooth surfaces.
HEAD_LIGHT = Light(direction=(-0.3, 0.4, 1.0))
SHINY = Material(ambient=0.3, diffuse=0.85, specular=0.3, shininess=24.0, two_sided=True)
# Of volumes of colours: as opaque as they say.
_IDENTITY = TransferFunction([(0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])
# Scalar modes do not use it, but a scene has one.
_COLORLESS = TransferFunction([(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])


def compose_scene(fields: Sequence[Field], *, spacing_is_free: bool = False, **options: Unpack[LookOptions]) -> Scene:
    """Return a scene, not made yet (`Scene.sketched`). What is not given, or None, is chosen from the scalars.

    Parameters
    ----------
    fields
        What is shown: labels, colours and channels as groups of their own, the sum of all others as one.
    spacing_is_free
        The distance of slices is left to a renderer that has an error or a time to keep; otherwise it is chosen for
        scattered fields and isosurfaces.
    options
        Those of `Scene`, and of the transfer function and light that are chosen.
    """
    check_names("render", options, LookOptions)
    given = pick_given(SceneOptions, options)
    mode = given.get("mode", MODES[0])
    free = options.get("transfer_function") is None
    light = adds_light(fields, mode, options)
    own_look = [free and (light or _has_own_look(one, mode, options)) for one in fields]
    apart: Any = [one for one, own in zip(fields, own_look, strict=True) if own]
    measures = [one for one, own in zip(fields, own_look, strict=True) if not own]
    values = [one for one in fields if not is_labelled(one)]
    chosen = cache(partial(automatic.choose, values))
    if mode in SURFACES and values:
        # An iterator can be read once.
        iso = given.get("iso_value")
        given["iso_value"] = chosen().surface if iso is None else iso_value_of("render: iso_value", iso)
    shown: Any = list(fields)
    function: Any
    look: Look | None = None
    if apart:
        iso = given.get("iso_value")
        function = [_own_look(one, mode, iso, options) for one in apart]
        if measures:
            of_measures = cache(partial(automatic.choose, measures))
            of_sum, look = _transfer_function(measures, mode, iso, options, of_measures)
            function, shown = [of_sum, *function], [measures, *apart]
    else:
        function, look = _transfer_function(fields, mode, given.get("iso_value"), options, chosen)
    chooses_spacing = not spacing_is_free and "slice_spacing" not in given
    if chooses_spacing:
        measured = [sums_of(one)[1] if is_weighted(one, mode) else one for one in fields]
        given["slice_spacing"] = spacing_of_data(measured, mode, look)
    if look is not None and look.reference_length is not None:
        given.setdefault("reference_length", look.reference_length)
    shading = options.get("shading")
    lit = (shading is None or truth("render: shading", shading)) and mode in COLORED
    if mode not in COLORED:
        _set_scalar_colors(given, options)
    if lit and mode in COMPOSITE and not {"lights", "material"} & given.keys():
        given.setdefault("cut_faces", "clip" in given or any(one.domain for one in fields))
    if given.get("slice_planes") is not None and mode in COLORED:
        planes = slice_planes_of("Scene: slice_planes", given["slice_planes"])
        given["slice_planes"] = with_colors(planes, options.get("slice_cmap"), options.get("slice_clim"))
    given.setdefault("lights", (HEAD_LIGHT,) if lit else ())
    given.setdefault("material", SHINY)
    if given.get("ambient_occlusion") is True:
        given["ambient_occlusion"] = AmbientOcclusion(_surroundings(fields))
    scene = Scene.sketched(shown, function, given, _coloring(options, len(function) if apart else 1))
    if chooses_spacing:
        _warn_of_strays(scene)
    if all(options.get(name) is None for name in _SAY_WHAT_IS_MEANT):
        _warn_of_one_value(scene)
    _warn_of_facets(scene)
    _warn_of_what_lies_outside(scene)
    if free and fields:
        _warn_of_own_colors(fields, mode, options)
    if scene.options["shadows"] and mode in COLORED and not scene.lights:
        warn(option_ref("shadows", "true") + " changes nothing where there are no lights")
    return scene


def _warn_of_own_colors(fields: Sequence[Field], mode: str, options: Mapping[str, Any]) -> None:
    """Warn of colours and opacities that change nothing, as all fields are labels or colours and have their own."""
    ignored = [name for name in ("cmap", "clim", "opacity") if options.get(name) is not None]
    of_labels = all(map(is_labelled, fields))
    if ignored and (of_labels or mode in COLORED and all(is_labelled(one) or is_colored(one) for one in fields)):
        owner = (
            "labels, whose colours are those of a LabelColors" if of_labels else "colours, which are drawn as they are"
        )
        warn(option_refs(ignored) + f" change{'s' * (len(ignored) == 1)} nothing in a picture of {owner}")


def _coloring(options: Mapping[str, Any], groups: int) -> Any:
    """Return what gives the first group its colours, for `Scene`; None: nothing."""
    field, cmap = options.get("color_by"), options.get("color_map")
    if field is None or options.get("mode", MODES[0]) not in COLORED:
        return None
    if isinstance(field, Field):
        if not isinstance(cmap, TransferFunction):
            cmap = TransferFunction.from_colormap(
                DEFAULT_CMAP if cmap is None else cmap, 1.0, automatic.choose([field]).clim
            )
        field = (field, cmap)
    elif cmap is not None:
        warn(
            option_ref("color_map")
            + " changes nothing: the field of "
            + option_ref("color_by")
            + " has its own colours"
        )
    return [field, *[None] * (groups - 1)] if groups > 1 else field


def is_colored(field: Field) -> bool:
    """Return whether a field's samples are colours."""
    return isinstance(field, RegularField) and field.colored


def is_channel(field: Field) -> TypeGuard[RegularField]:
    """Return whether a field has a colour of its own, in which it is shown beside others."""
    return isinstance(field, RegularField) and field.color is not None


def _has_own_look(field: Field, mode: str, options: Mapping[str, Any]) -> bool:
    """Return whether a field is a group of its own: labels, and in pictures of colours colours and channels."""
    channel = is_channel(field) and options.get("cmap") is None
    return is_labelled(field) or mode in COLORED and (is_colored(field) or channel)


def _own_look(field: Field, mode: str, iso_value: Any, options: Mapping[str, Any]) -> TransferFunction:
    """Return the transfer function of a field that is a group of its own."""
    if is_labelled(field):
        return LabelColors.completed(field.label_colors, field.labels_found)
    if is_colored(field):
        return _IDENTITY
    assert isinstance(field, RegularField)
    # Surfaces have the colour itself.
    own = {"cmap": [field.color if mode in SURFACES else (0.0, 0.0, 0.0), field.color], "clim": field.window}
    asked = {**own, **pick_given(LookOptions, options)}
    # Of the light of channels the limits are those of a picture of colours.
    seen = mode if mode in COLORED else MODES[0]
    return _transfer_function([field], seen, iso_value, asked, partial(automatic.choose, [field]))[0]


def is_labelled(field: Field) -> TypeGuard[RegularField]:
    """Return whether a field's samples name things."""
    return isinstance(field, RegularField) and field.labels


def _warn_of_one_value(scene: Scene) -> None:
    """Warn of volumes whose samples are all equal: there is nothing to choose a look by."""
    volumes = [one for one in scene.fields if one.size and not is_labelled(one) and not is_colored(one)]
    # X-rays show how thick a volume is.
    if TRAITS[scene.mode].integrates or not volumes or not all(isinstance(one, RegularField) for one in volumes):
        return
    (low, high), *others = [one.value_range for one in volumes]
    # A surface lies where values differ: in volumes that end there is none.
    ends = TRAITS[scene.mode].shows_surfaces and all(isinstance(one, RegularField) and one.domain for one in volumes)
    told_as_empty = ends or (low == 0.0 and not TRAITS[scene.mode].is_composited)
    if low == high and all(found == (low, low) for found in others) and not told_as_empty:
        shown = (
            "a translucent block, with limits around that value" if TRAITS[scene.mode].is_composited else "its block"
        )
        warn(f"all samples are {low:g}: there is nothing in the volume to tell apart, and the picture shows {shown}")


def _warn_of_facets(scene: Scene) -> None:
    """Warn of a sphere so large that its faces cut the data elsewhere than it does."""
    sphere, boxes = scene.options["clip"].sphere, [one.bounds for one in scene.fields if one.size]
    if sphere is None or not boxes:
        return
    aside = scene.options["clip"].aside
    corners = corners_of(joined_bounds(boxes))
    distances = np.linalg.norm(corners - np.asarray(sphere[0]), axis=1)
    cuts = distances.max() > sphere[1] - aside
    if cuts and aside > _MOST_ASIDE * scene.slice_spacing:
        warn(
            f"the sphere is drawn with flat faces up to {aside:.3g} aside, more than {_MOST_ASIDE:g} slices; cut with "
            "a smaller sphere, or with a plane: pass " + option_ref("clip", "...")
        )


def _warn_of_what_lies_outside(scene: Scene) -> None:
    """Warn of slice planes beside the data, and of fields that give colours elsewhere."""
    boxes = [one.bounds for one in scene.fields if one.size]
    if not boxes:
        return
    (lower, upper), corners = joined_bounds(boxes), corners_of(joined_bounds(boxes))
    for plane in scene.options["slice_planes"]:
        heights = corners @ np.asarray(plane.normal)
        if plane.offset is not None and not heights.min() <= plane.offset <= heights.max():
            warn(
                f"a slice plane lies beside the data, and is not seen: its offset is {plane.offset:.6g}, those of the "
                f"data are {heights.min():.6g} to {heights.max():.6g}"
            )
    for coloring in scene.color_by:
        others = [one.bounds for one in coloring[0] if one.size] if coloring is not None else []
        if not others:
            continue
        first, last = joined_bounds(others)
        if any(a > d or b < c for a, b, c, d in zip(lower, upper, first, last, strict=True)):
            warn("the field of " + option_ref("color_by") + " lies beside the data, whose own colours are shown")


def _warn_of_strays(scene: Scene) -> None:
    """Warn where few kernels far away from all others set the distance of slices, which is a share of the extent."""
    for field in scene.fields:
        if not isinstance(field, EllipsoidField) or not field.size:
            continue
        wanted = kernel_spacing(field)
        if not scene.slice_spacing > COARSE * wanted > 0.0:
            continue
        low, high = np.percentile(field.centers, _MOST_CENTRES, axis=0)
        lower, upper = field.centre_bounds
        whole, most = math.dist(lower, upper), math.dist(low, high)
        if most < _FAR_APART * whole:
            warn(
                f"coarse slices: {scene.slice_spacing:.3g} apart, kernels {wanted:.3g} thin; a few far kernels make "
                f"the data {whole:.3g} long instead of {most:.3g}; leave them out, or pass "
                + option_ref("slice_spacing", f"{wanted:.3g}")
            )


def _surroundings(fields: Sequence[Field]) -> float:
    """Return a radius for ambient occlusion: a share of the diagonal of the box around the centres."""
    boxes = [one.centre_bounds for one in fields if one.size]
    low, high = joined_bounds(boxes) if boxes else ((0.0,) * 3, (0.0,) * 3)
    return _SURROUNDINGS * math.dist(low, high) or 1.0


def _refuse_both(whole: str, parts: Sequence[str], options: Mapping[str, Any]) -> None:
    """Raise InvalidInput where parts of an option are given beside the whole of it."""
    clash = [name for name in parts if (value := options.get(name)) is not None and value is not False]
    if clash:
        raise complain(
            "render: these options cannot be used together",
            option_refs([whole, *clash]),
            "either " + option_ref(whole) + ", or " + option_refs(parts),
        )


def _set_scalar_colors(scene_options: Any, options: Mapping[str, Any]) -> None:
    """Set the colours of a scalar picture."""
    if "scalar_colors" in scene_options:
        _refuse_both("scalar_colors", ("cmap", "clim", "log_scale"), options)
        return
    cmap, clim, log = (options.get(name) for name in ("cmap", "clim", "log_scale"))
    scene_options["scalar_colors"] = ScalarColors("gray" if cmap is None else cmap, clim, bool(log))


def _transfer_function(
    fields: Sequence[Field], mode: str, iso_value: Any, options: Mapping[str, Any], chosen: Callable[[], Look]
) -> tuple[TransferFunction, Look | None]:
    """Return a transfer function, and the automatic look that it was chosen by, or None."""
    given: TransferFunction | str | None = options.get("transfer_function")
    cmap: Any
    opacity: Any
    clim: Any
    cmap, opacity, clim = (options.get(name) for name in ("cmap", "opacity", "clim"))
    if given is not None:
        if mode in COLORED:
            _refuse_both("transfer_function", ("cmap", "opacity", "clim"), options)
        return TransferFunction.preset(given) if isinstance(given, str) else given, None
    if mode not in COLORED:
        return _COLORLESS, None
    if mode in SURFACES and clim is None:
        clim = surface_limits(fields, iso_value_of("render: iso_value", iso_value))
    look = chosen() if opacity is None or clim is None else None
    if look is not None:
        own: Any = look.opacity if clim is None else (0.0, look.top_opacity)
        cmap = look.cmap if cmap is None and clim is None else cmap
        opacity, clim = own if opacity is None else opacity, look.clim if clim is None else clim
    function = TransferFunction.from_colormap(DEFAULT_CMAP if cmap is None else cmap, opacity, clim)
    least, largest = range_of(fields)
    return function.with_least(least if options.get("clim") is None and least < largest else None), look


def suggested_look(data: object, given: Mapping[str, object]) -> dict[str, Any]:
    """Return the look that generated data sets suggest, where nobody gave another one."""
    suggested: Any = getattr(data, "suggested", None)
    if not isinstance(suggested, Mapping) or {"transfer_function", "cmap", "opacity", "clim"} & given.keys():
        return {}
    look: dict[str, Any] = {}
    mode = given.get("mode") or suggested.get("mode", MODES[0])
    if mode in SURFACES and "iso_value" in suggested and "iso_value" not in given:
        look["iso_value"] = suggested["iso_value"]
    if mode in COMPOSITE or "iso_value" in look:
        maker: Any = data
        look["transfer_function"] = maker.transfer_function()
    return {"mode": mode, **look}

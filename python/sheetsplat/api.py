"""`open` reads a file into a field; `render` makes a picture of data in one call."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from sheetsplat._checks import (
    as_array,
    attribute,
    check_progress,
    choice,
    color,
    image_size,
    instance,
    is_off,
    names,
    parts,
    shown,
    whole,
)
from sheetsplat._objects import kind_of_object
from sheetsplat._waiting import asking
from sheetsplat.bricks.workers import look_after
from sheetsplat.camera import Camera
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.decisions import Decisions
from sheetsplat.choose.kernels import with_own_kernel
from sheetsplat.choose.look import is_labelled, suggested_look
from sheetsplat.choose.picture import choose, kept
from sheetsplat.errors import InvalidInput, Unsupported, complain, option_ref, option_refs, unusable
from sheetsplat.fields import EllipsoidField, Field, RegularField, any_in_bricks
from sheetsplat.fields.labelled import with_labels
from sheetsplat.image import Image
from sheetsplat.labels import LabelColors
from sheetsplat.look.channel_light import adds_light
from sheetsplat.look.decades import in_decades
from sheetsplat.look.measure import with_values
from sheetsplat.notices import warn
from sheetsplat.options.bricks import cluster_of
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import MODES, SCALAR, check_names, documented, filled, pick, pick_given
from sheetsplat.options.data import FileOptions, OpenOptions
from sheetsplat.options.picture import LookOptions, RenderOptions, unused
from sheetsplat.options.renderer import OUTPUTS, Output, Progress, RendererOptions
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

if TYPE_CHECKING:
    from sheetsplat.bcc import BccVolume
    from sheetsplat.datasets import Dataset


Made = TypeVar("Made", bound=Field)


class VtkDataSet(Protocol):
    """A data set of VTK or PyVista."""

    def GetPointData(self) -> Any:  # noqa: N802
        """Return the arrays of its points."""


Data = Field | Sequence[Field] | ArrayLike | str | os.PathLike[str] | Mapping[str, Any] | VtkDataSet


def _shape(shape: object) -> tuple[int, int, int]:
    wanted = "three whole numbers, (nk, nj, ni)"
    found = parts("open: shape", shape, wanted, 3)
    if len(found) != 3:
        raise complain(unusable("open: shape"), shown(shape), wanted)
    nk, nj, ni = (whole("open: shape", part) for part in found)
    return nk, nj, ni


def _given(group: type, options: Any) -> dict[str, Any]:
    """Return the options of a group that were given, but for `quality`; None, False and 0 stand for the default."""
    given = pick_given(group, options)
    given.pop("quality", None)
    switched = ("prefilter", "log", "offset", "resample")
    return {name: value for name, value in given.items() if name not in switched or not is_off(value)}


@documented(OpenOptions, chooses=True)
def open(
    path: Data, **options: Unpack[OpenOptions]
) -> RegularField | EllipsoidField | list[RegularField | EllipsoidField]:
    """Return the field of a file, which may be gzipped, or of data that another library holds.

    Of a file with several channels of which `name` chooses none it is a list of fields, each with the `name` and the
    `color` of its channel. Volumes of colours and of labels are fields that are `colored`, or have `labels`.

    Regular volumes: .npy, .npz, NRRD, MetaImage (.mhd, .mha), NIfTI (.nii, .hdr), DICOM series (a folder, or one of its
    files), TIFF stacks (a file, or a folder of slices), MRC, OpenVDB, NetCDF, VTKHDF images, HDF5 with volumes
    (FILE:/dataset), Zarr and OME-Zarr (FOLDER:/array), .vti, .vtr, .pvti, .pvtr, .vtm and .pvd of images, .vtk of
    images and rectilinear grids, raw samples. Scattered data: .ssk of encoded
    fields, VTKHDF meshes, Gmsh (.msh), MED, XDMF, HDF5 with
    particles, .obj and .ply of closed meshes, .ply of 3D Gaussian Splatting, .vtm and .pvd of meshes (FILE.vtm:/block),
    .vthb, .vtu, .vts, .vtp, .pvtu, .pvts, .pvtp, .vtk, .csv, .npz with an array centers, PLOT3D solutions with a grid.

    Parameters
    ----------
    path
        The file; its format is found by content, then by suffix. Or an array [k, j, i], an xarray DataArray or
        Dataset, a dask, Zarr or h5py array, a PyVista or VTK data set, a meshio Mesh, or a pandas or polars DataFrame
        or a dict of columns x, y, z and others (data.md).
    **options
        Those of OpenOptions.

    Raises
    ------
    InvalidInput
        For damaged files, wrong sizes or other content, and for options that do not apply to the format.
    OutOfMemory
        Where the samples do not fit.
    Error
        Where the file cannot be read.

    Examples
    --------
    >>> np.save("cube.npy", values)
    >>> ss.open("cube.npy", spacing=(1, 1, 2)).spacing
    (1.0, 1.0, 2.0)
    """
    check_names("open", options, OpenOptions)
    asked = Asked.of("open", options)
    given = _given(OpenOptions, options)
    weight = given.pop("weight", None)
    fields = _opened(path, options if isinstance(weight, str) else given)
    if weight is not None and not isinstance(weight, str):
        fields = _weighted(fields, weight, given)
    made = [with_own_kernel(one, asked) for one in fields]
    return made[0] if len(made) == 1 else made


def _opened(path: Any, options: Any) -> list[RegularField | EllipsoidField]:
    """Return the fields of a file or another library's data with the kernels that were given, or plain ones."""
    from sheetsplat.io.opening import open_fields

    given = _given(OpenOptions, options)
    if "shape" in given:
        given["shape"] = _shape(given["shape"])
    if "offset" in given:
        given["offset"] = whole("open: offset", given["offset"])
    kind = None if isinstance(path, str | os.PathLike) else kind_of_object(path)
    if kind is not None:
        from sheetsplat.io.objects import field_of_object

        return [field_of_object(path, kind, given)]
    if isinstance(path, np.ndarray) or _is_list(path):
        return [_of_array("open", path, given)]
    return open_fields(path, given)


def _is_list(data: object) -> bool:
    """Return whether data are a list of numbers, and not one of several data."""
    if isinstance(data, list | tuple) and _are_several(data):
        raise complain(
            "open: several data cannot be opened",
            f"a list of {len(data)}",
            "one file or array",
            "pass the list to sheetsplat.render, or as a series to sheetsplat.animate",
        )
    return isinstance(data, list | tuple) and bool(data)


def _are_several(data: object) -> bool:
    """Return whether a list has several data: paths, data of other libraries, fields, or arrays with three axes."""
    if not isinstance(data, list | tuple):
        return False

    def is_one(part: object) -> bool:
        is_path = isinstance(part, str | os.PathLike | Field) or kind_of_object(part) is not None
        return is_path or attribute(part, "ndim") == 3 or callable(attribute(part, "field"))

    return bool(data) and all(map(is_one, data))


def _of_array(owner: str, data: Any, given: dict[str, Any]) -> Any:
    """Return the field of an array; `given`: options of `open`, of which those of files are refused."""
    log = given.pop("log", None)
    for name in pick(FileOptions, given):
        raise complain(unusable(f"{owner}: {name}"), "an array", f"{name} only for files")
    field = RegularField(data, **with_labels(data, given))
    return field if log is None else in_decades([field], {}, log)[0]


def _is_made(data: object) -> bool:
    """Return whether data are a field, or several."""
    several = isinstance(data, list | tuple) and bool(data) and all(isinstance(one, Field) for one in data)
    return several or isinstance(data, Field)


def _refuse_for_made(given: Mapping[str, Any]) -> None:
    """Raise InvalidInput for options of `open` that were given for fields."""
    if given:
        raise complain(
            "render: these options cannot be used",
            option_refs(given) + " for a field that is made already",
            "them only for arrays and files",
            "give them to the field itself, or to sheetsplat.open",
        )


def to_fields(data: object, **options: Unpack[OpenOptions]) -> list[Field]:
    """Return the fields of an array, a path, a field or several fields; `options` make fields of the first two.

    Their kernels are those that were given, or plain ones; they may have weights, which fields take, too.
    """
    given = _given(OpenOptions, options)
    weight = given.pop("weight", None)
    if isinstance(weight, str):
        return _fields_of(data, {**given, "weight": weight})
    fields = _fields_of(data, given)
    return fields if weight is None else _weighted(fields, weight, given)


def _weighted(fields: list[Made], weight: Any, given: Mapping[str, Any]) -> list[Made]:
    """Return fields whose means are weighted by another file, a field, or numbers."""
    if len(fields) > 1:
        found, wanted = f"weights for {len(fields)} fields", "one field"
        raise complain(unusable("render: weight"), found, wanted, option="weight", kind=Unsupported)
    if isinstance(weight, os.PathLike):
        (weight,) = _fields_of(weight, {name: one for name, one in given.items() if name not in ("log", "scalar")})
    return [one.weighted_by(weight) for one in fields]


def _fields_of(data: Any, given: dict[str, Any]) -> list[Field]:
    """Return the fields of data, by the options of `open` that were given."""
    # Generated data sets, and other objects with a method field().
    maker = None if isinstance(data, np.ndarray) else attribute(data, "field")
    if callable(maker):
        data = maker()
    if isinstance(data, str | os.PathLike) or kind_of_object(data) is not None:
        return [*_opened(data, given)]
    # Readers are not needed before.
    from sheetsplat.io.common_world import in_one_world

    if _is_made(data):
        _refuse_for_made(given)
        fields: Any = data
        return [data] if isinstance(data, Field) else in_one_world(fields)
    if isinstance(data, list | tuple) and not data:
        advice = "check the pattern of names that made the list"
        raise complain(
            "the picture cannot be made", f"an empty {type(data).__name__}", "files, arrays or fields", advice
        )
    if _are_several(data):
        parts: Any = data
        return in_one_world([field for one in parts for field in _fields_of(one, dict(given))])
    return [_of_array("render", data, given)]


def _refuse_one_for_each(count: int, look: Mapping[str, Any]) -> None:
    """Raise InvalidInput for a list of colormaps or of limits: several fields have one, or transfer functions."""
    for name, is_one in (("cmap", _is_color), ("clim", lambda part: np.ndim(part) == 0)):
        given = look.get(name)
        if isinstance(given, list | tuple) and not all(map(is_one, given)):
            raise complain(
                unusable(f"render: {name}"),
                f"{shown(given)} for {count} fields",
                "one for the sum of all fields",
                "pass " + option_ref("transfer_function", "...") + ", a list with a TransferFunction for each field",
                option=name,
            )


def _is_color(part: object) -> bool:
    """Return whether a part of a colormap is a colour."""
    try:
        return not isinstance(part, str) or bool(color("cmap", part))
    except InvalidInput:
        return False


def with_coloring(opened: Opened, options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return options of a picture with the field that gives colours, or what `Scene` takes, where one is given."""
    return options if options.get("color_by") is None else {**options, "color_by": _coloring(opened, options)}


def _coloring(opened: Opened, options: Mapping[str, Any]) -> Any:
    given, data = options["color_by"], opened.data
    if isinstance(given, Field) or isinstance(given, tuple | list) and any(isinstance(one, Field) for one in given):
        return given
    first = opened.fields[0]
    if len(opened.fields) > 1:
        told = f"an array of shape {given.shape}" if isinstance(given, np.ndarray) else shown(given)
        found, wanted = f"{told} for {len(opened.fields)} fields", "a field for each, with its function"
        raise complain(unusable("render: color_by"), found, wanted, "give them to sheetsplat.Scene", option="color_by")
    if isinstance(given, os.PathLike) or isinstance(given, str) and Path(given).exists():
        return _only(given, _fields_of(given, {}))
    if isinstance(given, str):
        of_data = {name: one for name, one in _given(OpenOptions, options).items() if name not in ("log", "name")}
        if _is_made(data) or isinstance(data, np.ndarray | list | tuple):
            found = f"{shown(given)}, which is no file, for data whose arrays have no names"
            wanted = "the path of a file, a field, or numbers"
            raise complain(unusable("render: color_by"), found, wanted, option="color_by")
        return _only(given, _fields_of(data, {**of_data, "scalar": given}))
    numbers_ = as_array("render: color_by cannot be used", given, "a field, a name, or numbers of the data's shape")
    wanted_shape = first.shape if isinstance(first, RegularField) else getattr(first, "values", np.zeros(0)).shape
    if numbers_.shape != wanted_shape:
        found, wanted = f"an array of shape {numbers_.shape}", f"as many as the data have, {wanted_shape}"
        raise complain(unusable("render: color_by"), found, wanted, option="color_by")
    _require_finite(numbers_, first)
    if isinstance(first, RegularField):
        return first.replace(numbers_, labels=False, **({} if first.given_base is not None else {"base": None}))
    assert isinstance(first, EllipsoidField)
    return with_values(first, numbers_.astype(np.float64))


def _require_finite(given: np.ndarray[Any, Any], data: Field) -> None:
    """Raise InvalidInput for infinite numbers that give colours, and for NaN unless the data may have missing ones."""
    if given.dtype.kind != "f":
        return
    skips = isinstance(data, RegularField) and data.nan == "skip"
    wrong = np.argwhere(np.isinf(given) if skips else ~np.isfinite(given))
    if len(wrong):
        at = wrong[0].tolist()
        missing = bool(np.isnan(given[tuple(at)]))
        skip = "open the data with " + option_ref("nan", "skip") + ": they keep their own colours there"
        advice = skip if missing and isinstance(data, RegularField) else "replace it"
        found = f"{'NaN' if missing else 'infinity'} at {at}"
        raise complain(unusable("render: color_by"), found, "finite numbers", advice, option="color_by")


def _only(given: object, fields: Sequence[Field]) -> Field:
    """Return the field that gives colours; InvalidInput for several."""
    if len(fields) > 1:
        found, advice = f"{len(fields)} fields in {shown(given)}", "choose one by sheetsplat.open(..., name=...)"
        raise complain(unusable("render: color_by"), found, "one", advice, option="color_by")
    return fields[0]


def _asks_for_values(options: Mapping[str, Any]) -> bool:
    """Return whether options of a picture are about values, so that numbers which look like labels are none."""
    function, mode, log = (options.get(name) for name in ("transfer_function", "mode", "log"))
    of_values = function is not None and not isinstance(function, LabelColors)
    scalar = isinstance(mode, str) and mode in SCALAR
    given = any(options.get(name) is not None for name in ("cmap", "clim", "opacity", "iso_value", "weight"))
    return of_values or scalar or given or not (log is None or is_off(log))


@dataclass(frozen=True)
class Opened:
    """Data as fields of their values that have the kernels which were given, or plain ones; a scene stays one.

    Whether their logarithm is shown is a matter of the mode.

    Attributes
    ----------
    data
        What was given.
    fields
        The fields; none for a scene.
    """

    data: object
    fields: tuple[Field, ...] = ()

    @classmethod
    def of(cls, data: object, options: Mapping[str, Any]) -> Opened:
        """Return data opened with those of `options` that `open` takes."""
        if isinstance(data, Scene):
            return cls(data)
        path = Path(data) if isinstance(data, str) else data
        given = pick(OpenOptions, options)
        if _is_made(data):
            of_made = _given(OpenOptions, given)
            _refuse_for_made({name: one for name, one in of_made.items() if name != "weight" or isinstance(one, str)})
        fields = to_fields(path, **{**given, "log": None})
        if given.get("labels") is None and not _is_made(data) and _asks_for_values(options):
            # (Only the samples' looks said that they are labels.)
            fields = [one.replace(labels=False) if is_labelled(one) else one for one in fields]
        return cls(data, tuple(fields))


def _chosen(opened: Opened, options: Any, asked: Asked, size: tuple[int, int], outputs: Iterable[str]) -> Decisions:
    """Return what is drawn of data: all of a scene is given, of anything else the rest is chosen."""
    look, data = pick_given(LookOptions, options), opened.data
    if isinstance(data, Scene):
        clash = [*look, *_given(OpenOptions, options)]
        if clash:
            raise complain(
                "render: these options cannot be used",
                option_refs(clash) + " for a scene that is made already",
                "them only for arrays, files and fields",
                "give them to sheetsplat.Scene",
            )
        if options.get("quality") is not None:
            warn(option_ref("quality") + " changes nothing in a scene, which has its own kernels, slices and filter")
        return kept(data, options, asked, size)
    if isinstance(data, list | tuple) and len(data) > 1:
        _refuse_one_for_each(len(data), look)
    options = with_coloring(opened, options)
    look = pick_given(LookOptions, options)
    suggested = suggested_look(data, look)
    # False has the same effect as leaving the option out.
    wanted = [*(name for name, value in look.items() if value is not False), *outputs]
    wanted += [name for name in ("weight",) if options.get(name) is not None]
    mode = choice("render: mode", look.get("mode", suggested.get("mode", MODES[0])), MODES)
    if isinstance(look.get("transfer_function"), list | tuple) and adds_light(opened.fields, mode):
        # The light of channels has their colours and limits.
        wanted.remove("transfer_function")
    if ignored := unused(mode, wanted):
        warn(f"mode {mode} does not use these options: " + option_refs(ignored))
    return choose(opened.fields, options, asked, size, made=_is_made(data), suggested=suggested)


def _warn_of_replaced(options: Any, projection: object) -> None:
    """Warn of options that others make void: those of a camera and of a renderer that are given whole."""
    for made, group in (("camera", CameraOptions), ("renderer", RendererOptions)):
        if options.get(made) is not None and (given := pick_given(group, options)):
            warn(option_ref(made) + " replaces these options: " + option_refs(given))
    if options.get("camera") is None and options.get("fov_y") is not None and projection == "orthographic":
        warn(option_ref("fov_y") + " changes nothing without " + option_ref("projection", "perspective"))
    for name, owner in (("color_map", "color_by"), ("slice_cmap", "slice_planes"), ("slice_clim", "slice_planes")):
        used = options.get(owner)
        if options.get(name) is not None and (used is None or isinstance(used, tuple | list) and not used):
            warn(option_ref(name) + " changes nothing without " + option_ref(owner, "..."))


@dataclass(frozen=True)
class Prepared:
    """A picture that is not drawn yet: what was given, and what was chosen from the data.

    Attributes
    ----------
    scene, camera, size, renderer
        What `Renderer.render` takes, and the renderer that draws it.
    outputs, progress, depth_limit, client
        As given.
    decisions
        What was chosen, why, and by whom, where `prepare` made it.
    """

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    renderer: Renderer
    outputs: tuple[Output, ...] = ()
    progress: Progress | None = None
    depth_limit: ArrayLike | None = None
    client: Any = None
    decisions: Decisions | None = None

    def render(self) -> Image:
        """Return the picture; raises what `Renderer.render` does."""
        if any_in_bricks(self.scene.fields):
            from sheetsplat.bricks.picture import draw

            return draw(
                self.renderer.settings, self.scene, self.camera, self.size, self.outputs, self.progress,
                depth_limit=self.depth_limit, client=self.client,
            )  # fmt: skip
        if self.client is not None:
            raise complain(
                unusable("render: client"),
                "a client, for data that are not in bricks",
                "a volume in bricks",
                "open it with sheetsplat.open_bricks(path, client=client)",
                option="client",
            )
        return self.renderer.render(
            self.scene, self.camera, self.size, self.outputs, self.progress, depth_limit=self.depth_limit
        )


def prepare(data: Data | Dataset | BccVolume | Scene | Opened, **options: Unpack[RenderOptions]) -> Prepared:
    """Return what `render` draws, without drawing it: the same options and errors.

    `Opened` data are not read again.
    """
    check_names("render", options, RenderOptions)
    picture = filled(RenderOptions, options)
    size = image_size(picture["size"])
    # Data in bricks are looked at by its workers before they are drawn.
    client = cluster_of("render: client", picture["client"])
    look_after("render", client, picture["worker_timeout"])
    renderer: Renderer | None = picture["renderer"]
    if renderer is not None:
        instance("render: renderer", renderer, Renderer)
    outputs: Any = names("Renderer: outputs", picture["outputs"], OUTPUTS)
    asked = Asked.of("render", options)
    opened = data if isinstance(data, Opened) else Opened.of(data, options)
    decided = _chosen(opened, options, asked, size, outputs)
    _warn_of_replaced(options, picture["projection"])
    if renderer is None:
        renderer = Renderer(**pick(RendererOptions, options))
    rest = outputs, picture["progress"], picture["depth_limit"], client
    return Prepared(decided.scene, decided.camera, size, renderer, *rest, decided)


@documented(RenderOptions, chooses=True)
def render(data: Data | Dataset | BccVolume | Scene, **options: Unpack[RenderOptions]) -> Image:
    """Return a picture of an array, a file, a field or several fields. Options that are not given follow from the data.

    Parameters
    ----------
    data
        Array [k, j, i], path of a file, field, volume in bricks (`open_bricks`), sequence of fields, anything else
        that `open` takes, or an object whose method ``field()`` makes a field, as generated data sets have. A data set
        is shown as it suggests where no colours are given. A scene is drawn as it is, with the options of the picture,
        the camera and the renderer only; a quality changes nothing.
    **options
        Those of RenderOptions.

    Raises
    ------
    Error
        What opening, `Scene`, `Camera.fit` and `Renderer` raise.

    Examples
    --------
    >>> image = ss.render(values, cmap="magma", opacity="sigmoid_5", size=(40, 30))
    >>> image.size
    (40, 30)
    """
    check_progress("Renderer", options.get("progress"))
    with asking(options.get("progress")):
        return prepare(data, **options).render()

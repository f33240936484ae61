"""How a picture was made, without its data: as text in a PNG, and back into a scene and a camera."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sheetsplat import _sheetsplat
from sheetsplat._checks import image_size, shown, strength
from sheetsplat._values import arguments_of
from sheetsplat.camera import Camera
from sheetsplat.errors import Error, InvalidInput, complain
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.fields.regular import BOUNDARIES
from sheetsplat.fields.trim import Trim
from sheetsplat.look.strays import trimmed
from sheetsplat.options.core import checked, definitions
from sheetsplat.options.data import FITS, OpenOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.plain_values import class_of, object_of, tuples
from sheetsplat.quantity import Quantity, notes_of
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

#: Version of the format of the text.
FORMAT = 1
#: Most characters of the text; more are neither written nor read.
LONGEST = 1 << 20
_MOST_FIELDS = 256
_MOST_OBJECTS = 4096
# Settings of a renderer that belong to a machine, or that chose settings which are written themselves.
_LEFT_OUT = ("device", "threads", "max_error", "max_seconds")
_RENDERER = tuple(name for name in definitions(RendererClassOptions) if name not in _LEFT_OUT)
_OF_VOLUMES = (
    *("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "prefilter", "nan"),
    *("boundary", "base"),
)
_KERNELS = ("radius", "falloff", "normalization", "w0", "prefilter")
_OF_ELLIPSOIDS = ("normalization", "w0", "falloff", "min_scale", "base")
# Options of volumes in pictures that were made before volumes had any of them.
_BEFORE = {"boundary": "zero", "base": 0.0}
_OPENED = tuple(name for name in definitions(OpenOptions) if name != "grid")
# What options of fields can be.
_ABOVE_0 = ("w0", "falloff", "radius", "min_scale", "spacing", "neighbors", "support", "shape")
_WORDS = {
    "normalization": ("none", "lattice", "threshold"),
    "lattice": ("cartesian", "bcc"),
    "nan": ("error", "skip"),
    "boundary": BOUNDARIES,
    "fit": FITS,
}
_KINDS: dict[str, tuple[type[Field], tuple[str, ...]]] = {
    "RegularField": (RegularField, _OF_VOLUMES),
    "EllipsoidField": (EllipsoidField, _OF_ELLIPSOIDS),
}
_CAMERAS = {
    "orthographic": ("eye", "target", "up", "height"),
    "perspective": ("eye", "target", "up", "fov_y", "near", "shift"),
    "fit": ("lower", "upper", "direction", "up", "kind", "margin", "fov_y"),
}
_Result = TypeVar("_Result")


class DamagedRecipe(InvalidInput):
    """A description of a picture that was changed, damaged, or written by a newer version."""


def _damaged(found: str, wanted: str, advice: str = "") -> Error:
    return complain("the description in the picture cannot be used", found, wanted, advice, kind=DamagedRecipe)


@dataclass(frozen=True)
class FieldRecipe:
    """How a field was made.

    Attributes
    ----------
    kind
        "RegularField" or "EllipsoidField".
    options
        Its own options, without its arrays.
    opened
        The options of `sheetsplat.open` that made it, without paths; empty for fields of arrays.
    quantity
        What scalar and lengths are.
    ghost_points
        Distance and weight of its ghost points, or None.
    trim
        What was left out of the data.

    Examples
    --------
    >>> ss.render(values, size=(32, 32)).recipe.fields[0].kind
    'RegularField'
    """

    kind: str
    options: Mapping[str, Any]
    opened: Mapping[str, Any]
    quantity: Quantity = Quantity()
    ghost_points: tuple[float, float] | None = None
    trim: Trim = Trim()

    @classmethod
    def of(cls, field: Field) -> FieldRecipe:
        """Return how a field was made."""
        # Data in bricks are made again of the same file in memory.
        kind = "RegularField" if isinstance(field, RegularField) else "EllipsoidField"
        options = {name: getattr(field, name) for name in _KINDS[kind][1]}
        if isinstance(field, RegularField):
            # One that was not given is found again in the same data.
            options["base"] = field.given_base
        ghosts = field.ghost_options if isinstance(field, EllipsoidField) else None
        return cls(kind, options, dict(field.opened), field.quantity, ghosts, field.trim)

    def kernels_of(self, field: Field) -> Field:
        """Return a volume with the kernels of the one in the picture, unless it has some of its own."""
        if not isinstance(field, RegularField) or not field.is_plain:
            return field
        known = {**self.opened, **self.options}
        changes = {name: known[name] for name in _KERNELS if known.get(name) is not None}
        if field.boundary == "edge" and known.get("boundary") is not None:
            changes["boundary"] = known["boundary"]
        if field.given_base is None and known.get("base") is not None:
            changes["base"] = known["base"]
        now = {name: field.given_base if name == "base" else getattr(field, name) for name in changes}
        same = now == changes
        return field.as_settled() if same else field.replace(**changes)

    def _trimmed(self, path: str | os.PathLike[str], field: Field) -> Field:
        """Return a field without what was left out of the one of the picture."""
        if self.trim.kernels and self.trim.kernels[-1] >= field.size:
            found = f"{field.size} kernels"
            raise complain(f"{path} is no data for this picture", found, f"more than {self.trim.kernels[-1]} of them")
        return trimmed(field, self.trim)

    def open(self, path: str | os.PathLike[str], **options: Any) -> Field:
        """Return the field of a file, opened as this one was; `options` of `sheetsplat.open` replace what they name."""
        from sheetsplat.io.formats import find_format
        from sheetsplat.io.opening import open_field

        raw = any(name in options or name in self.opened for name in ("shape", "dtype"))
        form = find_format(path, raw_options=raw, name=options.get("name"), grid="grid" in options)
        if form.scattered != (self.kind == "EllipsoidField"):
            raise complain(
                f"{path} is no data for this picture", f"a file of format {form.name}", f"what makes a {self.kind}"
            )
        own = {} if self.kind == "EllipsoidField" and self.opened else self.options
        given = {**own, **self.opened, **options}
        given = {name: value for name, value in given.items() if value is not None and value is not False}
        field: Field = self._trimmed(path, open_field(path, given).opened_with(self.opened))
        if isinstance(field, EllipsoidField) and self.ghost_points is not None:
            return field.with_ghost_points(distance=self.ghost_points[0], weight=self.ghost_points[1])
        return field


@dataclass(frozen=True)
class Recipe:
    """How a picture was made, without its data: everything that `render` needs to make it again from the same data.

    Attributes
    ----------
    transfer_functions
        Of the scene, one for each group of fields.
    groups
        How many fields are in each group.
    options
        Every option of `Scene` by its name.
    camera
        The camera.
    size
        (width, height) in pixels.
    fields
        How each field was made.
    renderer
        Options of `Renderer`: the backend that drew the picture, and what may change its last digits.

    Examples
    --------
    >>> ss.render(values, size=(32, 32)).save("cube.png")
    >>> recipe = ss.Recipe.read("cube.png")
    >>> again = ss.Renderer().render(recipe.scene([ss.RegularField(values)]), recipe.camera, size=recipe.size)
    """

    transfer_functions: tuple[TransferFunction, ...]
    groups: tuple[int, ...]
    options: Mapping[str, Any]
    camera: Camera
    size: tuple[int, int]
    fields: tuple[FieldRecipe, ...]
    renderer: Mapping[str, Any]

    @classmethod
    def of(
        cls, scene: Scene, camera: Camera, size: tuple[int, int], renderer: Mapping[str, Any], **changes: Any
    ) -> Recipe:
        """Return the recipe of a picture; `changes` are options of the scene that were chosen in place of its own."""
        made_of = tuple(map(FieldRecipe.of, scene.fields))
        settings = {name: renderer[name] for name in _RENDERER}
        groups, options = tuple(map(len, scene.groups)), {**scene.options, **changes}
        return cls(scene.transfer_functions, groups, options, camera, size, made_of, settings)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is shown, where that is not the data as they are."""
        return notes_of(one.quantity for one in self.fields)

    def scene(self, fields: Sequence[Field]) -> Scene:
        """Return the scene of as many fields as the picture had.

        Volumes that leave their kernels open have those of the picture's.
        """
        if len(fields) != len(self.fields):
            raise complain(
                "the picture cannot be made again",
                f"{len(fields)} field{'s' * (len(fields) != 1)}",
                f"{len(self.fields)}, as many as it was made of",
                "give as many files",
            )
        rest = (recipe.kernels_of(one) for recipe, one in zip(self.fields, fields, strict=True))
        groups = [list(itertools.islice(rest, count)) for count in self.groups]
        return Scene(groups, self.transfer_functions, **self.options)

    def to_json(self) -> str:
        """Return it as JSON, with the version of the package."""
        camera = {"maker": self.camera.maker, **self.camera.arguments}
        plain = {
            "format": FORMAT,
            "version": _sheetsplat.__version__,
            "size": self.size,
            "camera": camera,
            "transfer_functions": [function.points.tolist() for function in self.transfer_functions],
            "groups": self.groups,
            "scene": dict(self.options),
            "fields": [_members(one) for one in self.fields],
            "renderer": dict(self.renderer),
        }
        return json.dumps(plain, default=_plain, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> Recipe:
        """Return what `to_json` wrote. InvalidInput, naming the key, for anything else: nothing in it is executed."""
        if not isinstance(text, str):
            raise _damaged(f"{type(text).__name__}, {shown(text)}", "a text")
        if len(text) > LONGEST:
            raise _damaged(f"{len(text)} characters", f"at most {LONGEST}")
        with _reading("JSON"):
            plain = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_without_repetition)
        names = ("format", "version", "size", "camera", "transfer_functions", "groups", "scene", "fields", "renderer")
        parts = _mapping("description", plain, names, all_of_them=True)
        _check_version(parts["format"], parts["version"])
        fields, functions = _read("fields", _fields, parts["fields"]), parts["transfer_functions"]
        return cls(
            transfer_functions=_read("transfer_functions", _transfer_functions, functions),
            groups=_groups(parts["groups"], functions, len(fields)),
            options=_read("scene", _scene_options, parts["scene"]),
            camera=_read("camera", _camera, parts["camera"]),
            size=_read("size", image_size, parts["size"]),
            fields=fields,
            renderer=_read("renderer", _renderer, parts["renderer"]),
        )

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Recipe:
        """Return the recipe in a PNG. InvalidInput where it has none, or one that was changed or damaged."""
        from sheetsplat.io.png_text import KEYWORD, read_text

        text = read_text(Path(path), LONGEST)
        if text is None:
            raise complain(
                f"{path} does not say how it was made",
                f"no text {KEYWORD!r} in it",
                "a PNG that sheetsplat wrote with its description",
            )
        return cls.from_json(text)


def _members(instance: Any) -> dict[str, Any]:
    return {one.name: getattr(instance, one.name) for one in fields(instance)}


def _plain(value: Any) -> Any:
    """Return what JSON has no name for as something that it has."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, np.dtype):
        return value.str
    if isinstance(value, type):
        return np.dtype(value).str
    if isinstance(value, os.PathLike):
        raise TypeError("a path is nothing that a picture says")
    return arguments_of(value)


def _no_constant(name: str) -> float:
    raise ValueError(f"the number {name}")


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the key {shown(next(name for name in names if names.count(name) > 1))} twice")
    return found


@contextlib.contextmanager
def _reading(key: str) -> Iterator[None]:
    """Turn what goes wrong with the value of a key into InvalidInput that names the key."""
    try:
        yield
    except DamagedRecipe:
        raise
    except Error as error:
        named = f"{key}: " if error.option in (None, key) else f"{key}: {error.option}: "
        raise _damaged(named + (error.found or error.what), error.wanted) from None
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError, AttributeError) as error:
        raise _damaged(f"{key}: {str(error) or type(error).__name__}", "what sheetsplat wrote") from None


def _read(key: str, reader: Callable[[Any], _Result], value: Any) -> _Result:
    with _reading(key):
        return reader(value)


def _mapping(key: str, value: Any, known: Sequence[str], *, all_of_them: bool = False) -> dict[str, Any]:
    """Return an object of JSON whose keys are known; every key of it, or any of them."""
    if not isinstance(value, dict):
        raise _damaged(f"{key}: {shown(value)}", "an object {name: value}")
    for name in value:
        if name not in known:
            raise _damaged(f"{key}: the unknown key {shown(name)}", "only: " + ", ".join(known))
    for name in known if all_of_them else ():
        if name not in value:
            raise _damaged(f"{key}: no key {name!r}", "all of: " + ", ".join(known))
    return value


def _list(key: str, value: Any, most: int) -> list[Any]:
    if not isinstance(value, list) or len(value) > most:
        found = f"{len(value)} entries" if isinstance(value, list) else shown(value)
        raise _damaged(f"{key}: {found}", f"a list of at most {most}")
    return value


def _check_version(form: Any, version: Any) -> None:
    if type(form) is not int or form != FORMAT:
        raise _damaged(f"format: {shown(form)}", f"{FORMAT}", "use the version of sheetsplat that wrote it")
    here = _numbers_of(_sheetsplat.__version__)
    found = _numbers_of(version) if isinstance(version, str) else None
    if found is None or here is None or found > here:
        advice = "use the version of sheetsplat that wrote it"
        raise _damaged(f"version: {shown(version)}", f"a version up to {_sheetsplat.__version__}", advice)


def _numbers_of(version: str) -> tuple[int, ...] | None:
    found = re.fullmatch(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})", version, re.ASCII)
    return None if found is None else tuple(map(int, found.groups()))


def _transfer_functions(value: Any) -> tuple[TransferFunction, ...]:
    found = tuple(map(_transfer_function, _list("transfer_functions", value, _MOST_FIELDS)))
    if not found:
        raise _damaged("transfer_functions: none", "at least one")
    return found


def _transfer_function(value: Any) -> TransferFunction:
    rows = _list("transfer_functions", value, LONGEST)
    for row in rows:
        if not isinstance(row, list) or len(row) != 5:
            raise _damaged(f"transfer_functions: {shown(row)}", "rows of five numbers")
        for part in row:
            strength("transfer_functions", part)
    return TransferFunction(rows)


def _groups(value: Any, functions: Any, fields: int) -> tuple[int, ...]:
    """Return the number of fields of each group: a group for each transfer function, and all fields in one."""
    counts = _list("groups", value, _MOST_FIELDS)
    whole = all(type(count) is int and count > 0 for count in counts)
    if not whole or len(counts) != len(functions) or sum(counts) != fields:
        wanted = f"{len(functions)} numbers that add up to {fields}"
        raise _damaged(f"groups: {shown(value)}", wanted)
    return tuple(counts)


def _camera(value: Any) -> Camera:
    maker = value.get("maker") if isinstance(value, dict) else None
    if not isinstance(maker, str) or maker not in _CAMERAS:
        raise _damaged(f"camera: maker: {shown(maker)}", "one of: " + ", ".join(_CAMERAS))
    # Pictures that were made before cameras had a shift have none.
    given = {"shift": [0.0, 0.0], **value} if maker == "perspective" else value
    arguments = dict(_mapping("camera", given, ("maker", *_CAMERAS[maker]), all_of_them=True))
    del arguments["maker"]
    return Camera.of_arguments(maker, arguments)


def _object(key: str, kind: type, value: Any) -> Any:
    names = tuple(one.name for one in fields(kind) if one.init)
    given = _mapping(key, value, names)
    with _reading(key):
        return object_of(kind, given)


def _scene_options(value: Any) -> dict[str, Any]:
    given = dict(_mapping("scene", value, tuple(definitions(SceneOptions))))
    for name, part in given.items():
        kind, several = class_of(definitions(SceneOptions)[name])
        if kind is not None and several:
            given[name] = tuple(_object(name, kind, one) for one in _list(name, part, _MOST_OBJECTS))
        elif kind is not None:
            given[name] = None if part is None else _object(name, kind, part)
        elif isinstance(part, dict):
            raise _damaged(f"scene: {name}: {shown(part)}", "a value, or a list of values")
        else:
            given[name] = tuples(part)
    return checked("scene", given, SceneOptions)


def _fields(value: Any) -> tuple[FieldRecipe, ...]:
    found = tuple(field_recipe_of(_of_today(one)) for one in _list("fields", value, _MOST_FIELDS))
    if not found:
        raise _damaged("fields: none", "at least one")
    return found


def _of_today(field: Any) -> Any:
    """Return what a picture says about a field with the options that fields did not have when it was made."""
    if not isinstance(field, dict) or not isinstance(field.get("options"), dict) or field.get("kind") != "RegularField":
        return field
    options = field["options"]
    return field if "boundary" in options else {**field, "options": {**_BEFORE, **options}}


def field_recipe_of(value: Any) -> FieldRecipe:
    """Return how a field was made, of what JSON says; InvalidInput, naming the key, for anything else."""
    names = tuple(one.name for one in fields(FieldRecipe))
    # Earlier pictures left nothing out.
    whole_fields = {"trim": {}, **value} if isinstance(value, dict) else value
    given = _mapping("fields", whole_fields, names, all_of_them=True)
    kind, ghosts = given["kind"], given["ghost_points"]
    if not isinstance(kind, str) or kind not in _KINDS:
        raise _damaged(f"fields: kind: {shown(kind)}", " or ".join(_KINDS))
    options = _usable("options", _simple("options", _mapping("options", given["options"], _KINDS[kind][1])))
    opened = _usable("opened", _simple("opened", _mapping("opened", given["opened"], _OPENED)))
    quantity = _object("quantity", Quantity, given["quantity"])
    if ghosts is not None:
        parts = _list("ghost_points", ghosts, 2)
        numbers = len(parts) == 2 and all(_is_number(part) for part in parts)
        if kind != "EllipsoidField" or not (numbers and 1.0 <= parts[0] <= 2.0 and 0.0 < parts[1] <= 1e300):
            wanted = "a distance from 1 to 2 and a weight above 0, of an EllipsoidField; or null"
            raise _damaged(f"ghost_points: {shown(ghosts)} of a {kind}", wanted)
        ghosts = (float(parts[0]), float(parts[1]))
    return FieldRecipe(kind, options, opened, quantity, ghosts, _trim(given["trim"], kind))


def _trim(value: Any, kind: str) -> Trim:
    given = _mapping("trim", value, tuple(one.name for one in fields(Trim)))
    kernels = _list("trim: kernels", given.get("kernels", []), LONGEST)
    rising = all(type(one) is int for one in kernels) and all(a < b for a, b in itertools.pairwise([-1, *kernels]))
    if not rising or (kernels and kind != "EllipsoidField"):
        raise _damaged(f"trim: kernels: {shown(kernels)} of a {kind}", "rising numbers, of an EllipsoidField")
    limits = given.get("limits")
    if limits is None:
        return Trim(tuple(kernels))
    two = isinstance(limits, list) and len(limits) == 2 and all(map(_is_number, limits))
    if not two or not limits[0] <= limits[1]:
        raise _damaged(f"trim: limits: {shown(limits)}", "two numbers that do not fall, or null")
    return Trim(tuple(kernels), (float(limits[0]), float(limits[1])))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _simple(key: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values that are texts, numbers, truths, or lists of a few numbers; whoever uses them checks them again."""
    for name, value in given.items():
        simple = value is None or isinstance(value, str | bool) or _is_number(value)
        if not simple and not (isinstance(value, list) and len(value) <= 3 and all(map(_is_number, value))):
            raise _damaged(f"{key}: {name}: {shown(value)}", "a text, a number, or up to three numbers")
    return {name: tuples(value) for name, value in given.items()}


def _usable(key: str, given: dict[str, Any]) -> dict[str, Any]:
    """Return options of a field, or InvalidInput where one of them is none that a field can have."""
    for name, value in given.items():
        parts = value if isinstance(value, tuple) else (value,)
        usable, wanted = True, ""
        if name in _ABOVE_0:
            usable, wanted = value is None or all(_is_number(part) and part > 0 for part in parts), "above 0"
        elif name == "base":
            usable, wanted = value is None or _is_number(value), "a finite number"
        elif name in _WORDS:
            usable, wanted = value is None or value in _WORDS[name], "one of: " + ", ".join(_WORDS[name])
        if not usable:
            raise _damaged(f"{key}: {name}: {shown(value)}", wanted)
    return given


def _renderer(value: Any) -> dict[str, Any]:
    given = _mapping("renderer", value, _RENDERER)
    return {name: part for name, part in checked("renderer", given, RendererClassOptions).items() if name in _RENDERER}

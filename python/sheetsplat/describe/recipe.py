"""How a picture was made, without its data: as text in a PNG, and back into a scene and a camera."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from sheetsplat import _sheetsplat
from sheetsplat._checks import image_size, shown
from sheetsplat.camera import Camera
from sheetsplat.describe.schema import (
    DEEPEST,
    LONGEST,
    camera_of,
    check_object,
    fits,
    function_of,
    object_of,
    plain,
    tuples,
    value_of,
)
from sheetsplat.describe.toml import depth
from sheetsplat.errors import Error, InvalidInput, complain
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.fields.trim import Trim
from sheetsplat.look.strays import trimmed
from sheetsplat.options.core import Option, UnknownOption, checked, definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.quantity import Quantity, notes_of
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Given = TypeVar("Given")
#: Version of the format of the text.
FORMAT = 1
_MOST_FIELDS = 256
# Settings of a renderer that belong to a machine, or that chose settings which are written themselves.
_LEFT_OUT = ("device", "threads", "max_error", "max_seconds")
_RENDERER = {name: one for name, one in definitions(RendererClassOptions).items() if name not in _LEFT_OUT}
_OPENED = {name: one for name, one in definitions(OpenOptions).items() if name != "grid"}
_KERNELS = ("radius", "falloff", "normalization", "w0", "prefilter")
# The own options of fields by their kind.
_KINDS = {
    "RegularField": ("spacing", "axes", "origin", "lattice", *_KERNELS, "nan", "boundary", "base", "labels"),
    "EllipsoidField": ("normalization", "w0", "falloff", "min_scale", "base", "periodic"),
}
# Options of volumes in pictures that were made before volumes had any of them.
_BEFORE = {"boundary": "zero", "base": 0.0, "labels": False}
_PARTS = ("format", "version", "size", "camera", "transfer_functions", "groups", "scene", "fields", "renderer")


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
    colored
        Whether its samples are colours.

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
    colored: bool = False

    @classmethod
    def of(cls, field: Field) -> FieldRecipe:
        """Return how a field was made."""
        # Data in bricks are made again of the same file in memory.
        kind = "RegularField" if isinstance(field, RegularField) else "EllipsoidField"
        options = {name: getattr(field, name) for name in _KINDS[kind]}
        if isinstance(field, RegularField):
            # One that was not given is found again in the same data.
            options["base"] = field.given_base
            # Axes have lengths.
            del options["axes" if field.axes is None else "spacing"]
        ghosts = field.ghost_options if isinstance(field, EllipsoidField) else None
        # Weights that are no array of the file have no name.
        unnamed = {"weight": None} if field.weighting is not None else {}
        colored = isinstance(field, RegularField) and field.colored
        return cls(kind, options, {**unnamed, **field.opened}, field.quantity, ghosts, field.trim, colored)

    def kernels_of(self, field: Field) -> Field:
        """Return a volume with the kernels of the one in the picture, unless it has some of its own."""
        if not isinstance(field, RegularField) or not field.is_plain:
            return field
        known = {**self.opened, **self.options}
        if known.get("labels") is not None and known["labels"] != field.labels:
            field = field.replace(labels=known["labels"])
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
    colors
        Of how many fields each group has its colours, and by which transfer function, None where it has its own; these
        fields come behind those of the groups. Empty where all have their own.

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
    colors: tuple[tuple[int, TransferFunction] | None, ...] = ()

    @classmethod
    def of(
        cls, scene: Scene, camera: Camera, size: tuple[int, int], renderer: Mapping[str, Any], **changes: Any
    ) -> Recipe:
        """Return the recipe of a picture; `changes` are options of the scene that were chosen in place of its own."""
        given = [one for one in scene.color_by if one is not None]
        made_of = tuple(map(FieldRecipe.of, (*scene.fields, *(field for fields, _ in given for field in fields))))
        settings = {name: renderer[name] for name in _RENDERER}
        groups, options = tuple(map(len, scene.groups)), {**scene.options, **changes}
        colors = tuple(None if one is None else (len(one[0]), one[1]) for one in scene.color_by) if given else ()
        return cls(scene.transfer_functions, groups, options, camera, size, made_of, settings, colors)

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
        colors: Any = [one and (list(itertools.islice(rest, one[0])), one[1]) for one in self.colors] or None
        return Scene(groups, self.transfer_functions, color_by=colors, **self.options)

    def to_json(self) -> str:
        """Return it as JSON, with the version of the package. InvalidInput for weights that are no array of a file."""
        if any("weight" in one.opened and one.opened["weight"] is None for one in self.fields):
            found = "weights that are no array of the data's file"
            raise complain("the picture cannot be described", found, "weights by their name")
        told = {
            "format": FORMAT,
            "version": _sheetsplat.__version__,
            "size": self.size,
            "camera": {"maker": self.camera.maker, **self.camera.arguments},
            "transfer_functions": self.transfer_functions,
            "groups": self.groups,
            "scene": self.options,
            "fields": self.fields,
            "renderer": self.renderer,
            **({"colors": self.colors} if self.colors else {}),
        }
        return json.dumps(plain(told), allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> Recipe:
        """Return what `to_json` wrote. InvalidInput, naming the key, for anything else: nothing in it is executed."""
        with _reading("JSON"):
            if not isinstance(text, str):
                raise complain("", f"{type(text).__name__}, {shown(text)}", "a text")
            if len(text) > LONGEST:
                raise complain("", f"{len(text)} characters", f"at most {LONGEST}")
            if (found := depth(text)) > DEEPEST:
                raise complain("", f"lists or objects nested {found} deep", f"at most {DEEPEST}")
            parts = json.loads(text, parse_constant=_no_constant, object_pairs_hook=_without_repetition)
        with _reading("description"):
            check_object(parts, (*_PARTS, "colors"), _PARTS)
        _check_version(parts["format"], parts["version"])
        made = {}
        for key, reader in _READERS.items():
            with _reading(key):
                made[key] = reader(parts[key])
        with _reading("groups"):
            functions, total = len(made["transfer_functions"]), len(made["fields"])
            groups = parts["groups"]
            with _reading("colors"):
                colors = _colors(parts.get("colors", []), functions)
            total -= sum(one[0] for one in colors if one is not None)
            if not _are_counts(groups) or len(groups) != functions or 0 in groups or sum(groups) != total:
                raise complain("", shown(groups), f"{functions} numbers that add up to {total}")
        return cls(groups=tuple(groups), options=made.pop("scene"), colors=colors, **made)

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


def for_each(data: Sequence[Given], opened: Sequence[Mapping[str, Any]]) -> list[Given]:
    """Return the data of each field: one alone stands for all fields that were opened as different parts of it.

    opened: the options of `sheetsplat.open` that made each field.
    """
    parts = {(one.get("name"), one.get("scalar")) for one in opened}
    return [*data] * (len(opened) if len(data) == 1 and len(parts) == len(opened) else 1)


def _no_constant(name: str) -> float:
    raise ValueError(f"the number {name}")


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the key {shown(next(name for name in names if names.count(name) > 1))} twice")
    return found


@contextlib.contextmanager
def _reading(*keys: str) -> Iterator[None]:
    """Turn what goes wrong with the value of a key into InvalidInput that names the key."""
    try:
        yield
    except DamagedRecipe:
        raise
    except UnknownOption as error:
        raise _damaged(f"{': '.join(keys)}: the unknown key {shown(error.option)}", "", str(error.advice)) from None
    except Error as error:
        named = ": ".join(dict.fromkeys([*keys, error.option or keys[-1]]))
        raise _damaged(f"{named}: {error.found or error.what}", error.wanted) from None
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError, AttributeError) as error:
        found = str(error) or type(error).__name__
        raise _damaged(f"{': '.join(keys)}: {found}", "what sheetsplat wrote") from None


def _are_counts(value: Any) -> bool:
    return fits(value, Sequence[int]) and all(one >= 0 for one in value)


def _check_version(form: Any, version: Any) -> None:
    advice = "use the version of sheetsplat that wrote it"
    if type(form) is not int or form != FORMAT:
        raise _damaged(f"format: {shown(form)}", f"{FORMAT}", advice)
    here, found = _numbers_of(_sheetsplat.__version__), _numbers_of(version)
    if found is None or here is None or found > here:
        raise _damaged(f"version: {shown(version)}", f"a version up to {_sheetsplat.__version__}", advice)


def _numbers_of(version: Any) -> tuple[int, ...] | None:
    found = re.fullmatch(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})", str(version), re.ASCII)
    return None if found is None else tuple(map(int, found.groups()))


def _transfer_functions(value: Any) -> tuple[TransferFunction, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= _MOST_FIELDS:
        raise complain("", shown(value), f"from 1 to {_MOST_FIELDS} lists of rows of five numbers")
    return tuple(map(function_of, value))


def _colors(value: Any, groups: int) -> tuple[tuple[int, TransferFunction] | None, ...]:
    """Return of how many fields, by which function, each group has its colours; None: it has its own."""
    wanted = f"for each of {groups} groups null, or a number of fields and rows of five numbers"
    if not isinstance(value, list) or len(value) not in (0, groups):
        raise complain("", shown(value), wanted)
    for one in value:
        if one is not None and not (isinstance(one, list) and len(one) == 2 and _are_counts(one[:1]) and one[0]):
            raise complain("", shown(one), wanted)
    return tuple(None if one is None else (one[0], function_of(one[1])) for one in value)


def _camera(value: Any) -> Camera:
    check_object(value)
    # Pictures that were made before cameras had a shift have none.
    return camera_of(value, "maker", optional=("shift",))


def _options(key: str, value: Any, known: Mapping[str, Option]) -> dict[str, Any]:
    """Return the options that an object of JSON says; None where one is open."""
    with _reading(key):
        check_object(value, tuple(known))
    found = {}
    for name, part in value.items():
        with _reading(key, name):
            found[name] = None if part is None else tuples(value_of(known[name], part))
    return found


def _scene_options(value: Any) -> dict[str, Any]:
    return checked("scene", _options("scene", value, definitions(SceneOptions)), SceneOptions)


def _renderer(value: Any) -> dict[str, Any]:
    given = checked("renderer", _options("renderer", value, _RENDERER), RendererClassOptions)
    return {name: given[name] for name in _RENDERER}


def _fields(value: Any) -> tuple[FieldRecipe, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= _MOST_FIELDS:
        raise complain("", shown(value), f"from 1 to {_MOST_FIELDS} fields")
    return tuple(field_recipe_of(one, _BEFORE) for one in value)


def field_recipe_of(value: Any, before: Mapping[str, Any] | None = None) -> FieldRecipe:
    """Return how a field was made, of what JSON says; InvalidInput, naming the key, for anything else.

    before: options of volumes that have no boundary.
    """
    with _reading("fields"):
        # Earlier pictures left nothing out, and told nothing of colours.
        given = {"trim": {}, "colored": False, **value} if isinstance(value, dict) else value
        names = tuple(one.name for one in fields(FieldRecipe))
        check_object(given, names, names)
        kind, ghosts, trim = given["kind"], given["ghost_points"], given["trim"]
        if not fits(kind, str) or kind not in _KINDS:
            raise complain("", shown(kind), " or ".join(_KINDS), option="kind")
        scattered = kind == "EllipsoidField"
        if ghosts is not None and not (
            scattered and fits(ghosts, tuple[float, float]) and 1.0 <= ghosts[0] <= 2.0 and 0.0 < ghosts[1] <= 1e300
        ):
            wanted = "a distance from 1 to 2 and a weight above 0, of an EllipsoidField; or null"
            raise complain("", f"{shown(ghosts)} of a {kind}", wanted, option="ghost_points")
        with _reading("trim"):
            check_object(trim)
            left_out = object_of(Trim, trim)
            if left_out.kernels and not scattered:
                raise complain("", f"{shown(left_out.kernels)} of a {kind}", "an EllipsoidField", option="kernels")
        if not fits(given["colored"], bool) or (given["colored"] and scattered):
            wanted = "true or false, false for an EllipsoidField"
            raise complain("", f"{shown(given['colored'])} of a {kind}", wanted, option="colored")
        with _reading("quantity"):
            check_object(given["quantity"])
            quantity = object_of(Quantity, given["quantity"])
        options = _options("options", given["options"], {name: _OPENED[name] for name in _KINDS[kind]})
        if not scattered and "boundary" not in options:
            options = {**(before or {}), **options}
        opened = _options("opened", given["opened"], _OPENED)
        ghosts = None if ghosts is None else (float(ghosts[0]), float(ghosts[1]))
        return FieldRecipe(kind, options, opened, quantity, ghosts, left_out, given["colored"])


_READERS: dict[str, Callable[[Any], Any]] = {
    "transfer_functions": _transfer_functions,
    "scene": _scene_options,
    "camera": _camera,
    "size": image_size,
    "fields": _fields,
    "renderer": _renderer,
}

"""Scene files: reading, writing and drawing them."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Unpack

from sheetsplat import _sheetsplat, api
from sheetsplat._checks import file_path, shown
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import FieldRecipe, Recipe, field_recipe_of, for_each
from sheetsplat.describe.schema import (
    DEEPEST,
    LONGEST,
    camera_of,
    check_keys,
    class_of,
    eye_parts,
    fits,
    plain,
    tuples,
    value_of,
)
from sheetsplat.describe.toml import Place, depth, document, lines_of_keys
from sheetsplat.errors import Error, complain, option_ref, unusable
from sheetsplat.fields import Field, as_fields
from sheetsplat.image import Image
from sheetsplat.io.pictures import whole_file
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import Option, check_names, definitions, pick_given
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.look import TransferOptions
from sheetsplat.options.picture import RenderOptions, SizeOptions
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import EffectOptions, LightOptions, ModeOptions, SamplingOptions, SceneOptions
from sheetsplat.options.values import Whole
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

#: Version of the format.
FORMAT = 1
#: How names of scene files end.
SUFFIX = ".toml"
#: The groups of options of each section, in the order of a file.
SECTIONS: dict[str, tuple[type, ...]] = {
    "picture": (QualityOptions, SizeOptions),
    "data": (OpenOptions,),
    "look": (ModeOptions, TransferOptions, SamplingOptions, EffectOptions),
    "light": (LightOptions,),
    "camera": (CameraOptions,),
    "renderer": (RendererClassOptions,),
}
_COMMENT = "# A scene of sheetsplat: `sheetsplat render FILE.toml -o picture.png` makes the picture.\n\n"
_TOP = ("format", "version", "exact", *SECTIONS)
# What a file says of its data beside the options of `open`; all but the first in exact scenes only.
_OF_EXACT_DATA = ("kind", "group", "trim", "ghost_points")
_OF_DATA = ("file", *_OF_EXACT_DATA)
# What a camera with an eye has beside the options of cameras that are fitted.
_OF_EYE = ("eye", "height", "near", "shift")
_MORE_KEYS = {"data": _OF_DATA, "camera": _OF_EYE}
# Arguments of `render` that are neither data nor scene.
_OF_PICTURE = ("quality", "size", "camera", "outputs", "progress", "depth_limit", *definitions(CameraOptions))
# Options of the look of which one replaces the others.
_COLOURS = ("cmap", "opacity", "clim")
Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


@cache
def options_of(section: str) -> dict[str, Option]:
    """Return the options of a section by name; of data without the quality, which is one for all of a picture."""
    found = {name: one for group in SECTIONS[section] for name, one in definitions(group).items()}
    return {name: one for name, one in found.items() if (section, name) != ("data", "quality")}


class SceneFile:
    """What a picture is made of, as a TOML file says it: data, look, light, camera, renderer, size and quality.

    Keys are the keyword arguments of `sheetsplat.render`, in a table for each group; what a file does not say is chosen
    from the data. A file with ``exact = true``, as `of` makes it of a picture, leaves nothing to choose. Paths of data
    are relative to the file. Immutable.

    Parameters
    ----------
    tables
        What `tomllib` makes of a file; `read`, `parse`, `of` and `of_options` make them.
    name, folder, lines
        Name for messages, folder to which paths are relative, and lines of keys for messages.

    Raises
    ------
    InvalidInput
        For unknown keys, and values of a wrong type.

    Examples
    --------
    >>> np.save("cube.npy", values)
    >>> ss.SceneFile.of_options("cube.npy", cmap="magma", size=(32, 32)).save("cube.toml")
    >>> ss.SceneFile.read("cube.toml").render().save("cube.png")
    """

    __slots__ = ("_folder", "_lines", "_name", "_tables")

    def __init__(
        self,
        tables: Mapping[str, Any],
        *,
        name: str = "the scene",
        folder: str | os.PathLike[str] = ".",
        lines: Mapping[Place, int] | None = None,
    ) -> None:
        self._tables = dict(tables)
        self._name, self._folder = name, Path(folder)
        self._lines = lines or {}
        self._check()

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> SceneFile:
        """Return the scene of a file.

        Raises
        ------
        InvalidInput
            For what is no TOML, and for unknown keys and values of a wrong type, with the line and the nearest name.
        Error
            Where the file cannot be read.
        """
        file = file_path("the scene cannot be read", path, "the path of a scene file")
        failed = f"{file} cannot be read"
        try:
            if not file.is_file():
                raise complain(failed, "no such file", "a scene file", kind=Error)
            with file.open("rb") as stream:
                content = stream.read(LONGEST + 1)
        except OSError as error:
            raise complain(failed, error.strerror or str(error), "a scene file", kind=Error) from None
        if len(content) > LONGEST:
            raise complain(failed, f"more than {LONGEST} bytes", "a scene file")
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError as error:
            raise complain(failed, f"bytes that are no text: {error.reason} at {error.start}", "UTF-8") from None
        return cls.parse(text, name=str(file), folder=file.resolve().parent)

    @classmethod
    def parse(cls, text: str, *, name: str = "scene", folder: str | os.PathLike[str] = ".") -> SceneFile:
        """Return the scene of a text; `name`: for messages, `folder`: to which paths of data are relative.

        Raises InvalidInput as `read`.
        """
        if (found := depth(text)) > DEEPEST:
            raise complain(f"{name} cannot be read", f"tables or arrays nested {found} deep", f"at most {DEEPEST}")
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise complain(f"{name} cannot be read", str(error), "TOML") from None
        return cls(tables, name=name, folder=folder, lines=lines_of_keys(text))

    @classmethod
    def of(cls, picture: Image | Recipe, data: Paths = ()) -> SceneFile:
        """Return the exact scene of a picture, or of its recipe.

        Parameters
        ----------
        picture
            The picture; ``SceneFile.of(ss.Recipe.read("x.png"), "data.nrrd")`` takes what a PNG says.
        data
            The files that it was made of, one for each field, or the one whose channels or arrays all fields are;
            without them, `render` asks for the data.

        Raises
        ------
        InvalidInput
            For another number of files.
        """
        recipe = picture.recipe if isinstance(picture, Image) else picture
        # The description in a PNG has plain values only.
        told = json.loads(recipe.to_json())
        made, functions = told["fields"], told["transfer_functions"]
        paths = for_each(_paths(data), [one["opened"] for one in made])
        if paths and len(paths) != len(made):
            found = f"{len(paths)} files for a picture of {len(made)} fields"
            raise complain("the scene cannot be written", found, "one for each field")
        if recipe.colors:
            found, advice = "colours of another field", "write one of the data, with " + option_ref("color_by", "...")
            raise complain("the scene cannot be written", found, "a picture without them", advice)
        told["scene"]["transfer_function"] = functions if len(functions) > 1 else functions[0]
        groups = [number if len(made) > 1 else None for number, count in enumerate(recipe.groups) for _ in range(count)]
        tables = {
            "format": FORMAT,
            "version": told["version"],
            "exact": True,
            "picture": {"size": told["size"]},
            "data": list(map(_data_table, made, groups, paths or itertools.repeat(None))),
            "look": _changed("look", told["scene"]),
            "light": _changed("light", told["scene"]),
            "camera": _camera_table(recipe.camera),
            "renderer": _changed("renderer", told["renderer"]),
        }
        return cls(_without_none(tables))

    @classmethod
    def of_options(cls, data: Paths = (), **options: Unpack[RenderOptions]) -> SceneFile:
        """Return the scene file of a call of `sheetsplat.render`.

        Parameters
        ----------
        data
            Path of the file, or several; without them, `render` asks for the data.
        **options
            Those of `sheetsplat.render`, but for functions and what is no part of a scene: outputs, progress.

        Raises
        ------
        InvalidInput
            For options and values that a file cannot hold.
        """
        check_names("SceneFile.of_options", options, RenderOptions)
        given: dict[str, Any] = {
            name: os.fspath(value) if isinstance(value, os.PathLike) else value
            for name, value in options.items()
            if value is not None
        }
        tables: dict[str, Any] = {"format": FORMAT, "version": _sheetsplat.__version__}
        renderer, camera = given.pop("renderer", None), given.pop("camera", None)
        if isinstance(renderer, Renderer):
            known = options_of("renderer")
            given |= {name: value for name, value in renderer.settings.items() if value != known[name].default}
        for section in SECTIONS:
            tables[section] = {name: plain(given.pop(name), name) for name in options_of(section) if name in given}
        if isinstance(camera, Camera):
            tables["camera"] = _camera_table(camera)
        for name in given:
            raise complain("the scene cannot be written", f"{name}, which is no part of a scene", option=name)
        paths = [tables["data"] | {"file": os.fspath(path)} for path in _paths(data)]
        tables["data"] = paths[0] if len(paths) == 1 else paths or tables["data"]
        return cls(_without_none(tables))

    # ------------------------------------------------------------------------------------------------------ checking

    def _at(self, place: Place) -> str:
        """Return the name of the file, with the line of a place, or of the nearest one around it."""
        for length in range(len(place), 0, -1):
            if place[:length] in self._lines:
                return f"{self._name}, line {self._lines[place[:length]]}"
        return self._name

    @contextlib.contextmanager
    def _checking(self, *place: str | int) -> Iterator[None]:
        """Say in errors where in the file their option is."""
        try:
            yield
        except Error as error:
            inner = [one for one in self._lines if one[: len(place)] == place and one[-1:] == (error.option,)]
            # The key itself comes before one of the same name in a table of it.
            nearest = min(inner, key=len, default=place)
            told = error.complaint
            raise type(error)(f"{self._at(nearest)}: {error.what}", told.found, told.wanted, told.advice) from None
        except (TypeError, ValueError, OverflowError) as error:
            raise complain(f"{self._at(place)}: {'.'.join(map(str, place))} cannot be used", str(error)) from None

    def _check(self) -> None:
        tables = self._tables
        with self._checking():
            check_keys(tables, _TOP, "a scene file")
        with self._checking("format"):
            form = tables.get("format")
            if type(form) is not int or form != FORMAT:
                found = "nothing" if form is None else shown(form)
                advice = f"write format = {FORMAT}" if form is None else "use the version of sheetsplat that wrote it"
                raise complain(unusable("format"), found, str(FORMAT), advice)
        for name, kind, wanted in (("exact", bool, "true or false"), ("version", str, "a text")):
            with self._checking(name):
                if not isinstance(tables.get(name, kind()), kind):
                    raise complain(unusable(name), shown(tables[name]), wanted)
        for section in SECTIONS:
            table = tables.get(section, {})
            if section == "data" and isinstance(table, list):
                for number, one in enumerate(table):
                    self._check_section(one, section, number)
            else:
                self._check_section(table, section)

    def _check_section(self, table: Any, section: str, *number: int) -> None:
        place: Place = (section, *number)
        with self._checking(*place):
            if not isinstance(table, dict):
                raise complain(unusable(section), shown(table), f"a table [{section}]")
            check_keys(table, [*_MORE_KEYS.get(section, ()), *options_of(section)], f"[{section}]")
        for name, value in table.items():
            with self._checking(*place, name):
                if name in _MORE_KEYS.get(section, ()):
                    self._check_more(name, value, table)
                else:
                    self._check_value(section, name, value)
        with self._checking(*place):
            _camera_of(table)
            if section == "data" and self.is_exact:
                _field_recipe(table)

    def _check_more(self, name: str, value: Any, table: Mapping[str, Any]) -> None:
        """Check a value that is none of an option of `sheetsplat.render`."""
        if name in _OF_EYE and "eye" not in table:
            raise complain(unusable(name), "a camera without an eye", "eye and target with it")
        if name in _OF_EXACT_DATA and not self.is_exact:
            raise complain(unusable(name), "a scene that is not exact", "it only with exact = true")
        if name == "file" and (not isinstance(value, str) or not value or "\0" in value):
            raise complain(unusable(name), shown(value), "the path of a file")
        if name == "group" and not fits(value, Whole(0, 255)):
            raise complain(unusable(name), shown(value), "the number of a group, from 0 on")

    def _check_value(self, section: str, name: str, value: Any) -> None:
        option = options_of(section)[name]
        if class_of(option.type)[1] and isinstance(value, list):
            for number, one in enumerate(value):
                with self._checking(section, name, number):
                    value_of(option, [one])
        found = value_of(option, value)
        if self.is_exact and section in ("look", "light"):
            if name in definitions(SceneOptions):
                _checked(option, found)
            elif name != "transfer_function":
                wanted = "a scene that is not exact, or transfer_function"
                raise complain(unusable(name), f"{name} in an exact scene, which chooses nothing", wanted)

    # ------------------------------------------------------------------------------------------------------- content

    @property
    def is_exact(self) -> bool:
        """Whether nothing is chosen from the data: what the file does not say has the default of its class."""
        return self._tables.get("exact") is True

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of data; none where the data are to be given."""
        return tuple(self._folder / one["file"] for one in self._data() if "file" in one)

    def _data(self) -> list[dict[str, Any]]:
        table = self._tables.get("data", {})
        return table if isinstance(table, list) else [table]

    def _values(self, section: str) -> dict[str, Any]:
        """Return the options of a section as `sheetsplat.render` takes them."""
        known = options_of(section)
        return {name: value_of(known[name], value) for name, value in self._tables.get(section, {}).items()}

    @property
    def camera(self) -> Camera | None:
        """The camera, where the file has an eye; None where it is fitted to what is seen."""
        return _camera_of(self._tables.get("camera", {}))

    @property
    def options(self) -> dict[str, Any]:
        """What it says apart from its data, as keyword arguments of `sheetsplat.render`, with objects for tables."""
        found: dict[str, Any] = {}
        for section in ("picture", "look", "light"):
            found |= self._values(section)
        found |= {"camera": self.camera} if self.camera is not None else self._values("camera")
        return found

    # ------------------------------------------------------------------------------------------------------- drawing

    def prepare(self, data: Any = None, **changes: Unpack[RenderOptions]) -> api.Prepared:
        """Return what `render` draws, without drawing it."""
        check_names("SceneFile.render", changes, RenderOptions)
        given: dict[str, Any] = dict(changes)
        with self._locating(changes):
            options, sources = self.options, self._sources(data)
            clash = [name for name in definitions(CameraOptions) if name in given]
            if clash and "camera" in options:
                advice = "leave it out, or give a camera"
                raise complain(
                    unusable(clash[0]), f"{self._name}, whose camera has an eye", "", advice, option=clash[0]
                )
            renderer = self._renderer(given)
            data, rest = (self._exact if self.is_exact else self._chosen)(sources, options, given)
            return api.prepare(data, **rest, renderer=renderer)

    def render(self, data: Any = None, **changes: Unpack[RenderOptions]) -> Image:
        """Return the picture.

        Parameters
        ----------
        data
            In place of the file's own: what `sheetsplat.render` takes; of several fields a list of paths or fields.
        **changes
            Options of `sheetsplat.render` in place of the file's own.

        Raises
        ------
        InvalidInput
            Where data or options cannot be used, with the line of the file where an option of it is the reason.
        Error
            What `sheetsplat.render` raises.
        """
        prepared = self.prepare(data, **changes)
        with self._locating(changes):
            return prepared.render()

    @contextlib.contextmanager
    def _locating(self, changes: Mapping[str, Any]) -> Iterator[None]:
        """Say in errors about an option of the file on which line it is."""
        try:
            yield
        except Error as error:
            sections = [one for one in SECTIONS if error.option in self._tables.get(one, {})]
            if not sections or error.option in changes:
                raise
            told, where = error.complaint, self._at((sections[0], str(error.option)))
            raise type(error)(f"{where}: {error.what}", told.found, told.wanted, told.advice, error.option) from None

    def _renderer(self, changes: dict[str, Any]) -> Renderer:
        """Return the renderer, and take its options out of `changes`."""
        given = {name: changes.pop(name) for name in definitions(RendererClassOptions) if name in changes}
        own = changes.pop("renderer", None)
        return own if own is not None else Renderer(**{**self._values("renderer"), **given})

    def _opened(self, table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of `sheetsplat.open` for data; the path of a grid is relative to the file."""
        given = {name: tuples(value) for name, value in table.items() if name not in _OF_DATA}
        if "grid" in given:
            given["grid"] = self._folder / given["grid"]
        return {**given, **{name: value for name, value in changes.items() if name in options_of("data")}}

    def _sources(self, data: Any) -> list[Any]:
        """Return the data of each field: what is given, else the files."""
        own = self._data()
        if data is None:
            if not all("file" in one for one in own):
                what = f"{self._at(('data',))}: the scene names no file of its data"
                raise complain(what, "", "data", "give them to render, or name them: [data] file = ...")
            return list(self.files)
        given = for_each(data if isinstance(data, list | tuple) else [data], own)
        if len(given) != len(own):
            raise complain(f"{self._name} cannot be drawn", f"{len(given)} data", f"{len(own)}, one for each field")
        return given

    def _chosen(
        self, sources: list[Any], options: dict[str, Any], changes: Mapping[str, Any]
    ) -> tuple[Any, dict[str, Any]]:
        """Return what `api.prepare` takes for a scene that leaves open what is chosen from the data."""
        if any(name in changes for name in _COLOURS):
            options.pop("transfer_function", None)
        if changes.get("transfer_function") is not None:
            options = {name: value for name, value in options.items() if name not in _COLOURS}
        quality = {"quality": changes.get("quality", options.get("quality", "good"))}
        opened = [self._opened(one, changes) for one in self._data()]
        of_data = definitions(OpenOptions)
        options = {**options, **{name: one for name, one in changes.items() if name not in of_data}, **quality}
        if len(sources) == 1:
            made = isinstance(sources[0], Field | Scene)
            return sources[0], options | {name: one for name, one in opened[0].items() if not made or name in changes}
        fields = [
            field
            for one, given in zip(sources, opened, strict=True)
            for field in ([one] if isinstance(one, Field) else as_fields(api.open(one, **given, **quality), "the data"))
        ]
        return fields, options

    def _exact(
        self, sources: list[Any], options: dict[str, Any], changes: Mapping[str, Any]
    ) -> tuple[Scene, dict[str, Any]]:
        """Return what `api.prepare` takes for a scene that leaves nothing open."""
        for name in _COLOURS:
            if name in changes:
                what = f"{self._name} is an exact scene, which chooses no colours"
                raise complain(what, name, "transfer_function", option=name)
        groups: dict[int, list[Field]] = {}
        for table, source in zip(self._data(), sources, strict=True):
            made = _field_recipe(table)
            given = self._opened({name: table[name] for name in ("grid",) if name in table}, changes)
            if isinstance(source, str | os.PathLike):
                fields = [made.open(source, **given)]
            else:
                fields = [made.kernels_of(one) for one in api.to_fields(source, **given)]
            groups.setdefault(table.get("group", 0), []).extend(fields)
        options = {**options, **changes}
        functions = changes.get("transfer_function") or self._values("look").get("transfer_function")
        if functions is None:
            raise complain(f"{self._name} is an exact scene", "no transfer_function", "one", "add it to [look]")
        if isinstance(functions, str):
            functions = TransferFunction.preset(functions)
        scene = Scene([one for _, one in sorted(groups.items())], functions, **pick_given(SceneOptions, options))
        return scene, {name: one for name, one in options.items() if name in _OF_PICTURE}

    # ------------------------------------------------------------------------------------------------------- writing

    def to_toml(self, folder: str | os.PathLike[str] | None = None) -> str:
        """Return the text of the file; paths of data are relative to `folder` where they lie in it, else absolute.

        Raises InvalidInput for names of files that UTF-8 does not have.
        """
        moved = [self._moved(one, folder) for one in self._data()]
        tables = self._tables | {"data": moved if isinstance(self._tables.get("data"), list) else moved[0]}
        ordered = {name: tables[name] for name in _TOP if name in tables and tables[name] not in ({}, [])}
        try:
            return _COMMENT + document(ordered)
        except ValueError:
            raise complain("the scene cannot be written", "a path that is no text", "names of files in UTF-8") from None

    def _moved(self, table: Mapping[str, Any], folder: str | os.PathLike[str] | None) -> dict[str, Any]:
        """Return a table of data with its paths for a file in another folder."""
        moved = dict(table)
        for name in ("file", "grid"):
            if name in moved and folder is not None:
                path = Path(os.path.abspath(self._folder / moved[name]))
                home = Path(os.path.abspath(folder))
                moved[name] = os.fspath(path.relative_to(home) if home in path.parents else path)
        return {name: moved[name] for name in (*_OF_DATA[:1], *moved) if name in moved}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file; it appears whole or not at all.

        Raises
        ------
        InvalidInput
            For names that do not end with .toml.
        Error
            Where the file cannot be written.
        """
        target = file_path("the scene cannot be saved", path, f"a path that ends with {SUFFIX}")
        if target.suffix.lower() != SUFFIX:
            raise complain(f"{target} cannot be written", f"the suffix {target.suffix!r}", SUFFIX)
        text = self.to_toml(target.resolve().parent)
        with whole_file(target) as made:
            made.write_text(text, encoding="utf-8")

    def __eq__(self, other: object) -> bool:
        """Return whether they say the same, of the same files."""
        if not isinstance(other, SceneFile):
            return NotImplemented
        return self.to_toml(os.sep) == other.to_toml(os.sep)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return a short description."""
        files = ", ".join(map(str, self.files)) or "no files"
        return f"SceneFile({files}{', exact' if self.is_exact else ''})"


def _paths(data: Paths) -> list[str | os.PathLike[str]]:
    return [data] if isinstance(data, str | os.PathLike) else list(data)


def _camera_of(table: Mapping[str, Any]) -> Camera | None:
    return camera_of({"projection": "orthographic", **table}, "projection") if "eye" in table else None


def _camera_table(camera: Camera) -> dict[str, Any]:
    return {"projection": camera.kind, **eye_parts(camera)}


def _field_recipe(table: Mapping[str, Any]) -> FieldRecipe:
    """Return how a field of an exact scene is made."""
    opened = {name: one for name, one in table.items() if name not in (*_OF_DATA, "grid")}
    told = {"kind": table.get("kind", "RegularField"), "options": {}, "opened": opened, "quantity": {}}
    return field_recipe_of({**told, "ghost_points": table.get("ghost_points"), "trim": table.get("trim", {})})


def _data_table(field: Mapping[str, Any], group: int | None, path: str | os.PathLike[str] | None) -> dict[str, Any]:
    """Return the table of a field's data, of what a PNG says about it."""
    # Kernels of scattered data that a reader made follow from what it was told.
    own = {} if field["kind"] == "EllipsoidField" and field["opened"] else field["options"]
    known = options_of("data")
    given = {name: one for name, one in {**own, **field["opened"]}.items() if name in known and one is not False}
    trim = {name: one for name, one in field["trim"].items() if one}
    file = None if path is None else os.fspath(path)
    return {
        **{"kind": field["kind"], "group": group, **given},
        **{"trim": trim or None, "ghost_points": field["ghost_points"], "file": file},
    }


def _checked(option: Option, value: Any) -> Any:
    """Return what a class makes of the value of an option."""
    return value if option.check is None else option.check(option.name, value)


def _changed(section: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the plain values of a picture's options that are not the defaults."""
    known = {name: option for name, option in options_of(section).items() if values.get(name) is not None}
    defaults = {name: plain(_checked(option, option.default)) for name, option in known.items()}
    return {name: values[name] for name in known if values[name] != defaults[name]}


def _without_none(value: Any) -> Any:
    """Return plain values without the entries of tables that are None."""
    if isinstance(value, Mapping):
        return {name: _without_none(one) for name, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list | tuple) else value

"""Scene files: reading, writing and drawing them."""

from __future__ import annotations

import contextlib
import json
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from sheetsplat import _sheetsplat, api
from sheetsplat._checks import file_path, shown
from sheetsplat.camera import Camera
from sheetsplat.errors import Error, complain, unusable
from sheetsplat.fields import Field
from sheetsplat.image import Image
from sheetsplat.io.pictures import whole_file
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import check_names, definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.picture import RenderOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.plain_values import class_of, tuples
from sheetsplat.recipe import LONGEST, FieldRecipe, Recipe, field_recipe_of
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.scene_file.positions import Place, depth, lines_of_keys
from sheetsplat.scene_file.sections import SECTIONS, camera_of, check_keys, options_of, value_of
from sheetsplat.scene_file.tables import camera_table, changed, checked, data_table, one_or_all, plain, without_none
from sheetsplat.scene_file.toml import document
from sheetsplat.transfer import TransferFunction

#: Version of the format.
FORMAT = 1
#: How names of scene files end.
SUFFIX = ".toml"
_COMMENT = "# A scene of sheetsplat: `sheetsplat render FILE.toml -o picture.png` makes the picture.\n\n"
# Scene files nest five deep.
_DEEPEST = 32
_TOP = ("format", "version", "exact", *SECTIONS)
# What a file says of its data beside the options of `open`; all but the first in exact scenes only.
_OF_EXACT_DATA = ("kind", "group", "trim", "ghost_points")
_OF_DATA = ("file", *_OF_EXACT_DATA)
# What a camera with an eye has beside the options of cameras that are fitted.
_OF_EYE = ("eye", "height", "near")
_MORE_KEYS = {"data": _OF_DATA, "camera": _OF_EYE}
# Arguments of `render` that are neither data nor scene.
_OF_PICTURE = ("quality", "size", "camera", "outputs", "progress", "depth_limit", *definitions(CameraOptions))
# Options of the look of which one replaces the others.
_COLOURS = ("cmap", "opacity", "clim")
Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


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
        if (found := depth(text)) > _DEEPEST:
            raise complain(f"{name} cannot be read", f"tables or arrays nested {found} deep", f"at most {_DEEPEST}")
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
            The files that it was made of, one for each field; without them, `render` asks for the data.

        Raises
        ------
        InvalidInput
            For another number of files.
        """
        recipe = picture.recipe if isinstance(picture, Image) else picture
        # The description in a PNG has plain values only.
        told = json.loads(recipe.to_json())
        paths = _paths(data)
        if paths and len(paths) != len(recipe.fields):
            found = f"{len(paths)} files for a picture of {len(recipe.fields)} fields"
            raise complain("the scene cannot be written", found, "one for each field")
        scene = {"transfer_function": one_or_all(told["transfer_functions"]), **told["scene"]}
        tables: dict[str, Any] = {"format": FORMAT, "version": told["version"], "exact": True}
        tables["picture"] = {"size": told["size"]}
        groups = [number for number, count in enumerate(told["groups"]) for _ in range(count)]
        tables["data"] = [
            data_table(one, group if len(told["fields"]) > 1 else None)
            for one, group in zip(told["fields"], groups, strict=True)
        ]
        for table, path in zip(tables["data"], paths, strict=False):
            table["file"] = os.fspath(path)
        for section in ("look", "light"):
            known = options_of(section)
            tables[section] = changed(known, {name: scene[name] for name in known if name in scene})
        tables["camera"] = camera_table(recipe.camera)
        tables["renderer"] = changed(options_of("renderer"), told["renderer"])
        return cls(without_none(tables))

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
        given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
        tables: dict[str, Any] = {"format": FORMAT, "version": _sheetsplat.__version__}
        renderer = given.pop("renderer", None)
        if isinstance(renderer, Renderer):
            known = options_of("renderer")
            given |= {name: value for name, value in renderer.settings.items() if value != known[name].default}
        camera = given.pop("camera", None)
        for section in SECTIONS:
            tables[section] = {name: plain(name, given.pop(name)) for name in options_of(section) if name in given}
        if isinstance(camera, Camera):
            tables["camera"] = camera_table(camera)
        for name in given:
            raise complain("the scene cannot be written", f"{name}, which is no part of a scene", option=name)
        paths = _paths(data)
        tables["data"] = [tables["data"] | {"file": os.fspath(path)} for path in paths] or tables["data"]
        if len(paths) == 1:
            (tables["data"],) = tables["data"]
        return cls(without_none(tables))

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
        for name, kind in (("exact", bool), ("version", str)):
            with self._checking(name):
                if not isinstance(tables.get(name, kind()), kind):
                    raise complain(unusable(name), shown(tables[name]), "true or false" if kind is bool else "a text")
        for section in SECTIONS:
            self._check_section(section)

    def _check_section(self, section: str) -> None:
        table = self._tables.get(section, {})
        several = section == "data" and isinstance(table, list)
        for number, one in enumerate(table if several else [table]):
            place: Place = (section, number) if several else (section,)
            with self._checking(*place):
                if not isinstance(one, dict):
                    raise complain(unusable(section), shown(one), f"a table [{section}]")
                check_keys(one, [*_MORE_KEYS.get(section, ()), *options_of(section)], f"[{section}]")
            for name, value in one.items():
                with self._checking(*place, name):
                    self._check_value(section, name, value)
            if section == "camera" and "eye" in one:
                with self._checking(*place):
                    camera_of(one)
            elif section == "camera":
                for name in _OF_EYE:
                    if name in one:
                        with self._checking(*place, name):
                            raise complain(unusable(name), "a camera without an eye", "eye and target with it")
            if section == "data" and self.is_exact:
                with self._checking(*place):
                    _field_recipe(one)

    def _check_value(self, section: str, name: str, value: Any) -> None:
        if section == "data" and name in _OF_DATA:
            if name in _OF_EXACT_DATA and not self.is_exact:
                raise complain(unusable(name), "a scene that is not exact", "it only with exact = true")
            if name == "file" and (not isinstance(value, str) or not value or "\0" in value):
                raise complain(unusable(name), shown(value), "the path of a file")
            if name == "group" and (type(value) is not int or not 0 <= value < 256):
                raise complain(unusable(name), shown(value), "the number of a group, from 0 on")
            return
        if section == "camera" and name in _OF_EYE:
            return
        option = options_of(section)[name]
        if class_of(option)[1] and isinstance(value, list):
            for number, one in enumerate(value):
                with self._checking(section, name, number):
                    value_of(option, [one])
        found = value_of(option, value)
        if self.is_exact and section in ("look", "light"):
            own = definitions(SceneOptions)
            if name not in own and name != "transfer_function":
                wanted = "a scene that is not exact, or transfer_function"
                raise complain(unusable(name), f"{name} in an exact scene, which chooses nothing", wanted)
            if name in own:
                checked(own[name], found)

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
        table = self._tables.get("camera", {})
        return camera_of(table) if "eye" in table else None

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
        with self._locating(changes):
            return self._exact(data, dict(changes)) if self.is_exact else self._chosen(data, dict(changes))

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
            missing = [number for number, one in enumerate(own) if "file" not in one]
            if missing:
                what = f"{self._at(('data',))}: the scene names no file of its data"
                raise complain(what, "", "data", "give them to render, or name them: [data] file = ...")
            return list(self.files)
        given = list(data) if isinstance(data, list | tuple) else [data]
        if len(given) != len(own):
            raise complain(f"{self._name} cannot be drawn", f"{len(given)} data", f"{len(own)}, one for each field")
        return given

    def _chosen(self, data: Any, changes: dict[str, Any]) -> api.Prepared:
        """Return the picture of a scene that leaves open what is chosen from the data."""
        options = self.options
        if any(name in changes for name in _COLOURS):
            options.pop("transfer_function", None)
        if changes.get("transfer_function") is not None:
            options = {name: value for name, value in options.items() if name not in _COLOURS}
        self._refuse_camera(options, changes)
        sources, tables = self._sources(data), self._data()
        renderer = self._renderer(changes)
        quality = {"quality": changes.get("quality", options.get("quality", "good"))}
        opened = [self._opened(one, changes) for one in tables]
        of_data = definitions(OpenOptions)
        options = {**options, **{name: one for name, one in changes.items() if name not in of_data}, **quality}
        if len(sources) == 1:
            made = isinstance(sources[0], Field | Scene)
            options |= {name: one for name, one in opened[0].items() if not made or name in changes}
            return api.prepare(sources[0], **options, renderer=renderer)
        fields = [
            one if isinstance(one, Field) else api.open(one, **given, **quality)
            for one, given in zip(sources, opened, strict=True)
        ]
        return api.prepare(fields, **options, renderer=renderer)

    def _refuse_camera(self, options: Mapping[str, Any], changes: Mapping[str, Any]) -> None:
        clash = [name for name in definitions(CameraOptions) if name in changes]
        if clash and "camera" in options:
            advice = "leave it out, or give a camera"
            raise complain(unusable(clash[0]), f"{self._name}, whose camera has an eye", "", advice, option=clash[0])

    def _exact(self, data: Any, changes: dict[str, Any]) -> api.Prepared:
        """Return the picture of a scene that leaves nothing open."""
        options = self.options
        self._refuse_camera(options, changes)
        renderer = self._renderer(changes)
        tables = self._data()
        fields: list[Any] = []
        for table, source in zip(tables, self._sources(data), strict=True):
            grid = {"grid": self._folder / table["grid"]} if "grid" in table else {}
            given = {**grid, **{name: one for name, one in changes.items() if name in options_of("data")}}
            if isinstance(source, str | os.PathLike):
                fields.append(_field_recipe(table).open(source, **given))
            else:
                fields += map(_field_recipe(table).kernels_of, api.to_fields(source, **given))
        known = definitions(SceneOptions)
        wrong = [name for name in changes if name in _COLOURS]
        if wrong:
            what = f"{self._name} is an exact scene, which chooses no colours"
            raise complain(what, wrong[0], "transfer_function", option=wrong[0])
        scene_options = {name: one for name, one in {**options, **changes}.items() if name in known and one is not None}
        functions = changes.get("transfer_function") or options.get("transfer_function")
        if functions is None:
            raise complain(f"{self._name} is an exact scene", "no transfer_function", "one", "add it to [look]")
        if isinstance(functions, str):
            functions = TransferFunction.preset(functions)
        numbers = [one.get("group", 0) for one in tables]
        groups = [
            [field for field, at in zip(fields, numbers, strict=True) if at == group] for group in sorted({*numbers})
        ]
        scene = Scene(groups if len(groups) > 1 else groups[0], functions, **scene_options)
        rest = {name: one for name, one in {**options, **changes}.items() if name in _OF_PICTURE}
        return api.prepare(scene, **rest, renderer=renderer)

    # ------------------------------------------------------------------------------------------------------- writing

    def to_toml(self, folder: str | os.PathLike[str] | None = None) -> str:
        """Return the text of the file; paths of data are relative to `folder` where they lie in it, else absolute.

        Raises InvalidInput for names of files that UTF-8 does not have.
        """
        tables = dict(self._tables)
        if any("file" in one or "grid" in one for one in self._data()):
            moved = [self._moved(one, folder) for one in self._data()]
            tables["data"] = moved if isinstance(tables["data"], list) else moved[0]
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


def _field_recipe(table: Mapping[str, Any]) -> FieldRecipe:
    """Return how a field of an exact scene is made."""
    opened = {name: one for name, one in table.items() if name not in (*_OF_DATA, "grid")}
    told = {"kind": table.get("kind", "RegularField"), "options": {}, "opened": opened, "quantity": {}}
    return field_recipe_of({**told, "ghost_points": table.get("ghost_points"), "trim": table.get("trim", {})})

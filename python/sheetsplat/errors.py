"""The errors of the package.

Every error carries fields: what failed, what was found, what was wanted, what to do next, and the option that it is
about. Messages refer to options by name, so that Python and the command line spell them each in their own way.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TypeGuard

from sheetsplat._escaping import escaped

__all__ = [
    "Cancelled",
    "Complaint",
    "DeviceUnavailable",
    "Error",
    "InvalidInput",
    "OptionRef",
    "OutOfMemory",
    "Unsupported",
    "Words",
    "about_option",
    "complain",
    "missing_package",
    "option_ref",
    "option_refs",
    "spelled_in_python",
    "unusable",
]

# Characters of a text within a message; the longest list of names that belongs into one is shorter.
_LONGEST = 1200
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
# Packages whose modules have other names.
_PACKAGES = {"PIL": "pillow", "flip_evaluator": "flip-evaluator", "nrrd": "pynrrd", "imageio_ffmpeg": "imageio-ffmpeg"}
# The extras of this package that install what it needs beside its dependencies.
_EXTRAS = {
    "encode": ("constriction",),
    "plot": ("matplotlib",),
    "medical": ("nibabel", "pydicom"),
    "science": ("xarray", "h5netcdf", "zarr", "numcodecs", "tifffile", "mrcfile", "dask", "pandas", "meshio"),
    "parquet": ("pyarrow",),
    "astro": ("astropy",),
    "pyvista": ("vtk", "vtkmodules", "pyvista"),
    "view": ("aiohttp",),
    "jupyter": ("anywidget", "traitlets"),
    "video": ("imageio_ffmpeg",),
    "distributed": ("distributed", "cryptography"),
}
_CONSTANTS = {"true": "True", "false": "False", "none": "None", "...": "..."}


@dataclass(frozen=True)
class OptionRef:
    """A reference to an option within a message.

    Attributes
    ----------
    name
        The argument of Python's functions.
    value
        ``true``, ``false``, ``none``, a number, a name such as ``skip``, or ``...`` for any value; empty: the option
        alone.
    """

    name: str
    value: str = ""


def spelled_in_python(option: OptionRef) -> str:
    """Return an option as a keyword argument: ``allow_inexact=True``, ``nan="skip"``, ``max_error``."""
    if not option.value:
        return option.name
    # (A kind of sums is called "none".)
    constant = option.value in _CONSTANTS and option.name != "normalization"
    literal = constant or _NUMBER.fullmatch(option.value)
    value = _CONSTANTS.get(option.value, option.value) if literal else f'"{option.value}"'
    return f"{option.name}={value}"


@dataclass(frozen=True)
class Words:
    """A text in pieces: strings and references to options."""

    pieces: tuple[str | OptionRef, ...] = ()

    @staticmethod
    def of(text: str | Words) -> Words:
        """Return a text as words."""
        return text if isinstance(text, Words) else Words((text,) if text else ())

    def __add__(self, other: str | Words) -> Words:
        """Join two texts."""
        return Words(self.pieces + Words.of(other).pieces)

    def __radd__(self, other: str) -> Words:
        """Join two texts."""
        return Words.of(other) + self

    def __bool__(self) -> bool:
        """Return whether there is any text."""
        return bool(self.pieces)

    def text(self, spelling: Callable[[OptionRef], str] = spelled_in_python) -> str:
        """Return the text, with every reference spelled by a function, as one line without control characters."""
        # Names from files stand in it, and what other libraries say of files.
        return escaped("".join(piece if isinstance(piece, str) else spelling(piece) for piece in self.pieces))


def option_ref(name: str, value: str = "") -> Words:
    """Return a piece of a message that refers to an option: ``"pass " + option_ref("nan", "skip")``."""
    return Words((OptionRef(name, value),))


def option_refs(names: Iterable[str]) -> Words:
    """Return references to several options, with commas between them."""
    return functools.reduce(
        lambda words, name: words + ", " + option_ref(name) if words else option_ref(name), names, Words()
    )


@dataclass(frozen=True)
class Complaint:
    """The fields of a message. Empty fields are left out of the text."""

    what: Words
    found: Words = Words()
    wanted: Words = Words()
    advice: Words = Words()
    option: str | None = None

    def text(self, spelling: Callable[[OptionRef], str] = spelled_in_python) -> str:
        """Return the message, "what: found ...; wanted ...; advice", with options spelled by a function."""
        parts = (("found ", self.found), ("wanted ", self.wanted), ("", self.advice))
        rest = "; ".join(introduction + part.text(spelling) for introduction, part in parts if part)
        return ": ".join(part for part in (self.what.text(spelling), rest) if part)


class Error(Exception):
    """Base class of all errors that sheetsplat raises itself.

    Attributes
    ----------
    what, found, wanted, advice
        What could not be done, the value or state that prevented it, what would have been accepted, and what the
        reader can do next. Options are spelled as keyword arguments. Any but `what` may be empty.
    option
        The option that the error is about: the one that was given, else the one that alone is referred to in `what`;
        None where there is none, or more than one.
    complaint
        The same fields, with references to options that a front end can spell in its own way.

    Examples
    --------
    >>> try:
    ...     ss.render(values, mode="isosurfaces")
    ... except ss.Error as error:
    ...     print(error.what, "|", error.advice)
    render: mode cannot be used | did you mean isosurface?
    """

    __module__ = "sheetsplat"

    def __init__(
        self,
        what: str | Words = "",
        found: str | Words = "",
        wanted: str | Words = "",
        advice: str | Words = "",
        option: str | None = None,
    ) -> None:
        # Exceptions are pickled as their class and args.
        super().__init__(what, found, wanted, advice, option)
        option = option or _only_option(Words.of(what))
        self.complaint = Complaint(Words.of(what), Words.of(found), Words.of(wanted), Words.of(advice), option)
        self.what = self.complaint.what.text()
        self.found = self.complaint.found.text()
        self.wanted = self.complaint.wanted.text()
        self.advice = self.complaint.advice.text()
        self.option = option

    def __str__(self) -> str:
        """Return the message as Python spells it."""
        return self.complaint.text()


class InvalidInput(Error, ValueError):
    """A number, an array, a file or an option that has no meaning here.

    Examples
    --------
    >>> ss.Light((0, 0, 0))
    Traceback (most recent call last):
    ...
    sheetsplat.InvalidInput: ...
    """

    __module__ = "sheetsplat"


class DeviceUnavailable(Error, RuntimeError):
    """No device for the backend is available; the message lists every attempt.

    Examples
    --------
    >>> issubclass(ss.DeviceUnavailable, ss.Error), issubclass(ss.DeviceUnavailable, RuntimeError)
    (True, True)
    """

    __module__ = "sheetsplat"


class OutOfMemory(Error, RuntimeError):
    """More memory would be needed than is available; nothing was left allocated.

    Examples
    --------
    >>> issubclass(ss.OutOfMemory, ss.Error), issubclass(ss.OutOfMemory, RuntimeError)
    (True, True)
    """

    __module__ = "sheetsplat"


class Unsupported(Error, RuntimeError):
    """A valid request that cannot be fulfilled here within its error bound.

    Examples
    --------
    >>> ss.Renderer("cpu", precision="uint8").render(scene, camera, size=(32, 32))
    Traceback (most recent call last):
    ...
    sheetsplat.Unsupported: ...
    """

    __module__ = "sheetsplat"


class Cancelled(Error):
    """The progress callback returned False; the renderer stays usable.

    Examples
    --------
    >>> ss.render(values, size=(32, 32), progress=lambda share: False)
    Traceback (most recent call last):
    ...
    sheetsplat.Cancelled: ...
    """

    __module__ = "sheetsplat"


def about_option(error: Error, old: str, new: str) -> Error:
    """Return an error that refers to another option in place of `old`."""
    told = error.complaint

    def renamed(text: Words) -> Words:
        return Words(tuple(replace(one, name=new) if _is_option(one, old) else one for one in text.pieces))

    option = new if told.option == old else told.option
    return type(error)(renamed(told.what), renamed(told.found), renamed(told.wanted), renamed(told.advice), option)


def _is_option(piece: str | OptionRef, name: str) -> TypeGuard[OptionRef]:
    return isinstance(piece, OptionRef) and piece.name == name


def complain(
    what: str | Words,
    found: str | Words = "",
    wanted: str | Words = "",
    advice: str | Words = "",
    *,
    option: str | None = None,
    kind: type[Error] = InvalidInput,
) -> Error:
    """Return an error with the fields that all errors have.

    Parameters
    ----------
    what, found, wanted, advice, option
        The attributes of `Error`. Texts may refer to options by `option_ref`.
    kind
        The class of the error.
    """
    return kind(_bounded(what), _bounded(found), _bounded(wanted), _bounded(advice), option)


def missing_package(what: str, error: ImportError) -> Error:
    """Return the error for something that needs a package which is not installed."""
    module = (error.name or str(error)).partition(".")[0]
    name = _PACKAGES.get(module, module)
    extra = next((extra for extra, modules in _EXTRAS.items() if module in modules), None)
    command = f"pip install {name}" if extra is None else f"pip install 'sheetsplat[{extra}]'"
    return complain(what, f"no package {name}", name, command, kind=Unsupported)


def unusable(what: str) -> Words:
    """Return "`what` cannot be used", where `what` is an owner and one of its options: "Renderer: threads"."""
    owner, colon, option = what.rpartition(": ")
    return owner + colon + (option_ref(option) if option.isidentifier() else Words.of(option)) + " cannot be used"


def _only_option(words: Words) -> str | None:
    names = {piece.name for piece in words.pieces if isinstance(piece, OptionRef)}
    return names.pop() if len(names) == 1 else None


def _bounded(text: str | Words) -> Words:
    # What was found may be a file's own words, of any length.
    return Words(tuple(_shortened(piece) if isinstance(piece, str) else piece for piece in Words.of(text).pieces))


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 4 :]}"

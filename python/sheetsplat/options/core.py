"""What an option is, and what is made of its definition: signatures, docstrings, and the check of keyword names."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from sheetsplat._checks import nearest_names, shown
from sheetsplat.errors import Error, InvalidInput, complain, unusable
from sheetsplat.modes import TRAITS
from sheetsplat.options.values import Value

Mode = Literal["composite", "isosurface", "mip", "minimum", "average", "xray"]
MODES: tuple[str, ...] = get_args(Mode)
# Modes that show colours, those that also accumulate opacity, and those that make one number a pixel.
COLORED = tuple(mode for mode in MODES if not TRAITS[mode].is_scalar)
COMPOSITE = tuple(mode for mode in MODES if TRAITS[mode].is_composited)
SURFACES = tuple(mode for mode in MODES if TRAITS[mode].shows_surfaces)
SCALAR = tuple(mode for mode in MODES if TRAITS[mode].is_scalar)
MEANS = tuple(mode for mode in MODES if TRAITS[mode].mean)

# Converts the value of an option, or raises InvalidInput; the first argument names the option in the message.
Check = Callable[[str, Any], Any]
Documented = TypeVar("Documented", bound=Callable[..., Any])
_COLUMNS = 120
# A reference to another option in a help text.
REFERENCE = re.compile(r"\{(\w+)\}")


class UnknownOption(InvalidInput, TypeError):
    """A keyword argument that the function does not have."""


@dataclass(eq=False)
class CommandLine:
    """One option of the command line.

    Attributes
    ----------
    flag
        Its spelling; made from the option's name unless given. "--log/--no-log" is a switch with two spellings.
    parameter
        Name of the parameter that the command receives; the option's name unless given.
    value
        What it accepts; by the option's type unless given.
    help
        Help text where it differs from the option's.
    default
        Default value in words where it differs from the option's.
    metavar
        How the help shows the value; by `value` unless given.
    multiple
        May be repeated.
    switch
        Takes no value.
    bare
        The value that it stands for where none follows; "": one must follow.
    """

    flag: str = ""
    parameter: str = ""
    value: Value | None = None
    help: str = ""
    default: str = ""
    metavar: str = ""
    multiple: bool = False
    switch: bool = False
    bare: str = ""


@dataclass(eq=False)
class Option:
    """The definition of one option, which annotates a field of a TypedDict.

    Attributes
    ----------
    help
        What it does, in sentences for both Python and the command line; ``{name}`` refers to another option.
    default
        The value where it is not given.
    unset
        What is used where the default is None.
    chosen
        What `render` and the command line choose, where that differs from `default` and `unset`.
    accepts
        Its Python type in words, where the annotation is too long to be read.
    modes
        The modes that use it.
    effect
        The effect of the plan that any value but the default switches on.
    in_values
        It is given in values of the field.
    gradients
        Any value but None calls for gradients.
    backends
        The backends that use it, for options of the renderer; all unless given.
    check
        Converts a value, for classes that take their options from definitions.
    flag, value, switch
        Of the command line, as those of `CommandLine`, where the option has one spelling that needs nothing else.
    cli
        Its spellings on the command line, if not that one; none for options that Python alone has.
    called
        Names under which it is looked for: the message about such a name has this one.
    harmless
        On the command line, giving it in a mode that does not use it is a warning, not an error.
    name, type
        Those of the field that it annotates; `definitions` adds them.
    """

    help: str
    default: object = None
    unset: str = ""
    chosen: str = ""
    accepts: str = ""
    modes: tuple[str, ...] = MODES
    effect: str = ""
    in_values: bool = False
    gradients: bool = False
    backends: tuple[str, ...] = ()
    check: Check | None = None
    flag: str = ""
    value: Value | None = None
    switch: bool = False
    cli: tuple[CommandLine, ...] | None = None
    called: tuple[str, ...] = ()
    harmless: bool = False
    name: str = ""
    type: Any = None

    @property
    def spellings(self) -> tuple[CommandLine, ...]:
        """All options of the command line that stand for this one."""
        return (CommandLine(self.flag, value=self.value, switch=self.switch),) if self.cli is None else self.cli

    @property
    def type_text(self) -> str:
        """The Python type in words."""
        return self.accepts or _type_text(self.type)

    def default_text(self, *, chooses: bool) -> str:
        """Return the value that is used where none is given; `chooses`: by `render` and the command line."""
        if chooses and self.chosen:
            return self.chosen
        return self.unset or ("" if self.default is None else value_text(self.default))


@cache
def definitions(group: type) -> dict[str, Option]:
    """Return the options of a TypedDict by name, those of its bases first."""
    found: dict[str, Option] = {}
    for name, annotation in group.__annotations__.items():
        kind, option = get_args(annotation)
        found[name] = replace(option, name=name, type=kind)
    return found


def pick(group: type, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of `options` that belong to a group."""
    names = definitions(group)
    return {name: value for name, value in options.items() if name in names}


def pick_given(group: type, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of `options` that belong to a group and are not None."""
    return {name: value for name, value in pick(group, options).items() if value is not None}


def filled(group: type, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value of every option of a group, given or default, unchecked."""
    return {name: options.get(name, defined.default) for name, defined in definitions(group).items()}


def check_names(function: str, options: Mapping[str, Any], group: type, others: Sequence[str] = ()) -> None:
    """Raise UnknownOption, a TypeError, for a name that is not an option of `group` nor one of `others`.

    InvalidInput for what is no text where an option is a text alone: readers look for it among names.
    """
    defined = definitions(group)
    for name, value in options.items():
        if name in defined and defined[name].type == str | None and not isinstance(value, str | None):
            advice = f'pass {name}="{value}"' if isinstance(value, int) else ""
            raise complain(unusable(f"{function}: {name}"), shown(value), "a text", advice, option=name)
        if name not in defined and name not in others:
            called = next((f"did you mean {own}?" for own, one in defined.items() if name in one.called), "")
            near = called or nearest_names(name, [*defined, *others])
            advice = near or f"help(sheetsplat.{function}) lists the options"
            raise complain(
                f"{function}: there is no option of this name", name, "", advice, option=name, kind=UnknownOption
            )


def checked(owner: str, options: Mapping[str, Any], group: type) -> dict[str, Any]:
    """Return the value of every option of a group: given or default, converted by its check.

    Raises UnknownOption for other names, and what the checks raise.
    """
    check_names(owner, options, group)
    values = filled(group, options)
    for name, defined in definitions(group).items():
        if defined.check is not None:
            try:
                values[name] = defined.check(f"{owner}: {name}", values[name])
            except Error as error:
                raise _concerning(error, name) from None
    return values


def _concerning(error: Error, name: str) -> Error:
    """Return an error with the name of an option, unless it has one."""
    if error.option is not None:
        return error
    told = error.complaint
    return type(error)(told.what, told.found, told.wanted, told.advice, name)


def parameters(group: type, *, chooses: bool) -> list[inspect.Parameter]:
    """Return keyword-only parameters; where the function chooses values itself, the default of those is None."""
    return [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None if chooses and defined.chosen else defined.default,
            # The types of options with `accepts` are too long for a signature.
            annotation=inspect.Parameter.empty if defined.accepts else defined.type,
        )
        for name, defined in definitions(group).items()
    ]


def documented(group: type, *, chooses: bool = False) -> Callable[[Documented], Documented]:
    """Decorate a function, or a class, that takes ``**options: Unpack[group]``: full signature, docs of every option.

    The docstring has an entry ``**options``, which the entries of the options replace. An option of the group may also
    be a parameter of its own, which can be given by position.

    Parameters
    ----------
    group
        TypedDict of the options.
    chooses
        The function chooses values that are not given, as `Option.chosen` says.
    """

    def decorate(target: Documented) -> Documented:
        function: Any = target.__init__ if isinstance(target, type) else target  # type: ignore[misc]
        signature = inspect.signature(function)
        fixed = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        more = [one for one in parameters(group, chooses=chooses) if one.name not in signature.parameters]
        function.__signature__ = signature.replace(parameters=[*fixed, *more])
        if target.__doc__:
            target.__doc__ = with_entries(target.__doc__, group, chooses=chooses)
        return target

    return decorate


def with_entries(text: str, group: type, *, chooses: bool) -> str:
    """Return a docstring whose entry ``**options`` is replaced by one for each option of a group."""
    found = re.search(r"^( *)\*\*options\n(?:\1 +.*\n)+", text, re.MULTILINE)
    if found is None:
        raise ValueError("the docstring has no entry **options")
    margin = found[1]
    lines = [line for defined in definitions(group).values() for line in _entry(defined, chooses=chooses)]
    entries = "".join(f"{margin}{line}\n" for line in lines)
    return text[: found.start()] + entries + text[found.end() :]


def _entry(option: Option, *, chooses: bool) -> list[str]:
    default = option.default_text(chooses=chooses)
    words = in_python(option.help)
    if default:
        words += f" Default: {in_python(default)}."
    if option.modes != MODES:
        words += f" For {modes_text(option.modes)}."
    return [f"{option.name} : {option.type_text}", *(f"    {line}" for line in _wrapped(words, _COLUMNS - 12))]


def _wrapped(text: str, columns: int) -> Iterator[str]:
    """Yield the lines of a text. The module textwrap takes ten times as long, at every import of the package."""
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > columns:
            yield line
            line = word
        else:
            line = f"{line} {word}" if line else word
    yield line


def modes_text(modes: tuple[str, ...]) -> str:
    """Return "the mode composite" or "the modes composite and isosurface"."""
    return f"the mode{'s' * (len(modes) > 1)} {' and '.join(modes)}"


def in_python(text: str) -> str:
    """Return a help text with references to options as Python spells them."""
    return REFERENCE.sub(r"`\1`", text)


def value_text(value: object) -> str:
    """Return a default value as Python spells it, strings in double quotes."""
    return f'"{value}"' if isinstance(value, str) else repr(value)


def defaults_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the defaults of a function's parameters, for options whose values go to that function."""
    return {name: one.default for name, one in inspect.signature(function).parameters.items()}


def choices_of(kind: Any) -> tuple[str, ...]:
    """Return the names that a Literal, perhaps in a union, allows."""
    if get_origin(kind) is Literal:
        return tuple(one for one in get_args(kind) if isinstance(one, str))
    if get_origin(kind) in (Union, UnionType):
        return tuple(name for part in get_args(kind) for name in choices_of(part))
    return ()


def _type_text(kind: Any) -> str:
    if kind is NoneType or kind is None:
        return "None"
    if get_origin(kind) is Literal:
        return ", ".join(value_text(one) for one in get_args(kind))
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(_type_text(part) for part in get_args(kind) if part is not NoneType)
    return str(getattr(kind, "__name__", kind))

"""Scenes: fields with their classification, light and compositing. Conventions, sections 3 (Slices) to 7 (Modes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import Bounds, Triple, parts, shown
from sheetsplat.errors import Unsupported, complain, option_ref, unusable
from sheetsplat.fields import (
    BrickedKernels,
    Field,
    RegularField,
    any_in_bricks,
    as_fields,
    default_spacing,
    joined_bounds,
)
from sheetsplat.labels import groups_of
from sheetsplat.light import Light, Material
from sheetsplat.look.weighted import SUMS, is_weighted, sums_of
from sheetsplat.modes import TRAITS
from sheetsplat.options.core import check_names, checked, documented
from sheetsplat.options.scene import IsoValue, SceneOptions, surfaces_of
from sheetsplat.plan import PictureQuality
from sheetsplat.quantity import notes_of
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.transfer import TransferFunction

# A transfer function, or its points.
Look = TransferFunction | Sequence[Sequence[float]] | NDArray[Any]
# Fields whose scalars add up, each with its transfer function.
Groups = list[tuple[tuple[Field, ...], TransferFunction]]
# What takes the place of a group's colours: another field with a transfer function, whose opacities do not count.
Coloring = tuple[Field | Sequence[Field], Look]
Colorings = tuple[tuple[tuple[Field, ...], TransferFunction] | None, ...]


def _is_table(value: object) -> bool:
    """Return whether a value is a table of points rather than a single point."""
    if isinstance(value, np.ndarray):
        return value.ndim == 2
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], list | tuple | np.ndarray)


def _is_several(transfer_function: object) -> bool:
    """Return whether a value is a sequence of transfer functions rather than a single one."""
    return isinstance(transfer_function, list | tuple) and any(
        isinstance(one, TransferFunction) or _is_table(one) for one in transfer_function
    )


def _groups(field: object, transfer_function: object) -> Groups:
    """Return the groups of fields whose scalars add up, each with its transfer function."""
    several = _is_several(transfer_function)
    given: Any = transfer_function if several else [transfer_function]
    functions = [one if isinstance(one, TransferFunction) else TransferFunction(one) for one in given]
    nested = isinstance(field, list | tuple) and any(isinstance(one, list | tuple) for one in field)
    if several or nested:
        members = list(field) if isinstance(field, list | tuple) else [field]
        groups = [tuple(as_fields(one, f"Scene: group {n} of field")) for n, one in enumerate(members)]
    else:
        groups = [tuple(as_fields(field, "Scene: field"))]
    if len(groups) != len(functions):
        raise complain(
            "Scene: field and transfer_function do not fit together",
            f"groups of fields: {len(groups)}, transfer functions: {len(functions)}",
            "one for each group",
            "Scene([a, b], [tf_a, tf_b]), or for their sum Scene([a, b], tf)",
        )
    return list(zip(groups, functions, strict=True))


def _colorings(color_by: object, groups: Groups) -> Colorings:
    """Return what gives each group its colours, None where it has its own."""
    if color_by is None:
        return (None,) * len(groups)
    one = isinstance(color_by, tuple) and len(color_by) == 2 and isinstance(color_by[0], Field | list)
    given: Any = [color_by] if one else color_by
    wanted = "(field, transfer function), or a sequence with one or None for each group of fields"
    found = parts("Scene: color_by", given, wanted, len(groups) + 1)
    if len(found) != len(groups):
        raise complain(unusable("Scene: color_by"), f"{len(found)} for {len(groups)} groups of fields", wanted)
    made: list[tuple[tuple[Field, ...], TransferFunction] | None] = []
    for number, (pair, (fields, _)) in enumerate(zip(found, groups, strict=True)):
        if pair is None:
            made.append(None)
            continue
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise complain(unusable("Scene: color_by"), shown(pair), wanted)
        field, function = pair
        look = function if isinstance(function, TransferFunction) else TransferFunction(function)
        givers = tuple(as_fields(field, "Scene: color_by"))
        if any(isinstance(other, RegularField) and not other.has_values for other in (*fields, *givers)):
            found_ = f"samples that are colours or labels, in group {number} or for it"
            raise complain(
                unusable("Scene: color_by"), found_, "values", "open them with labels=False, or leave it out"
            )
        if any_in_bricks((*fields, *givers)):
            advice = "open them with sheetsplat.open"
            raise complain(unusable("Scene: color_by"), "data in bricks", "data in memory", advice, kind=Unsupported)
        made.append((givers, look))
    return tuple(made)


def _components(field: RegularField, mode: str) -> list[tuple[Any, TransferFunction]]:
    """Return red, green and blue of a colour volume, each with the ramp that makes colours of it."""
    if not TRAITS[mode].is_composited:
        raise complain(
            f"Scene: mode {mode} cannot be used",
            "a volume of colours",
            option_ref("mode", "composite") + ", or a scalar mode, which shows how opaque it is",
            option="mode",
        )
    made = []
    for channel in range(3):
        top = np.zeros(5)
        top[0], top[1 + channel], top[4] = field.full_color, 1.0, 1.0
        black = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        made.append((field.part_of_color(channel), TransferFunction(np.stack((black, top)))))
    return made


def _native(value: Any) -> Any:
    """Return what the native scene takes for a checked value."""
    if isinstance(value, tuple) and all(isinstance(one, Light) for one in value):
        return [light.native for light in value]
    return getattr(value, "native", value)


@documented(SceneOptions)
class Scene:
    """Everything about a picture except the camera and the size. Immutable.

    Parameters
    ----------
    field
        A field, or a sequence of fields of any kind whose scalars add up. With several transfer functions, a sequence
        of as many entries, each a field or a sequence of fields whose scalars add up.
    transfer_function
        Scalar to colour and opacity per reference length; a TransferFunction, or its points. Or a sequence of them,
        one for each entry of `field`; in scalar modes the scalars of all fields add up nevertheless. Fields of labels
        have a LabelColors.
    color_by
        A field, or several that add up, with a transfer function whose colours take the place of the first ones where
        that field is not empty; opacities, and where surfaces lie, stay. With several transfer functions a sequence
        with one or None for each entry of `field`. Scalar modes do not use it.
    **options
        Those of SceneOptions.

    Raises
    ------
    InvalidInput
        Where a number or a combination has no meaning.

    Examples
    --------
    >>> field = ss.RegularField(values)
    >>> scene = ss.Scene(field, [(0, 0, 0, 0, 0), (1, 1, 0.8, 0.6, 0.5)], lights=[ss.Light((0.3, 0.5, 1))])
    >>> scene.replace(mode="mip").mode
    'mip'
    """

    __slots__ = ("_colors", "_groups", "_native", "_options", "_quality", "_sums")
    _colors: Colorings
    _native: _sheetsplat.Scene | None
    _sums: tuple[Scene, Scene] | None
    _quality: PictureQuality | None

    def __init__(
        self,
        field: Field | Sequence[Field | Sequence[Field]],
        transfer_function: Look | Sequence[Look],
        *,
        color_by: Coloring | Sequence[Coloring | None] | None = None,
        **options: Unpack[SceneOptions],
    ) -> None:
        check_names("Scene", options, SceneOptions)
        groups = _groups(field, transfer_function)
        self._make(groups, checked("Scene", options, SceneOptions), _colorings(color_by, groups))
        self.check()

    @classmethod
    def sketched(
        cls, field: object, transfer_function: object, options: Mapping[str, Any], color_by: object = None
    ) -> Scene:
        """Return what `Scene` does, but for `check`."""
        groups = _groups(field, transfer_function)
        return cls.of_checked(groups, checked("Scene", options, SceneOptions), _colorings(color_by, groups))

    @classmethod
    def of_checked(cls, groups: Groups, options: Mapping[str, Any], colors: Colorings = ()) -> Scene:
        """Return the scene of groups and of all options of another one, `Scene.options`, which are not checked."""
        made = cls.__new__(cls)
        made._make(groups, dict(options), colors or (None,) * len(groups))
        return made

    def _make(
        self,
        groups: Groups,
        options: dict[str, Any],
        colors: Colorings,
        quality: PictureQuality | None = None,
        native: _sheetsplat.Scene | None = None,
    ) -> None:
        self._groups, self._options, self._quality, self._native = groups, options, quality, native
        self._colors = colors
        self._sums = None

    def check(self) -> None:
        """Make the native scene, once, or raise what is wrong with what options mean together."""
        if self._native is None:
            self._native = self._made()

    def _made(self) -> _sheetsplat.Scene:
        if self._options["clip"].sphere and (self._options["shadows"] or self._options["ambient_occlusion"]):
            found = "a sphere, with shadows or ambient occlusion"
            raise complain(unusable("Scene: clip"), found, "planes and a box with them", option="clip")
        if TRAITS[self.mode].adds and self.notes:
            raise complain(
                f"Scene: mode {self.mode} cannot be used",
                f"a field of logarithms: {self.notes[0]}",
                "a field of the values",
                option_ref("log_scale", "true") + " shows the logarithm of their sums",
                option="mode",
            )
        native = {name: _native(value) for name, value in self._options.items()}
        # The engine makes the numbers of a scalar picture; the image makes their colours, the mean of samples, and what
        # slice planes put behind it.
        del native["scalar_colors"], native["supersampling"], native["iso_value"], native["slice_planes"]
        native["filter"] = native["filter"] or "none"
        native["second_order"] = native["preintegration"] == "second_order"
        native["preintegration"] = bool(native["preintegration"])
        native["iso_values"] = self.surfaces
        if any(isinstance(one, BrickedKernels) for one in self.fields):
            # The native field of kernels in bricks is a sample, which would have slices farther apart.
            native |= {"slice_spacing": self.slice_spacing, "reference_length": self.reference_length}
        return _sheetsplat.Scene(self._native_groups(), **native)

    def _native_groups(self) -> list[tuple[Any, Any, str, int]]:
        """Return fields, transfer function, role, and number of the set of labels of each native group."""
        made: list[tuple[Any, Any, str, int]] = []
        for number, (fields, function) in enumerate(self._groups):
            apart = [one for one in fields if isinstance(one, RegularField) and not one.has_values]
            if apart and len(fields) > 1:
                raise complain(
                    f"Scene: {'labels' if apart[0].labels else 'colours'} cannot be added up",
                    f"{len(fields)} fields in one group",
                    "a field of labels or colours in a group of its own",
                    "Scene([volume, labels], [tf, LabelColors(...)])",
                )
            if apart and apart[0].labels:
                made += [(*group, number) for group in groups_of(apart[0], function)]
                continue
            made.append(([one.native for one in fields], function.native, "shown", number))
            if TRAITS[self.mode].is_scalar:
                continue
            if apart:
                made += [([one], ramp.native, "colors", number) for one, ramp in _components(apart[0], self.mode)]
            if (coloring := self._colors[number]) is not None:
                opaque = coloring[1].points.copy()
                opaque[:, 4] = 1.0
                natives = [one.native for one in coloring[0]]
                made.append((natives, TransferFunction(opaque).native, "colors", number))
        return made

    @property
    def color_by(self) -> Colorings:
        """For each group the fields that give it colours, with their transfer function; None: it has its own."""
        return self._colors

    @property
    def sums(self) -> tuple[Scene, Scene] | None:
        """The x-rays of product and weight whose quotient is shown where a mean is weighted; None elsewhere.

        Raises
        ------
        Unsupported
            For several fields.
        """
        if self._sums is None and any(is_weighted(one, self.mode) for one in self.fields):
            if len(self.fields) > 1:
                raise complain(
                    "Scene: a weighted mean cannot be shown",
                    f"{len(self.fields)} fields",
                    "one field with weights",
                    kind=Unsupported,
                )
            lengths = {"slice_spacing": self.slice_spacing, "reference_length": self.reference_length}
            product, weight = (self.sketch(field=one, mode=SUMS, **lengths) for one in sums_of(self.fields[0]))
            self._sums = product, weight
        return self._sums

    @property
    def native(self) -> _sheetsplat.Scene:
        """The scene of the native renderer. Unsupported for a weighted mean, which is made of two."""
        if self.sums is not None:
            raise complain(
                "a weighted mean cannot be examined",
                "a quotient of two pictures",
                "one without weights",
                "take field.weighted_by(None)",
                kind=Unsupported,
            )
        self.check()
        assert self._native is not None
        return self._native

    def replace(self, **changes: Any) -> Scene:
        """Return a scene with some options changed and all others as in this one.

        Parameters
        ----------
        changes
            Options of `Scene`, including `field` and `transfer_function`. Distances that were not given follow from the
            field of the new scene.

        Raises
        ------
        InvalidInput
            As `Scene`, and for unknown names.
        """
        made = self.sketch(**changes)
        made.check()
        return made

    def sketch(self, **changes: Any) -> Scene:
        """Return what `replace` does, but for `check`."""
        check_names("Scene.replace", changes, SceneOptions, ("field", "transfer_function", "color_by"))
        own = len(self._groups) > 1
        # One transfer function in place of several classifies the sum of all fields.
        functions = changes.pop("transfer_function", self.transfer_functions if own else self.transfer_function)
        fields = changes.pop("field", self.groups if own and _is_several(functions) else self.fields)
        same = len(self._colors) == (len(functions) if _is_several(functions) else 1)
        colors = changes.pop("color_by", self._colors if same and any(self._colors) else None)
        return Scene.sketched(fields, functions, {**self._options, **changes}, colors)

    @property
    def quality(self) -> PictureQuality | None:
        """What the option `quality` set where `sheetsplat.render` made the scene; None in all others."""
        return self._quality

    def with_quality(self, quality: PictureQuality | None) -> Scene:
        """Return the same scene with what a quality set, which its plans then say; it does not count for equality."""
        made = Scene.__new__(Scene)
        made._make(self._groups, self._options, self._colors, quality, self._native)
        return made

    @property
    def fields(self) -> tuple[Field, ...]:
        """All fields, one group after the other."""
        return tuple(one for fields, _ in self._groups for one in fields)

    @property
    def groups(self) -> tuple[tuple[Field, ...], ...]:
        """The fields in groups: inside a group scalars add up, and each group has its transfer function."""
        return tuple(fields for fields, _ in self._groups)

    @property
    def options(self) -> Mapping[str, Any]:
        """Every option of `Scene` by its name, as it was given or by default."""
        return MappingProxyType(self._options)

    @property
    def transfer_function(self) -> TransferFunction:
        """Scalar to colour and opacity, of the first group."""
        return self._groups[0][1]

    @property
    def transfer_functions(self) -> tuple[TransferFunction, ...]:
        """The transfer function of each group."""
        return tuple(function for _, function in self._groups)

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights."""
        found: tuple[Light, ...] = self._options["lights"]
        return found

    @property
    def material(self) -> Material:
        """The Phong coefficients."""
        found: Material = self._options["material"]
        return found

    @property
    def scalar_colors(self) -> ScalarColors:
        """How the numbers of a scalar picture become colours."""
        found: ScalarColors = self._options["scalar_colors"]
        return found

    @property
    def mode(self) -> str:
        """How slices are combined into pixels: the option `mode`."""
        found: str = self._options["mode"]
        return found

    @property
    def iso_value(self) -> IsoValue | None:
        """Value of the isosurface, or pairs (value, opacity), or None; as it was given."""
        found: IsoValue | None = self._options["iso_value"]
        return found

    @property
    def surfaces(self) -> tuple[tuple[float, float], ...]:
        """The isosurfaces as pairs (value, opacity); none where no `iso_value` was given."""
        return surfaces_of(self.iso_value)

    @property
    def filter(self) -> str | None:
        """Filter of kernels before slicing: None or "ewa"."""
        found: str | None = self._options["filter"]
        return found

    @property
    def supersampling(self) -> int:
        """Samples a pixel along each axis."""
        found: int = self._options["supersampling"]
        return found

    @property
    def background(self) -> Triple | None:
        """Red, green, blue behind the picture, or None."""
        found: Triple | None = self._options["background"]
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        """What is shown, where that is not the data as they are."""
        return notes_of(one.quantity for one in self.fields)

    @property
    def slice_spacing(self) -> float:
        """Distance of slices in world units."""
        return self._length("slice_spacing")

    @property
    def reference_length(self) -> float:
        """Length in world units to which opacities refer."""
        return self._length("reference_length")

    def _length(self, option: str) -> float:
        given: float | None = self._options[option]
        return default_spacing(self.fields) if given is None else given

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return joined_bounds([one.bounds for one in self.fields])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the arguments."""
        return _made, (self.groups, self.transfer_functions, dict(self._options), self._quality, self._colors)

    def __eq__(self, other: object) -> bool:
        """Return whether fields, transfer functions, colours of other fields and options are the same."""
        if not isinstance(other, Scene):
            return NotImplemented
        # The quickest first.
        mine = self._options, self.transfer_functions, self.groups, self._colors
        return mine == (dict(other.options), other.transfer_functions, other.groups, other.color_by)

    def __hash__(self) -> int:
        """Return a hash of fields, transfer function and mode."""
        return hash((self.groups, self.transfer_functions, self.mode))

    def __repr__(self) -> str:
        """Return a short description."""
        return f"Scene({', '.join(map(repr, self.fields))}, mode {self.mode!r}, {len(self.lights)} lights)"


def _made(
    groups: tuple[Any, ...],
    functions: tuple[TransferFunction, ...],
    options: dict[str, Any],
    quality: PictureQuality | None,
    colors: Colorings,
) -> Scene:
    """Return the scene of what `Scene.__reduce__` gave."""
    scene = Scene(groups, functions, color_by=colors if any(colors) else None, **options)
    return scene if quality is None else scene.with_quality(quality)

"""Scenes: fields with their classification, light and compositing. Conventions, sections 3 (Slices) to 7 (Modes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Unpack

from sheetsplat import _sheetsplat
from sheetsplat._checks import Bounds, Triple
from sheetsplat.fields import Field, as_fields, joined_bounds
from sheetsplat.light import Light, Material
from sheetsplat.options.core import check_names, checked, documented
from sheetsplat.options.scene import SceneOptions
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.transfer import TransferFunction


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
        A field, or a sequence of fields of any kind whose scalars add up.
    transfer_function
        Scalar to colour and opacity per reference length; a TransferFunction, or its points.
    **options
        Those of SceneOptions.

    Raises
    ------
    InvalidInput
        Where a number or a combination has no meaning.
    """

    __slots__ = ("_fields", "_options", "_transfer_function", "native")

    def __init__(
        self,
        field: Field | Sequence[Field],
        transfer_function: TransferFunction | Sequence[Sequence[float]],
        **options: Unpack[SceneOptions],
    ) -> None:
        check_names("Scene", options, SceneOptions)
        self._fields = tuple(as_fields(field, "Scene: field"))
        if not isinstance(transfer_function, TransferFunction):
            transfer_function = TransferFunction(transfer_function)
        self._transfer_function = transfer_function
        self._options = checked("Scene", options, SceneOptions)
        native = {name: _native(value) for name, value in self._options.items()}
        # The engine makes the numbers of a scalar picture; the image makes their colours.
        del native["scalar_colors"]
        native["filter"] = native["filter"] or "none"
        native["second_order"] = native["preintegration"] == "second_order"
        native["preintegration"] = bool(native["preintegration"])
        self.native = _sheetsplat.Scene([one.native for one in self._fields], transfer_function.native, **native)

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
        check_names("Scene.replace", changes, SceneOptions, ("field", "transfer_function"))
        given = {"field": self._fields, "transfer_function": self._transfer_function, **self._options}
        return Scene(**{**given, **changes})

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields whose scalars add up."""
        return self._fields

    @property
    def options(self) -> Mapping[str, Any]:
        """Every option of `Scene` by its name, as it was given or by default."""
        return MappingProxyType(self._options)

    @property
    def transfer_function(self) -> TransferFunction:
        """Scalar to colour and opacity."""
        return self._transfer_function

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
        """One of "composite", "isosurface", "xray" and "mip"."""
        found: str = self._options["mode"]
        return found

    @property
    def iso_value(self) -> float | None:
        """Value of the isosurface, or None."""
        found: float | None = self._options["iso_value"]
        return found

    @property
    def filter(self) -> str | None:
        """Filter of kernels before slicing: None or "ewa"."""
        found: str | None = self._options["filter"]
        return found

    @property
    def background(self) -> Triple | None:
        """Red, green, blue behind the picture, or None."""
        found: Triple | None = self._options["background"]
        return found

    @property
    def slice_spacing(self) -> float:
        """Distance of slices in world units."""
        return self.native.slice_distance

    @property
    def reference_length(self) -> float:
        """Length in world units to which opacities refer."""
        return self.native.reference_distance

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return joined_bounds([one.bounds for one in self._fields])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the arguments."""
        return _made, (self._fields, self._transfer_function, dict(self._options))

    def __eq__(self, other: object) -> bool:
        """Return whether fields, transfer function and options are the same."""
        if not isinstance(other, Scene):
            return NotImplemented
        # The quickest first.
        mine = self._options, self._transfer_function, self._fields
        return mine == (dict(other.options), other.transfer_function, other.fields)

    def __hash__(self) -> int:
        """Return a hash of fields, transfer function and mode."""
        return hash((self._fields, self._transfer_function, self.mode))

    def __repr__(self) -> str:
        """Return a short description."""
        return f"Scene({', '.join(map(repr, self._fields))}, mode {self.mode!r}, {len(self.lights)} lights)"


def _made(fields: tuple[Field, ...], function: TransferFunction, options: dict[str, Any]) -> Scene:
    """Return the scene of what `Scene.__reduce__` gave."""
    return Scene(fields, function, **options)

"""Maxima and means of several channels: a picture of each in its colour, added as light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import Field, RegularField
from sheetsplat.modes import TRAITS

if TYPE_CHECKING:
    from sheetsplat.scene import Scene

# With one of them the numbers of all channels together are what is asked for.
_OF_NUMBERS = ("cmap", "scalar_colors", "log_scale", "transfer_function")


def adds_light(fields: Sequence[Field], mode: object, options: Mapping[str, Any] | None = None) -> bool:
    """Return whether a picture is the light of channels: several in a scalar mode of values, by no colormap."""
    given = [one for one in map((options or {}).get, _OF_NUMBERS) if one is not None and one is not False]
    traits = TRAITS[mode] if isinstance(mode, str) and mode in TRAITS else None
    of_values = traits is not None and traits.is_scalar and not traits.integrates
    channels = all(isinstance(one, RegularField) and one.color is not None for one in fields)
    return not given and of_values and len(fields) > 1 and channels


def is_light(scene: Scene) -> bool:
    """Return whether a picture of a scene is the light of channels."""
    return len(scene.groups) == len(scene.fields) and adds_light(scene.fields, scene.mode)


def channels_of(scene: Scene) -> tuple[Scene, ...]:
    """Return the scene of each channel of a picture that is their light; none for all others."""
    if not is_light(scene):
        return ()
    lengths = {"slice_spacing": scene.slice_spacing, "reference_length": scene.reference_length}
    pairs = zip(scene.fields, scene.transfer_functions, strict=True)
    return tuple(scene.sketch(field=one, transfer_function=function, **lengths) for one, function in pairs)


def light_of(scenes: Sequence[Scene], scalars: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Return the sum of the last colours of transfer functions, each times the share of its number between the limits.

    Premultiplied (h, w, 4), at most 1; where no channel has a number it is transparent. A channel whose transfer
    function has no opacity is not shown.
    """
    rgba = np.zeros((*scalars[0].shape, 4))
    for scene, scalar in zip(scenes, scalars, strict=True):
        function = scene.transfer_function
        if not function.points[:, 4].any():
            continue
        width = function.v_max - function.v_min
        shares = np.clip((scalar - function.v_min) / width, 0.0, 1.0) if width > 0.0 else scalar >= function.v_max
        known = ~np.isnan(scalar)
        rgba[known, :3] += np.outer(shares[known], function.at(function.v_max)[:3])
        rgba[known, 3] = 1.0
    return np.minimum(rgba, 1.0).astype(np.float32)

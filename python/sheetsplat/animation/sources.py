"""Where the scene of a frame comes from: one scene for all, a file, data in memory, or a picture that is drawn."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sheetsplat import api
from sheetsplat.choose.kernels import in_sums
from sheetsplat.errors import complain
from sheetsplat.fields import Field, RegularField
from sheetsplat.look.automatic import choose
from sheetsplat.look.decades import in_decades
from sheetsplat.look.strays import without_strays
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction


class Source(Protocol):
    """Makes the scene of a frame, also in another process."""

    @property
    def template(self) -> Scene:
        """A scene with the look of this one; its fields may stand for others."""

    def scene(self) -> Scene:
        """Return the scene."""

    def digest(self) -> str:
        """Return a text that is the same for the same data, without reading files."""


def digest_of_fields(fields: Sequence[Field]) -> str:
    """Return a text that is the same for the same fields."""
    made = hashlib.blake2b(digest_size=16)
    for one in fields:
        kind, parts = one.__reduce_ex__(5)[1]
        made.update(kind.__name__.encode())
        for name, part in sorted(parts.items()):
            made.update(name.encode())
            if isinstance(part, np.ndarray):
                made.update(f"{part.dtype.str}{part.shape}".encode())
                made.update(np.ascontiguousarray(part).data)
            else:
                made.update(repr(part).encode())
    return made.hexdigest()


@dataclass(frozen=True)
class SharedLook:
    """What all steps of a time series have in common: how fields are made of data, and scenes of fields.

    Attributes
    ----------
    scene
        A scene with the look of all: its fields stand for those of the steps.
    opened
        Options of `sheetsplat.open`, without quality.
    kernel
        Options of the kernels of volumes, found once; None: as the data have them.
    log
        The option of this name: the value from which decades count in all steps, False where they show values.
    given
        The options of the look that were given, for what is left out.
    colors
        A colormap and its limits, with which each step has opacities by its own histogram; None: the scene's
        transfer function for all.
    """

    scene: Scene
    opened: Mapping[str, Any]
    kernel: Mapping[str, Any] | None = None
    log: bool | float | None = False
    given: Mapping[str, Any] = field(default_factory=dict)
    colors: tuple[Any, tuple[float, float]] | None = None

    def of(self, data: Any, options: Mapping[str, Any] | None = None) -> Scene:
        """Return the scene of a step; `options` of `sheetsplat.open` choose it among those of a file."""
        if isinstance(data, Scene):
            return data
        opened: Any = {**self.opened, **(options or {})}
        fields: Sequence[Field] = api.Opened.of(data, opened).fields
        if len(fields) != len(self.scene.fields):
            raise complain(
                "a step of the film cannot be drawn",
                f"{len(fields)} fields",
                f"{len(self.scene.fields)}, as the others",
            )
        fields = in_decades(fields, {**self.given, "mode": self.scene.mode}, self.log)
        fields = without_strays([in_sums(one, self.scene.mode)[0] for one in fields], self.given, framed=False)
        if self.kernel is not None:
            kernel = dict(self.kernel)
            fields = [one.replace(**kernel) if isinstance(one, RegularField) else one for one in fields]
        groups = self.scene.groups
        if len(groups) == 1:
            return self._scene(fields)
        rest = iter(fields)
        return self._scene([[next(rest) for _ in group] for group in groups])

    def _scene(self, fields: Sequence[Any]) -> Scene:
        look: dict[str, Any] = {}
        if self.colors is not None:
            cmap, limits = self.colors
            look["transfer_function"] = TransferFunction.from_colormap(cmap, choose(fields).opacity, limits)
        lengths = {"slice_spacing": self.scene.slice_spacing, "reference_length": self.scene.reference_length}
        made = self.scene.replace(field=fields, **look, **lengths)
        return made.with_quality(self.scene.quality)


@dataclass(frozen=True)
class OneScene:
    """The same scene for every frame that has this source."""

    template: Scene

    def scene(self) -> Scene:
        """Return the scene."""
        return self.template

    def digest(self) -> str:
        """Return a text that is the same for the same fields."""
        return digest_of_fields(self.template.fields)


@dataclass(frozen=True)
class FileStep:
    """A file of a time series, which the process that draws the frame reads."""

    path: Path
    look: SharedLook
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def template(self) -> Scene:
        """The look of the series."""
        return self.look.scene

    def scene(self) -> Scene:
        """Return the scene of the file."""
        return self.look.of(self.path, self.options)

    def digest(self) -> str:
        """Return name, size and time of change of the file, and what chooses a step of it."""
        # FILE:/dataset names a part of a file.
        path = self.path if self.path.exists() else Path(str(self.path).partition(":/")[0])
        try:
            found = os.stat(path)
        except OSError as error:
            raise complain(f"{self.path} cannot be read", error.strerror or str(error), "a file of the film") from None
        chosen = "".join(f" {name} {one}" for name, one in self.options.items())
        return f"{self.path.name} {found.st_size} {found.st_mtime_ns}{chosen}"


@dataclass(frozen=True)
class MemoryStep:
    """Data of a time series in memory, or what a function returns: only this process can make its scene."""

    data: Callable[[], Any]
    look: SharedLook

    def here(self) -> OneScene:
        """Return the scene, which other processes can take."""
        return OneScene(self.look.of(self.data()))

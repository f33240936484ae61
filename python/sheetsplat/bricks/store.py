"""Where arrays of bricks are kept that were made once: in memory, or in files of a folder that all processes see."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Error, complain, option_ref


@dataclass(frozen=True, eq=False)
class MemoryStore:
    """Arrays in memory, by their names."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def write(self, name: str, values: NDArray[Any]) -> None:
        """Keep an array."""
        self.arrays[name] = values

    def read(self, name: str, cuts: Any) -> NDArray[Any]:
        """Return a part of an array."""
        found: NDArray[Any] = self.arrays[name][cuts]
        return found

    @property
    def carried(self) -> int:
        """Bytes that go along where it is pickled."""
        return sum(one.nbytes for one in self.arrays.values())


@dataclass(frozen=True, eq=False)
class FileStore:
    """Arrays in files of a folder that all processes see.

    Attributes
    ----------
    folder
        The folder.
    what, wanted
        What is kept, and how much room it takes, for messages.
    """

    folder: Path
    what: str
    wanted: str
    carried: int = 0

    @classmethod
    def new(cls, parent: str | None, what: str, wanted: str) -> FileStore:
        """Return an empty store in a new folder, which goes with it; Error where there can be none."""
        try:
            made = cls(Path(tempfile.mkdtemp(prefix="sheetsplat-", dir=parent)), what, wanted)
        except OSError as error:
            raise cls(Path(parent or tempfile.gettempdir()), what, wanted).unusable(error) from None
        weakref.finalize(made, shutil.rmtree, made.folder, True)
        return made

    def write(self, name: str, values: NDArray[Any]) -> None:
        """Write an array; what is there is replaced at once. Error where that is not possible."""
        try:
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".part", delete=False) as file:
                np.save(file, values)
            Path(file.name).replace(self.folder / f"{name}.npy")
        except OSError as error:
            raise self.unusable(error) from None

    def read(self, name: str, cuts: Any) -> NDArray[Any]:
        """Return a part of an array; Error where it cannot be read any more."""
        try:
            return np.array(np.load(self.folder / f"{name}.npy", mmap_mode="r")[cuts])
        except (OSError, ValueError) as error:
            raise self.unusable(error) from None

    def unusable(self, error: Exception) -> Error:
        """Return the error for a folder that cannot be used."""
        return complain(
            f"{self.what} in {self.folder} cannot be used",
            str(error),
            f"a folder that all workers see, with room for {self.wanted}",
            "pass " + option_ref("scratch", "...") + " to sheetsplat.open_bricks",
            kind=Error,
        )


#: Where arrays are.
Store = MemoryStore | FileStore

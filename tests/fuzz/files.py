"""Spoiled files of every format: a field, or an error of the package, within little time and memory."""

from __future__ import annotations

import gzip
import pickle
import shutil
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from random import Random

from readable_files import KINDS, MEMORY, OF_LIBRARIES, SECONDS, Files, read, write

import sheetsplat as ss
from fuzz.cases import Case
from fuzz.limits import memory_limit
from fuzz.mutations import mutated
from fuzz.part import RIGHT, Outcome, Part
from fuzz.shrinking import fewest

#: Share of the files that are packed as a whole.
_PACKED = 0.15
#: Kinds whose readers take a file by its name and do not unpack it.
_NEVER_PACKED = ("picture", "zarr", "meshio")


@cache
def _valid(path: Path) -> dict[str, Files]:
    """Return the valid files that children spoil."""
    found: dict[str, Files] = pickle.loads(path.read_bytes())
    return found


class SpoiledFiles(Part):
    """Files of every kind, spoiled by `mutated`.

    Parameters
    ----------
    kinds
        Names in `readable_files.KINDS`; empty: all.
    """

    name = "files"
    batch = 200
    seconds = SECONDS / 2
    memory = 2 << 30

    def __init__(self, kinds: Sequence[str] = ()) -> None:
        self.chosen = tuple(kinds) or tuple(KINDS)
        self._store = Path()

    @cached_property
    def kinds(self) -> Mapping[str, float]:
        """Each kind of file as often as the others."""
        return dict.fromkeys(self.chosen, 1.0)

    def prepare(self, folder: Path) -> None:
        """Write a valid file of each kind: once, as some carry the time at which they were written."""
        self._store = folder / "valid.pickle"
        found = pickle.loads(self._store.read_bytes()) if self._store.exists() else {}
        for kind in self.chosen:
            if kind not in found:
                with tempfile.TemporaryDirectory() as place:
                    found[kind] = KINDS[kind](Path(place))
        self._store.write_bytes(pickle.dumps(found))

    def case(self, kind: str, seed: int) -> Case:
        """Return files of a kind one of which is spoiled."""
        rng = Random(f"{kind} {seed}")
        valid = _valid(self._store)
        files = dict(valid[kind])
        donors = [content for other in sorted(valid) for content in list(valid[other].values())[:2]]
        which = rng.choice(list(files))
        files[which] = mutated(rng, files[which], donors)
        if rng.random() < _PACKED and not any(word in kind for word in _NEVER_PACKED):
            files = {name: gzip.compress(content, mtime=0) for name, content in files.items()}
        return {"kind": kind, "files": files, "spoiled": which}

    def run(self, case: Case, folder: Path) -> Outcome:
        """Read the files."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        write(folder, case["files"])
        # Libraries warn of what they find.
        warnings.simplefilter("ignore" if case["kind"] in OF_LIBRARIES else "error")
        try:
            with memory_limit(MEMORY):
                read(case["kind"], folder / next(iter(case["files"])))
        except ss.Error as error:
            if not str(error):
                return Outcome("wrong", "an error without a text", type(error).__name__)
            return Outcome(type(error).__name__)
        return RIGHT

    def shrunk(self, case: Case, wrong: Callable[[Case], bool]) -> Case:
        """Leave out bytes of the spoiled file."""
        which = case["spoiled"]

        def of(content: bytes) -> Case:
            return {**case, "files": {**case["files"], which: content}}

        return of(fewest(case["files"][which], lambda content: wrong(of(content))))

"""Numbered random scenes: backends against the reference, within the bounds of conventions.md, section 9."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

import sweep_scenes

import sheetsplat as ss
from fuzz.cases import Case
from fuzz.part import RIGHT, Outcome, Part


class RandomScenes(Part):
    """Scenes over all effects, modes, cameras and fields; of eleven pictures OpenGL draws one."""

    name = "scenes"
    batch = 40
    seconds = 120.0
    patience = 1200.0
    memory = 6 << 30
    most_kept = 40
    first = sweep_scenes.DRAWN_ENDS
    kinds: Mapping[str, float] = {"cpu": 10.0, "gl": 1.0}

    def case(self, kind: str, seed: int) -> Case:
        """Return the parts of a numbered scene, and the backend that draws it."""
        return {"backend": kind, "number": seed, "parts": sweep_scenes.scene_of(seed)[1]}

    def run(self, case: Case, folder: Path) -> Outcome:
        """Compare the backend's picture with the reference's."""
        warnings.simplefilter("ignore")
        try:
            wrong = sweep_scenes.fault(case["parts"], case["backend"])
        except ss.Error as error:
            return Outcome(type(error).__name__)
        if wrong:
            return Outcome("wrong", f"{case['backend']}: {wrong.partition(':')[0]}", wrong)
        return RIGHT

    def shrunk(self, case: Case, wrong: Callable[[Case], bool]) -> Case:
        """Leave out kernels, fields, lights, effects and pixels."""
        return {**case, "parts": sweep_scenes.shrunk(case["parts"], lambda parts: wrong({**case, "parts": parts}))}

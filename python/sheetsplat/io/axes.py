"""Volumes whose axes a file states: turned so that they are the axes of the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, shown, triple
from sheetsplat.io.checks import unreadable
from sheetsplat.io.records import Floats

_ADVICE = "resample the volume to such axes"


def along_the_world(
    path: Path, what: str, steps: Floats, origin: Floats, values: NDArray[Any]
) -> tuple[NDArray[Any], Triple, Triple]:
    """Return a volume turned so that its axes are z, y, x of the world, with spacing and origin.

    Parameters
    ----------
    path, what
        The file and the entry of its header, for messages.
    steps
        (3, 3): each row is the step in the world along an axis of the file, the fastest first. InvalidInput unless
        each is along an axis of the world.
    origin
        World position of the file's first sample.
    values
        Samples, the axes in the opposite order of the steps.
    """
    wanted = "three directions along the axes of the world"
    if steps.shape != (3, 3) or not np.all(np.isfinite(steps)):
        raise unreadable(path, f"{what} {shown(steps.tolist())}", wanted)
    along = steps != 0
    if not (np.all(along.sum(axis=0) == 1) and np.all(along.sum(axis=1) == 1)):
        raise unreadable(path, f"{what} {shown(steps.tolist())}", wanted, _ADVICE)
    world = along.argmax(axis=1)
    lengths = steps[np.arange(3), world]
    file_axis = np.argsort(world)
    values = values.transpose([2 - file_axis[2], 2 - file_axis[1], 2 - file_axis[0]])
    first, spacing = origin.copy(), np.ones(3)
    for axis in range(3):
        step = lengths[file_axis[axis]]
        if step < 0:
            values = np.flip(values, 2 - axis)
            first[axis] += step * (values.shape[2 - axis] - 1)
        spacing[axis] = abs(step)
    return values, triple("spacing", spacing), triple("origin", first)

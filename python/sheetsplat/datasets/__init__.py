"""Generated data sets: seeded, reproducible, never downloaded.

Each function returns a :class:`Dataset`: samples, and how to draw them::

    from sheetsplat import datasets
    ball = datasets.noisy_ball()
    field = ball.field()

Formulas: :func:`marschner_lobb` (with :func:`marschner_lobb_value` and :func:`marschner_lobb_gradient`),
:func:`noisy_ball`, :func:`tubes`. Flows from a solver, in place of the simulations of the 2005 paper:
:func:`vortex`, :func:`turbulence`, :func:`jet`; these take up to twenty seconds the first time and are then cached
in :func:`cache_folder`.

Solids filled with ellipsoids, in place of those of the 2006 paper: :func:`chess_piece`, :func:`monster` and
:func:`toy_car` of meshes in the folder ``SHEETSPLAT_DATA``, :func:`toy_train` of primitives. They return a
:class:`SolidDataset` and take about a second each.
"""

from __future__ import annotations

from collections.abc import Callable

from ._cache import cache_folder
from ._dataset import Dataset
from ._flows import jet, turbulence, vortex
from ._shapes import marschner_lobb, marschner_lobb_gradient, marschner_lobb_value, noisy_ball, tubes
from ._solids import SolidDataset, chess_piece, monster, toy_car, toy_train

#: Every data set by its name; each can be called without arguments.
DATASETS: dict[str, Callable[..., Dataset | SolidDataset]] = {
    make.__name__: make
    for make in (marschner_lobb, noisy_ball, tubes, vortex, turbulence, jet, chess_piece, monster, toy_car, toy_train)
}

__all__ = [
    "DATASETS",
    "Dataset",
    "SolidDataset",
    "cache_folder",
    "chess_piece",
    "jet",
    "marschner_lobb",
    "marschner_lobb_gradient",
    "marschner_lobb_value",
    "monster",
    "noisy_ball",
    "toy_car",
    "toy_train",
    "tubes",
    "turbulence",
    "vortex",
]

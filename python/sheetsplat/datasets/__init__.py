"""Generated data sets: seeded, reproducible, never downloaded.

Each function returns a :class:`Dataset`: samples, and how to draw them::

    from sheetsplat import datasets
    ball = datasets.noisy_ball()
    field = ball.field()

They are formulas: :func:`marschner_lobb` (with :func:`marschner_lobb_value` and :func:`marschner_lobb_gradient`),
:func:`noisy_ball`, :func:`tubes`.
"""

from __future__ import annotations

from collections.abc import Callable

from ._dataset import Dataset
from ._shapes import marschner_lobb, marschner_lobb_gradient, marschner_lobb_value, noisy_ball, tubes

#: Every data set by its name; each can be called without arguments.
DATASETS: dict[str, Callable[..., Dataset]] = {make.__name__: make for make in (marschner_lobb, noisy_ball, tubes)}

__all__ = [
    "DATASETS",
    "Dataset",
    "marschner_lobb",
    "marschner_lobb_gradient",
    "marschner_lobb_value",
    "noisy_ball",
    "tubes",
]

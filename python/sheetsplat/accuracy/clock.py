"""The times that a measurement may compare."""

from __future__ import annotations

from typing import Literal, get_args

Clock = Literal["wall", "cpu"]
CLOCKS: tuple[str, ...] = get_args(Clock)

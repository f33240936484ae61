"""Times in words: how long something takes, and how long it goes on by how much of it is done."""

from __future__ import annotations

import math


def time_left(seconds: float, share: float) -> str:
    """Return how long the rest takes in words, "2:05 left", after `seconds` for a share of the whole; "" unless known.

    >>> from sheetsplat._time_left import time_left
    >>> time_left(60.0, 0.25), time_left(3600.0, 0.5), time_left(1.0, 0.0)
    ('3:00 left', '1:00:00 left', '')
    """
    if share <= 0.0:
        return ""
    minutes, rest = divmod(round(seconds * (1.0 - share) / share), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02} left" if hours else f"{minutes}:{rest:02} left"


def about(seconds: float) -> str:
    """Return a time to one digit, 1 ms or more.

    >>> from sheetsplat._time_left import about
    >>> about(0.013), about(41.0), about(200.0), about(9000.0)
    ('0.01 s', '40 s', '3 minutes', '2 hours')
    """
    for unit, length in (("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 1.5 * length:
            return f"{_one_digit(seconds / length)} {unit}"
    return f"{_one_digit(seconds)} s"


def _one_digit(number: float) -> str:
    digits = -math.floor(math.log10(max(number, 1e-3)))
    return f"{round(max(number, 1e-3), digits):.{max(digits, 0)}f}"

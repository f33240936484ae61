"""How long something goes on, by how much of it is done."""

from __future__ import annotations


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

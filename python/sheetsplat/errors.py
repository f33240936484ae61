"""The errors of the package. Every message says what failed, what was found, what was wanted and what to do next."""

from __future__ import annotations

from sheetsplat._sheetsplat import (
    Cancelled,
    DeviceUnavailable,
    Error,
    InvalidInput,
    OutOfMemory,
    Unsupported,
    complaint_text,
)

__all__ = ["Cancelled", "DeviceUnavailable", "Error", "InvalidInput", "OutOfMemory", "Unsupported", "complain"]

# Characters of a part of a message; the longest list of names that belongs into one is shorter.
_LONGEST = 1200


def complain(
    failed: str, found: str = "", wanted: str = "", then: str = "", *, kind: type[Error] = InvalidInput
) -> Error:
    """Return an error whose message has the four parts that all messages have.

    Parameters
    ----------
    failed, found, wanted, then
        What could not be done, what was there, what would have been right, what the reader can do. Empty parts are
        left out.
    kind
        The class of the error.
    """
    return kind(complaint_text(*map(_bounded, (failed, found, wanted, then))))


def _bounded(part: str) -> str:
    # What was found may be a file's own words, of any length.
    return part if len(part) <= _LONGEST else f"{part[: _LONGEST // 2]} ... {part[-_LONGEST // 4 :]}"

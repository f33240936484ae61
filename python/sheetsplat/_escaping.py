"""Texts from elsewhere, made harmless for a terminal, a log or a figure."""

from __future__ import annotations


def escaped(text: str, *, kept: str = "") -> str:
    r"""Return a text with escapes, such as ``\x1b``, in place of all that is no visible letter.

    These are control characters and line ends, which move the cursor, set the title or forge a line; characters that
    turn the direction of writing or have no width; and what stands for bytes of a file name that are no text.

    Parameters
    ----------
    text
        Of any origin.
    kept
        Characters that stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in kept else ascii(one)[1:-1] for one in text)

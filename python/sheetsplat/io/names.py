"""The names of the arrays of a file: every reader tells them here where it chooses one, before it reads any."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextvars import ContextVar
from dataclasses import dataclass

_asked: ContextVar[bool] = ContextVar("names_of_arrays", default=False)


@dataclass(frozen=True)
class Names:
    """The names of the arrays of a file among which ``name=`` or ``scalar=`` chooses.

    Attributes
    ----------
    names
        All of them, that which is shown by itself first; none where there is no choice.
    shown
        The one that is shown by itself; None: one must be chosen.

    Examples
    --------
    >>> np.savez("two.npz", density=values, speed=values)
    >>> ss.io.arrays("two.npz")
    Names(names=('density', 'speed'), shown=None)
    """

    names: tuple[str, ...] = ()
    shown: str | None = None


class Told(Exception):
    """Ends the reading of a file of which the names alone are wanted."""

    def __init__(self, names: Names) -> None:
        super().__init__()
        self.names = names


def tell_names(names: Iterable[str], shown: str | None = None) -> tuple[str, ...]:
    """Return names as error messages list them; where names alone are asked for, reading ends here.

    Parameters
    ----------
    names
        Those that a reader knows.
    shown
        The one that it shows where nobody chooses; the only one unless given.
    """
    known = tuple(names)
    shown = known[0] if shown is None and len(known) == 1 else shown
    if _asked.get():
        first = () if shown is None else (shown,)
        raise Told(Names((*first, *(one for one in known if one != shown)), shown))
    return known


def are_asked_for() -> bool:
    """Return whether the names alone are wanted, so that what else is not chosen is no reason to end."""
    return _asked.get()


def names_in(read: Callable[[], object]) -> Names:
    """Return the names that a reader tells; none where it tells none. Raises what it raises."""
    token = _asked.set(True)
    try:
        read()
    except Told as end:
        return end.names
    finally:
        _asked.reset(token)
    return Names()

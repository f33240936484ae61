"""Names of the effects of plans: which there are, and which a renderer can force."""

from __future__ import annotations

from collections.abc import Iterable

from sheetsplat import _sheetsplat
from sheetsplat._checks import nearest_names, shown
from sheetsplat.errors import complain, option_ref

_KNOWN = frozenset(name for name, *_ in _sheetsplat.known_effects())
#: The backends that can force an effect on or off, where any can.
FORCED_BY = {name: frozenset(backends) for name, *_, backends in _sheetsplat.known_effects() if backends}


def check_effects(backend: str, names: Iterable[str]) -> None:
    """Raise InvalidInput for a name of no effect, with the nearest that a backend ("auto": any) can force.

    The plan tells which of the others follow from the scene, or are another backend's.
    """
    for name in names:
        if name not in _KNOWN:
            own = [one for one, backends in FORCED_BY.items() if backend in ("auto", *backends)]
            wanted = f"one of: {', '.join(own)}" if own else f"none: backend {backend} draws what the scene says"
            advice = nearest_names(name, own) or "correct the name in " + option_ref("effects")
            raise complain("the effects cannot be forced", f"the name {shown(name)}", wanted, advice, option="effects")

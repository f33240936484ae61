"""What a client of dask.distributed knows of its workers: which there are, what they keep, and what goes wrong."""

from __future__ import annotations

import time
import uuid
import weakref
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary, WeakValueDictionary

from sheetsplat._sheetsplat import __version__
from sheetsplat._waiting import ask
from sheetsplat.bricks.watch import Watch, connected
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.options.workers import timeout_of

# Seconds that a client waits for the first worker, and between two looks whether it is there.
_PATIENCE, _LOOK = 10.0, 0.05
# Sources that hold more than this are sent to the workers once.
_LARGE = 1 << 20


@dataclass(eq=False)
class _Held:
    """What workers have of some data, as long as anything shows these.

    Attributes
    ----------
    places
        Which worker each brick or piece is asked of.
    sent
        Futures of sources that the workers were sent, by their texts.
    kept
        Of one picture, by what it depends on: the future, and those who had a part in it.
    """

    places: dict[int, str] = field(default_factory=dict)
    sent: dict[str, Any] = field(default_factory=dict)
    kept: dict[bytes, tuple[Any, frozenset[str]]] = field(default_factory=dict)


class Workers:
    """What the client knows of its workers: which were checked, which has which brick, and what they were sent."""

    def __init__(self, client: Any) -> None:
        self._client = weakref.ref(client)
        self.watch = Watch(client)
        self._checked: set[str] = set()
        # Dask's processes count by spans as long as they live, and each picture would be a new one.
        self.span = {"name": ("sheetsplat",), "ids": (uuid.uuid4().hex,)}
        # By the token of the data; as long as one of the objects is there that exist as long as anything shows these.
        self._held: WeakValueDictionary[str, _Held] = WeakValueDictionary()
        self._owned: WeakKeyDictionary[Any, _Held] = WeakKeyDictionary()

    def check(self) -> None:
        """Raise an error where there is no worker, or one with another version of this package."""
        client = self._client()
        assert client is not None
        with connected(client):
            known = set(self.watch.now() or self._first())
            found = self.watch.call(self._versions)
        for address, version in sorted(found.items()):
            if isinstance(version, OSError):
                # It ended meanwhile.
                known.discard(address)
            elif version != __version__:
                there = f"{version}" if isinstance(version, str) else f"none that can be used ({version})"
                raise complain(
                    "a picture cannot be drawn by these workers",
                    f"sheetsplat {there} on worker {address}",
                    f"{__version__}, as here",
                    "install the same version everywhere",
                    kind=Unsupported,
                )
        if not known:
            raise complain("a picture cannot be drawn", "no worker that answers", "workers that live", kind=Error)
        self._checked |= known
        self.workers = sorted(known)

    def _first(self) -> frozenset[str]:
        """Return the workers that there are as soon as there is any; TimeoutError where there is none for too long."""
        ends = time.monotonic() + _PATIENCE
        while not self.watch.now():
            if time.monotonic() > ends:
                raise TimeoutError
            ask()
            time.sleep(_LOOK)
        return self.watch.there

    def _versions(self) -> dict[str, Any]:
        new = sorted(self.watch.there - self._checked)
        client: Any = self._client()
        found: dict[str, Any] = client.run(_version, workers=new, on_error="return") if new else {}
        return found

    def held(self, source: Any) -> _Held:
        """Return what workers have of the data of a source; it is let go with the last source that shows them."""
        held = self._held.get(source.token) or _Held()
        self._held[source.token] = self._owned[getattr(source, "owner", source)] = held
        return held

    def place(self, source: Any, number: int) -> str:
        """Return the worker that a brick is asked of: the same one as before while it is there."""
        places = self.held(source).places
        found = places.get(number)
        if found not in self.workers:
            found = places[number] = self.workers[number % len(self.workers)]
        return found

    def kept(self, key: bytes, source: Any) -> Any:
        """Return the future of what an earlier picture of a source made, or None."""
        found, workers = self.held(source).kept.get(key, (None, frozenset()))
        # What is made by workers that are gone would be waited for in vain.
        usable = found is not None and found.status in ("pending", "finished") and workers <= set(self.workers)
        return found if usable else None

    def keep(self, key: bytes, future: Any, source: Any) -> None:
        """Keep what one picture of a source makes for those after it, in place of what was kept before."""
        for held in list(self._held.values()):
            held.kept.clear()
        self.held(source).kept[key] = future, frozenset(self.workers)

    def drop_unfinished(self) -> None:
        """Give up what was to be kept and is not made yet, unless a picture waits for it."""
        for held in list(self._held.values()):
            held.kept = {key: kept for key, kept in held.kept.items() if kept[0].status == "finished"}

    def sent(self, client: Any, source: Any) -> Any:
        """Return what tasks take for a source: one with large arrays is sent to the workers once."""
        if getattr(source, "carried", 0) <= _LARGE:
            return source
        sent, key = self.held(source).sent, repr(source)
        if key not in sent or sent[key].status != "finished":
            sent[key] = self.watch.call(lambda: client.scatter(source, hash=False))
        return sent[key]


# By the identity of the client, which cannot be a key where it is compared by something else.
_known: dict[int, tuple[Any, Workers]] = {}


def workers_of(client: Any) -> Workers:
    """Return what is known of the workers of a client: the same object as long as the client lives."""
    for key in [key for key, (known, _) in _known.items() if known() is None]:
        del _known[key]
    found = _known.get(id(client))
    if found is None or found[0]() is not client:
        found = (weakref.ref(client), Workers(client))
        _known[id(client)] = found
    return found[1]


def look_after(owner: str, client: Any, timeout: Any) -> None:
    """Set the seconds after which workers of a client are given up, where there are both; InvalidInput for others."""
    if timeout is not None:
        seconds = timeout_of(f"{owner}: worker_timeout", timeout)
        if client is not None:
            workers_of(client).watch.timeout = seconds


def memory_limit(dask_worker: Any) -> int | None:
    """Return the memory that a worker may take; None: any. `Client.run` gives the worker by this name."""
    limit: int | None = dask_worker.memory_manager.memory_limit
    return limit


def _version() -> str:
    from sheetsplat._sheetsplat import __version__

    return str(__version__)

"""Whether the workers of a client live, as far as its scheduler has heard of them; and errors of a cluster.

Workers say so by heartbeats, several a second to one in some seconds, from a thread that no task holds up: one that is
busy says so too. One that says nothing any more hangs, or its machine or the network does.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from sheetsplat._waiting import begun, wait
from sheetsplat.errors import Error, complain, missing_package, option_ref
from sheetsplat.options.workers import WORKER_TIMEOUT

Result = TypeVar("Result")
# Seconds between two questions to the scheduler, and what counts at most of the time between two looks: while this
# process is stopped it hears of nobody.
_WATCH = 0.5
_MOST = 1.0
# Of many workers Dask wants heartbeats less often, of each in this part of their number, in seconds.
_HEARTBEATS = 10.0


_REASON = "sheetsplat-silent-worker"
# Nobody else refers to them.
_endings: set[asyncio.Future[None]] = set()


async def _end(nanny: Any) -> None:
    # It hangs too where its machine does.
    with suppress(OSError):
        await nanny.kill(reason=_REASON)


async def workers_now(silent: Sequence[str], dask_scheduler: Any) -> dict[str, tuple[float, bool]]:
    """Give silent workers up; return when each other one was heard of, and whether it is paused, by address.

    `Client.run_on_scheduler` gives the scheduler by this name.
    """
    for address in silent:
        # As Dask does itself after five minutes (`worker-ttl`): their tasks and what they kept are lost, and a nanny,
        # where there is one, ends the process and starts another one.
        if address in dask_scheduler.workers:
            nanny = dask_scheduler.workers[address].nanny
            await dask_scheduler.remove_worker(address=address, stimulus_id=_REASON)
            if nanny:
                ending = asyncio.ensure_future(_end(dask_scheduler.rpc(nanny)))
                _endings.add(ending)
                ending.add_done_callback(_endings.discard)
    return {address: (one.last_seen, one.status.name == "paused") for address, one in dask_scheduler.workers.items()}


class Watch:
    """Looks after the workers of a client while something waits for them.

    Attributes
    ----------
    timeout
        Seconds without a sign of life until a worker, or the scheduler, is given up.
    there
        The addresses of workers that live.
    paused
        Those of them that begin no task.
    """

    def __init__(self, client: Any) -> None:
        self._client = weakref.ref(client)
        self._lock = threading.RLock()
        self.timeout = WORKER_TIMEOUT
        self.there: frozenset[str] = frozenset()
        self.paused: list[str] = []
        # When the scheduler heard of each worker, by its clock, and how long it has not since then.
        self._heard: dict[str, tuple[float, float]] = {}
        self._silent: list[str] = []
        self._answer: Future[dict[str, tuple[float, bool]]] | None = None
        self._looked = self._asked = -math.inf
        # Seconds since the last answer of the scheduler, and since the question that it owes one.
        self._passed = self._owed = 0.0

    def look(self) -> None:
        """Look now and then; never waits.

        Raises
        ------
        Error
            Where no worker lives, or the scheduler does not.
        OSError
            Where the client has lost its scheduler.
        """
        with self._lock:
            client = self._running()
            now = time.monotonic()
            passed, self._looked = min(now - self._looked, _MOST), now
            self._passed += passed
            if self._answer is None:
                if now - self._asked >= _WATCH:
                    self._ask(client)
            elif self._answer.done():
                answer, self._answer = self._answer, None
                self._take(answer.result())
            else:
                self._owed += passed
                if self._owed >= self.timeout:
                    what = f"the scheduler {client.scheduler.address} cannot be used"
                    raise self._no_sign(what, "it", "a scheduler that answers")

    def now(self) -> frozenset[str]:
        """Return the addresses of workers that live now; raises what `look` does."""
        with self._lock:
            old = self._answer
        if old is not None:
            wait(old, self.look)
        with self._lock:
            client = self._running()
            if self._answer is None or self._answer is old:
                self._ask(client)
            asked = self._answer
        assert asked is not None
        wait(asked, self.look)
        while self._answer is asked:
            self.look()
        return self.there

    def call(self, function: Callable[[], Result]) -> Result:
        """Return what a function returns that waits for workers; called again where one of them is given up meanwhile.

        Raises what the function does, and what `look` does.
        """
        while True:
            before = self.there or self.now()

            def all_there(known: frozenset[str] = before) -> bool:
                self.look()
                return known <= self.there

            future = begun(function)
            if wait(future, all_there):
                try:
                    return future.result()
                except OSError:
                    # A worker that is given up takes its connections along.
                    if before <= self.now():
                        raise

    def _running(self) -> Any:
        client = self._client()
        if client is None or client.status != "running":
            raise OSError("closed" if client is None else client.status)
        return client

    def _ask(self, client: Any) -> None:
        silent = self._silent
        self._answer = begun(lambda: client.run_on_scheduler(workers_now, silent))
        self._asked, self._owed = time.monotonic(), 0.0

    def _take(self, found: dict[str, tuple[float, bool]]) -> None:
        passed, self._passed = self._passed, 0.0
        heard = {}
        for address, (seen, _) in found.items():
            before, silence = self._heard.get(address, (seen, 0.0))
            heard[address] = seen, silence + passed if seen == before else 0.0
        self._heard = heard
        limit = max(self.timeout, len(found) / _HEARTBEATS)
        silent = sorted(address for address, (_, silence) in heard.items() if silence >= limit)
        if silent and len(silent) == len(found):
            of = f"worker {silent[0]}" + (f" and {len(silent) - 1} others" if len(silent) > 1 else "")
            raise self._no_sign("the workers of a client cannot be used", of, "workers that live")
        self._silent = silent
        self.there = frozenset(found).difference(silent)
        self.paused = [address for address, (_, paused) in found.items() if paused and address in self.there]

    def _no_sign(self, what: str, of: str, wanted: str) -> Error:
        return complain(
            what,
            f"no sign of life from {of} for {self.timeout:g} s",
            wanted,
            "end it and start it again, or allow more time by " + option_ref("worker_timeout"),
            kind=Error,
        )


@contextmanager
def connected(client: Any) -> Iterator[None]:
    """Turn errors of the cluster into errors of this package."""
    try:
        import distributed
    except ImportError as error:
        raise missing_package("a cluster cannot be used", error) from error
    try:
        yield
    except Error:
        raise
    except distributed.KilledWorker as error:
        number = str(error.task).rsplit("-", 1)[-1]
        raise complain(
            f"brick {number} cannot be drawn",
            f"workers that ended while they drew it, the last at {error.last_worker.address}",
            "workers that live",
            "give workers more memory, or use smaller bricks",
            kind=Error,
        ) from None
    except (OSError, distributed.CancelledError) as error:
        found = f"a connection that was lost ({client.status})"
        # It is an OSError too.
        if isinstance(error, TimeoutError) and client.status in ("running", "connecting"):
            found = "no worker that answers"
        address = getattr(getattr(client, "scheduler", None), "address", "")
        raise complain(
            f"the scheduler {address} cannot be used", found, "a scheduler that runs, with workers", kind=Error
        ) from error

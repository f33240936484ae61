"""Who may hold a connection to the viewer's server, and for how long."""

from __future__ import annotations

import asyncio
import logging
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass

_log = logging.getLogger("sheetsplat")

# Seconds without a fault after which the next one is told again.
_FORGOTTEN = 60.0


@dataclass(frozen=True)
class Limits:
    """What a server grants.

    Attributes
    ----------
    patience
        Seconds until a connection must have shown the link in a whole request, and between two requests of one.
    strangers
        Number of connections that have not shown the link; the oldest gives way to the next.
    pause
        Seconds until the next try where connections cannot be taken.
    heartbeat
        Seconds after which a page that says nothing is asked whether it is there; it has half of them to answer.
    """

    patience: float = 10.0
    strangers: int = 64
    pause: float = 0.5
    heartbeat: float = 20.0


class Strangers:
    """Connections that have not shown the link.

    Each ends when its time is over, and before that where there are too many. So whoever does not know the link cannot
    keep out those who do, who show it at once.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        # The oldest first.
        self._waiting: dict[asyncio.BaseTransport, asyncio.TimerHandle] = {}

    def add(self, line: asyncio.Transport) -> None:
        """Take in a new connection."""
        for one in [one for one in self._waiting if one.is_closing()]:
            self.know(one)
        if len(self._waiting) >= self._limits.strangers:
            self.end_oldest()
        timer = asyncio.get_running_loop().call_later(self._limits.patience, self._end, line)
        self._waiting[line] = timer

    def know(self, line: asyncio.BaseTransport | None) -> None:
        """Let a connection be: it has shown the link, or is gone."""
        if line in self._waiting:
            self._waiting.pop(line).cancel()

    def end_oldest(self) -> None:
        """End the oldest connection, where there is one."""
        for line in list(self._waiting)[:1]:
            self._end(line)

    def _end(self, line: asyncio.BaseTransport) -> None:
        self.know(line)
        assert isinstance(line, asyncio.Transport)
        line.abort()


async def accept(
    listener: socket.socket, protocol: Callable[[], asyncio.Protocol], strangers: Strangers, pause: float
) -> None:
    """Take connections until cancelled.

    asyncio's own servers try to take as many as may wait, and log each that they cannot: without descriptors, megabytes
    a second.
    """
    loop = asyncio.get_running_loop()
    failed = -math.inf
    while True:
        try:
            line, _ = await loop.sock_accept(listener)
        except ConnectionError:
            # Gone before it was there.
            continue
        except OSError as error:
            if loop.time() - failed > _FORGOTTEN:
                _log.warning("the viewer cannot take connections and tries again: %s", error.strerror or error)
            failed = loop.time()
            await asyncio.sleep(pause)
            # Not before: those with the link show it meanwhile.
            strangers.end_oldest()
            continue
        try:
            transport, _ = await loop.connect_accepted_socket(protocol, line)
        except OSError:
            line.close()
        else:
            strangers.add(transport)

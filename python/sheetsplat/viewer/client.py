"""A page or widget that looks at a session: what it is sent, and how many frames ahead of what it has drawn."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from sheetsplat._json import plain
from sheetsplat.errors import Error
from sheetsplat.notices import PictureWarning

_log = logging.getLogger("sheetsplat")

#: What takes a message, as an object of JSON and bytes, to a page. It may be called by any thread.
Deliver = Callable[[dict[str, Any], bytes], None]
# Frames that a page may have been sent before it says that it drew one of them.
_AHEAD = 2
_LONGEST_TEXT = 2000
# A page that says nothing for so many seconds is sent frames again: the message was lost.
_SILENCE = 2.0


def error_message(text: str) -> dict[str, Any]:
    """Return the message of an error."""
    return {"type": "error", "text": text[:_LONGEST_TEXT]}


@contextmanager
def faults_told(send: Callable[[dict[str, Any]], object]) -> Iterator[None]:
    """Send the message of an error to pages; one must not end the thread, or the line, that they wait for."""
    try:
        yield
    except Error as error:
        send(error_message(str(error)))
    except Exception as error:  # A fault of the program.
        _log.exception("the viewer met an error")
        send(error_message(f"{type(error).__name__}: {error}"))


def tell_warnings(send: Callable[[dict[str, Any]], object], warned: Iterable[PictureWarning]) -> None:
    """Send warnings to pages, each text once."""
    for text in dict.fromkeys(map(str, warned)):
        send({"type": "warning", "text": text[:_LONGEST_TEXT]})


class Client:
    """A page or widget that looks at a session.

    Frames go out one by one: while a page has not drawn what it was sent, only the newest frame waits for it.
    """

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._lock = threading.Lock()
        self._under_way = 0
        self._waiting: tuple[dict[str, Any], bytes] | None = None
        self._sent = 0.0
        self.gone = False
        self.size: tuple[int, int] | None = None

    def send(self, message: dict[str, Any], payload: bytes = b"") -> None:
        """Send a message; numbers that are not finite become null. Where that fails, the page is gone."""
        told = plain(message)
        try:
            self._deliver(told, payload)
        except Exception:  # Whatever carries messages has errors of its own.
            _log.debug("a page of the viewer is gone", exc_info=True)
            self.gone = True

    def show(self, message: dict[str, Any], payload: bytes) -> None:
        """Send a frame as soon as the page is ready for it, unless a newer one comes before."""
        with self._lock:
            now = time.monotonic()
            if self._under_way >= _AHEAD and now - self._sent < _SILENCE:
                self._waiting = message, payload
                return
            self._under_way = min(self._under_way, _AHEAD - 1) + 1
            self._sent, self._waiting = now, None
            self.send(message, payload)

    def drew(self) -> None:
        """Note that the page has drawn a frame."""
        with self._lock:
            self._under_way = max(0, self._under_way - 1)
            if self._waiting is not None:
                message, payload = self._waiting
                self._waiting, self._sent = None, time.monotonic()
                self._under_way += 1
                self.send(message, payload)

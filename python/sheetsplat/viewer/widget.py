"""The viewer as a widget of notebooks. Needs anywidget."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from sheetsplat.errors import missing_package
from sheetsplat.viewer.client import Client
from sheetsplat.viewer.page import files
from sheetsplat.viewer.session import Session

_MOST_PLACES = 32
# Seconds between two signs of life of a place. Browsers let a hidden page send one a minute.
_BEAT, _MOST_SILENT = 15.0, 5


class Places:
    """The places of a notebook where a widget is displayed; each is a page of the session.

    A place that says nothing for some beats is forgotten: its page has gone without a word.

    Parameters
    ----------
    session
        What is shown.
    send
        Takes a message, which names its place, and bytes beside it, to all places.
    beat
        Seconds between two signs of life of a place.
    """

    def __init__(
        self, session: Session, send: Callable[[dict[str, Any], list[bytes] | None], object], beat: float = _BEAT
    ) -> None:
        self._session, self._send, self._beat = session, send, beat
        self._clients: dict[str, Client] = {}
        self._silent: dict[str, int] = {}
        self._watch: asyncio.Task[None] | None = None

    def received(self, _: Any, content: Any, buffers: Any) -> None:
        """Take a message of a place."""
        # All share a channel: each message names its place.
        place = content.get("place") if isinstance(content, dict) else None
        if not isinstance(place, str) or len(place) > 64:
            return
        kind = content.get("type")
        if kind == "bye":
            self._forget(place)
        elif place in self._clients or (kind == "hello" and self._let_in(place)):
            self._silent[place] = 0
            if kind != "alive":
                given = {name: part for name, part in content.items() if name != "place"}
                self._session.receive(self._clients[place], given)
        elif kind != "hello":
            # It says hello again.
            self._send({"type": "forgotten", "place": place}, None)

    def _let_in(self, place: str) -> bool:
        if len(self._clients) >= _MOST_PLACES:
            return False

        def deliver(message: dict[str, Any], payload: bytes) -> None:
            self._send({**message, "place": place}, [payload] if payload else None)

        self._clients[place] = self._session.connect(deliver)
        if self._watch is None or self._watch.done():
            # Without a loop, whose time passes only while places are heard, none is forgotten.
            with contextlib.suppress(RuntimeError):
                self._watch = asyncio.get_running_loop().create_task(self._watching())
        return True

    def _forget(self, place: str) -> None:
        if place in self._clients:
            self._session.disconnect(self._clients.pop(place))
            del self._silent[place]

    async def _watching(self) -> None:
        """Count beats, of which none passes while a cell runs and no place is heard."""
        while self._clients:
            await asyncio.sleep(self._beat)
            for place in list(self._clients):
                self._silent[place] += 1
                if self._silent[place] > _MOST_SILENT:
                    self._forget(place)


def make_widget(session: Session) -> Any:
    """Return a widget that shows a session; each place where it is displayed is a page of its own.

    Raises Unsupported where anywidget is not installed.
    """
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise missing_package("the viewer cannot be shown in a notebook", error) from None

    class ViewerWidget(anywidget.AnyWidget):
        """Carries messages between the page in a notebook and a session."""

        _esm = files.widget_script()
        _css = files.style()
        height = traitlets.Int(520).tag(sync=True)
        beat = traitlets.Float(_BEAT).tag(sync=True)

    widget = ViewerWidget()
    widget.on_msg(Places(session, lambda message, buffers: widget.send(message, buffers)).received)
    return widget

"""Films of what a viewer shows: drawn by a thread of its own, so that the page goes on, and saved by the browser."""

from __future__ import annotations

import logging
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sheetsplat.animation import Animation, animate, turntable
from sheetsplat.errors import Cancelled, complain
from sheetsplat.notices import taken
from sheetsplat.viewer import compose
from sheetsplat.viewer.client import Client, faults_told, tell_warnings
from sheetsplat.viewer.protocol import FILMS

if TYPE_CHECKING:
    from sheetsplat.renderer import Renderer
    from sheetsplat.scene import Scene
    from sheetsplat.viewer.data import Shown
    from sheetsplat.viewer.state import State

_log = logging.getLogger("sheetsplat")

# Seconds between two messages about the progress.
_PAUSE = 0.25
_BEHIND = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Order:
    """What is filmed.

    Attributes
    ----------
    state
        What is shown.
    size
        (width, height) in pixels.
    renderer
        Draws the frames, and nothing else meanwhile.
    name
        Name of the file, without a suffix.
    what
        "turn": the eye turns once about its target; "times": the times one after the other.
    frames
        Number of frames of a turn.
    fps
        Frames a second.
    kind
        The suffix: one of `protocol.FILMS`.
    """

    state: State
    size: tuple[int, int]
    renderer: Renderer
    name: str
    what: str
    frames: int
    fps: float
    kind: str


def film_of(shown: Shown, order: Order) -> Animation:
    """Return the film of an order; what is transparent has the colour that the page shows behind it."""
    options: Any = {"size": order.size, "renderer": order.renderer, "fps": order.fps, "camera": order.state.camera}
    options["client"] = shown.client
    if order.what == "turn":
        return turntable(_scene(shown, order.state, order.size), frames=order.frames, **options)
    if len(shown.times) < 2:
        raise complain("the film cannot be made", "one time", "data of several times, or a film that turns")
    return animate(
        lambda number: _scene(shown, replace(order.state, time=number), order.size), len(shown.times), **options
    )


def _scene(shown: Shown, state: State, size: tuple[int, int]) -> Scene:
    scene = compose.drawn_scene(shown, state, size)
    if scene.background is not None:
        return scene
    return scene.replace(background=state.changes.get("backdrop", _BEHIND)).with_quality(scene.quality)


class Filming:
    """Makes one film at a time.

    Parameters
    ----------
    shown
        The data.
    """

    def __init__(self, shown: Shown) -> None:
        self._shown = shown
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._stopped = False

    def start(self, page: Client, make: Callable[[], Order]) -> None:
        """Begin to draw an order for a page; where another film is being made the page is told so."""
        with self._lock:
            if self._thread is not None:
                page.send({"type": "error", "text": "a film is being made; stop it, or wait until it is saved"})
                return
            self._stopped = False
            self._thread = threading.Thread(
                target=self._make, args=(page, make), name="sheetsplat-viewer-film", daemon=True
            )
            self._thread.start()

    def stop(self) -> None:
        """Give the film up that is being made."""
        self._stopped = True

    def _make(self, page: Client, make: Callable[[], Order]) -> None:
        told = 0.0

        def progress(share: float) -> bool:
            nonlocal told
            if time.monotonic() - told > _PAUSE:
                told = time.monotonic()
                page.send({"type": "filming", "share": share})
            return not (self._stopped or page.gone)

        stopped = True
        try:
            # The page must learn that there will be no film.
            with faults_told(page.send), taken() as warned:
                stopped = self._given_up(page, make, progress)
            tell_warnings(page.send, warned)
        finally:
            with self._lock:
                self._thread = None
            page.send({"type": "filmed", "stopped": stopped})

    def _given_up(self, page: Client, make: Callable[[], Order], progress: Callable[[float], bool]) -> bool:
        """Draw a film and send it to a page; return whether it was given up."""
        try:
            with tempfile.TemporaryDirectory() as folder:
                order = make()
                path = Path(folder) / f"film.{order.kind}"
                film_of(self._shown, order).save(path, progress=progress)
                name = f"{order.name}.{order.kind}"
                page.send({"type": "file", "name": name, "kind": FILMS[order.kind]}, path.read_bytes())
        except Cancelled:
            _log.debug("a film of the viewer was given up")
            return True
        return False

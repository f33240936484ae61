"""A session: what is shown, drawn by one thread, and shared by all pages and widgets that look at it."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from sheetsplat._checks import Triple, is_auto
from sheetsplat.api import Prepared
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.describe.scene_file import SceneFile
from sheetsplat.errors import Cancelled, Error, Unsupported
from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.notices import taken
from sheetsplat.options.renderer import Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.viewer import compose, frames
from sheetsplat.viewer.about import about, bars_of, frame_message, picked
from sheetsplat.viewer.changing import state_after, unit_note
from sheetsplat.viewer.client import Client, Deliver, error_message, faults_told, tell_warnings
from sheetsplat.viewer.code import arguments, python_code
from sheetsplat.viewer.data import DEFAULT_QUALITY, Shown
from sheetsplat.viewer.drawing import pictures_of, renderer_of
from sheetsplat.viewer.filming import Filming, Order
from sheetsplat.viewer.history import History
from sheetsplat.viewer.measuring import error_of, measured_effects
from sheetsplat.viewer.previews import Previews
from sheetsplat.viewer.protocol import Message, parse
from sheetsplat.viewer.state import Cue, State, camera_parts

_log = logging.getLogger("sheetsplat")

# Least seconds that the first stage of a picture may take before a newer picture stops it.
_PATIENCE = 1.0
# Seconds without a change after which data in bricks are drawn: until then coarse copies alone.
_REST = 0.15
_BEHIND: Triple = (0.0, 0.0, 0.0)
# Things that pages may wait for; what is asked for beyond them is dropped.
_MOST_JOBS = 100
_Jobs = dict[tuple[str, int], tuple[Message, Client]]


class _Present(NamedTuple):
    """What is shown at one time: `unmoved`, by the first camera; `refit`, which was for another size."""

    state: State
    size: tuple[int, int]
    unmoved: bool
    refit: bool


class Session:
    """Draws what is shown, and tells it to its pages.

    One thread draws. A change makes the running picture obsolete: its first stage is still shown, so that something
    follows the hand, and all later ones are left out. Frames have numbers that rise.

    Parameters
    ----------
    shown
        The data.
    size
        (width, height) of pictures until a page says its own.
    """

    def __init__(self, shown: Shown, size: tuple[int, int] = (800, 600)) -> None:
        self.shown = shown
        base = shown.base(0, 0)
        options = shown.options
        quality = options.get("quality") or DEFAULT_QUALITY
        changes = {"depth_cue": Cue()} if is_auto(options.get("depth_cue")) else {}
        self._first = State(shown.camera(base.scene, size), base.scene.mode, quality, changes=changes)
        self._state = self._good = self._first
        self._size = self._framed_for = size
        self._renderer, self._settings = base.renderer, dict(self._first.settings)
        self._clients: list[Client] = []
        self._wake = threading.Condition()
        self._version, self._drawn, self._number = 1, 0, 0
        # What pages wait for, in its order: at once, or when the picture is complete. The same is done once.
        self._jobs: _Jobs = {}
        self._idle_jobs: _Jobs = {}
        self._image: Image | None = None
        self._previews, self._history = Previews(shown), History()
        # A picture may be wanted before a page is there; the newest frame is there for pages that come later.
        self._early, self._busy = False, False
        self._frame_sent: tuple[dict[str, Any], bytes] | None = None
        self._costs: dict[str, float | None] = {}
        self._filming = Filming(shown)
        self._stopped = self._closed = False
        self._worker: threading.Thread | None = None

    # What Python sees.

    @property
    def state(self) -> State:
        """What is shown."""
        with self._wake:
            return self._state

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures."""
        with self._wake:
            return self._size

    def scene(self) -> Scene:
        """Return the scene that is shown."""
        return compose.scene_of(self.shown, self.state)

    def picture(self, size: tuple[int, int] | None = None, progress: Progress | None = None) -> Image:
        """Return the picture that is shown, complete; raises what `Renderer.render` does."""
        state, scene, own = self._settled()
        client = self.shown.client
        renderer = renderer_of(self.shown, state)
        return Prepared(scene, state.camera, size or own, renderer, progress=progress, client=client).render()

    def _settled(self) -> tuple[State, Scene, tuple[int, int]]:
        """Return state, scene and size as the next picture has them: no picture may have been drawn at the size yet."""
        with self._wake:
            now = self._present()
        state, scene = self._framed(now)
        return state, compose.fitted_scene(self.shown, state, scene, now.size), now.size

    def code(self) -> str:
        """Return Python that makes the picture that is shown."""
        state, _, size = self._settled()
        return python_code(self.shown, state, size)

    def scene_file(self) -> SceneFile:
        """Return the scene that is shown as a scene file; it names the data where they are files, and is exact then."""
        state, scene, size = self._settled()
        files = self.shown.files(state.choice, state.time)
        if files and any(scene.color_by):
            # Fields that give colours are no data of a recipe's scene file.
            return SceneFile.of_options(files, **arguments(self.shown, state, scene, size))
        recipe = Recipe.of(scene, state.camera, size, renderer_of(self.shown, state).settings)
        return SceneFile.of(recipe, files if len(files) == len(scene.fields) else ())

    def look_from(self, camera: Camera) -> None:
        """Show the scene by another camera."""
        state = self.state
        state = replace(state, camera=camera, camera_of=state.choice)
        self._change(state, None, told=True, names=("camera",))

    # What pages see.

    def connect(self, deliver: Deliver) -> Client:
        """Return a new page's end of the session."""
        client = Client(deliver)
        with self._wake:
            self._clients.append(client)
            self._start()
        return client

    def expect(self) -> None:
        """Begin to draw for a page that will come: a browser takes a second to start."""
        with self._wake:
            self._early = True
            self._start()

    def _start(self) -> None:
        """Let the thread that draws begin; the caller holds the lock."""
        if self._worker is None and not self._closed:
            self._worker = threading.Thread(target=self._work, name="sheetsplat-viewer", daemon=True)
            self._worker.start()

    def disconnect(self, client: Client) -> None:
        """Forget a page, and what it asked for."""
        client.gone = True
        with self._wake:
            self._clients = [one for one in self._clients if one is not client]
            for jobs in (self._jobs, self._idle_jobs):
                for key in [key for key, (_, asking) in jobs.items() if asking is client]:
                    del jobs[key]

    def close(self) -> None:
        """Stop drawing and tell all pages."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
            clients, worker = self._clients, self._worker
        self._filming.stop()
        for client in clients:
            client.send({"type": "closed"})
        if worker is not None and worker is not threading.current_thread():
            worker.join(10.0)

    def receive_text(self, client: Client, text: str | bytes) -> None:
        """Take a message of a page; whatever is not known is dropped."""
        self._receive(client, parse(text))

    def receive(self, client: Client, given: object) -> None:
        """Take a message of a page as an object of JSON; whatever is not known is dropped."""
        try:
            text = json.dumps(given, allow_nan=False)
        except (TypeError, ValueError, RecursionError):
            text = ""
        self._receive(client, parse(text))

    def _receive(self, client: Client, message: Message | None) -> None:
        if message is None:
            _log.debug("the viewer dropped a message")
            return
        with faults_told(self._tell):
            self._take(client, message)

    def _take(self, client: Client, message: Message) -> None:
        parts = message.parts
        if message.type == "drawn":
            client.drew()
        elif message.type in ("hello", "size"):
            self._resize(client, (parts["width"], parts["height"]), first=message.type == "hello")
        elif message.type == "set":
            self._set(client, parts["changes"])
        elif message.type in ("undo", "redo"):
            self._move(back=message.type == "undo")
        elif message.type == "stop":
            with self._wake:
                self._stopped = True
        elif message.type == "film":
            state = self.state
            self._filming.start(client, lambda: self._order(state, **parts))
        elif message.type == "film_stop":
            self._filming.stop()
        else:
            with self._wake:
                if message.type in ("pick", "measure") and len(self._idle_jobs) < _MOST_JOBS:
                    # Of places under the pointer the newest alone is told.
                    key = "tell" if parts.get("purpose") == "tell" else repr(message)
                    self._idle_jobs[key, id(client)] = message, client
                elif message.type not in ("pick", "measure") and len(self._jobs) < _MOST_JOBS:
                    self._jobs[repr(message), id(client)] = message, client
                self._wake.notify_all()

    def _resize(self, client: Client, size: tuple[int, int], *, first: bool) -> None:
        client.size = size
        if first:
            client.send({"type": "hello", **compose.offered()})
        with self._wake:
            ready = self._frame_sent if first else None
            if first:
                self._owe_state(client)
            self._size = size
            self._version += 1
            self._wake.notify_all()
        if ready is not None:
            # Something to look at until there is a picture of this size.
            client.send({**ready[0], "last": False}, ready[1])
        self._say_busy(client)

    def _set(self, client: Client, changes: Mapping[str, Any]) -> None:
        try:
            state, told = state_after(self.shown, self._first, self.state, changes)
        except Error as error:
            client.send(error_message(str(error)))
            with self._wake:
                self._owe_state(client)
                self._wake.notify_all()
            return
        with self._wake:
            if client.size is not None:
                self._size = client.size
        self._change(state, client, told=told, names=changes)
        if note := unit_note(self.shown, state, changes.get("look")):
            client.send({"type": "warning", "text": note})

    def _change(
        self, state: State, client: Client | None, *, told: bool, names: Iterable[str], remembered: bool = True
    ) -> None:
        """Show a state; what is changed has `names`, and can be undone where it is `remembered`.

        `told`: the page that asked for it is told, too, as all others are.
        """
        with self._wake:
            before = self._state
            if remembered and state != before:
                self._history.note(before, names)
            self._state = state
            others = [one for one in self._clients if one is not client or told]
            if told or replace(state, camera=before.camera) != before:
                for one in others:
                    self._owe_state(one)
            # A picture that failed is tried again.
            if state.drawn != before.drawn or state == before:
                self._version += 1
                self._stopped = True
            self._wake.notify_all()
        self._say_busy()

    def _move(self, *, back: bool) -> None:
        """Show what was shown before, or what was undone."""
        with self._wake:
            state = self._history.move(self._state, back=back)
        if state is not None:
            self._change(state, None, told=True, names=(), remembered=False)

    def _say_busy(self, client: Client | None = None) -> None:
        """Tell pages that a picture is under way, once until it is complete; `client`: that page, whatever it knows."""
        with self._wake:
            news = self._version != self._drawn and not self._busy
            self._busy = self._busy or news
            pages = list(self._clients) if news else [client] if client is not None and self._busy else []
        for one in pages:
            one.send({"type": "drawing"})

    def _owe_state(self, client: Client) -> None:
        """Let the thread that draws tell a page what is shown; the caller holds the lock."""
        self._jobs["state", id(client)] = Message("state", {}), client

    # The thread that draws.

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(self._has_work)
                if self._closed:
                    return
                job, draws = None, self._draws()
                if self._jobs:
                    job = self._jobs.pop(next(iter(self._jobs)))
                elif not draws and self._idle_jobs:
                    job = self._idle_jobs.pop(next(iter(self._idle_jobs)))
                    self._stopped = False
            with faults_told(self._tell), taken() as warned:
                if job is not None:
                    self._do(*job)
                elif draws:
                    self._draw()
            tell_warnings(self._tell, warned)

    def _draws(self) -> bool:
        """Return whether a picture is to be drawn, for a page that is there or expected."""
        return self._version != self._drawn and (self._early or bool(self._clients))

    def _has_work(self) -> bool:
        return self._closed or self._draws() or bool(self._jobs) or bool(self._idle_jobs)

    def _tell(self, message: dict[str, Any], payload: bytes = b"") -> None:
        for client in self._pages():
            client.send(message, payload)

    def _pages(self) -> list[Client]:
        """Return the pages that are there; those that are gone are forgotten."""
        with self._wake:
            self._clients = [one for one in self._clients if not one.gone]
            return list(self._clients)

    def _superseded(self, version: int) -> bool:
        return self._closed or self._version != version

    def _draw(self) -> None:
        """Draw the newest state, stage by stage, until a newer one comes."""
        with self._wake:
            now, version = self._present(), self._version
            state, size = now.state, now.size
            self._drawn, self._stopped = version, False
        began = time.perf_counter()
        stage, previewed = 1, False

        def progress(_: float) -> bool:
            # What changes no picture is told while one is drawn.
            self._tell_owed()
            patient = stage == 1 and not previewed and time.perf_counter() - began < _PATIENCE
            return patient or not self._superseded(version)

        try:
            state, scene = self._framed(now)
            scene = compose.fitted_scene(self.shown, state, scene, size)
            if state.settings != self._settings:
                self._renderer, self._settings = renderer_of(self.shown, state), dict(state.settings)
            preview = self._previews.draw(scene, state, size)
            if preview is not None:
                previewed = True
                self._frame(preview, state, version, 1000.0 * (time.perf_counter() - began), preview=True)
                if self._superseded(version):
                    return
            resumed = time.perf_counter()
            if any_in_bricks(scene.fields) and not self._rested(version):
                return
            first = self._previews.first_seconds(scene, state, previewed=previewed)
            for image in pictures_of(self.shown, self._renderer, scene, state, size, progress, first):
                seconds = time.perf_counter() - resumed
                last = self._frame(image, state, version, 1000.0 * (time.perf_counter() - began))
                if stage == 1:
                    self._previews.note(scene, state, seconds)
                if last:
                    self._previews.note_last(scene, state, seconds)
                stage += 1
                if self._superseded(version):
                    return
                resumed = time.perf_counter()
        except Cancelled:
            return
        except Error as error:
            self._fail(error, state, version)

    def _rested(self, version: int) -> bool:
        """Wait for a moment; return whether no newer state came meanwhile."""
        with self._wake:
            return not self._wake.wait_for(lambda: self._superseded(version), _REST)

    def _present(self) -> _Present:
        """Return what is shown now; the caller holds the lock."""
        unmoved = self._state.camera is self._first.camera
        return _Present(self._state, self._size, unmoved, unmoved and self._size != self._framed_for)

    def _framed(self, now: _Present) -> tuple[State, Scene]:
        """Return the state with a camera that shows its data, and its scene.

        The first camera follows the size of the page while nobody has moved it; other data are framed anew.
        """
        state, size = now.state, now.size
        scene = compose.scene_of(self.shown, state)
        if state.camera_of != state.choice:
            camera = compose.other_camera(self.shown, state, scene, size, unmoved=now.unmoved)
        elif now.refit:
            camera = self.shown.camera(scene, size)
        else:
            return state, scene
        framed = replace(state, camera=camera, camera_of=state.choice)
        with self._wake:
            if self._state.camera is state.camera and self._state.choice == state.choice:
                self._state = replace(self._state, camera=camera, camera_of=state.choice)
                if now.unmoved:
                    self._first, self._framed_for = replace(self._first, camera=camera), size
                if now.refit and state.camera_of == state.choice:
                    self._history.reframe(state.camera, camera)
        return framed, compose.scene_of(self.shown, framed)

    def _fail(self, error: Error, state: State, version: int) -> None:
        """Tell why a state cannot be shown, and go back to the last one that could be."""
        with self._wake:
            self._busy = False
            back = self._version == version and self._good != state
            if back:
                self._history.drop(self._good)
                self._state = self._good
                self._version += 1
            clients = list(self._clients)
        self._tell(error_message(str(error)))
        if back:
            self._tell_state(clients)

    def _frame(self, image: Image, state: State, version: int, milliseconds: float, *, preview: bool = False) -> bool:
        """Show a picture; return whether it is complete."""
        told = frame_message(image, state, milliseconds, preview=preview)
        last: bool = told["last"]
        kind, payload = frames.encoded(frames.levels(image, state.changes.get("backdrop", _BEHIND)), exact=last)
        self._number += 1
        message = {**told, "number": self._number, "kind": kind, **self._history.steps}
        if last:
            self._image = image
            with self._wake:
                self._good = state
                self._busy = self._busy and self._superseded(version)
        with self._wake:
            self._frame_sent = message, payload
        for client in self._pages():
            client.show(message, payload)
        if last and not self._superseded(version):
            self._tell(about(image, self._costs))
        return last

    # What pages ask for, done by the thread that draws.

    def _do(self, message: Message, client: Client) -> None:
        actions: dict[str, Callable[..., None]] = {
            "state": self._do_state,
            "pick": self._do_pick,
            "look": self._do_look,
            "reset": self._do_look,
            "save": self._do_save,
            "scene": self._do_scene,
            "code": self._do_code,
            "measure": self._do_measure,
        }
        try:
            actions[message.type](client, **message.parts)
        except Error as error:
            client.send(error_message(str(error)))

    def _tell_state(self, clients: list[Client]) -> None:
        state = self.state
        scene = compose.scene_of(self.shown, state)
        message = {
            "type": "state",
            "state": compose.state_parts(self.shown, state, scene),
            "data": compose.data_parts(self.shown, state, scene),
            **self._history.steps,
        }
        for client in clients:
            client.send(message)

    def _do_state(self, client: Client) -> None:
        try:
            self._tell_state([client])
        except Error as error:
            self._fail(error, self.state, self._version)

    def _tell_owed(self) -> None:
        """Tell pages what is shown that wait for it."""
        with self._wake:
            owed = [key for key in self._jobs if key[0] == "state"] if self._version == self._drawn else []
            clients = [self._jobs.pop(key)[1] for key in owed]
        if clients:
            with faults_told(self._tell):
                self._tell_state(clients)

    def _do_pick(self, client: Client, x: float, y: float, purpose: str) -> None:
        client.send(picked(self._image, x, y, purpose))

    def _do_look(self, client: Client, **parts: Any) -> None:
        camera = compose.camera_towards(self.shown, self.state, self.size, **parts)
        client.send({"type": "camera", "camera": camera_parts(camera)})

    def _do_save(self, client: Client, width: int, height: int, *, shown: bool) -> None:
        image, size = self._image, (width, height)
        with self._wake:
            current = self._drawn == self._version
        if image is None or image.size != size or not current:
            image = self.picture(size, lambda _: not (client.gone or self._closed))
        parts: dict[str, Any] = {"type": "file", "name": f"{self._name()}.png", "kind": "image/png"}
        if shown:
            # The page draws over it what it shows.
            parts |= {"type": "picture", "bars": bars_of(image), "camera": camera_parts(image.camera)}
        client.send(parts, image.to_png())

    def _name(self) -> str:
        """Return the name of files that are saved, without a suffix."""
        return Path(self.shown.title(self.state.choice, self.state.time)).stem or "picture"

    def _order(self, state: State, width: int, height: int, **parts: Any) -> Order:
        renderer = Renderer(**{**self.shown.base(0, 0).renderer.settings, **state.settings})
        return Order(state, (width, height), renderer, self._name(), **parts)

    def _do_scene(self, client: Client) -> None:
        text = self.scene_file().to_toml()
        client.send({"type": "file", "name": f"{self._name()}.toml", "kind": "text/plain"}, text.encode())

    def _do_code(self, client: Client) -> None:
        client.send({"type": "code", "text": self.code()})

    def _do_measure(self, client: Client, what: str) -> None:
        def progress(_: float) -> bool:
            return not (self._stopped or self._closed or client.gone)

        def effects() -> dict[str, Any]:
            state = self.state
            scene = compose.scene_of(self.shown, state)
            return measured_effects(self._renderer, scene, state.camera, self.size, progress)

        client.send({"type": "measuring", "what": what})
        stopped = False
        try:
            if what == "effects":
                told = effects()
                self._costs = told["costs"]
                self._tell(told)
            elif self._image is not None:
                # Nothing where there is no picture yet.
                client.send(*error_of(self._image, progress))
        except (Cancelled, Unsupported) as error:
            stopped = True
            if isinstance(error, Unsupported):
                client.send(error_message(str(error)))
        client.send({"type": "measured", "what": what, "stopped": stopped})

"""A session: what is shown, drawn by one thread, and shared by all pages and widgets that look at it."""

from __future__ import annotations

import json
import logging
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from sheetsplat._checks import Triple, is_auto
from sheetsplat.api import Prepared
from sheetsplat.bricks.picture import draw as draw_in_bricks
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.describe.scene_file import SceneFile
from sheetsplat.errors import Cancelled, Error, Unsupported, complain
from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.notices import PictureWarning, muted, taken
from sheetsplat.options.renderer import Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.viewer import compose, frames
from sheetsplat.viewer.about import about, picked
from sheetsplat.viewer.client import Client, Deliver
from sheetsplat.viewer.coarse import coarse_scene
from sheetsplat.viewer.code import python_code
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.filming import Filming, Order
from sheetsplat.viewer.protocol import Message, parse
from sheetsplat.viewer.state import Cue, State, camera_parts

_log = logging.getLogger("sheetsplat")

# Least seconds that the first stage of a picture may take before a newer picture stops it.
_PATIENCE = 1.0
_FIRST_SECONDS = 0.05
# Seconds of a first stage from which on coarse copies of the data are drawn before it, and of one of them with light.
_SLOW, _SLOW_LIGHT = 0.08, 0.25
# Seconds without a change after which data in bricks are drawn: until then coarse copies alone.
_REST = 0.15
# Pixels of the pictures that measure what effects cost.
_MEASURED = 240 * 180
_BEHIND: Triple = (0.0, 0.0, 0.0)
_LONGEST_TEXT = 2000
# Things that pages may wait for; what is asked for beyond them is dropped.
_MOST_JOBS = 100
_Jobs = dict[tuple[str, int], tuple[Message, Client]]


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
        quality = "good" if options.get("quality") is None else options["quality"]
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
        self._first_seconds, self._plain_light = 0.0, False
        self._previewer: Renderer | None = None
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

    def renderer(self, state: State) -> Renderer:
        """Return a renderer with the settings of a state."""
        if not state.settings:
            return self.shown.base(0, 0).renderer
        return Renderer(**{**self.shown.renderer_options(), **state.settings})

    def picture(self, size: tuple[int, int] | None = None, progress: Progress | None = None) -> Image:
        """Return the picture that is shown, complete; raises what `Renderer.render` does."""
        state, scene, own = self._settled()
        client = self.shown.client
        renderer = self.renderer(state)
        return Prepared(scene, state.camera, size or own, renderer, progress=progress, client=client).render()

    def _settled(self) -> tuple[State, Scene, tuple[int, int]]:
        """Return state, scene and size as the next picture has them: no picture may have been drawn at the size yet."""
        state, size = self.state, self.size
        scene = compose.scene_of(self.shown, state)
        state = self._framed(state, scene, size)
        return state, compose.fitted_scene(self.shown, state, scene, size), size

    def code(self) -> str:
        """Return Python that makes the picture that is shown."""
        state, _, size = self._settled()
        return python_code(self.shown, state, size)

    def scene_file(self) -> SceneFile:
        """Return the scene that is shown as a scene file, exact; it names the data where they are files."""
        state, scene, size = self._settled()
        recipe = Recipe.of(scene, state.camera, size, self.renderer(state).settings)
        files = self.shown.files(state.choice, state.time)
        return SceneFile.of(recipe, files if len(files) == len(scene.fields) else ())

    def look_from(self, camera: Camera) -> None:
        """Show the scene by another camera."""
        self._change(replace(self.state, camera=camera), None, told=True)

    # What pages see.

    def connect(self, deliver: Deliver) -> Client:
        """Return a new page's end of the session."""
        client = Client(deliver)
        with self._wake:
            self._clients.append(client)
            if self._worker is None and not self._closed:
                self._worker = threading.Thread(target=self._work, name="sheetsplat-viewer", daemon=True)
                self._worker.start()
        return client

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
        with self._faults_told():
            self._take(client, message)

    def _take(self, client: Client, message: Message) -> None:
        parts = message.parts
        if message.type == "drawn":
            client.drew()
        elif message.type in ("hello", "size"):
            self._resize(client, (parts["width"], parts["height"]), first=message.type == "hello")
        elif message.type == "set":
            self._set(client, parts["changes"])
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
                if message.type in ("pick", "measure"):
                    self._idle_jobs[message.type, id(client)] = message, client
                elif len(self._jobs) < _MOST_JOBS:
                    self._jobs[repr(message), id(client)] = message, client
                self._wake.notify_all()

    def _resize(self, client: Client, size: tuple[int, int], *, first: bool) -> None:
        client.size = size
        if first:
            client.send({"type": "hello", **compose.offered()})
        with self._wake:
            if first:
                self._owe_state(client)
            self._size = size
            self._version += 1
            self._wake.notify_all()

    def _set(self, client: Client, changes: Mapping[str, Any]) -> None:
        try:
            state, told = self._after(self.state, changes)
        except Error as error:
            client.send(_error_message(str(error)))
            with self._wake:
                self._owe_state(client)
                self._wake.notify_all()
            return
        with self._wake:
            if client.size is not None:
                self._size = client.size
        self._change(state, client, told=told)

    def _after(self, state: State, changes: Mapping[str, Any]) -> tuple[State, bool]:
        """Return the state after changes, and whether the page that asked must be told more than it knows."""
        told = False
        for name, value in changes.items():
            if name in ("choice", "time"):
                count = len(self.shown.names if name == "choice" else self.shown.times)
                state, told = state.numbered(name, value, count), True
            elif name == "look":
                state, more = self._with_look(state, value)
                told = told or more
            elif name == "automatic":
                state, told = self._automatic(state), True
            else:
                state = state.changed(name, value)
                told = told or name in ("mode", "quality", "surfaces", "effects", "background")
        return state, told

    def _with_look(self, state: State, value: object) -> tuple[State, bool]:
        given = value if isinstance(value, dict) else {}
        group = given.get("group", 0)
        groups = len(self.shown.base(state.choice, 0).scene.groups)
        if not isinstance(group, int) or not 0 <= group < groups:
            return state, True
        if given.get("automatic"):
            return state.with_curves(group, None), True
        return state.with_curves(group, compose.curves_of(self.shown, state, group).changed(given)), True

    def _automatic(self, state: State) -> State:
        return replace(compose.without_changes(state), changes=self._first.changes)

    def _change(self, state: State, client: Client | None, *, told: bool) -> None:
        """Show a state; `told`: the page that asked for it is told, too, as all others are."""
        with self._wake:
            camera_only = replace(state, camera=self._state.camera) == self._state
            self._state = state
            self._version += 1
            self._stopped = True
            others = [one for one in self._clients if one is not client or told]
            if told or not camera_only:
                for one in others:
                    self._owe_state(one)
            self._wake.notify_all()

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
                job, draws = None, self._version != self._drawn and bool(self._clients)
                if self._jobs:
                    job = self._jobs.pop(next(iter(self._jobs)))
                elif not draws and self._idle_jobs:
                    job = self._idle_jobs.pop(next(iter(self._idle_jobs)))
                    self._stopped = False
            with self._faults_told(), taken() as warned:
                if job is not None:
                    self._do(*job)
                elif draws:
                    self._draw()
            self._tell_warnings(warned)

    @contextmanager
    def _faults_told(self) -> Iterator[None]:
        """Tell all pages of an error; one must not end the thread, or the line, that they wait for."""
        try:
            yield
        except Error as error:
            self._tell(_error_message(str(error)))
        except Exception as error:  # A fault of the program.
            _log.exception("the viewer met an error")
            self._tell(_error_message(f"{type(error).__name__}: {error}"))

    def _has_work(self) -> bool:
        waits = self._version != self._drawn and bool(self._clients)
        return self._closed or waits or bool(self._jobs) or bool(self._idle_jobs)

    def _tell(self, message: dict[str, Any], payload: bytes = b"") -> None:
        for client in self._pages():
            client.send(message, payload)

    def _pages(self) -> list[Client]:
        """Return the pages that are there; those that are gone are forgotten."""
        with self._wake:
            self._clients = [one for one in self._clients if not one.gone]
            return list(self._clients)

    def _tell_warnings(self, warned: list[PictureWarning]) -> None:
        for text in dict.fromkeys(str(one) for one in warned):
            self._tell({"type": "warning", "text": text[:_LONGEST_TEXT]})

    def _superseded(self, version: int) -> bool:
        return self._closed or self._version != version

    def _draw(self) -> None:
        """Draw the newest state, stage by stage, until a newer one comes."""
        with self._wake:
            state, version, size = self._state, self._version, self._size
            self._drawn, self._stopped = version, False
        began = time.perf_counter()
        stage, previewed = 1, False

        def progress(_: float) -> bool:
            patient = stage == 1 and not previewed and time.perf_counter() - began < _PATIENCE
            return patient or not self._superseded(version)

        try:
            scene = compose.scene_of(self.shown, state)
            state = self._framed(state, scene, size)
            scene = compose.fitted_scene(self.shown, state, scene, size)
            if state.settings != self._settings:
                self._renderer, self._settings = self.renderer(state), dict(state.settings)
            previewed = self._preview(scene, state, size)
            if previewed and self._superseded(version):
                return
            resumed = time.perf_counter()
            pictures: Iterable[Image]
            if any_in_bricks(scene.fields):
                if not self._rested(version):
                    return
                pictures = [self._drawn_in_bricks(scene, state, size, progress)]
            else:
                pictures = self._renderer.progressive(
                    scene, state.camera, size=size, progress=progress, first_seconds=_FIRST_SECONDS
                )
            for image in pictures:
                if stage == 1:
                    self._first_seconds = time.perf_counter() - resumed
                self._frame(image, state, version, 1000.0 * (time.perf_counter() - began))
                stage += 1
                if self._superseded(version):
                    return
            if self._first_seconds > _SLOW and not any_in_bricks(scene.fields):
                # Sooner than it is needed.
                self.shown.coarse(scene.fields, (state.choice, state.time))
        except Cancelled:
            return
        except Error as error:
            self._fail(error, state, version)
            return
        with self._wake:
            self._good = state

    def _preview(self, scene: Scene, state: State, size: tuple[int, int]) -> bool:
        """Show a picture of coarse copies of the data, where the first stage of the data themselves is slow."""
        if self._first_seconds <= _SLOW and not any_in_bricks(scene.fields):
            return False
        fields = self.shown.coarse(scene.fields, (state.choice, state.time))
        if fields is None:
            return False
        began = time.perf_counter()
        drawn = coarse_scene(scene, fields, plain_light=self._plain_light)
        small = max(16, size[0] // 2), max(16, size[1] // 2)
        if self._previewer is None:
            goals = dict.fromkeys(("max_error", "max_seconds"))
            self._previewer = Renderer(**{**self.shown.renderer_options(), **goals, "effects": None})
        with muted():
            image = self._previewer.render(drawn, state.camera, size=small)
        seconds = time.perf_counter() - began
        # Volumes of light take long to make anew for each direction.
        lit = bool(scene.options["shadows"]) or scene.options["ambient_occlusion"] is not None
        self._plain_light = self._plain_light or (lit and seconds > _SLOW_LIGHT)
        self._frame(image, state, 0, 1000.0 * seconds, preview=True)
        return True

    def _rested(self, version: int) -> bool:
        """Wait for a moment; return whether no newer state came meanwhile."""
        with self._wake:
            return not self._wake.wait_for(lambda: self._superseded(version), _REST)

    def _drawn_in_bricks(self, scene: Scene, state: State, size: tuple[int, int], progress: Progress) -> Image:
        settings, client = self._renderer.settings, self.shown.client
        return draw_in_bricks(settings, scene, state.camera, size, (), progress, client=client)

    def _framed(self, state: State, scene: Scene, size: tuple[int, int]) -> State:
        """Return the state with the first camera fitted to the size of the page, while nobody has moved it."""
        if state.camera is not self._first.camera or size == self._framed_for:
            return state
        camera = self.shown.camera(scene, size)
        with self._wake:
            if self._state.camera is self._first.camera:
                self._state = replace(self._state, camera=camera)
            self._first, self._framed_for = replace(self._first, camera=camera), size
        return replace(state, camera=camera)

    def _fail(self, error: Error, state: State, version: int) -> None:
        """Tell why a state cannot be shown, and go back to the last one that could be."""
        self._tell(_error_message(str(error)))
        with self._wake:
            if self._version != version or self._good == state:
                return
            self._state = self._good
            self._version += 1
            clients = list(self._clients)
        self._tell_state(clients)

    def _frame(self, image: Image, state: State, version: int, milliseconds: float, *, preview: bool = False) -> None:
        stats = image.stats
        last = not preview and stats.get("stage") == stats.get("stages")
        kind, payload = frames.encoded(frames.levels(image, self._behind(state)), exact=last)
        self._number += 1
        message = {
            "type": "frame",
            "number": self._number,
            "kind": kind,
            "size": image.size,
            "stage": 0 if preview else int(stats.get("stage", 1)),
            "stages": int(stats.get("stages", 1)),
            "last": last,
            "milliseconds": milliseconds,
            "error": None if preview else stats.get("estimated_rmse"),
            "camera": camera_parts(state.camera),
        }
        for client in self._pages():
            client.show(message, payload)
        if last:
            self._image = image
            if not self._superseded(version):
                self._tell(about(image, self._costs))

    def _behind(self, state: State) -> Triple:
        """Return the colour behind transparent pixels."""
        found: Triple = state.changes.get("backdrop", _BEHIND)
        return found

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
            client.send(_error_message(str(error)))

    def _tell_state(self, clients: list[Client]) -> None:
        state = self.state
        scene = compose.scene_of(self.shown, state)
        message = {
            "type": "state",
            "state": compose.state_parts(self.shown, state, scene),
            "data": compose.data_parts(self.shown, state, scene),
        }
        for client in clients:
            client.send(message)

    def _do_state(self, client: Client) -> None:
        try:
            self._tell_state([client])
        except Error as error:
            self._fail(error, self.state, self._version)

    def _do_pick(self, client: Client, x: float, y: float) -> None:
        client.send(picked(self._image, x, y))

    def _do_look(self, client: Client, **parts: Any) -> None:
        state = self.state
        scene = compose.scene_of(self.shown, state)
        changes: dict[str, Any] = {}
        if parts.get("kind"):
            changes["projection"] = parts["kind"]
        if parts.get("direction"):
            changes |= {"direction": parts["direction"], "azimuth": 0.0, "elevation": 0.0, "zoom": 1.0}
        if parts.get("up"):
            changes["up"] = parts["up"]
        camera = self.shown.camera(scene, self.size, **changes)
        client.send({"type": "camera", "camera": camera_parts(camera)})

    def _do_save(self, client: Client, width: int, height: int) -> None:
        image, size = self._image, (width, height)
        with self._wake:
            current = self._drawn == self._version
        if image is None or image.size != size or not current:
            image = self.picture(size, lambda _: not (client.gone or self._closed))
        name = self._name()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            image.save(path)
            payload = path.read_bytes()
        client.send({"type": "file", "name": f"{name}.png", "kind": "image/png"}, payload)

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

        client.send({"type": "measuring", "what": what})
        stopped = False
        try:
            if what == "error":
                self._measure_error(client, progress)
            else:
                self._measure_effects(progress)
        except Cancelled:
            stopped = True
        except Unsupported as error:
            client.send(_error_message(str(error)))
            stopped = True
        client.send({"type": "measured", "what": what, "stopped": stopped})

    def _measure_error(self, client: Client, progress: Progress) -> None:
        """Send the error of the picture that is shown, as a map; nothing where there is none yet."""
        if self._image is None:
            return
        found = self._image.estimate_error(progress)
        payload, largest = frames.error_map(found.map)
        client.send({"type": "error_map", "rmse": found.rmse, "budget": found.budget, "largest": largest}, payload)

    def _measure_effects(self, progress: Progress) -> None:
        """Tell all pages what each effect costs, measured in a small picture."""
        state = self.state
        width, height = self.size
        share = min(1.0, (_MEASURED / (width * height)) ** 0.5)
        size = max(16, int(width * share)), max(16, int(height * share))
        scene = compose.scene_of(self.shown, state)
        if any_in_bricks(scene.fields):
            found = "data in bricks, which are drawn elsewhere"
            raise complain("effects cannot be measured", found, "data in memory", kind=Unsupported)
        plan = self._renderer.measure_effects(scene, state.camera, size, repeats=1, progress=progress)
        self._costs = {one.name: one.cost_ms for one in plan.effects}
        self._tell({"type": "costs", "size": size, "picture": plan.picture_ms, "costs": self._costs})


def _error_message(text: str) -> dict[str, Any]:
    return {"type": "error", "text": text[:_LONGEST_TEXT]}

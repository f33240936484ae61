"""Films: frames on demand, and their files."""

from __future__ import annotations

import base64
import hashlib
import io
import itertools
import logging
import os
import tempfile
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np

from sheetsplat import _sheetsplat
from sheetsplat._checks import check_progress, file_path, truth
from sheetsplat._time_left import time_left
from sheetsplat._waiting import ask, asking, call, note, wait
from sheetsplat._waiting import begun as fetch
from sheetsplat.animation.drawing import (
    Form,
    Task,
    content_of,
    draw_by_worker,
    draw_elsewhere,
    rgb_of,
    settings_of,
)
from sheetsplat.animation.encoding import SUFFIXES, encoder, find_ffmpeg
from sheetsplat.animation.folder import frames_there, held, make_folder, name_of
from sheetsplat.animation.portions import PortionSize
from sheetsplat.animation.sources import MemoryStep, OneScene, Source
from sheetsplat.animation.workers import Workers, cores
from sheetsplat.bricks.cluster import frames_side_by_side
from sheetsplat.bricks.needs import bricked_field
from sheetsplat.bricks.picture import Begun
from sheetsplat.bricks.picture import draw as draw_in_bricks
from sheetsplat.bricks.watch import connected
from sheetsplat.bricks.workers import look_after
from sheetsplat.bricks.workers import workers_of as workers_known
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.io.pictures import check_folder, listed_suffixes, whole_file
from sheetsplat.notices import warn
from sheetsplat.options.film import client_of, rate_of, workers_of
from sheetsplat.options.renderer import Progress
from sheetsplat.options.workers import WORKER_TIMEOUT, timeout_of
from sheetsplat.renderer import Renderer

_log = logging.getLogger("sheetsplat")

# Processes, a client in their place, and the seconds after which they are given up.
_Drawing = tuple[int, Any, "float | None"]
# How many tasks are ahead of the frame that is written, for each process.
_AHEAD = 2


@dataclass(frozen=True)
class SceneFrame:
    """A frame that is drawn of a scene."""

    source: Source | MemoryStep
    camera: Camera


@dataclass(frozen=True)
class PictureFrame:
    """A frame that a function of the caller draws."""

    draw: Callable[[], Image]


Frame = SceneFrame | PictureFrame


class Animation(Sequence[Image]):
    """A film: its frames are drawn when they are asked for, or written. Made by `turntable` and `animate`.

    ``len(film)`` counts the frames, ``film[n]`` draws one, ``film[10:20]`` is a part of the film. A notebook shows it
    as a video.

    >>> film = ss.turntable(values, frames=4, size=32)
    >>> film[2].size
    (32, 32)
    >>> film[1:3]
    Animation(2 frames, 32 x 32, 30 a second)

    Parameters
    ----------
    frames
        What each frame shows.
    size
        (width, height) in pixels.
    renderer
        Draws the frames.
    fps
        Pictures a second.
    workers, client, worker_timeout
        What draws the frames that are written, unless `save` is told, and how long it may give no sign of life.
    """

    def __init__(
        self,
        frames: Sequence[Frame],
        size: tuple[int, int],
        renderer: Renderer,
        *,
        fps: float = 30.0,
        workers: int | None = None,
        client: Any = None,
        worker_timeout: float | None = None,
    ) -> None:
        self._frames = tuple(frames)
        self._size, self._renderer, self._fps = size, renderer, rate_of("Animation: fps", fps)
        self._workers, self._client = workers_of("Animation: workers", workers), client_of("Animation: client", client)
        self._timeout = None if worker_timeout is None else timeout_of("Animation: worker_timeout", worker_timeout)
        self._made: tuple[MemoryStep | None, OneScene | None] = (None, None)
        self._digests: dict[int, str] = {}
        self._page = ""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self._size

    @property
    def fps(self) -> float:
        """Pictures a second."""
        return self._fps

    @property
    def renderer(self) -> Renderer:
        """What draws the frames: one backend for all."""
        return self._renderer

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The camera of each frame; none where a function draws them."""
        return tuple(one.camera for one in self._frames if isinstance(one, SceneFrame))

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> Image: ...
    @overload
    def __getitem__(self, index: slice) -> Animation: ...
    def __getitem__(self, index: int | slice) -> Image | Animation:
        """Return a frame as a picture, or a part of the film."""
        if isinstance(index, slice):
            options: Any = {"fps": self._fps, "workers": self._workers, "client": self._client}
            options["worker_timeout"] = self._timeout
            return Animation(self._frames[index], self._size, self._renderer, **options)
        return self._image(self._frames[index])

    def __iter__(self) -> Iterator[Image]:
        """Draw the frames one after the other."""
        return map(self._image, self._frames)

    def __eq__(self, other: object) -> bool:
        """Return whether frames, size, rate and renderer are the same; what draws them elsewhere does not count."""
        if not isinstance(other, Animation):
            return NotImplemented
        mine, others = (self.size, self.fps, self.renderer), (other.size, other.fps, other.renderer)
        return mine == others and self._frames == other._frames  # noqa: SLF001

    def __hash__(self) -> int:
        """Return a hash of the size and the number of frames."""
        return hash((self._size, self._fps, len(self._frames)))

    def __repr__(self) -> str:
        """Return a short description."""
        width, height = self._size
        return f"Animation({len(self)} frames, {width} x {height}, {self._fps:g} a second)"

    # ------------------------------------------------------------------------------------------------------- drawing

    def _source(self, frame: SceneFrame) -> Source:
        """Return what makes the scene of a frame anywhere; the last data in memory are kept."""
        if not isinstance(frame.source, MemoryStep):
            return frame.source
        step, made = self._made
        if step is not frame.source or made is None:
            made = frame.source.here()
            self._made = frame.source, made
        return made

    def _image(self, frame: Frame, progress: Progress | None = None) -> Image:
        if isinstance(frame, PictureFrame):
            return frame.draw()
        if _in_bricks(frame):
            scene = self._source(frame).scene()
            return draw_in_bricks(
                self._renderer.settings, scene, frame.camera, self._size, (), progress, client=self._client
            )
        return self._renderer.render(self._source(frame).scene(), frame.camera, size=self._size, progress=progress)

    def _mark(self, frame: Frame) -> str:
        """Return what a PNG says about which frame it is: a digest of its data and of how it is made."""
        if isinstance(frame, PictureFrame):
            return ""
        source = self._source(frame)
        recipe = Recipe.of(source.template, frame.camera, self._size, self._renderer.settings)
        key = id(source)
        if key not in self._digests or isinstance(frame.source, MemoryStep):
            self._digests[key] = source.digest()
        text = f"{_sheetsplat.__version__}\n{self._digests[key]}\n{recipe.to_json()}"
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def _task(self, number: int, form: Form, settings: Any, mark: str, *, metadata: bool) -> Task:
        frame = self._frames[number]
        camera = frame.camera if isinstance(frame, SceneFrame) else Camera.orthographic((0, 0, 1), (0, 0, 0), height=1)
        return Task(number, camera, self._size, settings, form, mark, metadata)

    def _drawn(
        self, numbers: Sequence[int], form: Form, drawing: _Drawing, progress: Progress, *, metadata: bool
    ) -> Iterator[tuple[int, bytes]]:
        """Yield frames as bytes, in their order."""
        workers, client, timeout = drawing
        look_after("Animation", client, timeout)
        here = client is None and workers == 1 or any(isinstance(self._frames[n], PictureFrame) for n in numbers)
        settings = dict(self._renderer.settings)
        if not here and client is None and settings["threads"] is None:
            settings["threads"] = max(1, cores() // workers)
        pairs = settings_of(Renderer(**settings))

        def task(number: int) -> Task:
            mark = self._mark(self._frames[number]) if form == "png" else ""
            return self._task(number, form, pairs, mark, metadata=metadata)

        if here:
            yield from self._drawn_here(numbers, task, progress)
            return
        if client is not None and any(_in_bricks(self._frames[n]) for n in numbers):
            # Workers that keep all of the data draw frames by themselves.
            alone = _alone(client, self._frames[numbers[0]])
            if alone:
                yield from self._drawn_there(numbers, task, client)
            else:
                yield from self._drawn_in_bricks(numbers, task, client, progress)
            return
        pool = Workers(min(workers, len(numbers)), timeout or WORKER_TIMEOUT) if client is None and numbers else None
        try:
            yield from self._drawn_there(numbers, task, client, pool, workers)
        finally:
            if pool is not None:
                pool.close()

    def _drawn_here(
        self, numbers: Sequence[int], task: Callable[[int], Task], progress: Progress
    ) -> Iterator[tuple[int, bytes]]:
        for done, number in enumerate(numbers):
            start, share = done / len(numbers), 1 / len(numbers)
            image = self._image(self._frames[number], lambda part, a=start, b=share: progress(a + b * part))  # type: ignore[misc]
            if image.size != self._size:
                found = f"a picture of {image.size[0]} x {image.size[1]} pixels as frame {number}"
                raise complain("the film cannot be written", found, f"{self._size[0]} x {self._size[1]}, as the first")
            yield number, content_of(image, task(number))
            _tell((done + 1) / len(numbers))

    def _drawn_in_bricks(
        self, numbers: Sequence[int], task: Callable[[int], Task], client: Any, progress: Progress
    ) -> Iterator[tuple[int, bytes]]:
        """Yield frames of data in bricks, each drawn by all workers, the next one begun meanwhile."""
        waiting: deque[tuple[int, Begun]] = deque()
        rest = iter(numbers)
        try:
            for done in range(len(numbers)):
                while len(waiting) < _AHEAD and (number := next(rest, None)) is not None:
                    frame = self._frames[number]
                    assert isinstance(frame, SceneFrame)
                    scene = self._source(frame).scene()
                    waiting.append((number, Begun(client, self._renderer.settings, scene, frame.camera, self._size)))
                number, begun = waiting.popleft()
                try:
                    image = begun.result(lambda part, a=done: progress((a + part) / len(numbers)))  # type: ignore[misc]
                finally:
                    begun.cancel()
                yield number, content_of(image, task(number))
                _tell((done + 1) / len(numbers))
        finally:
            for _, begun in waiting:
                begun.cancel()

    def _drawn_there(
        self,
        numbers: Sequence[int],
        task: Callable[[int], Task],
        client: Any,
        pool: Workers | None = None,
        workers: int = 1,
    ) -> Iterator[tuple[int, bytes]]:
        processes = workers if pool is not None else max(workers, _parallel(client))
        size = PortionSize(processes)
        waiting: deque[tuple[Sequence[int], Any]] = deque()
        submit = _submitter(client, pool)
        look = _look_of(client, pool)
        begun = done = 0

        def begin(portion: Sequence[int]) -> tuple[Sequence[int], Any]:
            frame = self._frames[portion[0]]
            assert isinstance(frame, SceneFrame)
            return portion, submit(self._source(frame), tuple(map(task, portion)))

        try:
            while done < len(numbers):
                while len(waiting) < _AHEAD * processes and begun < len(numbers):
                    portion = self._of_one_source(numbers[begun : begun + size.of(len(numbers) - begun)])
                    waiting.append(begin(portion))
                    begun += len(portion)
                portion, future = waiting[0]
                with connected(client) if _is_dask(client) else nullcontext():
                    # A worker may hang that has the frames already.
                    fetched = fetch(future.result)
                    wait(fetched, look)
                if _is_lost(future):
                    waiting = deque(begin(one) if _is_lost(other) else (one, other) for one, other in waiting)
                    continue
                drawn = fetched.result()
                waiting.popleft()
                size.learn(drawn.frames)
                for number, one in zip(portion, drawn.drawn(), strict=True):
                    for words in one.notices:
                        warn(words)
                    yield number, one.content
                    done += 1
                    _tell(done / len(numbers))
        finally:
            for _, future in waiting:
                future.cancel()

    def _of_one_source(self, numbers: Sequence[int]) -> Sequence[int]:
        """Return the first of some frames that have the same source as the first one."""
        first: Any = self._frames[numbers[0]]
        return list(
            itertools.takewhile(lambda number: getattr(self._frames[number], "source", None) is first.source, numbers)
        )

    # ------------------------------------------------------------------------------------------------------- writing

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        fps: float | None = None,
        workers: int | None = None,
        client: Any = None,
        worker_timeout: float | None = None,
        progress: Progress | None = None,
        overwrite: bool = False,
        metadata: bool = True,
    ) -> None:
        """Write the film: a file that appears whole or not at all, or a folder of pictures.

        A folder goes on where it stopped: frames of this film that are in it stay, and only the others are drawn. Each
        PNG says of which data and options it is made; files of changed data, and other options, make another film.
        Films of functions that draw their own pictures begin anew.

        Parameters
        ----------
        path
            .mp4 (H.264), .webm (VP9) or .gif; these need the extra ``video``. Or a folder, without a suffix, for
            frame_0000.png and so on. Films have no transparency: they are over the background, or white; PNGs do. Odd
            numbers of pixels of .mp4 and .webm are made even by a black edge.
        fps
            Pictures a second; the film's own unless given.
        workers, client, worker_timeout
            What draws the frames, and how long it may give no sign of life, as for `turntable`.
        progress
            Called with the finished share, from 0 to 1; where it returns False, the film is cancelled.
        overwrite
            Replace frames of another film in a folder.
        metadata
            Whether each PNG says how it was made (`Image.save`).

        Raises
        ------
        InvalidInput
            For another suffix, and for a folder with anything but frames of this film.
        Unsupported
            Where imageio-ffmpeg is not installed.
        Cancelled
            Where `progress` returned False.
        Error
            Where the file cannot be written, and what drawing raises.
        """
        wanted = f"a folder, or a path with {listed_suffixes(SUFFIXES)}"
        target = file_path("the film cannot be saved", path, wanted)
        if not self._frames:
            raise complain("the film cannot be saved", "no frames", "at least one")
        check_progress("Animation", progress)
        described = truth("Animation: metadata", metadata)
        rate = self._fps if fps is None else rate_of("Animation: fps", fps)
        count = self._workers if workers is None else workers_of("Animation: workers", workers)
        chosen = self._client if client is None else client_of("Animation: client", client)
        # A number of processes wins over the client of the film.
        chosen = None if client is None and workers is not None else chosen
        timeout = self._timeout if worker_timeout is None else timeout_of("Animation: worker_timeout", worker_timeout)
        drawing, told = (count, chosen, timeout), progress or (lambda share: None)
        with asking(progress, "the film"):
            self._save(target, rate, drawing, told, overwrite=overwrite, metadata=described)

    def _save(
        self, target: Path, fps: float, drawing: _Drawing, progress: Progress, *, overwrite: bool, metadata: bool
    ) -> None:
        if target.suffix.lower() in SUFFIXES and not target.is_dir():
            self._save_video(target, fps, drawing, progress)
        elif target.suffix == "" or target.is_dir():
            self._save_folder(
                target, drawing, progress, overwrite=truth("Animation: overwrite", overwrite), metadata=metadata
            )
        else:
            wanted = f"{', '.join(SUFFIXES)}, or a folder"
            raise complain(f"{target} cannot be written", f"the suffix {target.suffix!r}", wanted)

    def _save_video(self, path: Path, fps: float, drawing: _Drawing, progress: Progress) -> None:
        check_folder(path)
        find_ffmpeg(path)
        numbers = range(len(self))
        with encoder(path, self._size, fps) as film:
            for _, frame in _counted(self._drawn(numbers, "rgb", drawing, progress, metadata=False), len(self)):
                film.write(frame)

    def _save_folder(
        self, folder: Path, drawing: _Drawing, progress: Progress, *, overwrite: bool, metadata: bool
    ) -> None:
        make_folder(folder)
        with held(folder):
            there = frames_there(
                folder, len(self), lambda number: self._mark(self._frames[number]), overwrite=overwrite
            )
            rest = [number for number in range(len(self)) if number not in there]
            drawn = self._drawn(rest, "png", drawing, progress, metadata=metadata)
            for number, content in _counted(drawn, len(rest)):
                with whole_file(folder / name_of(number)) as made:
                    made.write_bytes(content)

    # ------------------------------------------------------------------------------------------------------ notebooks

    def _repr_html_(self) -> str:
        """Return the film for a notebook: a video, or without imageio-ffmpeg an animated picture."""
        if not self._page:
            width, height = self._size
            try:
                find_ffmpeg(Path("film.mp4"))
            except Unsupported:
                content = base64.b64encode(self._webp()).decode()
                self._page = f'<img width="{width}" height="{height}" src="data:image/webp;base64,{content}">'
            else:
                with tempfile.TemporaryDirectory() as folder:
                    film = Path(folder) / "film.mp4"
                    self.save(film)
                    content = base64.b64encode(film.read_bytes()).decode()
                source = f'<source type="video/mp4" src="data:video/mp4;base64,{content}">'
                self._page = f'<video controls autoplay loop muted playsinline width="{width}">{source}</video>'
        return self._page

    def _webp(self) -> bytes:
        from PIL import Image as Pillow

        frames = [Pillow.fromarray(np.ascontiguousarray(rgb_of(one))) for one in self]
        stream = io.BytesIO()
        duration = round(1000 / self._fps)
        frames[0].save(stream, "WEBP", save_all=True, append_images=frames[1:], duration=duration, loop=0, quality=90)
        return stream.getvalue()


def _alone(client: Any, frame: Frame) -> int:
    """Return how many workers can draw frames by themselves; 0: none can keep the data of this one."""
    if isinstance(frame, PictureFrame) or not isinstance(frame.source, OneScene):
        return 0
    field = bricked_field(frame.source.template)
    return 0 if field is None else frames_side_by_side(client, field)


def _submitter(client: Any, pool: Workers | None) -> Callable[[Source, tuple[Task, ...]], Any]:
    """Return what hands frames of one source over, and returns their future."""
    if pool is not None:
        return pool.submit
    if not _is_dask(client):
        return lambda source, tasks: client.submit(draw_elsewhere, source, tasks)
    run, counts, watch = uuid.uuid4().hex, itertools.count(), workers_known(client).watch
    scattered: list[tuple[Source, Any]] = []

    def submit(source: Source, tasks: tuple[Task, ...]) -> Any:
        if not scattered or scattered[0][0] is not source or _is_lost(scattered[0][1]):
            # By a name of its own: one by content may be that of another film, just being released.
            with connected(client):
                sent = watch.call(lambda: client.scatter(source, broadcast=True, hash=False))
            scattered[:] = [(source, sent)]
        return client.submit(draw_by_worker, scattered[0][1], tasks, key=f"render-frames-{run}-{next(counts)}")

    return submit


def _is_dask(client: Any) -> bool:
    return hasattr(client, "scatter")


def _is_lost(future: Any) -> bool:
    """Return whether what a worker of dask had is gone with it, and Dask cannot make it again."""
    return getattr(future, "status", "") in ("cancelled", "lost")


def _look_of(client: Any, pool: Workers | None) -> Callable[[], None] | None:
    """Return what looks after those that draw; None for an executor, which does so itself, or does not."""
    if pool is not None:
        return pool.look
    return workers_known(client).watch.look if _is_dask(client) else None


def _in_bricks(frame: Frame) -> bool:
    if isinstance(frame, PictureFrame) or not isinstance(frame.source, OneScene):
        return False
    return any_in_bricks(frame.source.template.fields)


def _counted(frames: Iterator[tuple[int, bytes]], count: int) -> Iterator[tuple[int, bytes]]:
    """Yield frames, and log how many of them are done, and when all will be."""
    began = time.monotonic()
    for done, frame in enumerate(frames, 1):
        yield frame
        _log.info("%d of %d frames, %s", done, count, time_left(time.monotonic() - began, done / count))


def _tell(share: float) -> None:
    note(share)
    ask()


def _parallel(client: Any) -> int:
    """Return how many frames a client draws at once, as far as it says."""
    if hasattr(client, "ncores"):
        return max(1, int(sum(call(client.ncores).values())))
    return int(getattr(client, "_max_workers", 0) or cores())

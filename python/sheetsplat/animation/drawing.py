"""Drawing frames, in this process or in another one."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from sheetsplat import pixels
from sheetsplat.animation.sources import Source
from sheetsplat.bricks.needs import bricked_field
from sheetsplat.bricks.picture import draw as draw_in_bricks
from sheetsplat.bricks.tasks import is_wanted, naming
from sheetsplat.camera import Camera
from sheetsplat.errors import Cancelled, Error, Words
from sheetsplat.image import Image
from sheetsplat.notices import PictureWarning
from sheetsplat.options.renderer import Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

#: Under which name a PNG says which frame of which film it is.
FRAME_KEYWORD = "sheetsplat frame"
Form = Literal["png", "rgb"]


@dataclass(frozen=True)
class Task:
    """A frame that is to be drawn.

    Attributes
    ----------
    number
        Of the frame.
    camera, size
        What `Renderer.render` takes.
    settings
        Options of the renderer, as pairs.
    form
        "png": the bytes of a PNG; "rgb": bytes of red, green, blue, rows from the top, over the background.
    mark
        What the PNG says about which frame it is.
    metadata
        Whether the PNG says how it was made.
    """

    number: int
    camera: Camera
    size: tuple[int, int]
    settings: tuple[tuple[str, Any], ...]
    form: Form
    mark: str = ""
    metadata: bool = True


@dataclass(frozen=True)
class Drawn:
    """A frame that was drawn: its bytes, the warnings about it, and the seconds that it took."""

    content: bytes
    notices: tuple[Words, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class Portion:
    """Frames that one task drew in their order, and the error that kept it from drawing all."""

    frames: tuple[Drawn, ...]
    error: Error | None = None

    def drawn(self) -> Iterator[Drawn]:
        """Yield the frames; then raise the error."""
        yield from self.frames
        if self.error is not None:
            raise self.error


@lru_cache(maxsize=2)
def _renderer(settings: tuple[tuple[str, Any], ...]) -> Renderer:
    plain: dict[str, Any] = {name: dict(value) if name == "effects" else value for name, value in settings}
    return Renderer(**plain)


def settings_of(renderer: Renderer) -> tuple[tuple[str, Any], ...]:
    """Return the options of a renderer as pairs that can be a key."""
    return tuple(
        (name, tuple(sorted(value.items())) if isinstance(value, Mapping) else value)
        for name, value in renderer.settings.items()
    )


def content_of(image: Image, task: Task) -> bytes:
    """Return what a film keeps of a picture."""
    if task.form == "png":
        return image.to_png(metadata=task.metadata, texts={FRAME_KEYWORD: task.mark} if task.mark else {})
    return rgb_of(image).tobytes()


def rgb_of(image: Image) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return red, green, blue, (h, w, 3), over white where there is no background."""
    return pixels.over(np.asarray(image, dtype=np.uint8), pixels.WHITE)


def draw(scene: Scene, task: Task, progress: Progress | None = None) -> Image:
    """Return the picture of a frame."""
    renderer = _renderer(task.settings)
    if bricked_field(scene) is not None:
        return draw_in_bricks(renderer.settings, scene, task.camera, task.size, (), progress)
    return renderer.render(scene, task.camera, size=task.size, progress=progress)


def draw_by_worker(source: Source, tasks: Sequence[Task]) -> Portion:
    """Return what `draw_elsewhere` does, in a worker of dask: until the task is cancelled; errors name the worker."""
    return _portion(source, tasks, by_worker=True)


def draw_elsewhere(source: Source, tasks: Sequence[Task]) -> Portion:
    """Return frames as bytes, with their warnings: for other processes, which keep the scene of their last source."""
    return _portion(source, tasks, by_worker=False)


def _portion(source: Source, tasks: Sequence[Task], *, by_worker: bool) -> Portion:
    frames: list[Drawn] = []
    for task in tasks:
        try:
            with naming(f"frame {task.number}") if by_worker else nullcontext():
                frames.append(_frame(source, task, is_wanted if by_worker else None))
        except Cancelled:
            raise
        except Error as error:
            return Portion(tuple(frames), error)
    return Portion(tuple(frames))


def _frame(source: Source, task: Task, progress: Progress | None) -> Drawn:
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PictureWarning)
        content = content_of(draw(_scene_of(source), task, progress), task)
    told = [one.message for one in caught]
    notices = tuple(one.words for one in told if isinstance(one, PictureWarning))
    return Drawn(content, notices, time.perf_counter() - began)


_last: list[tuple[Source, Scene]] = []


def _scene_of(source: Source) -> Scene:
    if not _last or _last[0][0] is not source:
        _last[:] = [(source, source.scene())]
    return _last[0][1]

"""Pictures of coarse copies of the data, for when the first stage of the data themselves takes too long."""

from __future__ import annotations

import time
from dataclasses import dataclass

from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.notices import muted
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.viewer.coarse import coarse_scene
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.state import State

# Seconds of a first stage from which on coarse copies of the data are drawn before it, and of one of them with light.
_SLOW, _SLOW_LIGHT = 0.08, 0.25
# Seconds that the first stage may take where something follows the hand by it, and where a coarse copy did so already:
# stages before the last one take as much processor time as that. One that took no longer than `_SOON` is drawn at once.
_FIRST, _AFTER_COPY, _AT_ONCE, _SOON = 0.05, 0.4, 10.0, 0.8


@dataclass(frozen=True)
class _Kind:
    """What the time of a first stage depends on most."""

    choice: int
    mode: str
    quality: str
    lit: bool


def _is_lit(scene: Scene) -> bool:
    """Return whether a scene has volumes of light, which take long to make anew for each direction."""
    return bool(scene.options["shadows"]) or scene.options["ambient_occlusion"] is not None


def _kind_of(scene: Scene, state: State) -> _Kind:
    return _Kind(state.choice, state.mode, state.quality, _is_lit(scene))


class Previews:
    """Draws them; not for several threads at once.

    Parameters
    ----------
    shown
        The data.
    """

    def __init__(self, shown: Shown) -> None:
        self._shown = shown
        self._seconds: dict[_Kind, float] = {}
        self._last: dict[_Kind, float] = {}
        self._plain_light = False
        self._renderer: Renderer | None = None

    def note(self, scene: Scene, state: State, seconds: float) -> None:
        """Take how long a first stage took; make the copies that the next one will need, sooner than it is needed."""
        self._seconds[_kind_of(scene, state)] = seconds
        if self._is_wanted(scene, state):
            self._shown.coarse(scene.fields, (state.choice, state.time))

    def note_last(self, scene: Scene, state: State, seconds: float) -> None:
        """Take how long the last stage took."""
        self._last[_kind_of(scene, state)] = seconds

    def first_seconds(self, scene: Scene, state: State, *, previewed: bool) -> float:
        """Return how long the first stage may take; `previewed`: a picture of a coarse copy is shown."""
        if not previewed:
            return _FIRST
        soon = self._last.get(_kind_of(scene, state), _AT_ONCE) <= _SOON
        return _AT_ONCE if soon else _AFTER_COPY

    def _is_wanted(self, scene: Scene, state: State) -> bool:
        kind = _kind_of(scene, state)
        # The first one with light is slow, and the first one without is sooner there than a copy.
        return any_in_bricks(scene.fields) or self._seconds.get(kind, 1.0 if kind.lit else 0.0) > _SLOW

    def draw(self, scene: Scene, state: State, size: tuple[int, int]) -> Image | None:
        """Return a picture of coarse copies, half as many pixels a side; None where none is needed, or can be made."""
        fields = self._shown.coarse(scene.fields, (state.choice, state.time)) if self._is_wanted(scene, state) else None
        if fields is None:
            return None
        began = time.perf_counter()
        drawn = coarse_scene(scene, fields, plain_light=self._plain_light)
        if self._renderer is None:
            goals = dict.fromkeys(("max_error", "max_seconds"))
            self._renderer = Renderer(**{**self._shown.renderer_options(), **goals, "effects": None})
        with muted():
            image = self._renderer.render(drawn, state.camera, size=(max(16, size[0] // 2), max(16, size[1] // 2)))
        slow = time.perf_counter() - began > _SLOW_LIGHT
        self._plain_light = self._plain_light or (_is_lit(scene) and slow)
        return image

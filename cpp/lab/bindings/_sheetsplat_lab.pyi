from collections.abc import Callable, Mapping, Sequence

from sheetsplat import _sheetsplat

COMPARATORS: tuple[str, ...]

class Renderer:
    def __init__(
        self,
        comparators: Sequence[str],
        *,
        device: int | None = None,
        precision: str = "auto",
        tagging: str = "auto",
        packing: str = "auto",
        path: str = "raster",
        effects: Mapping[str, bool] = ...,
        allow_inexact: bool = False,
        tile_size: int = 0,
        tags_per_clear: int = 0,
    ) -> None: ...
    def plan(
        self,
        scene: _sheetsplat.Scene,
        camera: _sheetsplat.Camera,
        *,
        size: tuple[int, int],
        coverage: bool = False,
        depth: bool = False,
    ) -> _sheetsplat.RenderPlan: ...
    def render(
        self,
        scene: _sheetsplat.Scene,
        camera: _sheetsplat.Camera,
        *,
        size: tuple[int, int],
        coverage: bool = False,
        depth: bool = False,
        progress: Callable[[float], object] | None = None,
    ) -> _sheetsplat.Image: ...

def fill_test(
    kernels: int, diameter_px: float, width: int, height: int, targets: int = 1, repeats: int = 5
) -> tuple[float, float]: ...

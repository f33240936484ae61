"""Types of the native half; the public names are in the package itself."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

__version__: str
spot_columns: int

_Triple = tuple[float, float, float]
_Corners = tuple[_Triple, _Triple]

class Field:
    @property
    def size(self) -> int: ...
    @property
    def value_range(self) -> Sequence[float]: ...
    @property
    def centres(self) -> _Corners: ...
    @property
    def supports(self) -> _Corners: ...
    @property
    def base(self) -> float: ...
    @property
    def least_weight(self) -> float: ...
    @property
    def default_slice_spacing(self) -> float: ...
    @property
    def domain(self) -> _Corners: ...
    @property
    def memory(self) -> int: ...
    def reach_along(self, from_point: _Triple, direction: _Triple) -> tuple[float, float]: ...
    def sums_at(self, points: NDArray[Any], threads: int = 0) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...

class EllipsoidFit:
    def __init__(
        self,
        data: NDArray[Any],
        *,
        points: NDArray[Any] | None = None,
        weights: NDArray[Any] | None = None,
        falloff: float = 8.0,
        threads: int = 0,
    ) -> None: ...
    def objective(self, kernels: NDArray[Any]) -> tuple[float, NDArray[np.float64]]: ...
    def residual(self, kernels: NDArray[Any]) -> tuple[float, NDArray[np.float64]]: ...
    def sums(self, kernels: NDArray[Any]) -> NDArray[np.float64]: ...
    def project(self, kernels: NDArray[Any], field: NDArray[Any]) -> NDArray[np.float64]: ...
    def normal(self, kernels: NDArray[Any], changes: NDArray[Any]) -> NDArray[np.float64]: ...
    def overlaps(self, kernels: NDArray[Any]) -> NDArray[np.float64]: ...
    def blocks(self, kernels: NDArray[Any]) -> NDArray[np.float64]: ...

def changed_ellipsoids(kernels: NDArray[Any], changes: NDArray[Any]) -> NDArray[np.float64]: ...

class RegularField(Field):
    def __init__(
        self,
        values: NDArray[Any],
        *,
        spacing: _Triple,
        origin: _Triple,
        lattice: str,
        radius: float,
        falloff: float,
        normalization: str,
        w0: float,
        nan: str,
        prefilter: bool,
        boundary: str = "zero",
        base: float | None = None,
        least_weight: float = 0.0,
        coefficients: NDArray[Any] | None,
        figures: dict[str, float] | None,
        value_range: tuple[float, float] | None = None,
        axes: Sequence[Sequence[float]] | None = None,
    ) -> None: ...
    @property
    def values(self) -> NDArray[Any]: ...
    @property
    def given_values(self) -> NDArray[Any]: ...
    @property
    def given_range(self) -> tuple[float, float]: ...
    @property
    def prefilter_figures(self) -> dict[str, float] | None: ...
    @property
    def lattice_constant(self) -> float: ...
    @property
    def has_holes(self) -> bool: ...
    def position(self, i: int, j: int, k: int) -> _Triple: ...

def prefilter_condition(radius: float, falloff: float, lattice: str) -> float: ...

class EllipsoidField(Field):
    def __init__(
        self,
        centers: NDArray[Any],
        scales: NDArray[Any],
        rotations: NDArray[Any] | None,
        values: NDArray[Any],
        *,
        weights: NDArray[Any] | None,
        normalization: str,
        w0: float,
        falloff: float,
        min_scale: float | None,
        cell_volume: float | None,
        base: float = 0.0,
        unit_rotations: bool = False,
        value_range: tuple[float, float] | None = None,
        periodic: _Corners | None = None,
    ) -> None: ...
    @property
    def size(self) -> int: ...
    @property
    def images(self) -> int: ...
    def with_images(self) -> EllipsoidField: ...
    @property
    def centers(self) -> NDArray[np.float64]: ...
    @property
    def scales(self) -> NDArray[np.float64]: ...
    @property
    def rotations(self) -> NDArray[np.float64] | None: ...
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def weights(self) -> NDArray[np.float64] | None: ...
    @property
    def weight_range(self) -> Sequence[float]: ...
    @property
    def scale_range(self) -> Sequence[float]: ...
    @property
    def isotropic(self) -> bool: ...
    @property
    def lattice_constant(self) -> float: ...
    def shapes(self, indices: NDArray[np.int64]) -> NDArray[np.float64]: ...
    def ghost_points(self, distance: float, most: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]: ...

def nearest_rotations(matrices: NDArray[Any]) -> NDArray[np.float64]: ...

class TransferFunction:
    def __init__(self, points: NDArray[np.float64]) -> None: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def v_min(self) -> float: ...
    @property
    def v_max(self) -> float: ...
    @property
    def max_opacity(self) -> float: ...
    @property
    def has_steps(self) -> bool: ...
    @property
    def steepest(self) -> float: ...
    def transparent_over(self, lower: float, upper: float) -> bool: ...
    def at(self, values: NDArray[np.float64]) -> NDArray[np.float64]: ...

class Light:
    def __init__(self, *, direction: _Triple, color: _Triple, space: str) -> None: ...

class Material:
    def __init__(
        self, *, ambient: float, diffuse: float, specular: float, shininess: float, two_sided: bool
    ) -> None: ...

class Clip:
    def __init__(
        self,
        *,
        planes: Sequence[tuple[_Triple, float]],
        box: _Corners | None,
        facets: tuple[Sequence[tuple[_Triple, float]], _Triple] | None,
    ) -> None: ...

class DepthCue:
    def __init__(self, *, start: float, end: float, color: _Triple, strength: float) -> None: ...

class AmbientOcclusion:
    def __init__(self, *, radius: float, strength: float) -> None: ...

class Scene:
    def __init__(
        self,
        groups: Sequence[tuple[Sequence[Field], TransferFunction, str, int]],
        **options: Any,
    ) -> None: ...
    def with_depth_limit(self, depths: NDArray[np.float64]) -> Scene: ...
    def with_part(
        self,
        *,
        cell: _Corners,
        centres: _Corners,
        depths: tuple[float, float],
        in_front: NDArray[np.float32] | None,
        supports: _Corners | None = None,
        domain: _Corners | None = None,
        filled: bool = False,
        light: LightVolumes | None = None,
        to_box: Sequence[Sequence[float]] | None = None,
    ) -> Scene: ...
    @property
    def slice_distance(self) -> float: ...
    @property
    def reference_distance(self) -> float: ...
    @property
    def centres(self) -> _Corners: ...

class LightPlan:
    @property
    def shapes(self) -> list[tuple[int, int, int]]: ...
    @property
    def step(self) -> float: ...

class LightVolumes:
    def __init__(self) -> None: ...
    @property
    def nbytes(self) -> int: ...

class Camera:
    @staticmethod
    def orthographic(eye: _Triple, target: _Triple, up: _Triple, height: float) -> Camera: ...
    @staticmethod
    def perspective(
        eye: _Triple, target: _Triple, up: _Triple, fov_y: float, near: float | None, shift: tuple[float, float]
    ) -> Camera: ...
    @staticmethod
    def fit(
        lower: _Triple, upper: _Triple, direction: _Triple, up: _Triple, kind: str, margin: float, fov_y: float
    ) -> Camera: ...
    @property
    def kind(self) -> str: ...
    @property
    def eye(self) -> _Triple: ...
    @property
    def target(self) -> _Triple: ...
    @property
    def up(self) -> _Triple: ...
    @property
    def height(self) -> float: ...
    @property
    def fov_y(self) -> float: ...
    @property
    def near(self) -> float: ...
    @property
    def shift(self) -> tuple[float, float]: ...
    def to_eye(self, point: _Triple) -> _Triple: ...
    def direction_to_eye(self, direction: _Triple) -> _Triple: ...

class RenderPlan:
    @property
    def backend(self) -> str: ...
    @property
    def precision(self) -> str: ...
    @property
    def packing(self) -> str: ...
    @property
    def tagging(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def slice_spacing(self) -> float: ...
    @property
    def first_slice(self) -> int: ...
    @property
    def first_depth(self) -> float: ...
    @property
    def cut_by_near(self) -> bool: ...
    @property
    def slices(self) -> int: ...
    @property
    def memory(self) -> int: ...
    @property
    def device(self) -> str: ...
    @property
    def effects(self) -> list[tuple[str, bool, str, bool, float]]: ...
    @property
    def expected_error(self) -> float: ...
    @property
    def error_budget(self) -> list[tuple[str, float]]: ...

def mode_traits() -> list[dict[str, Any]]:
    """Every mode: the fields of `sheetsplat.modes.ModeTraits`."""

def backend_traits() -> list[dict[str, Any]]:
    """Every backend: the fields of `sheetsplat.backends.BackendTraits`."""

def known_effects() -> list[tuple[str, str, str, list[str], list[str]]]:
    """All effects: name, meaning, what decides it (or ""), backends that list it, and that can force it."""

class Image:
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def rgba(self) -> NDArray[np.float32] | None: ...
    @property
    def scalar(self) -> NDArray[np.float32] | None: ...
    @property
    def coverage(self) -> NDArray[np.float32] | None: ...
    @property
    def depth(self) -> NDArray[np.float32] | None: ...
    @property
    def counts(self) -> NDArray[np.float32] | None: ...
    @property
    def plan(self) -> RenderPlan: ...
    @property
    def stats(self) -> dict[str, float]: ...
    @property
    def settings(self) -> dict[str, Any] | None: ...
    def save_png(self, path: str) -> None: ...
    def save_pfm(self, path: str) -> None: ...

class ErrorEstimate:
    @property
    def rmse(self) -> float: ...
    @property
    def budget(self) -> list[tuple[str, float]]: ...
    @property
    def map(self) -> NDArray[np.float32]: ...

def estimate_error(
    drawn: NDArray[np.float32],
    exact: NDArray[np.float32],
    unstopped: NDArray[np.float32] | None,
    halved: NDArray[np.float32],
    doubled: NDArray[np.float32],
    *,
    mode: str,
    preintegration: bool,
    budget: Sequence[tuple[str, float, str]],
) -> ErrorEstimate: ...
def compare(picture: NDArray[np.float32], reference: NDArray[np.float32], channels: int) -> dict[str, float]: ...
def probe_pixels(*, size: tuple[int, int], surfaces: bool) -> tuple[NDArray[np.int32], int, int]: ...
def thinned(spots: NDArray[np.float64], most: int, /) -> NDArray[np.float64]: ...
def choose_spots(
    spots: NDArray[np.float64], *, size: tuple[int, int], surfaces: bool, stop: float, seen: int
) -> NDArray[np.float64]: ...
def light_errors(
    spots: NDArray[np.float64],
    absorbed: bool,
    lights: int,
    left: NDArray[np.float64],
    shown: NDArray[np.float64],
    *,
    size: tuple[int, int],
    surfaces: bool,
    tried: int,
    seen: int,
) -> tuple[float, float]: ...

class Stages:
    @property
    def done(self) -> bool: ...

class Renderer:
    def __init__(
        self,
        *,
        backend: str,
        device: int | None,
        precision: str,
        tagging: str,
        packing: str,
        path: str,
        effects: Mapping[str, bool],
        allow_inexact: bool,
        tile_size: int,
        tags_per_clear: int,
        threads: int,
        max_error: float | None = None,
        max_seconds: float | None = None,
    ) -> None: ...
    def plan(
        self, scene: Scene, camera: Camera, *, size: tuple[int, int], coverage: bool, depth: bool
    ) -> RenderPlan: ...
    def render(
        self,
        scene: Scene,
        camera: Camera,
        *,
        size: tuple[int, int],
        coverage: bool,
        depth: bool,
        progress: Callable[[float], object] | None,
    ) -> Image: ...
    def estimate_error(
        self, image: Image, scene: Scene, camera: Camera, *, progress: Callable[[float], object] | None
    ) -> ErrorEstimate: ...
    def plan_light(self, part: Scene, camera: Camera, *, size: tuple[int, int]) -> LightPlan: ...
    def light_pieces(
        self,
        part: Scene,
        camera: Camera,
        *,
        size: tuple[int, int],
        light: LightPlan,
        progress: Callable[[float], object] | None,
    ) -> list[tuple[int, tuple[int, int, int], NDArray[np.float32]]]: ...
    def light_spots(
        self,
        part: Scene,
        camera: Camera,
        *,
        size: tuple[int, int],
        numbers: Sequence[int],
        progress: Callable[[float], object] | None,
    ) -> NDArray[np.float64]: ...
    def light_lines(
        self,
        part: Scene,
        camera: Camera,
        *,
        size: tuple[int, int],
        spots: NDArray[np.float64],
        number: int,
        progress: Callable[[float], object] | None,
    ) -> tuple[bool, int, NDArray[np.float64], NDArray[np.float64]]: ...
    def light_volumes(
        self,
        light: LightPlan,
        grids: Sequence[NDArray[np.float32]],
        *,
        progress: Callable[[float], object] | None,
    ) -> LightVolumes: ...
    def begin_stages(
        self,
        scene: Scene,
        camera: Camera,
        *,
        size: tuple[int, int],
        coverage: bool,
        depth: bool,
        first_seconds: float,
    ) -> Stages: ...
    def next_stage(self, stages: Stages, *, progress: Callable[[float], object] | None) -> Image: ...

class DeviceReport:
    @property
    def backend(self) -> str: ...
    @property
    def platform(self) -> str: ...
    @property
    def available(self) -> bool: ...
    @property
    def description(self) -> str: ...
    @property
    def extensions(self) -> list[str]: ...
    @property
    def workarounds(self) -> list[str]: ...

def devices() -> list[DeviceReport]: ...

class LatticeDescent:
    @overload
    def __init__(
        self,
        grids: Sequence[tuple[_Triple, NDArray[np.float64]]],
        levels: Sequence[tuple[tuple[int, int, int], tuple[int, int, int], float]],
        falloff: float,
        radius: float,
        threads: int,
        exact: bool = False,
    ) -> None: ...
    @overload
    def __init__(
        self,
        places: NDArray[np.float64],
        samples: NDArray[np.float64],
        levels: Sequence[tuple[tuple[int, int, int], tuple[int, int, int], float]],
        falloff: float,
        radius: float,
        threads: int,
    ) -> None: ...
    def norm(self, level: int) -> float: ...
    def misfit(self) -> tuple[float, float]: ...
    def residual(self) -> NDArray[np.float64]: ...
    def coefficients(self, level: int) -> NDArray[np.float32]: ...
    def soften(self, level: int, threshold: float, only_active: bool) -> tuple[float, int]: ...
    def round_off(
        self,
        level: int,
        step: float,
        squared_error_a_bit: float,
        bits: NDArray[np.float32],
        only_active: bool,
    ) -> tuple[float, int]: ...
    def set(self, level: int, coefficients: NDArray[np.float64]) -> None: ...

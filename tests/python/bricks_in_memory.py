"""Fields in memory that are drawn in bricks, each from what is around it alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import sheetsplat as ss
from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.bricks.light import light_of, planned_light
from sheetsplat.bricks.needs import field_of
from sheetsplat.bricks.partial import Finished
from sheetsplat.bricks.partition import Partition, partition_lattice, partition_points
from sheetsplat.bricks.tasks import Tasks
from sheetsplat.bricks.view import BrickView
from sheetsplat.bricks.whole import Whole

SIZE = (48, 40)
BOUND = 1e-6
LOOK = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.35, 0.2, 0.8, 0.3, 0.02), (0.7, 0.9, 0.6, 0.1, 0.3), (1.0, 1.0, 0.9, 0.8, 0.7)]
LIGHTS = (ss.Light((0.4, 0.6, 1.0)), ss.Light((-1.0, 0.2, 0.3), (0.3, 0.3, 0.5), "world"))


def blobs(shape: tuple[int, int, int], seed: int = 3) -> np.ndarray[Any, Any]:
    """Return a smooth volume with flat places, values 0 to 1, zero in some corners."""
    random = np.random.default_rng(seed)
    k, j, i = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    total = np.zeros(shape)
    for _ in range(6):
        at = [random.uniform(0.15, 0.85) * n for n in shape]
        width = random.uniform(0.12, 0.3) * min(shape)
        total += np.exp(-((k - at[0]) ** 2 + (j - at[1]) ** 2 + (i - at[2]) ** 2) / (2 * width**2))
    total = np.clip(total - 0.15, 0.0, 1.0)
    # Flat faces, which cells cut through.
    total[shape[0] // 3 : shape[0] // 2, shape[1] // 4 : shape[1] // 2, shape[2] // 3 : 2 * shape[2] // 3] = 0.85
    return total.astype(np.float32)


def needles(count: int = 40, seed: int = 5) -> ss.EllipsoidField:
    """Return needles 1:1000, longer than bricks, among round kernels."""
    random = np.random.default_rng(seed)
    centers = random.uniform(-1, 1, (count, 3))
    scales = random.uniform(0.2, 0.5, (count, 1)) * np.array([1.0, 0.6, 0.8])
    scales[::4] = np.array([1.5, 0.0015, 0.0015])
    turns = random.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    return ss.EllipsoidField(centers, scales, turns, random.uniform(0.2, 1.0, count), w0=0.3)


def camera_of(field: ss.RegularField | ss.EllipsoidField, kind: str) -> ss.Camera:
    """Return a camera that looks at a field, from inside of it for "inside"."""
    if kind == "inside":
        lower, upper = np.asarray(field.bounds)
        middle = 0.5 * (lower + upper)
        eye = middle + 0.11 * (upper - lower)
        return ss.Camera.perspective(tuple(eye), tuple(lower), fov_y=70, near=0.02 * float((upper - lower).min()))
    return ss.Camera.fit(field, direction=(0.45, -0.35, -1.0), kind=kind)


@dataclass(frozen=True, eq=False)
class Fields:
    """What makes the fields of bricks: a source of its own."""

    make: Callable[[int], ss.RegularField | ss.EllipsoidField]

    def __call__(self, number: int) -> ss.RegularField | ss.EllipsoidField:
        """Return the field of a brick."""
        return self.make(number)


@field_of.register
def _(source: Fields, view: BrickView, number: int) -> ss.RegularField | ss.EllipsoidField:
    return source(number)


class Bricked:
    """A field in memory that is drawn in bricks."""

    def __init__(self, field: ss.RegularField | ss.EllipsoidField, brick: Any) -> None:
        self.field = field
        self.lattice: LatticeSpec | None = None
        if isinstance(field, ss.RegularField):
            self.lattice = LatticeSpec.of(field)
            self.partition: Partition = partition_lattice(self.lattice, brick)
            self.whole = Whole.of_lattice(self.lattice, field.native.value_range, field.native.centres)
        else:
            self.partition = partition_points(np.asarray(field.centers), brick)
            self.whole = Whole.of_bricks(field, (field.bounds,), float(field.scales.max()))
        self.asked: list[int] = []

    def view(self, camera: ss.Camera, outputs: tuple[str, ...] = (), settings: Any = None, **options: Any) -> BrickView:
        """Return the view of a picture."""
        look = ss.TransferFunction(LOOK)
        return BrickView.of(self.partition, self.whole, look, options, camera, SIZE, outputs, None, settings)

    def field_of(self, view: BrickView) -> Fields:
        """Return what makes the fields of bricks from the samples or kernels around them alone."""

        def make(number: int) -> ss.RegularField | ss.EllipsoidField:
            self.asked.append(number)
            if self.lattice is not None:
                box = view.samples(number)
                cut = tuple(slice(*ends) for ends in self.lattice.to_read(box))
                values = np.ascontiguousarray(self.field.values[cut])
                return self.lattice.field(values, box, self.whole.value_range)
            brick = self.partition.bricks[number]
            extents = np.abs(self.field.native.shapes(np.arange(self.field.size))) ** 2
            reached = brick.reached(np.asarray(self.field.centers), np.sqrt(extents.sum(axis=2)), view.margin(number))
            return self.field.part(reached)

        return Fields(make)


def light_in_bricks(
    bricked: Bricked, view: BrickView, fields: Fields | None = None, numbers: Sequence[int] | None = None
) -> tuple[BrickView, Any]:
    """Return a view with how its light volumes are made, and the volumes, of all bricks or some."""
    view = planned_light(view, bricked.field)
    tasks = Tasks(fields or bricked.field_of(view), view)
    chosen = range(len(view.partition)) if numbers is None else numbers
    return view, light_of(tasks, view, id(tasks), chosen)[0]


def one_precision(field: Any, camera: ss.Camera, **options: Any) -> tuple[dict[str, Any], Any]:
    """Return settings with which a whole and its bricks are drawn in one precision, and that precision.

    By themselves bricks decide which of their tiles need float64.
    """
    settings = {"backend": "cpu", "allow_inexact": True}
    precision = whole_picture(field, camera, (), settings, **options)[1]
    return {**settings, "precision": precision}, precision


def whole_picture(
    field: Any, camera: ss.Camera, outputs: tuple[str, ...], settings: Any, **options: Any
) -> tuple[Finished, str]:
    """Return the picture of one process, and its precision."""
    scene = ss.Scene(field, LOOK, **options)
    image = ss.Renderer(**(settings or {})).render(scene, camera, SIZE, outputs)
    scalar = scene.mode in ("xray", "mip", "minimum", "average")
    return Finished(
        None if scalar else image.rgba,
        image.scalar if scalar else None,
        image.coverage if "coverage" in outputs else None,
        image.depth if "depth" in outputs else None,
    ), image.plan.precision


def differences(found: Finished, wanted: Finished) -> dict[str, float]:
    """Return the root mean square differences of everything that a picture has."""
    result = {}
    if wanted.scalar is not None:
        there = ~np.isnan(wanted.scalar)
        assert (there == ~np.isnan(found.scalar)).all()
        scale = max(1.0, float(np.abs(wanted.scalar[there]).max(initial=0.0)))
        apart = np.where(there, found.scalar - np.nan_to_num(wanted.scalar), 0.0) / scale
        result["scalar"] = float(np.sqrt(np.mean(apart**2)))
    else:
        result["rgba"] = float(np.sqrt(np.mean((found.rgba.astype(float) - wanted.rgba) ** 2)))
    if wanted.coverage is not None:
        scale = max(1.0, float(np.abs(wanted.coverage).max()))
        result["coverage"] = float(np.sqrt(np.mean(((found.coverage - wanted.coverage) / scale) ** 2)))
    if wanted.depth is not None:
        there = np.isfinite(wanted.depth)
        assert (there == np.isfinite(found.depth)).all()
        result["depth"] = float(np.abs(found.depth[there] - wanted.depth[there]).max(initial=0.0))
    return result


def field_named(name: str) -> ss.RegularField | ss.EllipsoidField:
    """Return one of the fields."""
    if name == "cartesian":
        return ss.RegularField(blobs((20, 24, 28)), origin=(-3.0, 2.0, 10.0))
    if name == "uneven":
        return ss.RegularField(blobs((20, 24, 28)), spacing=(0.7, 1.0, 1.6), origin=(0.3, 0.1, -0.7))
    if name == "oblique":
        # Turned, and leaning as a triclinic cell.
        axes = np.array(((0.8, 0.5, -0.3), (-0.4, 1.0, 0.3), (0.5, 0.1, 1.2)))
        return ss.RegularField(blobs((20, 24, 28)), axes=axes, origin=(0.3, 0.1, -0.7))
    if name == "prefiltered":
        return ss.RegularField(blobs((20, 24, 28)), radius=2.5, falloff=7.0, prefilter=True)
    if name == "long":
        # Longer than what prefiltered bricks read around them.
        return ss.RegularField(blobs((12, 12, 100)), radius=2.5, falloff=7.0, prefilter=True)
    if name == "holes":
        values = blobs((20, 24, 28))
        values[:, :3] = np.nan
        values[5:9, 10:14, 8:20] = np.nan
        return ss.RegularField(values, nan="skip", normalization="threshold", w0=0.3)
    if name == "threshold":
        return ss.RegularField(blobs((20, 24, 28)), normalization="threshold", w0=0.5)
    if name == "bcc":
        return ss.RegularField(blobs((37, 17, 19)), lattice="bcc", spacing=(1.3, 1.3, 1.3), origin=(0.2, -1.0, 3.0))
    return needles()


LIT: dict[str, Any] = {"lights": LIGHTS, "material": ss.Material(0.2, 0.8, 0.3, 20)}

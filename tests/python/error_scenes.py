"""Random scenes for estimates of error and for choices of settings: lattices, BCC and ellipsoids, all options mixed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scene_parts
from numpy.typing import NDArray

import sheetsplat as ss

Array = NDArray[np.float64]
# A scene is converged at this share of the slice distance in question: what is left is a hundredth of a second-order
# error, and a sixteenth of a first-order one.
CONVERGED = 1 / 16
# Share of the pixels that rays along an outline may be: some meet slices of one distance and none of another.
OUTLINE = 0.03


@dataclass
class Case:
    """A view of a scene. `options` are those of Scene that trade error for time."""

    name: str
    scene: ss.Scene
    camera: ss.Camera
    options: dict[str, Any]
    spacing: float  # the default distance of slices

    def drawn(self, **changes: Any) -> ss.Scene:
        """Return the scene with the case's own options, and with others in their place."""
        return self.scene.replace(**{**self.options, **changes})

    def default(self) -> ss.Scene:
        """Return the scene with all that can be chosen at its default."""
        return self.scene


def smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], width: float) -> Array:
    """Return noise from 0 to 1, blurred by a Gaussian of so many samples."""
    frequencies = np.meshgrid(*[np.fft.fftfreq(n) for n in shape], indexing="ij")
    squared = sum(f * f for f in frequencies)
    blurred = np.fft.ifftn(np.fft.fftn(rng.normal(size=shape)) * np.exp(-2 * (np.pi * width) ** 2 * squared)).real
    blurred -= blurred.min()
    return np.asarray(blurred / blurred.max())


def _lattice(rng: np.random.Generator, bcc: bool) -> ss.RegularField:
    shape = tuple(int(n) for n in rng.integers(10, 22, 3))
    values = smooth_noise(rng, shape, rng.uniform(0.3, 2.5))
    if rng.random() < 0.5:
        axes = np.meshgrid(*[np.linspace(-1, 1, n) for n in shape], indexing="ij")
        values *= np.clip(1.3 - np.sqrt(sum(a * a for a in axes)), 0, 1)
        values /= values.max()
    if rng.random() < 0.3:
        values = (values > 0.5) * 0.8 + 0.1 * values
    edge = 2 / max(shape)
    if bcc:
        return ss.RegularField(values, spacing=(edge,) * 3, origin=(-1, -1, -0.5), lattice="bcc")
    spacing = (edge,) * 3 if rng.random() < 0.6 else tuple((edge * rng.uniform(0.6, 1.4, 3)).tolist())
    return ss.RegularField(values, spacing=spacing, origin=(-1, -1, -1))


def _ellipsoids(rng: np.random.Generator) -> ss.EllipsoidField:
    count = int(rng.integers(20, 400))
    field = scene_parts.cloud(rng, count, rng.uniform(2, 12), 10 ** rng.uniform(0, 1))
    if rng.random() < 0.3:
        field["scales"] = field["scales"] * 10 ** rng.uniform(-0.7, 0.3, (count, 1))
    field["w0"] = float(rng.choice([0.3, 1.0]))
    if rng.random() < 0.3:
        field["normalization"] = "none"
    return ss.EllipsoidField(**field)


def _transfer(rng: np.random.Generator) -> tuple[ss.TransferFunction, bool]:
    count = int(rng.integers(2, 6))
    values = np.sort(rng.uniform(0.02, 1, count))
    opacity = np.sort(rng.random(count)) * rng.choice([0.03, 0.2, 0.6, 0.95])
    opacity[0] = 0
    if rng.random() < 0.3:
        rng.shuffle(opacity[1:])
    step = count > 2 and rng.random() < 0.3
    if step:
        values[count // 2] = values[count // 2 - 1]
    points = [(float(v), *rng.random(3).tolist(), float(a)) for v, a in zip(values, opacity, strict=True)]
    return ss.TransferFunction(points), bool(step)


def random_case(seed: int, spacing: float | None = None) -> Case:
    """Return a case; spacing: of slices, in default distances (unless given ½, 1 or 2)."""
    rng = np.random.default_rng([20, 5, seed])
    kind = str(rng.choice(["cartesian", "cartesian", "bcc", "ellipsoids", "ellipsoids"]))
    field = _ellipsoids(rng) if kind == "ellipsoids" else _lattice(rng, kind == "bcc")
    transfer, step = _transfer(rng)
    lights = [ss.Light((0.4, 0.6, 1.0))] if rng.random() < 0.5 else []
    mode = str(rng.choice(["composite"] * 7 + ["xray", "mip", "isosurface"]))
    fixed: dict[str, Any] = {"mode": mode}
    if mode == "isosurface":
        fixed["iso_value"] = float(rng.uniform(0.15, 0.6))
    options: dict[str, Any] = {
        "sampling": str(rng.choice(["point", "slab"])),
        "opacity_stop": float(rng.choice([0.98, 1.0, 0.9])),
    }
    if mode == "composite":
        options["preintegration"] = [False, False, False, True, "second_order"][rng.integers(5)]
    projection = str(rng.choice(["orthographic", "perspective"]))
    direction, up = (tuple(scene_parts.unit(rng.normal(size=3)).tolist()) for _ in range(2))
    camera = ss.Camera.fit(field, direction=direction, up=up, kind=projection)
    times = float(rng.choice([0.5, 1.0, 2.0])) if spacing is None else spacing
    scene = ss.Scene(field, transfer, lights=lights, **fixed)
    return _case(kind, scene, camera, options, times, step)


def _case(
    kind: str, scene: ss.Scene, camera: ss.Camera, options: dict[str, Any], times: float, step: bool = False
) -> Case:
    spacing = scene.slice_spacing
    options = options | {"slice_spacing": spacing * times, "reference_length": scene.reference_length}
    words = [kind, scene.mode, options["sampling"], f"stop {options['opacity_stop']:g}", f"{times:g} ds"]
    if options.get("preintegration"):
        words.append("second" if options["preintegration"] == "second_order" else "first")
    words += ["lit"] * bool(scene.lights) + ["step"] * step + ["perspective"] * ("perspective" in repr(camera).lower())
    return Case(" ".join(words), scene, camera, options, spacing)


def measured_cases(folder: Path, reduced: int = 2) -> list[Case]:
    """Return cases of measured volumes, every so many samples along each axis: flat and lit, soft and hard."""
    from sheetsplat import io

    names = ("nucleon_41x41x41", "tooth_103x94x161", "engine_256x256x128", "lobster_120x120x34", "mrbrain_128x128x84")
    cases = []
    for number, name in enumerate(names):
        found = sorted(folder.glob(f"{name}*.nrrd"))
        if not found:
            continue
        volume = io.read_volume(found[0])
        every = reduced if max(volume.values.shape) < 130 else 2 * reduced
        values = np.asarray(volume.values, np.float64)[::every, ::every, ::every]
        field = ss.RegularField(values / values.max(), spacing=tuple(every * s for s in volume.spacing))
        for lit, opacity in ((False, 0.05), (True, 0.3), (True, 0.9)):
            transfer = ss.TransferFunction(
                [(0.15, 0.2, 0.4, 0.8, 0), (0.5, 0.9, 0.5, 0.2, opacity), (1, 1, 1, 1, opacity)]
            )
            scene = ss.Scene(field, transfer, lights=[ss.Light((0.4, 0.6, 1.0))] if lit else [])
            camera = ss.Camera.fit(
                field, direction=(-0.5, -0.4, -0.8), kind=("orthographic", "perspective")[number % 2]
            )
            options = {
                "sampling": "point",
                "opacity_stop": 0.98 if opacity > 0.05 else 1.0,
                "preintegration": [False, True, False][number % 3],
            }
            cases.append(_case(name.split("_")[0], scene, camera, options, (0.5, 1.0, 2.0)[number % 3]))
    return cases


def difference(a: NDArray[Any], b: NDArray[Any], most_apart: float = 0.0) -> Array:
    """Return a - b, infinite where more than that share of the pixels have a number (NaN: none) in one picture alone.

    Of fewer such pixels, NaN is taken as 0.
    """
    if np.mean(np.isnan(a) != np.isnan(b)) > most_apart:
        return np.full(a.shape, np.inf)
    return np.nan_to_num(np.asarray(a, np.float64)) - np.nan_to_num(np.asarray(b, np.float64))


def rmse(picture: ss.Image, reference: ss.Image) -> float:
    """Return the root mean square difference; scalars are divided by max(1, largest of the reference).

    It is infinite where slices count in one picture alone: of other slices, at more than `OUTLINE` of the pixels.
    """
    a, b = picture.pixels, reference.pixels
    same = picture.plan.slice_spacing == reference.plan.slice_spacing
    scale = max(1.0, float(np.nanmax(b, initial=0.0))) if b.ndim == 2 else 1.0
    return float(np.sqrt(np.mean((difference(a, b, 0.0 if same else OUTLINE) / scale) ** 2)))


def exact_renderer() -> ss.Renderer:
    """Return a renderer in float64, for converged pictures."""
    return ss.Renderer("cpu", precision="float64", allow_inexact=True)


def converged(
    renderer: ss.Renderer, case: Case, size: tuple[int, int], spacing: float | None = None, **changes: Any
) -> ss.Image:
    """Return the picture without a stop at `CONVERGED` slice distances of the case, or at the one that is given."""
    fine = spacing if spacing is not None else case.options["slice_spacing"] * CONVERGED
    scene = case.drawn(slice_spacing=fine, opacity_stop=1.0, **changes)
    return renderer.render(scene, case.camera, size)

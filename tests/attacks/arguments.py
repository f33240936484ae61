"""Foreign objects as arguments of every public function: an error of the package at once, and no half-written file."""

from __future__ import annotations

import inspect
import os
import random
import resource
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import sheetsplat as ss
from attacks import Tally, soon
from attacks.values import FOREIGN
from sheetsplat import tiles
from sheetsplat.options.bricks import OpenBricksOptions
from sheetsplat.options.core import definitions
from sheetsplat.options.film import AnimateOptions, TurntableOptions
from sheetsplat.options.picture import RenderOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions

_SECONDS = 20
# Objects that are called, and parameters, by the function's name or "" for all, that take functions: what a function of
# the caller raises is the caller's.
_CALLED = ("type", "raising function", "function", "raises", "raises on everything")
_CALL = {("", "cmap"), ("", "progress"), ("", "opacity"), ("fit.solid", "values")}
# The first parameter, whatever its name is.
_FIRST = "the first"
# Of address space: whoever makes a list of a range without an end is told so before the machine is full.
_MEMORY = 6 << 30


class Calls:
    """Public functions by name, each with arguments that are right, and names of more that it takes.

    Parameters
    ----------
    folder
        Where files are written.
    """

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(0)
        samples = rng.random((6, 6, 6))
        self.folder = folder
        np.save(folder / "v.npy", samples)
        field = ss.RegularField(samples)
        dots = ss.EllipsoidField(rng.random((20, 3)), np.full(20, 0.2), values=rng.random(20))
        table = ss.TransferFunction([(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)])
        scene, camera = ss.Scene(field, table), ss.Camera.fit(field)
        self.image = ss.render(samples, size=12, backend="cpu", quality="draft")
        scalar = ss.render(samples, size=12, backend="cpu", mode="mip", quality="draft", outputs="depth")
        base: dict[str, Any] = {"size": 8, "backend": "cpu", "quality": "draft", "threads": 1}
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        vectors = {"eye": (9, 9, 9), "target": (0, 0, 0), "up": (0, 0, 1)}
        film = ss.turntable(samples, frames=2, **base)

        def options(kind: Any, *left_out: str) -> list[str]:
            return [name for name in definitions(kind) if name not in left_out]

        def save_film(**given: Any) -> Any:
            return film.save(**given)

        self.calls: dict[str, tuple[Callable[..., Any], dict[str, Any], list[str]]] = {
            "render": (ss.render, {"data": samples, **base}, options(RenderOptions, "client")),
            "render dots": (ss.render, {"data": dots, **base}, options(RenderOptions, "client")),
            "open": (
                ss.open,
                {"path": folder / "v.npy"},
                options(
                    OpenBricksOptions,
                    "brick",
                    "levels",
                    "brick_kernels",
                    "scratch",
                    "client",
                    "worker_timeout",
                    "progress",
                ),
            ),
            "open_bricks": (ss.open_bricks, {"path_or_array": samples, "brick": 16}, options(OpenBricksOptions)),
            "turntable": (ss.turntable, {"data": samples, "frames": 2, **base}, options(TurntableOptions, "client")),
            "animate": (
                ss.animate,
                {"function_or_sequence": [samples, samples], "frames": 2, **base},
                options(AnimateOptions, "client"),
            ),
            "Animation.save": (
                save_film,
                {"path": folder / "film", "overwrite": True},
                ["fps", "workers", "worker_timeout", "progress", "metadata"],
            ),
            "CameraPath": (ss.CameraPath, {"keys": [camera, camera]}, ["times", "closed"]),
            "Scene": (ss.Scene, {"field": field, "transfer_function": table}, options(SceneOptions)),
            "Renderer": (ss.Renderer, {"backend": "cpu"}, options(RendererClassOptions)),
            "Renderer.render": (
                ss.Renderer("cpu").render,
                {"scene": scene, "camera": camera, "size": (8, 8)},
                ["outputs", "progress", "depth_limit"],
            ),
            "Renderer.plan": (ss.Renderer("cpu").plan, {"scene": scene, "camera": camera, "size": (8, 8)}, ["outputs"]),
            "Renderer.progressive": (
                self._stages,
                {"scene": scene, "camera": camera, "size": (8, 8)},
                ["outputs", "progress", "depth_limit"],
            ),
            "Renderer.measure_effects": (
                ss.Renderer("cpu", threads=1).measure_effects,
                {"scene": scene, "camera": camera, "size": (4, 4), "repeats": 1},
                [],
            ),
            "Scene.replace": (scene.replace, {}, options(SceneOptions)),
            "render_tiles": (
                tiles.render_tiles,
                {"scene": scene, "camera": camera, "size": (8, 8), "path": folder / "tiles.npy", "tile": 5},
                [],
            ),
            "window": (tiles.window, {"camera": camera, "size": (9, 9), "at": (1, 2), "extent": (3, 4)}, []),
            "Camera.fit": (
                ss.Camera.fit,
                {"field": field, "direction": "x"},
                ["up", "azimuth", "elevation", "zoom", "margin"],
            ),
            "Camera.orthographic": (ss.Camera.orthographic, {**vectors, "height": 3}, []),
            "Camera.perspective": (ss.Camera.perspective, {**vectors, "fov_y": 30}, ["near"]),
            "RegularField": (
                ss.RegularField,
                {"values": samples},
                ["spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "prefilter", "nan"],
            ),
            "RegularField.evaluate": (field.evaluate, {"points": corners}, []),
            "EllipsoidField": (ss.EllipsoidField, {"centers": corners, "scales": np.ones(4), "values": np.ones(4)}, []),
            "TransferFunction": (ss.TransferFunction, {"points": [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]}, []),
            "TransferFunction.from_colormap": (
                ss.TransferFunction.from_colormap,
                {"cmap": "viridis", "opacity": 0.5, "clim": (0, 1)},
                [],
            ),
            "TransferFunction.preset": (ss.TransferFunction.preset, {"name": "ct_bone"}, []),
            "TransferFunction.from_curves": (
                ss.TransferFunction.from_curves,
                {"colors": [(0, 1, 1, 1)], "opacities": [(0, 1)]},
                [],
            ),
            "ScalarColors": (ss.ScalarColors, {"cmap": "gray"}, ["clim", "log"]),
            "Light": (ss.Light, {"direction": (1, 0, 0)}, ["color", "space"]),
            "Material": (ss.Material, {}, ["ambient", "diffuse", "specular", "shininess", "two_sided"]),
            "Clip": (ss.Clip, {}, ["planes", "box"]),
            "DepthCue": (ss.DepthCue, {"start": 0, "end": 9}, ["strength", "color"]),
            "AmbientOcclusion": (ss.AmbientOcclusion, {"radius": 2}, ["strength"]),
            "Quantity": (ss.Quantity, {}, ["name", "units", "floor", "axes"]),
            "Image.save": (self.image.save, {"path": folder / "a.png"}, ["metadata"]),
            "Image.to_png": (self.image.to_png, {}, ["metadata", "texts"]),
            "Image.pick": (self.image.pick, {"x": 4.0, "y": 4.0}, []),
            "Image.with_rgba": (self.image.with_rgba, {"rgba": self.image.rgba}, []),
            "Image.annotated": (scalar.annotated, {}, ["colorbar", "scalebar", "title", "size", "color", "axes"]),
            "Image.to_axes": (scalar.to_axes, {}, ["ax", "colorbar", "title"]),
            "accuracy": (
                ss.accuracy,
                {
                    "scene": scene,
                    "camera": camera,
                    "size": 8,
                    "backend": "cpu",
                    "repeats": 1,
                    "knobs": ["opacity_stop"],
                },
                [],
            ),
            "lattice_ripple": (ss.lattice_ripple, {"radius": 2.0, "falloff": 5.0}, ["lattice"]),
            "resample_to_bcc": (ss.resample_to_bcc, {"values": samples}, ["spacing", "origin"]),
            "SceneFile.read": (ss.SceneFile.read, {"path": folder / "no.toml"}, []),
            "fit.nearest": (ss.fit.nearest, {"points": rng.random((20, 3)), "values": np.ones(20)}, []),
            "fit.solid": (ss.fit.solid, {"vertices": corners, "triangles": faces, "spacing": 0.4}, []),
            "fit.delaunay": (ss.fit.delaunay, {"points": rng.random((9, 3)), "values": np.ones(9)}, []),
            "fit.sph": (
                ss.fit.sph,
                {"points": rng.random((9, 3)), "values": np.ones(9), "smoothing_lengths": np.full(9, 0.3)},
                [],
            ),
            "fit.winding_numbers": (
                ss.fit.winding_numbers,
                {"vertices": corners, "triangles": faces, "points": corners},
                [],
            ),
            "fit.read_mesh": (ss.fit.read_mesh, {"path": folder / "no.obj"}, []),
            "view": (
                self._view,
                {"data": samples, "browser": False, **base},
                ["choices", "times", "host", "port", *options(RenderOptions, "client")],
            ),
            "datasets.noisy_ball": (ss.datasets.noisy_ball, {}, ["n", "edge", "size", "seed"]),
            "io.save_npz": (ss.io.save_npz, {"path": folder / "dots.npz", "field": dots}, []),
        }
        self._use_what_is_taken()
        self._add_xarray(samples, base)

    def _stages(self, **given: Any) -> Any:
        return list(ss.Renderer("cpu", threads=1).progressive(**given))

    def _view(self, **given: Any) -> Any:
        ss.view(**given).close()

    def _use_what_is_taken(self) -> None:
        """Add the parameters that each function has, and leave out names that it does not know."""
        for name, (function, given, more) in list(self.calls.items()):
            parameters = inspect.signature(function).parameters
            names = [one for one, how in parameters.items() if how.kind not in (how.VAR_KEYWORD, how.VAR_POSITIONAL)]
            takes_all = any(how.kind == how.VAR_KEYWORD for how in parameters.values())
            known = [one for one in more if takes_all or one in names]
            added = [one for one in names if one not in given and one not in known]
            first = [one for one in names if one not in given][:1] if list(given)[:1] == [_FIRST] else []
            right = {(first[0] if one == _FIRST else one): value for one, value in given.items()}
            self.calls[name] = function, right, [*known, *[one for one in added if one not in right]]

    def _add_xarray(self, samples: Any, base: dict[str, Any]) -> None:
        try:
            import xarray

            import sheetsplat.integrations.xarray  # noqa: F401
        except ImportError:
            return
        array = xarray.DataArray(samples, dims=("z", "y", "x"), name="rho")
        self.calls["xarray render"] = array.sheetsplat.render, dict(base), list(definitions(RenderOptions))


def _is_of_python(error: BaseException) -> bool:
    """Return whether Python itself refused the call: a name given twice, or missing."""
    return isinstance(error, TypeError) and traceback.extract_tb(error.__traceback__)[-1].name in ("_called",)


def _called(function: Callable[..., Any], given: dict[str, Any]) -> Any:
    return function(**given)


def foreign_arguments(seed: int, count: int) -> Tally:
    """Call public functions with one argument or two of a foreign kind."""
    tally, rng = Tally(), random.Random(seed)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, limits[1]))
    kinds: Counter[str] = Counter()
    where = os.getcwd()
    try:
        with tempfile.TemporaryDirectory() as name, warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            calls = Calls(Path(name))
            os.chdir(name)
            for number in range(count):
                one = rng.choice(sorted(calls.calls))
                function, right, more = calls.calls[one]
                changed = rng.sample(sorted({*right, *more}), min(rng.choice((1, 1, 1, 2)), len({*right, *more})))
                chosen = {name: rng.choice(sorted(FOREIGN)) for name in changed}
                given = {**right, **{name: FOREIGN[kind]() for name, kind in chosen.items()}}
                said = f"{number}: {one} with {chosen}"
                tally.did("calls")
                try:
                    with soon(tally, said, _SECONDS):
                        _called(function, given)
                        tally.did("calls that work")
                except ss.Error as error:
                    tally.did("errors of the package")
                    if len(str(error)) > 4000 or not str(error).strip():
                        tally.failed(f"{said}: a message of {len(str(error))} characters")
                except Exception as error:  # Whatever else is raised is what is looked for.
                    called = [at for at, kind in chosen.items() if kind in _CALLED]
                    own = any({("", at), (one, at)} & _CALL for at in called)
                    if not own and not _is_of_python(error):
                        last = traceback.extract_tb(error.__traceback__)[-1]
                        place = f"{Path(last.filename).name}:{last.lineno}"
                        kinds[f"{type(error).__name__} at {place}"] += 1
                        tally.did(f"foreign: {type(error).__name__} at {place} ({one})")
                        if kinds[f"{type(error).__name__} at {place}"] == 1:
                            frames = [
                                f"{Path(at.filename).name}:{at.lineno}"
                                for at in traceback.extract_tb(error.__traceback__)
                            ]
                            tally.failed(f"{said}: {type(error).__name__}: {str(error)[:200]!r} {frames[-6:]}")
            left = [path for path in Path(name).iterdir() if path.name.startswith(".") or path.suffix == ".part"]
            if left:
                tally.failed(f"half-written files: {left}")
    finally:
        os.chdir(where)
        resource.setrlimit(resource.RLIMIT_AS, limits)
    return tally

"""VTK's two volume ray casters, in a process of their own that keeps their context, threads and faults apart."""

from __future__ import annotations

import importlib
import importlib.util
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.measure import forget_peak, resident

Caster = Literal["cpu", "gpu"]

#: Classes that are measured.
CASTERS: dict[Caster, str] = {"cpu": "vtkFixedPointVolumeRayCastMapper", "gpu": "vtkOpenGLGPUVolumeRayCastMapper"}
# Time allowed to the other process for one answer, s.
_PATIENCE = 300.0


@dataclass(frozen=True)
class Volume:
    """Samples [k, j, i] on a Cartesian lattice, as VTK takes them.

    Attributes
    ----------
    values
        The samples.
    spacing, origin
        World units between samples along x, y, z, and where sample (0, 0, 0) is.
    """

    values: NDArray[Any]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """How a volume is shown.

    Attributes
    ----------
    points
        (value, red, green, blue, opacity per `unit`) of the transfer function, linear in between.
    unit
        Reference length of opacities, world units.
    distance
        Distance of samples along a ray, world units.
    material
        Phong coefficients under one white head light; None: unlit.
    size
        (width, height) in pixels.
    threads
        Threads of the processor's ray caster.
    """

    points: tuple[tuple[float, float, float, float, float], ...]
    unit: float
    distance: float
    material: ss.Material | None
    size: tuple[int, int]
    threads: int


@dataclass(frozen=True)
class Shot:
    """One frame of VTK.

    Attributes
    ----------
    wall, cpu
        Elapsed seconds and those of all threads of its process, from the change of the camera until the picture is
        a NumPy array.
    rgba
        Premultiplied colours, (h, w, 4), in 256 steps; None unless requested.
    """

    wall: float
    cpu: float
    rgba: NDArray[np.float32] | None


class VtkMissing(Exception):
    """VTK cannot be measured here; the message says why."""


class Vtk:
    """VTK in its own process; a context manager. Raises VtkMissing if it does not start or does not answer."""

    def __init__(self) -> None:
        if importlib.util.find_spec("vtk") is None:
            raise VtkMissing("the package vtk is not installed (pip install vtk, or the extra sheetsplat[bench])")
        # A child of multiprocessing would run the caller's script again.
        self._pipe, other = multiprocessing.Pipe()
        script = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve(int(sys.argv[1]))"
        with other:
            command = [sys.executable, "-c", script, str(other.fileno())]
            self._process = subprocess.Popen(command, pass_fds=(other.fileno(),))
        try:
            self.version = str(self._ask("version"))
        except VtkMissing:
            self.close()
            raise

    def __enter__(self) -> Vtk:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        try:
            self._pipe.send(None)
        except OSError:
            pass
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._pipe.close()

    def show(self, caster: Caster, volume: Volume, look: Look) -> str:
        """Prepare a volume in place of what this caster showed before; return class, window and device in words."""
        material = None
        if look.material is not None:
            one = look.material
            material = (one.ambient, one.diffuse, one.specular, one.shininess, one.two_sided)
        told = self._ask(
            "show",
            caster,
            (np.ascontiguousarray(volume.values), volume.spacing, volume.origin),
            (look.points, look.unit, look.distance, material, look.size, look.threads),
        )
        return str(told)

    @property
    def peak(self) -> int:
        """The most bytes that its process had in memory since `forget_peak`."""
        return resident("VmHWM", self._process.pid)

    def forget_peak(self) -> None:
        """Let `peak` count from here on."""
        forget_peak(self._process.pid)

    def forget(self) -> None:
        """Release what is shown."""
        self._ask("forget")

    def frame(self, caster: Caster, camera: ss.Camera, *, picture: bool = False) -> Shot:
        """Draw an orthographic view and read it back."""
        wall, cpu, rgba = self._ask(
            "frame", caster, camera.eye, camera.target, camera.up, 0.5 * camera.height, bool(picture)
        )
        return Shot(float(wall), float(cpu), rgba)

    def _ask(self, *words: object) -> Any:
        try:
            self._pipe.send(words)
            if not self._pipe.poll(_PATIENCE):
                raise VtkMissing(f"VTK gave no answer within {_PATIENCE:g} s")
            fine, answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise VtkMissing(f"VTK's process ended ({type(error).__name__}); it may have found no OpenGL") from error
        if not fine:
            raise VtkMissing(str(answer))
        return answer


# ------------------------------------------------------------------------------------------------- the other process


def serve(handle: int) -> None:
    """Answer requests through a pipe until it ends."""
    pipe: Any = Connection(handle)
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    shown: dict[str, _Window] = {}
    while True:
        try:
            words = pipe.recv()
        except EOFError:
            return
        if words is None:
            # Windows end before the library does.
            shown.clear()
            return
        try:
            answer: Any = None
            if words[0] == "version":
                answer = importlib.import_module("vtk").vtkVersion().GetVTKVersion()
            elif words[0] == "show":
                shown.pop(words[1], None)
                shown[words[1]] = _Window(words[1], *words[2:])
                answer = shown[words[1]].kind
            elif words[0] == "forget":
                shown.clear()
            else:
                answer = shown[words[1]].frame(*words[2:])
            pipe.send((True, answer))
        except Exception as error:  # noqa: BLE001 - the message goes to the caller
            pipe.send((False, f"{type(error).__name__}: {error}"))


class _Window:
    """A volume in a window off the screen."""

    def __init__(self, caster: str, volume: tuple[Any, Any, Any], look: tuple[Any, ...]) -> None:
        vtk: Any = importlib.import_module("vtk")
        support: Any = importlib.import_module("vtk.util.numpy_support")
        self._vtk, self._support = vtk, support
        values, spacing, origin = volume
        points, unit, distance, material, self._size, threads = look

        # VTK uses the memory of the array.
        self._values = values
        image = vtk.vtkImageData()
        image.SetDimensions(*values.shape[::-1])
        image.SetSpacing(*spacing)
        image.SetOrigin(*origin)
        image.GetPointData().SetScalars(support.numpy_to_vtk(values.ravel()))

        mapper = getattr(vtk, CASTERS["cpu" if caster == "cpu" else "gpu"])()
        mapper.SetInputData(image)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetSampleDistance(distance)
        mapper.SetImageSampleDistance(1.0)
        if caster == "cpu":
            mapper.SetInteractiveSampleDistance(distance)
            mapper.SetIntermixIntersectingGeometry(0)
            mapper.SetNumberOfThreads(threads)
        else:
            mapper.SetUseJittering(0)
            mapper.SetLockSampleDistanceToInputSpacing(0)

        color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
        for value, red, green, blue, alpha in points:
            color.AddRGBPoint(value, red, green, blue)
            opacity.AddPoint(value, alpha)
        surface = vtk.vtkVolumeProperty()
        surface.SetColor(color)
        surface.SetScalarOpacity(opacity)
        surface.SetScalarOpacityUnitDistance(unit)
        surface.SetInterpolationTypeToLinear()
        surface.SetShade(material is not None)

        window, renderer = vtk.vtkRenderWindow(), vtk.vtkRenderer()
        window.SetOffScreenRendering(1)
        window.SetMultiSamples(0)
        window.SetAlphaBitPlanes(1)
        window.SetSize(*self._size)
        window.AddRenderer(renderer)
        renderer.SetBackground(0.0, 0.0, 0.0)
        renderer.SetBackgroundAlpha(0.0)
        renderer.AutomaticLightCreationOff()
        light = vtk.vtkLight()
        light.SetLightTypeToHeadlight()
        light.SetPositional(0)
        # The processor's caster shows no ambient term unless the light has an ambient colour.
        light.SetAmbientColor(1.0, 1.0, 1.0)
        renderer.AddLight(light)
        if material is not None:
            ambient, diffuse, specular, shininess, two_sided = material
            surface.SetAmbient(ambient)
            surface.SetDiffuse(diffuse)
            surface.SetSpecular(specular)
            # It takes the angle to the half vector, which is half of that to the mirrored light: four times the power
            # gives a highlight as wide.
            surface.SetSpecularPower(4.0 * shininess if caster == "cpu" else shininess)
            renderer.SetTwoSidedLighting(two_sided)
        thing = vtk.vtkVolume()
        thing.SetMapper(mapper)
        thing.SetProperty(surface)
        renderer.AddVolume(thing)
        renderer.GetActiveCamera().SetParallelProjection(1)
        self._window, self._renderer, self._pixels = window, renderer, vtk.vtkUnsignedCharArray()
        window.Render()
        told = [
            line.split(":", 1)[1].strip() for line in window.ReportCapabilities().splitlines() if "renderer" in line
        ]
        self.kind = f"{type(mapper).__name__} in {type(window).__name__} ({told[0] if told else 'unknown OpenGL'})"

    def frame(
        self, eye: Sequence[float], target: Sequence[float], up: Sequence[float], scale: float, picture: bool
    ) -> tuple[float, float, NDArray[np.float32] | None]:
        width, height = self._size
        wall, cpu = time.perf_counter(), time.process_time()
        camera = self._renderer.GetActiveCamera()
        camera.SetPosition(*eye)
        camera.SetFocalPoint(*target)
        camera.SetViewUp(*up)
        camera.SetParallelScale(scale)
        self._renderer.ResetCameraClippingRange()
        self._window.Render()
        self._window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, self._pixels)
        read = self._support.vtk_to_numpy(self._pixels).reshape(height, width, 4)[::-1].copy()
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        return wall, cpu, read.astype(np.float32) / 255.0 if picture else None

"""What a plotter of PyVista shows, as arrays: colours and depths of its surfaces, and what is drawn over them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Unsupported, complain

Floats = NDArray[np.float32]
Depths = NDArray[np.float64]

_WHAT = "composite: this plotter cannot be drawn with a volume"
_BLACK, _WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


class SurfacePicture(NamedTuple):
    """A picture of opaque surfaces.

    Attributes
    ----------
    colors
        float32 (h, w, 3), 0 to 1, row 0 at the top; the plotter's background where there is no surface.
    depths
        float64 (h, w), world units from the eye along the view direction; infinite where there is no surface.
    over
        float32 (h, w, 4), premultiplied: texts, labels, bars and orientation axes, which are drawn over everything;
        None without any.
    """

    colors: Floats
    depths: Depths
    over: Floats | None


def surface_picture(plotter: Any, size: tuple[int, int]) -> SurfacePicture:
    """Return what a plotter shows; the plotter stays as it is.

    Parameters
    ----------
    plotter
        A ``pyvista.Plotter`` with one view that was not closed; its camera is placed.
    size
        (width, height) in pixels.

    Raises
    ------
    Unsupported
        For what hides only a part of the light behind it, or has no depth: translucent surfaces, VTK's own volumes,
        render passes; for several views, and closed plotters.
    """
    refuse_unusable(plotter)
    window = plotter.render_window
    with contextlib.ExitStack() as undo:
        # Last of all: a window that is open, or read again, shows its own picture.
        undo.callback(window.Render)
        # Pixels at edges would have the colour of several depths.
        _set(undo, window.SetMultiSamples, window.GetMultiSamples(), 0)
        _set(undo, window.SetOffScreenRendering, window.GetOffScreenRendering(), 1)
        before = tuple(window.GetSize())
        undo.callback(window.SetSize, *before)
        window.SetSize(*size)
        main = plotter.renderer
        near_far = main.GetActiveCamera().GetClippingRange()
        undo.callback(main.GetActiveCamera().SetClippingRange, *near_far)
        main.ResetCameraClippingRange()
        others = [one for one in _items(window.GetRenderers()) if one is not main and one.GetDraw()]
        beneath = [one for one in others if one.GetLayer() < main.GetLayer()]
        above = [one for one in others if one not in beneath]
        flat = [one for one in _items(main.GetViewProps()) if one.IsA("vtkActor2D") and one.GetVisibility()]
        with contextlib.ExitStack() as hidden:
            for actor in flat:
                _set(hidden, actor.SetVisibility, 1, 0)
            for one in above:
                _set(hidden, one.SetDraw, 1, 0)
            window.Render()
            colors = _colors(window)
            depths = _depths(window, main.GetActiveCamera())
        over = _overlay(window, main, beneath) if flat or above else None
    return SurfacePicture(colors, depths, over)


def _set(undo: contextlib.ExitStack, setter: Callable[[Any], object], before: Any, value: Any) -> None:
    """Call a setter now, and with the value before at the end."""
    undo.callback(setter, before)
    setter(value)


def _items(collection: Any) -> list[Any]:
    """Return the items of a collection of VTK."""
    return [collection.GetItemAsObject(n) for n in range(collection.GetNumberOfItems())]


def _visible_props(renderer: Any) -> list[Any]:
    """Return what of a renderer is in the world and shown."""
    return [one for one in _items(renderer.GetViewProps()) if one.GetVisibility() and not one.IsA("vtkActor2D")]


def refuse_unusable(plotter: Any) -> None:
    """Raise Unsupported for plotters whose pictures do not have one colour and depth at each pixel."""
    if plotter.render_window is None:
        raise _refused("a plotter that was closed", "an open one", "pass auto_close=False to show")
    if len(plotter.renderers) > 1:
        raise _refused(f"{len(plotter.renderers)} views", "one view", "make a plotter for each")
    main = plotter.renderer
    if main.GetPass() is not None:
        advice = "leave out SSAA, EDL, SSAO, shadows, blur and depth of field"
        raise _refused("a render pass, which changes colours after depths are known", "none", advice)
    for prop in _visible_props(main):
        if prop.IsA("vtkVolume"):
            raise _refused("a volume that VTK draws", "surfaces", "give it to composite as data, and hide it in VTK")
        if prop.HasTranslucentPolygonalGeometry():
            advice = "make it opaque, hide it, or give it as data, which may be as translucent as you like"
            raise _refused("a translucent surface", "opaque surfaces: others have no single depth", advice)
    scale = [float(part) for part in plotter.scale]
    if scale != [1.0, 1.0, 1.0]:
        raise _refused(f"surfaces scaled by {tuple(scale)}", "surfaces in world units", "scale the data instead")


def _refused(found: str, wanted: str, advice: str) -> Exception:
    return complain(_WHAT, found, wanted, advice, kind=Unsupported)


def _read(window: Any, depth: bool) -> NDArray[Any]:
    """Return the last picture of a window, or its depth buffer; row 0 at the top."""
    from vtkmodules.util.numpy_support import vtk_to_numpy  # type: ignore[import-not-found, unused-ignore]
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter  # type: ignore[import-not-found, unused-ignore]

    reader = vtkWindowToImageFilter()
    reader.SetInput(window)
    reader.ReadFrontBufferOff()
    reader.ShouldRerenderOff()
    if depth:
        reader.SetInputBufferTypeToZBuffer()
    else:
        reader.SetInputBufferTypeToRGB()
    reader.Update()
    output = reader.GetOutput()
    width, height, _ = output.GetDimensions()
    pixels: NDArray[Any] = vtk_to_numpy(output.GetPointData().GetScalars()).reshape(height, width, -1)[::-1]
    return pixels


def _colors(window: Any) -> Floats:
    return np.asarray(_read(window, depth=False)[..., :3], dtype=np.float32) / np.float32(255.0)


def _depths(window: Any, camera: Any) -> Depths:
    """Return the depths of the last picture's surfaces."""
    buffer = _read(window, depth=True)[..., 0].astype(np.float64)
    near, far = camera.GetClippingRange()
    if camera.GetParallelProjection():
        depths = near + buffer * (far - near)
    else:
        depths = near * far / (far - buffer * (far - near))
    return np.where(buffer < 1.0, depths, np.inf)


def _overlay(window: Any, main: Any, beneath: list[Any]) -> Floats:
    """Return what is drawn over the surfaces: over black and over white, the differences are what shows through.

    Surfaces stay where they are, in one colour with the background, so that labels behind them stay hidden.
    """
    with contextlib.ExitStack() as undo:
        for one in beneath:
            _set(undo, one.SetDraw, 1, 0)
        for name in ("GradientBackground", "TexturedBackground"):
            _set(undo, getattr(main, f"Set{name}"), getattr(main, f"Get{name}")(), False)
        undo.callback(main.SetBackground, *main.GetBackground())
        plain = [_in_one_color(prop, undo) for prop in _visible_props(main)]
        pictures = []
        for color in (_BLACK, _WHITE):
            main.SetBackground(*color)
            for surface in plain:
                if surface is not None:
                    surface.SetColor(*color)
            window.Render()
            pictures.append(_colors(window))
    black, white = pictures
    alpha = np.clip(1.0 - (white - black).max(axis=2, keepdims=True), 0.0, 1.0)
    return np.concatenate([black, alpha], axis=2, dtype=np.float32)


def _in_one_color(prop: Any, undo: contextlib.ExitStack) -> Any:
    """Draw an actor in one colour without light, whose property is returned; hide what has no property."""
    if not (prop.IsA("vtkActor") and prop.GetMapper() is not None):
        _set(undo, prop.SetVisibility, 1, 0)
        return None
    own = prop.GetProperty()
    flat = own.NewInstance()
    # Vertices and edges have colours of their own.
    flat.SetRepresentation(own.GetRepresentation())
    flat.SetPointSize(own.GetPointSize())
    flat.SetLineWidth(own.GetLineWidth())
    flat.SetBackfaceCulling(own.GetBackfaceCulling())
    flat.SetFrontfaceCulling(own.GetFrontfaceCulling())
    flat.LightingOff()
    _set(undo, prop.SetProperty, own, flat)
    _set(undo, prop.SetBackfaceProperty, prop.GetBackfaceProperty(), None)
    _set(undo, prop.SetTexture, prop.GetTexture(), None)
    mapper = prop.GetMapper()
    _set(undo, mapper.SetScalarVisibility, mapper.GetScalarVisibility(), 0)
    return flat

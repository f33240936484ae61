"""PyVista: the accessor ``grid.sheetsplat.render(…)`` of all its data sets, and volumes among a plotter's surfaces.

The accessor is registered as PyVista documents for `register_dataset_accessor` (0.48 and newer).

>>> from sheetsplat.integrations.pyvista import composite
>>> plotter = pyvista.Plotter(off_screen=True)
>>> plotter.add_mesh(surface)
>>> composite(plotter, volume).save("picture.png")
"""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np
import pyvista  # type: ignore[import-not-found, unused-ignore]

from sheetsplat import api
from sheetsplat._checks import image_size, shown
from sheetsplat.camera import Camera, bounds_of
from sheetsplat.errors import complain, option_refs
from sheetsplat.image import Image
from sheetsplat.integrations.accessor import Accessor
from sheetsplat.integrations.vtk_picture import refuse_unusable, surface_picture
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import SCALAR, check_names, documented, pick, pick_given
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.picture import RenderOptions
from sheetsplat.scene import Scene

__all__ = ["Accessor", "composite"]

_register: Any = pyvista.register_dataset_accessor
_register("sheetsplat", pyvista.DataObject)(Accessor)

_PLOTTERS: Any = pyvista.BasePlotter


@documented(RenderOptions, chooses=True)
def composite(
    plotter: Any, data: Any, *, transparent_background: bool = False, **options: Unpack[RenderOptions]
) -> Image:
    """Return a picture of a volume among the surfaces of a plotter of PyVista; each hides what lies behind it.

    The plotter draws its surfaces without anti-aliasing, and the volume is drawn up to the depth of the surface at each
    pixel and put over it. Labels, texts, scalar bars and orientation axes are on top of both. The plotter stays as it
    is; a camera that was not placed yet is placed to show surfaces and data.

    Parameters
    ----------
    plotter
        A ``pyvista.Plotter`` with one view, which was not closed; it need not have been shown. All surfaces are
        opaque.
    data
        What `sheetsplat.render` takes.
    transparent_background
        Whether the picture is transparent where there is neither surface nor volume, in place of the plotter's
        background.
    **options
        Those of RenderOptions but for camera and background, which are the plotter's, and depth_limit.

    Returns
    -------
    Image
        ``image.depth_limit`` has the depths of the surfaces; plan, statistics, `Image.error` and `Image.pick` are those
        of the volume.

    Raises
    ------
    InvalidInput
        For anything but a plotter, for options of the camera, and for modes that make no colours.
    Unsupported
        For translucent surfaces, volumes of VTK, render passes such as SSAO, several views, scaled surfaces, and
        cameras that `Camera.from_pyvista` does not take.
    Error
        What `sheetsplat.render` raises.

    Examples
    --------
    >>> import pyvista
    >>> from sheetsplat.integrations.pyvista import composite
    >>> plotter = pyvista.Plotter(off_screen=True, window_size=(64, 48))
    >>> actor = plotter.add_mesh(pyvista.Plane(center=(4, 4, 4), i_size=9, j_size=9), color="gray")
    >>> image = composite(plotter, values)
    >>> image.size, bool(np.isfinite(image.depth_limit).any())  # depths where there is a surface
    ((64, 48), True)
    >>> plotter.close()
    """
    check_names("composite", options, RenderOptions)
    if not isinstance(plotter, _PLOTTERS):
        raise complain("composite: there is no plotter", shown(plotter), "a pyvista.Plotter")
    clash = [
        name
        for name in (*pick_given(CameraOptions, options), "camera", "background", "depth_limit")
        if options.get(name) is not None
    ]
    if clash:
        raise complain(
            "composite: these options cannot be used",
            option_refs(dict.fromkeys(clash)) + " beside a plotter",
            "the camera and the background of the plotter",
            "set them there: plotter.camera_position, plotter.set_background",
        )
    mode = data.mode if isinstance(data, Scene) else options.get("mode")
    if mode in SCALAR:
        found = f"mode {mode!r}, whose pictures are numbers"
        raise complain("composite: this mode cannot be used", found, "mode composite or isosurface", option="mode")
    refuse_unusable(plotter)
    given = options.pop("size", None)
    size = image_size(plotter.window_size if given is None else given)
    if not plotter.camera_set:
        _place_camera(plotter, data, options)
    camera = Camera.from_pyvista(plotter, size)
    surfaces = surface_picture(plotter, size)
    asked: dict[str, Any] = {**options, "camera": camera, "size": size, "depth_limit": surfaces.depths}
    image = api.render(data, **asked)
    there = np.isfinite(surfaces.depths) if transparent_background else np.ones(surfaces.depths.shape, dtype=bool)
    picture = _over(image.rgba, np.dstack([surfaces.colors, np.ones(there.shape)]) * there[..., None])
    return image.with_rgba(picture if surfaces.over is None else _over(surfaces.over, picture))


def _over(front: Any, back: Any) -> Any:
    """Return premultiplied colours in front of others."""
    return front + (1.0 - front[..., 3:]) * back


def _place_camera(plotter: Any, data: Any, options: Any) -> None:
    """Place the camera as the plotter's first picture would, so that it shows the data, too."""
    scene = data if isinstance(data, Scene) else api.to_fields(data, **pick(OpenOptions, options))
    boxes = [np.asarray(bounds_of(scene))]
    if any(prop.GetBounds() is not None for prop in plotter.renderer.actors.values() if hasattr(prop, "GetBounds")):
        boxes.append(np.asarray(plotter.bounds).reshape(3, 2).T)
    lower, upper = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    _, _, up = plotter.renderer.get_default_cam_pos()
    middle = 0.5 * (lower + upper)
    towards = np.asarray(plotter.theme.camera.position, dtype=np.float64)
    plotter.camera_position = [middle + towards, middle, up]
    plotter.renderer.ResetCamera(np.stack([lower, upper], axis=1).ravel().tolist())

"""Image-aligned sheet-buffer splatting of volumes.

A field of kernels becomes a picture: its kernels are summed in sheets parallel to the image, and the finished sheets
are classified, shaded and composited front to back.

>>> import sheetsplat as ss
>>> picture = ss.render("bonsai.nrrd")
>>> picture.save("bonsai.png")
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

# First of all: in a process of the command line it answers Ctrl-C until all others are read.
from sheetsplat import _interrupt as _interrupt
from sheetsplat._sheetsplat import __version__
from sheetsplat.accuracy import accuracy
from sheetsplat.api import open, render
from sheetsplat.camera import Camera
from sheetsplat.device import Device, devices
from sheetsplat.effects import AmbientOcclusion, Clip, DepthCue
from sheetsplat.errors import Cancelled, DeviceUnavailable, Error, InvalidInput, OutOfMemory, Unsupported
from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.image import ErrorEstimate, Image
from sheetsplat.light import Light, Material
from sheetsplat.notices import PictureWarning
from sheetsplat.orientation import Orientation
from sheetsplat.picking import Pick
from sheetsplat.plan import Effect, PictureQuality, QualitySetting, RenderPlan
from sheetsplat.quantity import Quantity
from sheetsplat.recipe import FieldRecipe, Recipe
from sheetsplat.renderer import Renderer
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

if TYPE_CHECKING:
    from sheetsplat import datasets as datasets
    from sheetsplat import fit as fit
    from sheetsplat import io as io
    from sheetsplat.accuracy import AccuracyReport as AccuracyReport
    from sheetsplat.accuracy import AccuracyRow as AccuracyRow
    from sheetsplat.animation import Animation as Animation
    from sheetsplat.animation import CameraPath as CameraPath
    from sheetsplat.animation import animate as animate
    from sheetsplat.animation import turntable as turntable
    from sheetsplat.bcc import resample_to_bcc as resample_to_bcc
    from sheetsplat.ripple import lattice_ripple as lattice_ripple
    from sheetsplat.scene_file import SceneFile as SceneFile
    from sheetsplat.viewer import Viewer as Viewer
    from sheetsplat.viewer import view as view

__all__ = [
    "AccuracyReport",
    "AccuracyRow",
    "AmbientOcclusion",
    "Animation",
    "Camera",
    "CameraPath",
    "Cancelled",
    "Clip",
    "DepthCue",
    "Device",
    "DeviceUnavailable",
    "Effect",
    "EllipsoidField",
    "Error",
    "ErrorEstimate",
    "FieldRecipe",
    "Image",
    "InvalidInput",
    "Light",
    "Material",
    "Orientation",
    "OutOfMemory",
    "Pick",
    "PictureQuality",
    "PictureWarning",
    "QualitySetting",
    "Quantity",
    "Recipe",
    "RegularField",
    "RenderPlan",
    "Renderer",
    "ScalarColors",
    "Scene",
    "SceneFile",
    "TransferFunction",
    "Unsupported",
    "Viewer",
    "__version__",
    "accuracy",
    "animate",
    "datasets",
    "fit",
    "io",
    "devices",
    "lattice_ripple",
    "open",
    "render",
    "resample_to_bcc",
    "turntable",
    "view",
]

logging.getLogger("sheetsplat").addHandler(logging.NullHandler())

# Read when first asked for, so that importing the package stays quick.
_LATE = {
    "Animation": ("sheetsplat.animation", "Animation"),
    "CameraPath": ("sheetsplat.animation", "CameraPath"),
    "animate": ("sheetsplat.animation", "animate"),
    "turntable": ("sheetsplat.animation", "turntable"),
    "AccuracyReport": ("sheetsplat.accuracy.report", "AccuracyReport"),
    "AccuracyRow": ("sheetsplat.accuracy.report", "AccuracyRow"),
    "SceneFile": ("sheetsplat.scene_file", "SceneFile"),
    "Viewer": ("sheetsplat.viewer", "Viewer"),
    "datasets": ("sheetsplat.datasets", None),
    "fit": ("sheetsplat.fit", None),
    "io": ("sheetsplat.io", None),
    "lattice_ripple": ("sheetsplat.ripple", "lattice_ripple"),
    "resample_to_bcc": ("sheetsplat.bcc", "resample_to_bcc"),
    "view": ("sheetsplat.viewer", "view"),
}


def __getattr__(name: str) -> Any:
    if name in _LATE:
        module, attribute = _LATE[name]
        found = importlib.import_module(module)
        return found if attribute is None else getattr(found, attribute)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)

"""Image-aligned sheet-buffer splatting of volumes.

A field of kernels becomes a picture: its kernels are summed in sheets parallel to the image, and the finished sheets
are classified, shaded and composited front to back.

>>> import sheetsplat as ss
>>> picture = ss.render("bonsai.nrrd")
>>> picture.save("bonsai.png")
"""

from __future__ import annotations

# First of all: in a process of the command line it answers Ctrl-C until all others are read.
from sheetsplat import _interrupt as _interrupt

# isort: split
import importlib
import logging
from typing import TYPE_CHECKING, Any

# A function and the package that it is in have the same name: only what is imported here keeps the name.
from sheetsplat.accuracy import accuracy

if TYPE_CHECKING:
    from sheetsplat import datasets as datasets
    from sheetsplat import fit as fit
    from sheetsplat import io as io
    from sheetsplat._sheetsplat import __version__ as __version__
    from sheetsplat.accuracy.report import AccuracyReport as AccuracyReport
    from sheetsplat.accuracy.report import AccuracyRow as AccuracyRow
    from sheetsplat.animation import Animation as Animation
    from sheetsplat.animation import CameraPath as CameraPath
    from sheetsplat.animation import Snapshot as Snapshot
    from sheetsplat.animation import animate as animate
    from sheetsplat.animation import turntable as turntable
    from sheetsplat.api import open as open
    from sheetsplat.api import render as render
    from sheetsplat.bcc import resample_to_bcc as resample_to_bcc
    from sheetsplat.bricks.opening import open_bricks as open_bricks
    from sheetsplat.camera import Camera as Camera
    from sheetsplat.describe.recipe import FieldRecipe as FieldRecipe
    from sheetsplat.describe.recipe import Recipe as Recipe
    from sheetsplat.describe.scene_file import SceneFile as SceneFile
    from sheetsplat.device import Device as Device
    from sheetsplat.device import devices as devices
    from sheetsplat.effects import AmbientOcclusion as AmbientOcclusion
    from sheetsplat.effects import Clip as Clip
    from sheetsplat.effects import DepthCue as DepthCue
    from sheetsplat.errors import Cancelled as Cancelled
    from sheetsplat.errors import DeviceUnavailable as DeviceUnavailable
    from sheetsplat.errors import Error as Error
    from sheetsplat.errors import InvalidInput as InvalidInput
    from sheetsplat.errors import OutOfMemory as OutOfMemory
    from sheetsplat.errors import Unsupported as Unsupported
    from sheetsplat.fields import BrickedField as BrickedField
    from sheetsplat.fields import BrickedKernels as BrickedKernels
    from sheetsplat.fields import EllipsoidField as EllipsoidField
    from sheetsplat.fields import RegularField as RegularField
    from sheetsplat.image import ErrorEstimate as ErrorEstimate
    from sheetsplat.image import Image as Image
    from sheetsplat.labels import LabelColors as LabelColors
    from sheetsplat.light import Light as Light
    from sheetsplat.light import Material as Material
    from sheetsplat.notices import PictureWarning as PictureWarning
    from sheetsplat.orientation import Orientation as Orientation
    from sheetsplat.picking import Pick as Pick
    from sheetsplat.plan import Effect as Effect
    from sheetsplat.plan import PictureQuality as PictureQuality
    from sheetsplat.plan import QualitySetting as QualitySetting
    from sheetsplat.plan import RenderPlan as RenderPlan
    from sheetsplat.quantity import Quantity as Quantity
    from sheetsplat.renderer import Renderer as Renderer
    from sheetsplat.ripple import lattice_ripple as lattice_ripple
    from sheetsplat.scalar_colors import ScalarColors as ScalarColors
    from sheetsplat.scene import Scene as Scene
    from sheetsplat.slice_planes import SlicePlane as SlicePlane
    from sheetsplat.transfer import TransferFunction as TransferFunction
    from sheetsplat.viewer import Viewer as Viewer
    from sheetsplat.viewer import view as view

__all__ = [
    "AccuracyReport",
    "AccuracyRow",
    "AmbientOcclusion",
    "BrickedField",
    "BrickedKernels",
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
    "LabelColors",
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
    "SlicePlane",
    "Snapshot",
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
    "open_bricks",
    "render",
    "resample_to_bcc",
    "turntable",
    "view",
]

logging.getLogger("sheetsplat").addHandler(logging.NullHandler())

# The module of each public name, imported when the name is first asked for: importing the package takes no time, and
# help on the command line needs neither NumPy nor the native module. The imports above tell type checkers the same.
_HOMES = {
    "_sheetsplat": ("__version__",),
    "accuracy.report": ("AccuracyReport", "AccuracyRow"),
    "animation": ("Animation", "CameraPath", "Snapshot", "animate", "turntable"),
    "api": ("open", "render"),
    "bcc": ("resample_to_bcc",),
    "bricks.opening": ("open_bricks",),
    "camera": ("Camera",),
    "device": ("Device", "devices"),
    "effects": ("AmbientOcclusion", "Clip", "DepthCue"),
    "errors": ("Cancelled", "DeviceUnavailable", "Error", "InvalidInput", "OutOfMemory", "Unsupported"),
    "fields": ("BrickedField", "BrickedKernels", "EllipsoidField", "RegularField"),
    "image": ("ErrorEstimate", "Image"),
    "labels": ("LabelColors",),
    "light": ("Light", "Material"),
    "notices": ("PictureWarning",),
    "orientation": ("Orientation",),
    "picking": ("Pick",),
    "plan": ("Effect", "PictureQuality", "QualitySetting", "RenderPlan"),
    "quantity": ("Quantity",),
    "describe.recipe": ("FieldRecipe", "Recipe"),
    "renderer": ("Renderer",),
    "ripple": ("lattice_ripple",),
    "scalar_colors": ("ScalarColors",),
    "slice_planes": ("SlicePlane",),
    "scene": ("Scene",),
    "describe.scene_file": ("SceneFile",),
    "transfer": ("TransferFunction",),
    "viewer": ("Viewer", "view"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
_MODULES = ("datasets", "fit", "io")

if not TYPE_CHECKING:  # else every name would be there for type checkers

    def __getattr__(name: str) -> Any:
        if name in _MODULES:
            return importlib.import_module(f"sheetsplat.{name}")
        if name not in _HOME_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(f"sheetsplat.{_HOME_OF[name]}"), name)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted(__all__)

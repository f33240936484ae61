"""An independent float64 renderer in NumPy: the image-formation page once more, for judging every backend.

The names and arguments are those of the package (RegularField, EllipsoidField, TransferFunction, Light, Material,
Scene, Camera), so that one function that takes a module builds the same scene for both. Nothing of the package is
imported. Section numbers are the page's. Vectorised over pixels and kernels; loops over slices and fields.
"""

from .kernels import EllipsoidField, Kernels, RegularField, ball_integral
from .picture import Around, Picture, ambiguous, is_gentle, render
from .scene import AmbientOcclusion, Camera, Clip, DepthCue, Light, Material, Scene, TransferFunction, first_order

__all__ = [
    "AmbientOcclusion",
    "Around",
    "Camera",
    "Clip",
    "DepthCue",
    "EllipsoidField",
    "Kernels",
    "Light",
    "Material",
    "Picture",
    "RegularField",
    "Scene",
    "TransferFunction",
    "ambiguous",
    "ball_integral",
    "first_order",
    "is_gentle",
    "render",
]

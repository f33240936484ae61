"""Fields: sets of kernels whose weighted sums are the scalar that is shown. Conventions, section 2 (Fields)."""

from sheetsplat.fields.base import Field, NanPolicy, Normalization, as_fields, default_spacing, joined_bounds
from sheetsplat.fields.bricked import BrickedField
from sheetsplat.fields.bricked_kernels import Bricked, BrickedKernels, KernelFacts, any_in_bricks, has_values_at_points
from sheetsplat.fields.ellipsoid import EllipsoidField
from sheetsplat.fields.regular import Boundary, Lattice, RegularField, as_samples
from sheetsplat.fields.wrapping import Periodic, Wrapping, periodic_box

__all__ = [
    "Boundary",
    "Bricked",
    "BrickedField",
    "BrickedKernels",
    "EllipsoidField",
    "Field",
    "KernelFacts",
    "Lattice",
    "NanPolicy",
    "Normalization",
    "Periodic",
    "RegularField",
    "Wrapping",
    "as_fields",
    "as_samples",
    "default_spacing",
    "has_values_at_points",
    "any_in_bricks",
    "joined_bounds",
    "periodic_box",
]

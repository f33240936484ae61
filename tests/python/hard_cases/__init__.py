"""Hard cases: what they are, and what must come of them.

A case is a scene, and its written outcome: a picture within a bound of section 9, a picture that is transparent to the
last bit, or an error of a kind that says why. It holds for every backend, unless a backend is named beside it.
"""

# Each of these modules adds its scenes to CASES, in the order of the page.
from . import shapes, sums, views, fields  # noqa: F401, I001
from .cases import CASES, TRANSPARENT, WITHIN, Case, Outcome, Refused, lattice
from .outcomes import Measured, expected_of, fault, measure, renderer_of, scene_of
from .promises import PROPERTIES, Property

__all__ = [
    "CASES",
    "PROPERTIES",
    "TRANSPARENT",
    "WITHIN",
    "Case",
    "Measured",
    "Outcome",
    "Property",
    "Refused",
    "expected_of",
    "fault",
    "lattice",
    "measure",
    "renderer_of",
    "scene_of",
]

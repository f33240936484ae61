"""Opacities and transfer functions by name."""

from __future__ import annotations

import re
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import nearest_names, shown
from sheetsplat.errors import complain, unusable

Floats = NDArray[np.float64]

_STEPS = 256
# The lowest opacity of "geom": a millionth of a grey level of 8 bits.
_FAINTEST = 1e-6 / 255.0
_SIGMOIDS = (3, 4, 5, 6, 7, 8, 9, 10, 15, 20)
#: Words for opacities over the limits of the colours, with the meaning that they have in PyVista.
WORDS: tuple[str, ...] = (
    *(word + turned for word in ("linear", "geom", "sigmoid") for turned in ("", "_r")),
    *(f"sigmoid_{width}{turned}" for width in _SIGMOIDS for turned in ("", "_r")),
    "foreground",
)
_LAYERS = re.compile(r"isolayers(?::(\d{1,2}))?")
_MOST_LAYERS = 32
_DEFAULT_LAYERS = 4
# Opacity of a layer, and its standard deviation as a share of the distance of two layers.
_LAYER_OPACITY, _LAYER_WIDTH = 0.8, 0.06
_LAYER_STEPS = 32

# Rows value (Hounsfield units), red, green, blue, opacity per reference length.
_IVORY, _WHITE = (0.95, 0.90, 0.80), (1.0, 1.0, 0.97)
PRESETS = MappingProxyType(
    {
        "ct_bone": (
            (150.0, 0.45, 0.22, 0.14, 0.0),
            (250.0, 0.70, 0.45, 0.32, 0.06),
            (450.0, *_IVORY, 0.40),
            (1200.0, *_WHITE, 0.70),
        ),
        "ct_muscle": (
            (-50.0, 0.90, 0.70, 0.45, 0.0),
            (10.0, 0.65, 0.25, 0.20, 0.08),
            (60.0, 0.72, 0.24, 0.20, 0.30),
            (150.0, 0.80, 0.40, 0.30, 0.30),
            (350.0, *_IVORY, 0.55),
            (1200.0, *_WHITE, 0.70),
        ),
        "ct_lung": (
            (-950.0, 0.10, 0.12, 0.25, 0.0),
            (-850.0, 0.35, 0.30, 0.45, 0.02),
            (-700.0, 0.85, 0.50, 0.45, 0.12),
            (-500.0, 0.95, 0.70, 0.60, 0.08),
            (-300.0, 0.95, 0.75, 0.65, 0.0),
        ),
    }
)


def opacities_of(word: str, low: float, high: float) -> Floats:
    """Return rows (value, opacity) of a word over two limits.

    linear: from 0 to 1. geom: from 4e-9 to 1 by equal factors. sigmoid_N: 1 / (1 + exp(-x)), x from -N to N; sigmoid:
    N = 10. foreground: 0 in the lowest 1/256 of the range, 1 above. With _r at the end: falling. isolayers:N: N
    Gaussian bumps spread evenly, 4 unless given.

    Raises
    ------
    InvalidInput
        For other words, with the nearest ones.
    """
    layers = _LAYERS.fullmatch(word)
    if layers is not None and 1 <= int(layers[1] or _DEFAULT_LAYERS) <= _MOST_LAYERS:
        return _isolayers(int(layers[1] or _DEFAULT_LAYERS), low, high)
    if word not in WORDS:
        wanted = "a number, numbers, pairs (value, opacity), linear, geom, sigmoid, sigmoid_3 … sigmoid_20 (each also "
        wanted += f"with _r), foreground, or isolayers:N with N up to {_MOST_LAYERS}"
        raise complain(unusable("opacity"), shown(word), wanted, nearest_names(word, (*WORDS, "isolayers")))
    if word == "foreground":
        # The first of the steps: samples at the limit itself are the background, however their sums are rounded.
        begin = low + (high - low) / _STEPS
        return np.array([(low, 0.0), (begin, 0.0), (begin, 1.0), (high, 1.0)])
    share = np.linspace(0.0, 1.0, 2 if word.startswith("linear") else _STEPS)
    base = word.removesuffix("_r")
    if base == "linear":
        opacity = share
    elif base == "geom":
        opacity = _FAINTEST ** (1.0 - share)
    else:
        width = float(base.removeprefix("sigmoid").lstrip("_") or 10)
        opacity = 1.0 / (1.0 + np.exp(-width * (2.0 * share - 1.0)))
    return np.column_stack([low + share * (high - low), opacity[::-1] if word.endswith("_r") else opacity])


def _isolayers(count: int, low: float, high: float) -> Floats:
    share = np.linspace(0.0, 1.0, count * _LAYER_STEPS + 1)
    # Distance from the nearest centre, in distances of two layers.
    away = np.abs(share * count - np.floor(np.minimum(share * count, count - 0.5)) - 0.5)
    opacity = _LAYER_OPACITY * np.exp(-0.5 * (away / _LAYER_WIDTH) ** 2)
    return np.column_stack([low + share * (high - low), np.where(opacity < 1e-3, 0.0, opacity)])

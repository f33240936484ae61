"""Values that nobody expects: random JSON, and foreign objects of Python."""

from __future__ import annotations

import decimal
import fractions
import itertools
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

HUGE = 10**400
_TEXTS = (
    "", " ", "\0", "a\0b", "\ud800", "é" * 40, "x" * 5000, "../../etc/passwd", "nan", "inf", "-0", "1e999", "auto",
    "composite", "isosurface", "viridis", "ct_bone", "#12345", "#123456", "red", "0:1:2", "isolayers:9999999",
    "sigmoid_-1", "%s%n", "{}", "${x}", "\u202e\u2028", "file:///etc/passwd", "http://127.0.0.1:1/", "|ls", "world",
)  # fmt: skip
_NUMBERS = (
    0, 1, -1, 2, 3, 7, 16, 255, 8192, 8193, 2**31, 2**53, 2**63, 2**64, 2**1000, HUGE, -HUGE, 0.0, -0.0, 0.5, 1.5,
    1e-320, 1e-30, 1e30, 1e38, 1e39, 1e200, -1e308, 1.7976931348623157e308, 3.14, 0.1 + 0.2,
)  # fmt: skip


def json_leaf(rng: random.Random) -> Any:
    """Return a text, number, truth value or null."""
    kind = rng.randrange(10)
    if kind < 4:
        return rng.choice(_NUMBERS)
    if kind == 4:
        return rng.uniform(-10.0, 10.0)
    if kind == 5:
        return 10.0 ** rng.uniform(-300.0, 300.0) * rng.choice((-1, 1))
    if kind < 8:
        return rng.choice(_TEXTS)
    return rng.choice((True, False, None))


def json_value(rng: random.Random, depth: int = 4) -> Any:
    """Return anything that JSON can say."""
    kind = rng.randrange(8)
    if depth == 0 or kind < 4:
        return json_leaf(rng)
    if kind < 6:
        return [json_value(rng, depth - 1) for _ in range(rng.choice((0, 1, 2, 3, 3, 4, 5, 17)))]
    return {str(json_leaf(rng))[:50]: json_value(rng, depth - 1) for _ in range(rng.randrange(5))}


def deep(rng: random.Random) -> str:
    """Return a JSON of thousands of brackets within each other."""
    count = rng.choice((10, 100, 1000, 5000, 50000))
    return rng.choice(("[" * count, "[" * count + "]" * count, '{"a":' * count + "1" + "}" * count))


class Raises:
    """Raises whatever is asked of it."""

    def _fail(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("the object of a stranger")

    __len__ = __iter__ = __array__ = __float__ = __int__ = __index__ = __bool__ = __getitem__ = _fail
    __fspath__ = __call__ = __contains__ = __eq__ = __lt__ = __add__ = __str__ = __repr__ = __format__ = _fail
    __hash__ = object.__hash__


class RaisesOnEverything(Raises):
    """Raises whatever attribute is asked for, too."""

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(f"no {name} here")


class Lies:
    """Says that it is long, and holds nothing."""

    def __len__(self) -> int:
        return 3

    def __getitem__(self, key: Any) -> Any:
        return self

    def __iter__(self) -> Iterator[Any]:
        return iter(())


class LyingArray:
    """Says that it is an array, and is none."""

    shape, dtype, ndim, size = (4, 4, 4), np.dtype(np.float32), 3, 64
    __array_interface__ = {"shape": (4, 4, 4), "typestr": "<f4", "data": None, "version": 3}

    def __array__(self, *_: Any, **__: Any) -> Any:
        return "no array"


class NegativeLength:
    """Has a length below 0."""

    def __len__(self) -> int:
        return -1


class WrongFloat:
    """Says that a word is a number."""

    def __float__(self) -> Any:
        return "x"

    def __index__(self) -> Any:
        return 2.5


def _self_list() -> list[Any]:
    made: list[Any] = []
    made.append(made)
    return made


def _self_dict() -> dict[str, Any]:
    made: dict[str, Any] = {}
    made["a"] = made
    return made


def _self_array() -> np.ndarray[Any, Any]:
    made = np.empty(3, object)
    made[0] = made
    return made


#: Makers of foreign objects by name: each attack gets new ones, as iterators are used up.
FOREIGN: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "true": lambda: True,
    "-1": lambda: -1,
    "0": lambda: 0,
    "a large number": lambda: 2**63,
    "400 digits": lambda: HUGE,
    "-400 digits": lambda: -HUGE,
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "1e308": lambda: 1e308,
    "1e-320": lambda: 1e-320,
    "complex": lambda: 1 + 2j,
    "decimal": lambda: decimal.Decimal("1e999999"),
    "decimal NaN": lambda: decimal.Decimal("sNaN"),
    "fraction": lambda: fractions.Fraction(HUGE, 3),
    "empty text": lambda: "",
    "text": lambda: "nonsense",
    "text with NUL": lambda: "a\0b.png",
    "surrogates": lambda: "\ud800\udfff",
    "long text": lambda: "x" * 100_000,
    "bytes": lambda: b"\xff\xfe",
    "bytearray": lambda: bytearray(5),
    "memoryview": lambda: memoryview(bytes(5)),
    "empty list": lambda: [],
    "list in itself": _self_list,
    "dict in itself": _self_dict,
    "array in itself": _self_array,
    "nested": lambda: [[1], [2, 3]],
    "list of None": lambda: [None] * 3,
    "list of texts": lambda: ["a", "b", "c"],
    "list of nan": lambda: [float("nan")] * 3,
    "list of large": lambda: [HUGE] * 3,
    "set": lambda: {1, 2, 3},
    "frozenset": lambda: frozenset((0.5,)),
    "dict": lambda: {"a": 1},
    "dict of numbers": lambda: {1: 2},
    "generator without end": lambda: (1.0 for _ in itertools.count()),
    "count": lambda: itertools.count(),
    "repeat": lambda: itertools.repeat("x"),
    "long range": lambda: range(10**18),
    "iterator": lambda: iter((1, 2, 3)),
    "empty array": lambda: np.zeros((0, 3)),
    "no axes": lambda: np.array(1.0),
    "empty cube": lambda: np.zeros((0, 4, 4)),
    "object array": lambda: np.array([object(), None]),
    "complex array": lambda: np.ones((3, 3), complex),
    "text array": lambda: np.array(["a", "b"]),
    "times": lambda: np.array(["2020-01-01"], "datetime64[D]"),
    "records": lambda: np.zeros(3, [("a", "f4"), ("b", "i2")]),
    "void": lambda: np.void(b"abc"),
    "nan array": lambda: np.full((4, 4, 4), np.nan),
    "inf array": lambda: np.full(3, np.inf),
    "masked": lambda: np.ma.masked_all(3),
    "six axes": lambda: np.zeros((1,) * 6),
    "negative strides": lambda: np.arange(27.0).reshape(3, 3, 3)[::-1, ::-1],
    "broadcast": lambda: np.broadcast_to(np.float32(1), (10**4, 10**4, 10**4)),
    "read-only": lambda: np.frombuffer(bytes(24)),
    "half": lambda: np.float16(3.5),
    "long double": lambda: np.longdouble("1e4000"),
    "numpy bool": lambda: np.bool_(True),
    "numpy text": lambda: np.str_("x"),
    "numpy time": lambda: np.datetime64("NaT"),
    "numpy complex": lambda: np.complex64(1j),
    "uint64": lambda: np.uint64(2**64 - 1),
    "int8": lambda: np.int8(-128),
    "function": lambda: lambda *_, **__: None,
    "raising function": lambda: Raises()._fail,
    "type": lambda: int,
    "module": lambda: random,
    "object": object,
    "ellipsis": lambda: ...,
    "slice": lambda: slice(None),
    "exception": lambda: ValueError("x"),
    "raises": Raises,
    "raises on everything": RaisesOnEverything,
    "lies": Lies,
    "no array": LyingArray,
    "negative length": NegativeLength,
    "wrong float": WrongFloat,
}

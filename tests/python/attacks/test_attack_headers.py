"""Headers and messages of notebooks that nobody expects, in small: tests/attacks does it by the thousand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import sheetsplat as ss


def test_headers_that_nobody_expects() -> None:
    for name in ("pydicom", "zarr", "dask.array"):
        pytest.importorskip(name)
    pytest.importorskip("aiohttp")
    from attacks import headers

    found = headers.foreign_headers(0, 120)
    kinds = {name.partition(":")[0] for name in found.done if name.endswith(": read")}
    assert not found.failures and kinds == {"dicom", "ome-zarr", "openvdb"}, found


def test_places_that_hold_themselves(tmp_path: Path) -> None:
    """NumPy's differences of such arrays never ended, until the stack did."""
    pytest.importorskip("aiohttp")
    from attacks import headers

    answers = iter(("place", "array in itself"))
    chosen: Any = SimpleNamespace(choice=lambda _: next(answers))
    with pytest.raises(ss.InvalidInput):
        headers.KINDS["openvdb"](tmp_path, chosen)()


def test_messages_that_no_notebook_sends() -> None:
    for name in ("anywidget", "aiohttp"):
        pytest.importorskip(name)
    from attacks import headers

    found = headers.notebook_messages(0, 100)
    assert not found.failures and found.done["messages"] == 100, found

"""The accessor of xarray: ``da.sheetsplat.render(…)`` and ``da.sheetsplat.field(…)`` for DataArrays and Datasets.

Registered as xarray documents in "Extending xarray using accessors".
"""

from __future__ import annotations

from typing import Any

import xarray  # type: ignore[import-not-found, unused-ignore]

from sheetsplat.integrations.accessor import Accessor

__all__ = ["Accessor"]

_registers: tuple[Any, ...] = (xarray.register_dataarray_accessor, xarray.register_dataset_accessor)
for _register in _registers:
    _register("sheetsplat")(Accessor)

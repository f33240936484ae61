"""The accessor of PyVista: ``grid.sheetsplat.render(…)`` and ``grid.sheetsplat.field(…)`` for all of its data sets.

Registered as PyVista documents for `register_dataset_accessor` (0.48 and newer).
"""

from __future__ import annotations

from typing import Any

import pyvista  # type: ignore[import-not-found, unused-ignore]

from sheetsplat.integrations.accessor import Accessor

__all__ = ["Accessor"]

_register: Any = pyvista.register_dataset_accessor
_register("sheetsplat", pyvista.DataObject)(Accessor)

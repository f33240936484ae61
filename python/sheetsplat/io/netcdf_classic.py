"""Classic NetCDF files whose variables are read by their positions, as a store of xarray."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from xarray import Variable  # type: ignore[import-not-found, unused-ignore]
from xarray.backends import BackendArray, ScipyDataStore  # type: ignore[import-not-found, unused-ignore]
from xarray.core import indexing  # type: ignore[import-not-found, unused-ignore]

from sheetsplat.io.source import Source
from sheetsplat.io.stored import StoredSamples


class ClassicStore(ScipyDataStore):  # type: ignore[misc, unused-ignore]
    """The variables of a classic file that is not packed, which may be used as long as its source is open.

    SciPy reads all variables at once, or maps the file into memory: what is mapped is asked for its place alone.
    """

    def __init__(self, source: Source) -> None:
        super().__init__(str(source.path), mmap=True)
        self._source = source

    def open_store_variable(self, name: str, var: Any) -> Any:
        """Return a variable that is read when it is asked for."""
        array = _StoredArray(self._source, _place(self._source, var.data))
        mapped = super().open_store_variable(name, var)
        return Variable(mapped.dims, indexing.LazilyIndexedArray(array), mapped.attrs)


def _place(source: Source, mapped: NDArray[Any]) -> StoredSamples:
    """Return where the samples of an array lie in the file that is mapped into memory."""
    whole: Any = mapped
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    first, start = (array.__array_interface__["data"][0] for array in (mapped, whole))
    return StoredSamples(source.path, mapped.dtype, mapped.shape, first - start, mapped.strides)


class _StoredArray(BackendArray):  # type: ignore[misc, unused-ignore]
    """What xarray reads parts of."""

    def __init__(self, source: Source, samples: StoredSamples) -> None:
        self._source, self._samples = source, samples
        self.shape, self.dtype = samples.shape, samples.dtype.newbyteorder("=")

    def __getitem__(self, key: Any) -> Any:
        """Return a part, by an index of xarray."""
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._part)

    def _part(self, key: tuple[Any, ...]) -> NDArray[Any]:
        # A number stands for a slice of one sample, an axis that is then dropped.
        cuts = tuple(one if isinstance(one, slice) else slice(one, one + 1) for one in key)
        kept = tuple(slice(None) if isinstance(one, slice) else 0 for one in key)
        return self._samples[cuts].read(self._source.fetch).astype(self.dtype)[kept]

"""Data in memory that other libraries hold: how each kind is recognized, and which reader reads it.

Objects are recognized by the names of their classes, so that no library is imported unless the data come from it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ObjectKind:
    """A kind of data of another library and its reader.

    Attributes
    ----------
    name
        How messages name it.
    reader
        "module:function", imported when such data are read. The function takes the object, its name for messages and
        `options`, and returns a `Volume` or `Scattered`.
    options
        Options that say how it is read.
    """

    name: str
    reader: str
    options: tuple[str, ...] = ()


_IO = "sheetsplat.io."
_TABLE = _IO + "tables:read_columns"
_ARRAY = _IO + "lazy_arrays:read"
_VTK = _IO + "vtk_objects:"
# By the first part of the module in which a class is defined, and its name.
_KINDS: dict[tuple[str, str], ObjectKind] = {
    ("xarray", "DataArray"): ObjectKind("the DataArray", _IO + "xarray_data:read_array", ("resample",)),
    ("xarray", "Dataset"): ObjectKind("the Dataset", _IO + "xarray_data:read_set", ("scalar", "resample")),
    ("dask", "Array"): ObjectKind("the dask array", _ARRAY),
    ("zarr", "Array"): ObjectKind("the Zarr array", _ARRAY),
    ("h5py", "Dataset"): ObjectKind("the HDF5 dataset", _ARRAY),
    ("vtkmodules", "vtkImageData"): ObjectKind("the image", _VTK + "read_image", ("scalar",)),
    ("vtkmodules", "vtkRectilinearGrid"): ObjectKind(
        "the rectilinear grid", _VTK + "read_rectilinear", ("scalar", "resample")
    ),
    ("vtkmodules", "vtkStructuredGrid"): ObjectKind("the structured grid", _VTK + "read_structured", ("scalar",)),
    ("vtkmodules", "vtkUnstructuredGrid"): ObjectKind("the grid", _VTK + "read_unstructured", ("scalar",)),
    ("vtkmodules", "vtkPolyData"): ObjectKind("the surface", _VTK + "read_surface", ("scalar",)),
    ("vtkmodules", "vtkMultiBlockDataSet"): ObjectKind("the blocks", _VTK + "read_blocks", ("scalar", "resample")),
    ("vtkmodules", "vtkOverlappingAMR"): ObjectKind("the AMR", _VTK + "read_amr", ("scalar",)),
    ("meshio", "Mesh"): ObjectKind("the mesh", _IO + "meshio_files:read_mesh", ("scalar",)),
    ("builtins", "dict"): ObjectKind("the dict", _TABLE, ("scalar",)),
    ("collections", "Mapping"): ObjectKind("the mapping", _TABLE, ("scalar",)),
    ("pandas", "DataFrame"): ObjectKind("the DataFrame", _TABLE, ("scalar",)),
    ("polars", "DataFrame"): ObjectKind("the DataFrame", _TABLE, ("scalar",)),
}


def kind_of_object(data: object) -> ObjectKind | None:
    """Return the kind of data of another library, None for everything else."""
    for base in type(data).__mro__:
        found = _KINDS.get((base.__module__.partition(".")[0], base.__name__))
        if found is not None:
            return found
    return None

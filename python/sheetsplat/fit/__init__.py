"""Kernels for data that are not regular: from meshes, points, particles and solids.

Each function returns :class:`Kernels`, of which :meth:`Kernels.field` makes a :class:`sheetsplat.EllipsoidField`;
:func:`sheetsplat.render` takes them as they are::

    from sheetsplat import fit
    kernels = fit.delaunay(points, values)
    picture = sheetsplat.render(kernels)

:func:`delaunay` shapes ellipsoids by the neighbours of a point, in a mesh or in the Delaunay tetrahedra, so that they
cover without gaps; :func:`nearest` makes spheres by distances alone; :func:`sph` takes the smoothing lengths of
particles; :func:`solid` fills a closed triangle mesh (:func:`read_mesh` reads one), and
`encode` makes few kernels
of a volume, with a bound of the error, and :func:`free_form_deformation` bends what any of them returned.
"""

from __future__ import annotations

from sheetsplat.encode.encoding import encode

from ._deform import control_lattice, free_form_deformation
from ._delaunay import delaunay
from ._kernels import Kernels
from ._mesh import read_mesh, winding_numbers
from ._nearest import nearest
from ._solid import solid
from ._sph import SPH_KERNELS, SphKernel, sph

__all__ = [
    "SPH_KERNELS",
    "Kernels",
    "SphKernel",
    "control_lattice",
    "delaunay",
    "encode",
    "free_form_deformation",
    "nearest",
    "read_mesh",
    "solid",
    "sph",
    "winding_numbers",
]

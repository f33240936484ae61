from ._delaunay import delaunay
from ._kernels import Kernels

// The rotation and the semi-axes of a kernel's support.
#pragma once

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// R and S of a matrix R S Q with Q orthogonal, whose unit sphere has the same image: by Jacobi rotations of the
/// columns, which keep the digits of the shortest semi-axis. Spheres to within rounding have R = 1 and equal semi-axes.
KernelAxes axes_of(const Mat3& shape);

} // namespace sheetsplat

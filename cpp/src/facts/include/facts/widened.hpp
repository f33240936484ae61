// Kernels widened by the EWA filter (conventions, section 10), in factored form: no covariance is ever formed.
#pragma once

#include "facts/frame.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The rows of B = V R S, which takes the unit sphere to the support: 3-vectors in the unit sphere for eye x, y and z.
struct ShapeRows {
    Vec3 x, y, z;
};

struct WidenedShape {
    ShapeRows rows;   ///< B' with B' B'^T = B B^T + diag(across^2, across^2, along^2)
    double amplitude; ///< sqrt(det B B^T / det B' B'^T): what is left of the kernel's height
};
/// semi_axes: of the kernel, whose shape is `rows`. Of a sphere the rows are not used.
WidenedShape widened(const ShapeRows& rows, const Vec3& semi_axes, const FilterWidth& width);

} // namespace sheetsplat

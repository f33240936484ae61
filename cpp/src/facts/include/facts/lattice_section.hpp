// Cross-sections of a lattice's kernels in factored form ([NM06] section 3.3, without any inverse of a covariance).
#pragma once

#include <glm/mat2x2.hpp>
#include <glm/vec2.hpp>

#include "facts/widened.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// All kernels of a lattice share one shape: with B = V M (columns: semi-axes in eye space), half_depth h = |B^T e_z|,
/// n = B^T e_z / h and u, v completing n to a basis, a point at depth t of a kernel centred at depth t_k has height
/// s = (t_k - t) / h along n, and the plane's point (x, y) relative to the centre is A (a, b) + s (B n)_xy with
/// A = [B u, B v]_xy.
struct LatticeSection {
    double half_depth = 1.0;               ///< h, world units
    glm::dmat2 to_unit{1.0};               ///< A^-1: eye xy -> unit-sphere plane coordinates
    glm::dvec2 shear{0.0};                 ///< A^-1 (B n)_xy: shift of the cross-section per unit of s
    bool sheared = false;                  ///< the shear matters (unequal spacing or oblique axes, seen at an angle)
    double extent_x = 1.0, extent_y = 1.0; ///< half the support's extent along eye x and y, world units
};

LatticeSection lattice_section(const RegularField& field, const Camera& camera);

LatticeSection section_of(const ShapeRows& rows);
/// B of a lattice's kernels.
ShapeRows rows_of(const RegularField& field, const Camera& camera);

} // namespace sheetsplat

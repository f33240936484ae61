#include "facts/lattice_section.hpp"

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

namespace sheetsplat {

LatticeSection lattice_section(const RegularField& field, const Camera& camera) {
    LatticeSection section;
    const Vec3 axes = field.semi_axes_world();
    // Rows of B = V S: the support's semi-axes are the world axes.
    const Vec3 row_x = camera.right_world() * axes;
    const Vec3 row_y = camera.up_world() * axes;
    const Vec3 row_z = camera.back_world() * axes;
    section.extent_x = glm::length(row_x);
    section.extent_y = glm::length(row_y);
    section.half_depth = glm::length(row_z);
    const Vec3 n = row_z / section.half_depth;
    const Vec3 helper = std::abs(n.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
    const Vec3 u = glm::normalize(glm::cross(n, helper));
    const Vec3 v = glm::cross(n, u);
    const glm::dmat2 plane(glm::dot(row_x, u), glm::dot(row_y, u), glm::dot(row_x, v), glm::dot(row_y, v));
    section.to_unit = glm::inverse(plane);
    const glm::dvec2 lean(glm::dot(row_x, n), glm::dot(row_y, n));
    const bool isotropic = axes.x == axes.y && axes.y == axes.z;
    if (isotropic) {
        // A sphere's cross-section needs no rotation; this one keeps u, v along eye x, y.
        section.to_unit = glm::dmat2(1.0 / axes.x, 0.0, 0.0, 1.0 / axes.x);
        section.shear = glm::dvec2(0.0);
        section.half_depth = section.extent_x = section.extent_y = axes.x;
    } else {
        section.shear = section.to_unit * lean;
        section.sheared = glm::length(section.shear) > 1e-12;
    }
    return section;
}

} // namespace sheetsplat

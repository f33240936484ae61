#include "facts/lattice_section.hpp"

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

namespace sheetsplat {

LatticeSection section_of(const ShapeRows& rows) {
    LatticeSection section;
    section.extent_x = glm::length(rows.x);
    section.extent_y = glm::length(rows.y);
    section.half_depth = glm::length(rows.z);
    const Vec3 n = rows.z / section.half_depth;
    const Vec3 helper = std::abs(n.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
    const Vec3 u = glm::normalize(glm::cross(n, helper));
    const Vec3 v = glm::cross(n, u);
    const glm::dmat2 plane(glm::dot(rows.x, u), glm::dot(rows.y, u), glm::dot(rows.x, v), glm::dot(rows.y, v));
    section.to_unit = glm::inverse(plane);
    section.shear = section.to_unit * glm::dvec2(glm::dot(rows.x, n), glm::dot(rows.y, n));
    section.sheared = glm::length(section.shear) > 1e-12;
    return section;
}

ShapeRows rows_of(const RegularField& field, const Camera& camera) {
    const KernelAxes& axes = field.kernel_axes();
    return {axes.row(camera.right_world()), axes.row(camera.up_world()), axes.row(camera.back_world())};
}

LatticeSection lattice_section(const RegularField& field, const Camera& camera) {
    if (!field.kernel_axes().is_sphere()) {
        return section_of(rows_of(field, camera));
    }
    const double radius = field.kernel_axes().lengths.x;
    // A sphere's cross-section needs no rotation; this one keeps u, v along eye x, y.
    LatticeSection section;
    section.to_unit = glm::dmat2(1.0 / radius, 0.0, 0.0, 1.0 / radius);
    section.shear = glm::dvec2(0.0);
    section.half_depth = section.extent_x = section.extent_y = radius;
    return section;
}

} // namespace sheetsplat

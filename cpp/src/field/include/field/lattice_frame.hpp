// Coordinates along the axes of a lattice.
#pragma once

#include <algorithm>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The inverse of steps, the columns: what takes differences of world positions to those of indices. (Of unit steps:
/// the determinant of others may be beyond float64.)
inline Mat3 to_indices(const Mat3& steps) {
    const Vec3 lengths(glm::length(steps[0]), glm::length(steps[1]), glm::length(steps[2]));
    Mat3 inverse = glm::inverse(Mat3(steps[0] / lengths.x, steps[1] / lengths.y, steps[2] / lengths.z));
    for (int column = 0; column < 3; ++column) {
        inverse[column] /= lengths;
    }
    return inverse;
}

/// The distances of opposite faces of the parallelepiped of three steps: of those that i, j and k cross.
inline Vec3 heights(const Mat3& steps) {
    const Mat3 rows = glm::transpose(to_indices(steps));
    return {1.0 / glm::length(rows[0]), 1.0 / glm::length(rows[1]), 1.0 / glm::length(rows[2])};
}

/// Coordinates in which a lattice's steps and its kernels' semi-axes lie along the axes: world units from sample (0, 0,
/// 0) on, or indices where the lattice's axes are not the world's.
struct LatticeFrame {
    explicit LatticeFrame(const RegularField& field)
        : origin(field.options().origin), oblique(field.options().axes.has_value()) {
        const Mat3& steps = field.steps();
        step = oblique ? Vec3(1.0) : Vec3(steps[0].x, steps[1].y, steps[2].z);
        semi_axes = oblique ? Vec3(field.options().radius) : field.kernel_axes().lengths;
        to_lattice = oblique ? to_indices(steps) : Mat3(1.0);
    }

    [[nodiscard]] Vec3 place(const Vec3& world) const {
        return oblique ? to_lattice * (world - origin) : world - origin;
    }

    Vec3 origin, step{1.0}, semi_axes{1.0};
    bool oblique;
    Mat3 to_lattice{1.0};
};

} // namespace sheetsplat

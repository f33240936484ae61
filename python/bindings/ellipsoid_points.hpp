// The sums of an EllipsoidField at single points.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "point_tree.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::bindings {

/// r^2 of a point that lies at `offset` from the centre of kernel i: |M^-1 offset|^2.
inline double squared_radius(const EllipsoidField& field, std::size_t i, Vec3 offset) {
    if (!field.arrays().rotations.empty()) {
        offset = glm::conjugate(field.arrays().rotations[i]) * offset;
    }
    offset /= field.semi_axes(i);
    return glm::dot(offset, offset);
}

/// D and W (conventions, section 2) at each point.
inline std::vector<std::array<double, 2>> sums_at(const EllipsoidField& field, std::vector<Vec3> points) {
    std::vector<std::array<double, 2>> sums(points.size(), {0.0, 0.0});
    const PointTree tree(std::move(points));
    const Kernel kernel = field.kernel();
    const double edge = kernel.edge(), gain = kernel.gain();
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Vec3& center = field.center(i);
        const Vec3 extent = field.extent(i);
        tree.each_in({center - extent, center + extent}, [&](std::size_t n, const Vec3& point) {
            const double r2 = squared_radius(field, i, point - center);
            if (r2 < 1.0) {
                const double weight = field.weight(i) * (std::exp(-kernel.falloff * r2) - edge) * gain;
                sums[n][0] += weight * field.value(i);
                sums[n][1] += weight;
            }
            return true;
        });
    }
    return sums;
}

} // namespace sheetsplat::bindings

// The sums of a field at single points. Source: conventions, section 2.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
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

/// What the kernels of a field add up to at a point.
struct FieldSums {
    double values = 0.0, weights = 0.0;         ///< D and W
    Vec3 values_slope{0.0}, weights_slope{0.0}; ///< their derivatives along the world's axes
    std::int64_t nearest = -1;                  ///< number of the kernel with the nearest centre; -1: none reaches
    double nearest_squared = std::numeric_limits<double>::infinity(); ///< distance of that centre, squared

    /// Adds a kernel that reaches the point: q = M^-1 offset of length below 1, slope = M^-T q.
    void add(const Kernel& kernel, std::size_t number, double value, double weight, const Vec3& offset, const Vec3& q,
             const Vec3& slope) {
        const double r2 = glm::dot(q, q), k = kernel.falloff;
        // For small k the two exponentials are nearly equal; their difference in closed form is not.
        const double g =
            (k < 1.0 ? kernel.edge() * std::expm1(k * (1.0 - r2)) : std::exp(-k * r2) - kernel.edge()) * kernel.gain();
        const Vec3 g_slope = -2.0 * k * kernel.gain() * std::exp(-k * r2) * slope;
        values += weight * value * g;
        weights += weight * g;
        values_slope += weight * value * g_slope;
        weights_slope += weight * g_slope;
        const double squared = glm::dot(offset, offset);
        if (squared < nearest_squared) {
            nearest_squared = squared;
            nearest = static_cast<std::int64_t>(number);
        }
    }
};

inline std::vector<FieldSums> sums_at(const EllipsoidField& field, std::vector<Vec3> points) {
    std::vector<FieldSums> sums(points.size());
    const PointTree tree(std::move(points));
    const bool turned = !field.arrays().rotations.empty();
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Vec3& center = field.center(i);
        const Vec3 extent = field.extent(i);
        tree.each_in({center - extent, center + extent}, [&](std::size_t n, const Vec3& point) {
            const Vec3 offset = point - center;
            const glm::dquat turn = turned ? field.arrays().rotations[i] : glm::dquat(1.0, 0.0, 0.0, 0.0);
            const Vec3 q = (turned ? glm::conjugate(turn) * offset : offset) / field.semi_axes(i);
            if (glm::dot(q, q) < 1.0) {
                const Vec3 slope = q / field.semi_axes(i);
                sums[n].add(field.kernel(), i, field.value(i), field.weight(i), offset, q,
                            turned ? turn * slope : slope);
            }
            return true;
        });
    }
    return sums;
}

inline FieldSums sums_at(const RegularField& field, const Vec3& point) {
    const Vec3 semi_axes = field.semi_axes_world(), origin = field.options().origin;
    const bool bcc = field.lattice() == Lattice::bcc;
    const double a = field.options().spacing.x;
    const Vec3 step = bcc ? Vec3(a, a, 0.5 * a) : field.options().spacing;
    // First and last sample along an axis that may reach the point, rounding and the shift of odd layers included.
    const auto range = [&](int axis, std::size_t count) {
        const double middle = (point[axis] - origin[axis]) / step[axis], reach = semi_axes[axis] / step[axis] + 1.0;
        const auto most = static_cast<double>(count);
        return std::array<std::size_t, 2>{
            static_cast<std::size_t>(std::clamp(std::floor(middle - reach), 0.0, most)),
            static_cast<std::size_t>(std::clamp(std::ceil(middle + reach) + 1.0, 0.0, most))};
    };
    const auto [nk, nj, ni] = field.shape();
    const auto along_i = range(0, ni), along_j = range(1, nj), along_k = range(2, nk);
    FieldSums sums;
    for (std::size_t k = along_k[0]; k < along_k[1]; ++k) {
        for (std::size_t j = along_j[0]; j < along_j[1]; ++j) {
            for (std::size_t i = along_i[0]; i < along_i[1]; ++i) {
                const Vec3 offset = point - field.position(i, j, k), q = offset / semi_axes;
                if (glm::dot(q, q) < 1.0) {
                    const double value = field.value(i, j, k);
                    if (!std::isnan(value)) {
                        sums.add(field.kernel(), (k * nj + j) * ni + i, value, 1.0, offset, q, q / semi_axes);
                    }
                }
            }
        }
    }
    return sums;
}

/// The sums of any field at each point.
inline std::vector<FieldSums> sums_at(const Field& field, std::vector<Vec3> points) {
    if (const auto* ellipsoids = as_ellipsoids(&field)) {
        return sums_at(*ellipsoids, std::move(points));
    }
    std::vector<FieldSums> sums(points.size());
    std::transform(points.begin(), points.end(), sums.begin(),
                   [&](const Vec3& point) { return sums_at(*as_regular(&field), point); });
    return sums;
}

} // namespace sheetsplat::bindings

// The sums of a field at single points. Source: conventions, section 2.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <glm/geometric.hpp>

#include "base/threads.hpp"
#include "point_tree.hpp"
#include "sheetsplat/field_points.hpp"

namespace sheetsplat {

namespace {

/// Points, or kernels and points, that one thread passes in less time than another takes to start.
constexpr std::size_t few = 2048;
/// Points that a thread takes at a time from a volume.
constexpr std::size_t points_at_a_time = 256;
/// Ellipsoids whose boxes are held at a time, and parts of the points for each thread, so that all end together.
constexpr std::size_t boxes_at_a_time = std::size_t{1} << 16;
constexpr std::size_t parts_a_thread = 4;

/// The profile of a kernel and its derivative, with what does not depend on the point known beforehand.
class Profile {
  public:
    explicit Profile(const Kernel& kernel)
        : falloff_(kernel.falloff), edge_(kernel.edge()), gain_(kernel.gain()), slope_(-2.0 * falloff_ * gain_) {}

    /// Adds a kernel that reaches the point: q = M^-1 offset of length below 1, slope = M^-T q.
    void add(FieldSums& sums, std::size_t number, double value, double weight, const Vec3& offset, const Vec3& q,
             const Vec3& slope) const {
        const double r2 = glm::dot(q, q);
        double exponential = 0.0, above_edge = 0.0;
        if (falloff_ < 1.0) {
            // The two exponentials are nearly equal; their difference in closed form is not.
            const double beyond = std::expm1(falloff_ * (1.0 - r2));
            above_edge = edge_ * beyond;
            exponential = edge_ + above_edge;
        } else {
            exponential = std::exp(-falloff_ * r2);
            above_edge = exponential - edge_;
        }
        const double g = above_edge * gain_;
        const Vec3 g_slope = slope_ * exponential * slope;
        sums.values += weight * value * g;
        sums.weights += weight * g;
        sums.values_slope += weight * value * g_slope;
        sums.weights_slope += weight * g_slope;
        const double squared = glm::dot(offset, offset);
        if (squared < sums.nearest_squared) {
            sums.nearest_squared = squared;
            sums.nearest = static_cast<std::int64_t>(number);
        }
    }

  private:
    double falloff_, edge_, gain_, slope_;
};

std::vector<FieldSums> sums_of(const EllipsoidField& field, const std::vector<Vec3>& points, ThreadPool& pool) {
    std::vector<FieldSums> sums(points.size());
    const PointTree tree(points);
    const std::vector<std::size_t> parts = tree.parts(parts_a_thread * static_cast<std::size_t>(pool.threads()));
    const Profile profile(field.kernel());
    const bool turned = !field.arrays().rotations.empty();
    const auto add = [&](std::size_t i, std::size_t n, const Vec3& point) {
        const Vec3 offset = point - field.center(i);
        const glm::dquat turn = turned ? field.arrays().rotations[i] : glm::dquat(1.0, 0.0, 0.0, 0.0);
        const Vec3 q = (turned ? glm::conjugate(turn) * offset : offset) / field.semi_axes(i);
        if (glm::dot(q, q) < 1.0) {
            const Vec3 slope = q / field.semi_axes(i);
            profile.add(sums[n], i, field.value(i), field.weight(i), offset, q, turned ? turn * slope : slope);
        }
        return true;
    };
    std::vector<Box> boxes(std::min(field.size(), boxes_at_a_time));
    for (std::size_t first = 0; first < field.size(); first += boxes_at_a_time) {
        const std::size_t count = std::min(boxes_at_a_time, field.size() - first);
        pool.run((count + few - 1) / few, [&](std::size_t block, int) {
            for (std::size_t i = block * few; i < std::min(count, (block + 1) * few); ++i) {
                const Vec3 &center = field.center(first + i), extent = field.extent(first + i);
                boxes[i] = {center - extent, center + extent};
            }
        });
        // A point belongs to one part, and so adds its kernels in their order.
        pool.run(parts.size(), [&](std::size_t part, int) {
            for (std::size_t i = 0; i < count; ++i) {
                tree.each_in_part(parts[part], boxes[i],
                                  [&](std::size_t n, const Vec3& point) { return add(first + i, n, point); });
            }
        });
    }
    return sums;
}

FieldSums sums_of(const RegularField& field, const Profile& profile, const Vec3& point) {
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
                        profile.add(sums, (k * nj + j) * ni + i, value, 1.0, offset, q, q / semi_axes);
                    }
                }
            }
        }
    }
    return sums;
}

} // namespace

std::vector<FieldSums> field_sums(const Field& field, const std::vector<Vec3>& points, int threads) {
    const auto* ellipsoids = as_ellipsoids(&field);
    const std::size_t work = points.size() + (ellipsoids != nullptr ? ellipsoids->size() : 0);
    ThreadPool pool(points.size() < 2 || work < few ? 1 : threads > 0 ? threads : usable_threads());
    if (ellipsoids != nullptr) {
        return sums_of(*ellipsoids, points, pool);
    }
    const RegularField& volume = *as_regular(&field);
    const Profile profile(field.kernel());
    std::vector<FieldSums> sums(points.size());
    pool.run((points.size() + points_at_a_time - 1) / points_at_a_time, [&](std::size_t block, int) {
        const std::size_t last = std::min(points.size(), (block + 1) * points_at_a_time);
        for (std::size_t n = block * points_at_a_time; n < last; ++n) {
            sums[n] = sums_of(volume, profile, points[n]);
        }
    });
    return sums;
}

} // namespace sheetsplat

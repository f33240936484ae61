// The sums of a field at single points. Source: conventions, section 2.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include <glm/geometric.hpp>

#include "base/threads.hpp"
#include "field/lattice_frame.hpp"
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

    [[nodiscard]] double exponential(double r2) const { return std::exp(-falloff_ * r2); }

    /// Adds a kernel that reaches the point, at a radius below 1; exponential: of r2, slope = M^-T M^-1 offset.
    void add(FieldSums& sums, std::size_t number, double value, double weight, const Vec3& offset, double r2,
             double exponential, const Vec3& slope) const {
        // For small k the two exponentials are nearly equal; their difference in closed form is not.
        const double above_edge = falloff_ < 1.0 ? edge_ * std::expm1(falloff_ * (1.0 - r2)) : exponential - edge_;
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
        const double r2 = glm::dot(q, q);
        if (r2 < 1.0) {
            const Vec3 slope = q / field.semi_axes(i);
            profile.add(sums[n], i, field.value(i), field.weight(i), offset, r2, profile.exponential(r2),
                        turned ? turn * slope : slope);
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
    for (FieldSums& one : sums) {
        one.nearest = field.given_kernel(one.nearest);
    }
    return sums;
}

/// Of the kernels of a volume along an axis that may reach a point: how far the point is from their centres, and what
/// each adds to r^2 and multiplies exp(-k r^2) by.
struct AxisReach {
    std::size_t first = 0;
    std::vector<double> offset, in_axes, squared, factor;

    [[nodiscard]] std::size_t count() const { return offset.size(); }
    /// first_centre, step: where the centres of kernels along the axis are.
    void find(std::array<std::size_t, 2> range, double point, double semi_axis, double falloff, double first_centre,
              double step) {
        first = range[0];
        for (std::vector<double>* numbers : {&offset, &in_axes, &squared, &factor}) {
            numbers->resize(range[1] - range[0]);
        }
        for (std::size_t n = 0; n < count(); ++n) {
            offset[n] = point - (first_centre + static_cast<double>(first + n) * step);
            in_axes[n] = offset[n] / semi_axis;
            squared[n] = in_axes[n] * in_axes[n];
            factor[n] = std::exp(-falloff * squared[n]);
        }
    }
};

/// Sums over the kernels of a volume at one point after the other.
class VolumeSums {
  public:
    explicit VolumeSums(const RegularField& field)
        : field_(field), profile_(field.kernel()), bcc_(field.lattice() == Lattice::bcc), frame_(field) {}

    FieldSums at(const Vec3& world) {
        const Vec3 point = frame_.place(world);
        const auto [nk, nj, ni] = field_.shape();
        const auto along_i = range(point, 0, ni), along_j = range(point, 1, nj), along_k = range(point, 2, nk);
        const double k = field_.kernel().falloff;
        const Vec3 &semi_axes = frame_.semi_axes, &step = frame_.step;
        z_.find(along_k, point.z, semi_axes.z, k, 0.0, step.z);
        // The odd layers of a BCC lattice are shifted.
        for (std::size_t odd = 0; odd < (bcc_ ? 2 : 1); ++odd) {
            const double shift = odd == 1 ? 0.5 : 0.0;
            x_[odd].find(along_i, point.x, semi_axes.x, k, shift * step.x, step.x);
            y_[odd].find(along_j, point.y, semi_axes.y, k, shift * step.y, step.y);
        }
        return std::visit([&](const auto& samples) { return sums(samples.data()); }, field_.samples());
    }

  private:
    /// First and last sample along an axis that may reach a point, rounding and the shift of odd layers included.
    [[nodiscard]] std::array<std::size_t, 2> range(const Vec3& point, int axis, std::size_t count) const {
        const double middle = point[axis] / frame_.step[axis];
        const double reach = frame_.semi_axes[axis] / frame_.step[axis] + 1.0;
        const auto most = static_cast<double>(count);
        return {static_cast<std::size_t>(std::clamp(std::floor(middle - reach), 0.0, most)),
                static_cast<std::size_t>(std::clamp(std::ceil(middle + reach) + 1.0, 0.0, most))};
    }

    template <class Sample>
    FieldSums sums(const Sample* samples) const {
        FieldSums sums;
        for (std::size_t c = 0; c < z_.count(); ++c) {
            const std::size_t layer = z_.first + c, odd = bcc_ ? layer % 2 : 0;
            const AxisReach &x = x_[odd], &y = y_[odd];
            for (std::size_t b = 0; b < y.count(); ++b) {
                if (y.squared[b] + z_.squared[c] >= 1.0) {
                    continue;
                }
                const std::size_t row = field_.row(y.first + b, layer) + x.first;
                const double factor = y.factor[b] * z_.factor[c];
                const SampleRange kernels = field_.kernels_of_row(y.first + b, layer);
                const std::size_t begin = kernels.begin > x.first ? kernels.begin - x.first : 0;
                const std::size_t end =
                    std::min<std::size_t>(x.count(), kernels.end > x.first ? kernels.end - x.first : 0);
                for (std::size_t a = begin; a < end; ++a) {
                    const double r2 = x.squared[a] + y.squared[b] + z_.squared[c];
                    const double value = static_cast<double>(samples[row + a]) - field_.counted_from();
                    if (r2 < 1.0 && !std::isnan(value)) {
                        Vec3 offset(x.offset[a], y.offset[b], z_.offset[c]);
                        Vec3 slope = Vec3(x.in_axes[a], y.in_axes[b], z_.in_axes[c]) / frame_.semi_axes;
                        if (frame_.oblique) {
                            offset = field_.steps() * offset;
                            slope = slope * frame_.to_lattice;
                        }
                        profile_.add(sums, row + a, value, 1.0, offset, r2, x.factor[a] * factor, slope);
                    }
                }
            }
        }
        return sums;
    }

    const RegularField& field_;
    Profile profile_;
    bool bcc_;
    LatticeFrame frame_;
    AxisReach x_[2], y_[2], z_;
};

} // namespace

std::vector<FieldSums> field_sums(const Field& field, const std::vector<Vec3>& points, int threads) {
    const auto* ellipsoids = as_ellipsoids(&field);
    const std::size_t work = points.size() + (ellipsoids != nullptr ? ellipsoids->size() : 0);
    ThreadPool pool(points.size() < 2 || work < few ? 1 : threads > 0 ? threads : usable_threads());
    if (ellipsoids != nullptr) {
        return sums_of(*ellipsoids, points, pool);
    }
    const RegularField& given = *as_regular(&field);
    const std::shared_ptr<const RegularField> mirrored = given.with_mirrored();
    const RegularField& volume = mirrored ? *mirrored : given;
    std::vector<FieldSums> sums(points.size());
    pool.run((points.size() + points_at_a_time - 1) / points_at_a_time, [&](std::size_t block, int) {
        const std::size_t last = std::min(points.size(), (block + 1) * points_at_a_time);
        VolumeSums at(volume);
        for (std::size_t n = block * points_at_a_time; n < last; ++n) {
            sums[n] = at.at(points[n]);
            sums[n].nearest = given.sample_of(sums[n].nearest);
        }
    });
    return sums;
}

} // namespace sheetsplat

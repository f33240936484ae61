#include "facts/extreme_blocks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <variant>
#include <vector>

#include <glm/geometric.hpp>

#include "field/lattice_frame.hpp"

namespace sheetsplat {

namespace {

/// Rays that meet a lattice, and candidates for them, spread over the picture by the additive recurrence of
/// M. Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018), section on R2.
constexpr int wanted_rays = 16, most_rays = 64;
constexpr std::array<double, 2> recurrence{0.7548776662466927, 0.5698402909980532};
/// Points of a ray, at most: of more, every few are looked at.
constexpr std::int64_t most_points = 512;
constexpr std::size_t most_along = static_cast<std::size_t>(2.0 * ExtremeBlocks::largest_radius);

template <class Value>
bool is_number(Value value) {
    return value == value;
}

/// Bounds and sums of one lattice, in units of max(0, exp(-k r^2) - exp(-k)).
template <class Value>
class LatticeSums {
  public:
    LatticeSums(const RegularField& field, const std::vector<Value>& samples, double peak, double sign, bool filled)
        : field_(field), samples_(samples), shape_(field.shape()), radius_(field.options().radius),
          half_(static_cast<std::int64_t>(std::ceil(std::max(radius_, 1.0)))),
          falloff_(field.kernel().falloff / (radius_ * radius_)), edge_(field.kernel().edge()),
          weights_(ExtremeBlocks::weights(field, peak)), counted_from_(field.counted_from()), sign_(sign),
          filled_(filled) {}

    /// Of the points in the block of a place (index coordinates), what sign times rho is not less than. (Ripples of the
    /// sum of weights are neglected where it is above 0.)
    [[nodiscard]] double bound(const std::array<int, 3>& block) const {
        std::array<ExtremeBlocks::Samples, 3> reaching{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            reaching[axis] = ExtremeBlocks::reaching_into(block[axis], shape_[2 - axis], radius_);
        }
        bool inside = true;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            inside = inside && (filled_ || ExtremeBlocks::is_inside(block[axis], shape_[2 - axis], radius_));
        }
        // Kernels of all sums that have less weight than those inside: towards 0.
        double least = inside ? std::numeric_limits<double>::max() : 0.0;
        for (std::size_t k = reaching[2].begin; k < reaching[2].end; ++k) {
            for (std::size_t j = reaching[1].begin; j < reaching[1].end; ++j) {
                const Value* row = samples_.data() + field_.row(j, k);
                for (std::size_t i = reaching[0].begin; i < reaching[0].end; ++i) {
                    const double value = sign_ * (static_cast<double>(row[i]) - counted_from_);
                    least = value < least ? value : least;
                }
            }
        }
        return least * weights_;
    }

    /// Samples in a block, and how many of them are not the base.
    struct Count {
        std::int64_t all = 0, drawn = 0;
    };
    [[nodiscard]] Count count(const std::array<int, 3>& block) const {
        std::array<ExtremeBlocks::Samples, 3> in{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            in[axis] = ExtremeBlocks::reaching_into(block[axis], shape_[2 - axis], 0.0);
        }
        Count count;
        for (std::size_t k = in[2].begin; k < in[2].end; ++k) {
            for (std::size_t j = in[1].begin; j < in[1].end; ++j) {
                const Value* row = samples_.data() + field_.row(j, k);
                count.all += static_cast<std::int64_t>(in[0].end - in[0].begin);
                count.drawn += std::count_if(row + in[0].begin, row + in[0].end, [base = counted_from_](Value value) {
                    const auto own = static_cast<double>(value);
                    return own < base || own > base;
                });
            }
        }
        return count;
    }

    /// Whether any kernel reaches a place.
    [[nodiscard]] bool reaches(const Vec3& place) const {
        double distance2 = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double last = static_cast<double>(shape_[static_cast<std::size_t>(2 - axis)]) - 1.0;
            const double off = place[axis] - std::clamp(std::round(place[axis]), 0.0, last);
            distance2 += off * off;
        }
        return distance2 < radius_ * radius_;
    }

    [[nodiscard]] double rho(const Vec3& place) const {
        std::array<std::array<double, most_along>, 3> factors{};
        std::array<std::int64_t, 3> first{}, begin{}, end{};
        for (int axis = 0; axis < 3; ++axis) {
            const auto at = static_cast<std::size_t>(axis);
            const double floor = std::floor(place[axis]);
            first[at] = static_cast<std::int64_t>(floor) - (half_ - 1);
            begin[at] = std::max<std::int64_t>(0, -first[at]);
            end[at] = std::min<std::int64_t>(2 * half_, static_cast<std::int64_t>(shape_[2 - at]) - first[at]);
            for (std::int64_t n = begin[at]; n < end[at]; ++n) {
                const double off = place[axis] - static_cast<double>(first[at] + n);
                factors[at][static_cast<std::size_t>(n)] = std::exp(-falloff_ * off * off);
            }
        }
        double sum = 0.0;
        for (std::int64_t z = begin[2]; z < end[2]; ++z) {
            for (std::int64_t y = begin[1]; y < end[1]; ++y) {
                const double across = factors[2][static_cast<std::size_t>(z)] * factors[1][static_cast<std::size_t>(y)];
                const Value* row = samples_.data() + field_.row(static_cast<std::size_t>(first[1] + y),
                                                                static_cast<std::size_t>(first[2] + z));
                for (std::int64_t x = begin[0]; x < end[0]; ++x) {
                    const Value value = row[first[0] + x];
                    const double weight = across * factors[0][static_cast<std::size_t>(x)] - edge_;
                    sum +=
                        weight > 0.0 && is_number(value) ? weight * (static_cast<double>(value) - counted_from_) : 0.0;
                }
            }
        }
        return sign_ * sum;
    }

  private:
    const RegularField& field_;
    const std::vector<Value>& samples_;
    const std::array<std::size_t, 3> shape_;
    const double radius_;
    const std::int64_t half_; ///< samples on either side that may reach a point
    const double falloff_, edge_;
    const double weights_;
    const double counted_from_, sign_;
    const bool filled_;
};

/// The points of a ray that are kept and where kernels may reach: start + n step, begin <= n < end, index coordinates.
struct Points {
    Vec3 start{0.0}, step{0.0};
    std::int64_t begin = 0, end = 0;
};

/// x, y: pixels.
Points points_of(const RegularField& field, const std::vector<Clip::Plane>& kept, const Camera& camera,
                 const Frame& frame, double x, double y) {
    const Mat3 to_index = to_indices(field.steps());
    const auto world_at = [&](std::int64_t n) {
        const double depth = frame.depth_of(n);
        const double pixel = frame.pixel * (frame.projection == Projection::perspective ? depth : 1.0);
        return camera.eye() + (x + 0.5 - frame.axis_x) * pixel * camera.right_world() +
               (frame.axis_y - y - 0.5) * pixel * camera.up_world() - depth * camera.back_world();
    };
    const auto place = [&](const Vec3& world) { return to_index * (world - field.options().origin); };
    const Vec3 front = world_at(0), back = world_at(frame.slices - 1);
    Points points;
    points.start = place(front);
    const auto most = static_cast<double>(frame.slices - 1);
    points.step = (place(back) - points.start) / std::max(1.0, most);
    double low = 0.0, high = most;
    for (const Clip::Plane& half : kept) {
        const auto inside = [&](const Vec3& world) { return glm::dot(half.normal, world) - half.offset; };
        const double of_front = inside(front), of_back = inside(back);
        if (of_front < 0.0 && of_back < 0.0) {
            return points;
        }
        if (of_front < 0.0) {
            low = std::max(low, most * of_front / (of_front - of_back));
        } else if (of_back < 0.0) {
            high = std::min(high, most * of_front / (of_front - of_back));
        }
    }
    for (int axis = 0; axis < 3; ++axis) {
        const double before = -field.options().radius;
        const double past =
            static_cast<double>(field.shape()[static_cast<std::size_t>(2 - axis)]) - 1.0 + field.options().radius;
        const double start = points.start[axis], step = points.step[axis];
        if (std::abs(step) * most < 1e-9) {
            high = start > before && start < past ? high : -1.0;
            continue;
        }
        low = std::max(low, std::min((before - start) / step, (past - start) / step));
        high = std::min(high, std::max((before - start) / step, (past - start) / step));
    }
    if (low <= high) {
        points.begin = static_cast<std::int64_t>(std::ceil(low));
        points.end = std::max(points.begin, static_cast<std::int64_t>(high) + 1);
    }
    return points;
}

} // namespace

bool ExtremeBlocks::fit(const RegularField& field) {
    const double radius = field.options().radius;
    if (field.lattice() != Lattice::cartesian || field.normalization() == Normalization::threshold ||
        radius > largest_radius) {
        return false;
    }
    // Sums of samples stay within float32.
    const auto [least, greatest] = field.value_range();
    const double largest = std::max(std::abs(least), std::abs(greatest));
    if (largest > 0.0 && (largest < 1e-25 || largest > 1e30)) {
        return false;
    }
    // Blocks are numbered in 32 bits.
    double blocks = 1.0;
    for (const std::size_t samples : field.shape()) {
        blocks *= count_along(samples, radius);
    }
    return blocks < static_cast<double>(std::numeric_limits<std::int32_t>::max());
}

int ExtremeBlocks::count_along(std::size_t samples, double radius) {
    return static_cast<int>(std::floor((static_cast<double>(samples) - 1.0 + radius) / edge)) + 2;
}

ExtremeBlocks::Samples ExtremeBlocks::reaching_into(int b, std::size_t samples, double radius) {
    const double low = edge * (b - 1.0) - radius, high = edge * b + radius;
    const double most = static_cast<double>(samples);
    const double begin = std::clamp(std::floor(low) + 1.0, 0.0, most), end = std::clamp(std::ceil(high), 0.0, most);
    return {static_cast<std::size_t>(begin), static_cast<std::size_t>(std::max(begin, end))};
}

bool ExtremeBlocks::is_inside(int b, std::size_t samples, double radius) {
    const double low = edge * (b - 1.0) - radius, high = edge * b + radius;
    return low >= -1.0 && high <= static_cast<double>(samples);
}

bool ExtremeBlocks::filled(const Scene& scene) {
    return scene.counted && scene.counted->mirrored && scene.counted->filled && !scene.part;
}

double ExtremeBlocks::weights(const RegularField& field, double ripple) {
    return ripple * field.lattice_constant() / field.kernel().gain();
}

ExtremeFacts extreme_facts(const RegularField& field, double peak, double sign, bool filled,
                           const std::vector<Clip::Plane>& kept, const Camera& camera, const Frame& frame) {
    if (frame.slices == 0 || field.size() == 0) {
        return {};
    }
    const auto share = [](std::int64_t part, std::int64_t of) {
        return of > 0 ? static_cast<double>(part) / static_cast<double>(of) : 0.0;
    };
    return std::visit(
        [&](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            const LatticeSums<Value> lattice(field, samples, peak, sign, filled);
            std::vector<double> bounds;
            const auto [least, greatest] = field.value_range();
            const double farthest =
                ExtremeBlocks::weights(field, peak) * std::min({0.0, sign * least, sign * greatest});
            std::int64_t looked = 0, left = 0, asked = 0, samples_met = 0, drawn = 0;
            int rays = 0;
            for (int candidate = 1; candidate <= most_rays && rays < wanted_rays; ++candidate) {
                const auto along = [&](std::size_t axis, int pixels) {
                    const double at = 0.5 + candidate * recurrence[axis];
                    return (at - std::floor(at)) * pixels - 0.5;
                };
                const Points points =
                    points_of(field, kept, camera, frame, along(0, frame.size.width), along(1, frame.size.height));
                if (points.begin == points.end) {
                    continue;
                }
                ++rays;
                const std::int64_t every = (points.end - points.begin + most_points - 1) / most_points;
                bounds.clear();
                std::array<int, 3> last{-1, -1, -1};
                double bound = 0.0, extreme = std::numeric_limits<double>::infinity();
                for (std::int64_t n = points.begin; n < points.end; n += every) {
                    const Vec3 place = points.start + static_cast<double>(n) * points.step;
                    std::array<int, 3> block{};
                    for (int axis = 0; axis < 3; ++axis) {
                        block[static_cast<std::size_t>(axis)] =
                            std::max(0, static_cast<int>(std::floor(place[axis] / ExtremeBlocks::edge)) + 1);
                    }
                    if (block != last) {
                        bound = lattice.bound(block);
                        const auto count = lattice.count(block);
                        samples_met += count.all;
                        drawn += count.drawn;
                        last = block;
                    }
                    bounds.push_back(bound);
                    asked += farthest < extreme ? 1 : 0;
                    if (bound < extreme && lattice.reaches(place)) {
                        const double rho = lattice.rho(place);
                        extreme = std::min(extreme, rho);
                    }
                }
                looked += static_cast<std::int64_t>(bounds.size());
                left += std::count_if(bounds.begin(), bounds.end(), [&](double of) { return of < extreme; });
            }
            return ExtremeFacts{share(left, looked), share(asked, looked), share(drawn, samples_met)};
        },
        field.samples());
}

} // namespace sheetsplat

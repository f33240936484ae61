#include "facts/crowd.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include <glm/geometric.hpp>

#include "base/poll.hpp"

namespace sheetsplat {

namespace {

constexpr std::size_t most_looked_at = std::size_t{1} << 18;
constexpr double ball = 4.0 / 3.0 * 3.14159265358979323846;
/// Centres nearer than this share of a kernel's size make kernels alike.
constexpr double alike_share = 1.0 / 1024.0;
/// Where cells begin within the first one: data at round places would lie on their borders.
constexpr double shift = 0.381966;
/// Mean of a lowered Gaussian with falloff 8 along its diameter.
constexpr double mean_along = 0.31;
/// Beyond this, float32 does not resolve the place at all.
constexpr double largest_loss = 1e7;

std::uint64_t mixed(std::uint64_t sum, double part) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &part, sizeof(bits));
    sum = (sum ^ bits) * 0x9E3779B97F4A7C15U;
    return sum ^ (sum >> 29);
}

/// The most kernels of one size, to a factor of 2 in volume, whose centres share a cell of `share` times their size.
std::size_t fullest_cell(const EllipsoidField& field, std::size_t stride, double share) {
    struct Cell {
        std::uint64_t key = 0;
        std::uint32_t count = 0;
    };
    const std::size_t looked_at = (field.size() + stride - 1) / stride;
    std::size_t slots = 16;
    while (slots < 2 * looked_at) {
        slots *= 2;
    }
    std::vector<Cell> cells(slots);
    const Vec3 first = field.centres_world().lower;
    int last_exponent = 0;
    double edge = share;
    std::uint32_t most = 0;
    for (std::size_t i = 0; i < field.size(); i += stride) {
        poll_at(i / stride);
        const Vec3 axes = field.semi_axes(i);
        const int exponent = std::ilogb(ball * axes.x * axes.y * axes.z);
        if (exponent != last_exponent) {
            last_exponent = exponent;
            edge = share * std::exp2(exponent / 3.0);
        }
        const Vec3 at = glm::floor((field.center(i) - first) / edge + shift);
        const std::uint64_t key = mixed(mixed(mixed(mixed(1, at.x), at.y), at.z), exponent);
        std::size_t slot = (key >> 20) & (slots - 1);
        while (cells[slot].count != 0 && cells[slot].key != key) {
            slot = (slot + 1) & (slots - 1);
        }
        cells[slot].key = key;
        most = std::max(most, ++cells[slot].count);
    }
    return most;
}

} // namespace

Crowd survey_crowd(const EllipsoidField& field) {
    if (field.size() == 0) {
        return {};
    }
    const std::size_t stride = (field.size() + most_looked_at - 1) / most_looked_at;
    const auto times = static_cast<double>(stride);
    const auto count = [&](double share) {
        return std::min(times * static_cast<double>(fullest_cell(field, stride, share)),
                        static_cast<double>(field.size()));
    };
    return {count(1.0), count(alike_share)};
}

ThinInSlabs survey_slabs(const EllipsoidField& field, const Camera& camera, const Frame& frame, double thick) {
    // In orthographic view the sections of a sphere do not move, so no precision is lost.
    if (field.size() == 0 || frame.slice_spacing <= thick * field.scale_range()[0] ||
        (field.isotropic() && frame.projection == Projection::orthographic)) {
        return {};
    }
    const Vec3 back = camera.back_world();
    const bool divided = field.normalization() == Normalization::threshold;
    const double per_sum = field.normalization() == Normalization::lattice ? 1.0 / field.lattice_constant() : 1.0;
    ThinInSlabs found;
    for (std::size_t i = 0; i < field.size(); ++i) {
        poll_at(i);
        const double half = field.isotropic() ? field.arrays().radii[i] : glm::length(back * field.shape(i));
        const double thickness = frame.slice_spacing / half;
        const double weight = std::min(1.0, mean_along * 2.0 / thickness) * field.weight(i);
        const double divisor = divided ? std::max(field.w0(), weight) : 1.0;
        const double value = std::abs(field.value(i)) * per_sum * weight / divisor;
        found.peak = std::max(found.peak, value);
        if (thickness > thick) {
            found.loss = std::max(found.loss, value * std::min(thickness, largest_loss));
        }
    }
    return found;
}

} // namespace sheetsplat

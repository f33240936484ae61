// Scattered ellipsoids: their arrays, validation and ranges.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/unusable.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {
namespace {

/// Sums over the kernels that overlap must stay finite in float64.
constexpr double largest_number = 1e300;
/// Products of three lengths must stay finite, and above 0, in float64.
constexpr double largest_length = 1e100, smallest_length = 1e-100;
/// A quaternion this far from unit length is a mistake and not a rounding error.
constexpr double quaternion_tolerance = 1e-3;
constexpr double equal_volumes = 1e-6;
/// Of one kernel, itself included, in a periodic box.
constexpr double most_images = 1000.0;
/// conventions, section 3.
constexpr double slices_of_diagonal = 2048.0;

std::string kernel(std::size_t i) { return " of kernel " + text_of_count(i); }

constexpr const char* owner = "EllipsoidField";

void require_positive(double value, const char* name, const char* advice) {
    if (!(value > 0.0) || !is_finite(value)) {
        throw InvalidInput(Complaint{unusable(owner, name), text_of(value), "a finite number above 0", advice});
    }
}

void check_length(std::size_t found, std::size_t kernels, const char* name) {
    if (found != kernels) {
        throw InvalidInput(Complaint{"EllipsoidField: the arrays do not fit together",
                                     text_of_count(kernels) + " centers and " + text_of_count(found) + " " + name,
                                     "as many of each", "give one entry for each kernel"});
    }
}

void check_centers(const std::vector<Vec3>& centers) {
    for (std::size_t i = 0; i < centers.size(); ++i) {
        const Vec3& at = centers[i];
        if (!is_finite(at) || std::max({std::abs(at.x), std::abs(at.y), std::abs(at.z)}) > largest_length) {
            throw InvalidInput(
                Complaint{"EllipsoidField: a center cannot be used", text_of(centers[i]) + ", the center" + kernel(i),
                          "three finite numbers of at most 1e100", "remove that kernel or correct its position"});
        }
    }
}

double checked_scale(double scale, std::size_t i, const std::optional<double>& least) {
    if (!is_finite(scale) || scale > largest_length) {
        throw InvalidInput(
            Complaint{"EllipsoidField: a scale cannot be used", text_of(scale) + ", a semi-axis" + kernel(i),
                      "a finite number above 0, at most 1e100", "remove that kernel or correct its scale"});
    }
    // A negative length is a mistake in the data, which a lower limit must not hide.
    if (scale < 0.0 || (scale == 0.0 && !least)) {
        throw InvalidInput(Complaint{"EllipsoidField: a kernel has no thickness",
                                     text_of(scale) + ", a semi-axis" + kernel(i), "semi-axes above 0",
                                     scale < 0.0 ? "a semi-axis is a length: remove its sign"
                                                 : "pass " + option_ref("min_scale", "...") +
                                                       ", to which shorter semi-axes are raised"});
    }
    const double used = least ? std::max(scale, *least) : scale;
    if (used < smallest_length) {
        throw InvalidInput(Complaint{"EllipsoidField: a kernel is too thin",
                                     text_of(scale) + ", a semi-axis" + kernel(i), "semi-axes of at least 1e-100",
                                     "use a smaller unit of length, or pass " + option_ref("min_scale", "...")});
    }
    return used;
}

/// Brings quaternions to unit length, unless they are of another field: a second division may change their last digits.
void check_rotations(std::vector<glm::dquat>& rotations, bool normalised) {
    for (std::size_t i = 0; i < rotations.size(); ++i) {
        glm::dquat& q = rotations[i];
        const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
        if (!is_finite(length) || std::abs(length - 1.0) > quaternion_tolerance) {
            throw InvalidInput(Complaint{
                "EllipsoidField: a rotation cannot be used", "a quaternion of length " + text_of(length) + kernel(i),
                "unit quaternions w, x, y, z, to within 1e-3", "divide each quaternion by its length"});
        }
        if (!normalised) {
            q = glm::dquat(q.w / length, q.x / length, q.y / length, q.z / length);
        }
    }
}

std::array<double, 2> check_values(const std::vector<double>& values) {
    if (values.empty()) {
        return {0.0, 0.0};
    }
    std::array<double, 2> range{values.front(), values.front()};
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!(std::abs(values[i]) <= largest_number)) {
            throw InvalidInput(
                Complaint{"EllipsoidField: a value cannot be used", text_of(values[i]) + ", the value" + kernel(i),
                          "a finite number of at most 1e300", "remove that kernel or correct its value"});
        }
        range = {std::min(range[0], values[i]), std::max(range[1], values[i])};
    }
    return range;
}

std::array<double, 2> check_weights(const std::vector<double>& weights) {
    if (weights.empty()) {
        return {1.0, 1.0};
    }
    std::array<double, 2> range{weights.front(), weights.front()};
    for (std::size_t i = 0; i < weights.size(); ++i) {
        if (!(weights[i] >= 0.0 && weights[i] <= largest_number)) {
            throw InvalidInput(Complaint{"EllipsoidField: a weight cannot be used",
                                         text_of(weights[i]) + ", the weight" + kernel(i),
                                         "a finite number of at least 0", "move the sign of a weight to its value"});
        }
        range = {std::min(range[0], weights[i]), std::max(range[1], weights[i])};
    }
    if (range[1] == 0.0) {
        throw InvalidInput(Complaint{"EllipsoidField: the weights cannot be used", "weights that are all 0",
                                     "at least one above 0",
                                     "leave out " + option_ref("weights") + " for a weight of 1 each"});
    }
    return range;
}

void check_masses(const std::vector<double>& values, const std::vector<double>& weights) {
    for (std::size_t i = 0; i < weights.size(); ++i) {
        if (!(std::abs(weights[i] * values[i]) <= largest_number)) {
            throw InvalidInput(Complaint{"EllipsoidField: a weight cannot be used",
                                         text_of(weights[i]) + " times the value " + text_of(values[i]) + kernel(i),
                                         "a product of at most 1e300",
                                         "divide all weights, and " + option_ref("w0") + ", by the largest weight"});
        }
    }
}

} // namespace

EllipsoidField::EllipsoidField(EllipsoidArrays arrays, const EllipsoidFieldOptions& options)
    : arrays_(std::move(arrays)), options_(options) {
    kernel_.falloff = options.falloff;
    normalization_ = options.normalization;
    w0_ = options.w0;
    require_positive(options.falloff, "falloff", "the papers use 8");
    if (options.normalization == Normalization::threshold) {
        require_positive(options.w0, "w0", "the papers use 1");
    } else if (!is_finite(options.w0)) {
        throw InvalidInput(Complaint{unusable(owner, "w0"), text_of(options.w0), "a finite number"});
    }
    if (options.min_scale) {
        require_positive(*options.min_scale, "min_scale", "give a length in world units, or leave it out");
        if (*options.min_scale > largest_length) {
            throw InvalidInput(Complaint{unusable(owner, "min_scale"), text_of(*options.min_scale), "at most 1e100",
                                         "give a length in world units"});
        }
    }
    if (options.cell_volume) {
        require_positive(*options.cell_volume, "cell_volume", "give the volume that one kernel stands for");
    }

    const std::size_t n = arrays_.centers.size();
    if (!arrays_.radii.empty() && !arrays_.scales.empty()) {
        throw InvalidInput(Complaint{"EllipsoidField: the arrays do not fit together", "both radii and scales",
                                     "one of them", "give radii for spheres, scales for ellipsoids"});
    }
    if (arrays_.scales.empty()) {
        check_length(arrays_.radii.size(), n, "radii");
    } else {
        check_length(arrays_.scales.size(), n, "scales");
    }
    check_length(arrays_.values.size(), n, "values");
    if (!arrays_.rotations.empty()) {
        check_length(arrays_.rotations.size(), n, "rotations");
    }
    if (!arrays_.weights.empty()) {
        check_length(arrays_.weights.size(), n, "weights");
    }
    check_centers(arrays_.centers);
    for (std::size_t i = 0; i < arrays_.radii.size(); ++i) {
        arrays_.radii[i] = checked_scale(arrays_.radii[i], i, options.min_scale);
    }
    for (std::size_t i = 0; i < arrays_.scales.size(); ++i) {
        Vec3& scale = arrays_.scales[i];
        for (int axis = 0; axis < 3; ++axis) {
            scale[axis] = checked_scale(scale[axis], i, options.min_scale);
        }
    }
    check_rotations(arrays_.rotations, arrays_.unit_rotations);
    if (!(std::abs(options.base) <= largest_number)) {
        throw InvalidInput(Complaint{unusable(owner, "base"), text_of(options.base),
                                     "a finite number of magnitude up to " + text_of(largest_number),
                                     "give the value that the field has where no kernel reaches"});
    }
    base_ = options.base;
    least_weight_ = options.least_weight;
    value_range_ = check_values(arrays_.values);
    if (!arrays_.values.empty()) {
        value_range_ = {value_range_[0] - base_, value_range_[1] - base_};
    }
    if (options_.value_range) {
        value_range_ = {std::min(value_range_[0], (*options_.value_range)[0]),
                        std::max(value_range_[1], (*options_.value_range)[1])};
    }
    weight_range_ = check_weights(arrays_.weights);
    check_masses(arrays_.values, arrays_.weights);
    // A sphere looks the same however it is turned.
    if (arrays_.scales.empty()) {
        arrays_.rotations.clear();
        arrays_.rotations.shrink_to_fit();
    }
    if (options.periodic) {
        wrap_centers();
    }
    if (n == 0) {
        arrays_ = {};
        return;
    }

    require_memory(static_cast<std::uint64_t>(n) * sizeof(double), "the semi-axes of a field",
                   "use fewer kernels at a time");
    std::vector<double> smallest(n);
    scale_range_ = {std::numeric_limits<double>::infinity(), 0.0};
    double least_volume = std::numeric_limits<double>::infinity(), largest_volume = 0.0;
    centres_world_ = Box{arrays_.centers.front(), arrays_.centers.front()};
    supports_world_ =
        Box{Vec3(std::numeric_limits<double>::infinity()), Vec3(-std::numeric_limits<double>::infinity())};
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3 axes = semi_axes(i);
        smallest[i] = std::min({axes.x, axes.y, axes.z});
        scale_range_ = {std::min(scale_range_[0], smallest[i]), std::max({scale_range_[1], axes.x, axes.y, axes.z})};
        const double volume = axes.x * axes.y * axes.z;
        least_volume = std::min(least_volume, volume);
        largest_volume = std::max(largest_volume, volume);
        const Vec3& at = arrays_.centers[i];
        centres_world_ = Box{glm::min(centres_world_.lower, at), glm::max(centres_world_.upper, at)};
        const Vec3 reach = extent(i);
        supports_world_ = Box{glm::min(supports_world_.lower, at - reach), glm::max(supports_world_.upper, at + reach)};
    }
    // The mean of the two middle ones for an even count.
    const auto middle = smallest.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(smallest.begin(), middle, smallest.end());
    const double median = n % 2 == 1 ? *middle : 0.5 * (*middle + *std::max_element(smallest.begin(), middle));
    slice_spacing_ = std::max(0.5 * median, glm::length(centres_world_.extent()) / slices_of_diagonal);
    if (options.slice_spacing) {
        slice_spacing_ = *options.slice_spacing;
    }
    if (domain_) {
        add_images();
    } else {
        domain_ = options.domain;
    }

    if (options.normalization == Normalization::lattice) {
        const Words failed = "EllipsoidField: " + option_ref("normalization", "lattice") + " cannot be used";
        const Words threshold = option_ref("normalization", "threshold");
        if (!options.cell_volume) {
            throw InvalidInput(Complaint{failed, "no " + option_ref("cell_volume"),
                                         "the volume that one kernel stands for",
                                         "pass " + option_ref("cell_volume", "...") + ", or use " + threshold});
        }
        if (largest_volume - least_volume > equal_volumes * largest_volume) {
            throw InvalidInput(Complaint{failed,
                                         "kernels whose semi-axes' products lie between " + text_of(least_volume) +
                                             " and " + text_of(largest_volume),
                                         "kernels of one volume, as on a lattice", "use " + threshold});
        }
        lattice_constant_ = kernel_.unit_mass() * largest_volume / *options.cell_volume;
        if (!(lattice_constant_ > 0.0) || !is_finite(lattice_constant_)) {
            throw InvalidInput(Complaint{failed, "a kernel's mass of " + text_of(lattice_constant_) + " cells",
                                         "a finite number above 0",
                                         "give " + option_ref("cell_volume") + " in the world's units, cubed"});
        }
    }
}

void EllipsoidField::wrap_centers() {
    // Of a side: what the digits of a position may leave open.
    constexpr double coarsest_place = 1e-3;
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const Box& box = *options_.periodic;
    domain_ = Box{Vec3(-infinity), Vec3(infinity)};
    for (int axis = 0; axis < 3; ++axis) {
        const double lower = box.lower[axis], side = box.upper[axis] - lower;
        if (!(lower <= box.upper[axis])) {
            throw InvalidInput(Complaint{unusable(owner, "periodic"), text_of(box.lower) + " to " + text_of(box.upper),
                                         "a lower and an upper corner",
                                         "give a side of length 0 along an axis that does not wrap"});
        }
        if (side == 0.0 || !is_finite(side)) {
            continue;
        }
        domain_->box.lower[axis] = lower;
        domain_->box.upper[axis] = box.upper[axis];
        for (Vec3& center : arrays_.centers) {
            double& at = center[axis];
            // What lies in the box stays what it is to the last digit.
            if (at < lower || at >= box.upper[axis]) {
                if (std::abs(at) * std::numeric_limits<double>::epsilon() > coarsest_place * side) {
                    throw InvalidInput(Complaint{unusable(owner, "periodic"),
                                                 "a center at " + text_of(at) +
                                                     ", of which float64 does not say where in a box of " +
                                                     text_of(side) + " it lies",
                                                 "positions and a box in one unit", "check the units of both"});
                }
                const double share = (at - lower) / side;
                at = lower + (share - std::floor(share)) * side;
                at = at < box.upper[axis] ? at : lower;
            }
        }
    }
}

void EllipsoidField::add_images() {
    /// By how many sides a kernel and its images lie farther along each axis.
    struct Images {
        Vec3 first{0.0}, last{0.0};
        double count = 1.0; ///< with the kernel itself
    };
    Vec3 side(0.0);
    const Box& box = domain_->box;
    for (int axis = 0; axis < 3; ++axis) {
        side[axis] = is_finite(box.lower[axis]) ? box.upper[axis] - box.lower[axis] : 0.0;
    }
    const auto images_of = [&](std::size_t i) {
        const Vec3 reach = extent(i), at = center(i);
        Images found;
        for (int axis = 0; axis < 3; ++axis) {
            if (side[axis] > 0.0) {
                found.first[axis] = std::floor((box.lower[axis] - reach[axis] - at[axis]) / side[axis]) + 1.0;
                found.last[axis] = std::ceil((box.upper[axis] + reach[axis] - at[axis]) / side[axis]) - 1.0;
                found.count *= found.last[axis] - found.first[axis] + 1.0;
            }
        }
        return found;
    };
    const std::size_t n = size();
    std::size_t all = n;
    for (std::size_t i = 0; i < n; ++i) {
        const double count = images_of(i).count;
        if (count > most_images) {
            const Vec3 reach = extent(i);
            throw InvalidInput(
                Complaint{"EllipsoidField: the periodic box cannot be used",
                          text_of(count) + " images of kernel " + text_of_count(i) + ", semi-axes up to " +
                              text_of(std::max({reach.x, reach.y, reach.z})),
                          "at most " + text_of(most_images) + " of a kernel",
                          "use smaller kernels, or pass " + option_ref("periodic", "...") + " with a larger box"});
        }
        all += static_cast<std::size_t>(count) - 1;
    }
    const auto reserve = [&](auto& array) {
        using Entry = typename std::decay_t<decltype(array)>::value_type;
        require_memory(static_cast<std::uint64_t>(all) * sizeof(Entry), "the images of kernels",
                       "use fewer kernels at a time");
        array.reserve(all);
    };
    reserve(arrays_.centers);
    reserve(owners_);
    for (std::size_t i = 0; i < n; ++i) {
        const Images found = images_of(i);
        const Vec3 reach = extent(i);
        for (double z = found.first.z; z <= found.last.z; ++z) {
            for (double y = found.first.y; y <= found.last.y; ++y) {
                for (double x = found.first.x; x <= found.last.x; ++x) {
                    if (x != 0.0 || y != 0.0 || z != 0.0) {
                        const Vec3 at = center(i) + Vec3(x, y, z) * side;
                        owners_.push_back(i);
                        arrays_.centers.push_back(at);
                        supports_world_ = Box{glm::min(supports_world_.lower, at - reach),
                                              glm::max(supports_world_.upper, at + reach)};
                    }
                }
            }
        }
    }
    const auto copy = [&](auto& array) {
        if (!array.empty()) {
            reserve(array);
            for (const std::size_t kernel : owners_) {
                array.push_back(array[kernel]);
            }
        }
    };
    copy(arrays_.radii);
    copy(arrays_.scales);
    copy(arrays_.rotations);
    copy(arrays_.values);
    copy(arrays_.weights);
}

std::int64_t EllipsoidField::given_kernel(std::int64_t number) const {
    const auto own = static_cast<std::int64_t>(given());
    return number < own ? number : static_cast<std::int64_t>(owners_[static_cast<std::size_t>(number - own)]);
}

std::shared_ptr<const EllipsoidField> EllipsoidField::without_end() const {
    EllipsoidArrays arrays = arrays_;
    arrays.unit_rotations = true;
    const auto cut = [&](auto& array) { array.resize(std::min(array.size(), given())); };
    cut(arrays.centers);
    cut(arrays.radii);
    cut(arrays.scales);
    cut(arrays.rotations);
    cut(arrays.values);
    cut(arrays.weights);
    EllipsoidFieldOptions options = options_;
    options.periodic.reset();
    return std::make_shared<const EllipsoidField>(std::move(arrays), options);
}

Mat3 EllipsoidField::shape(std::size_t i) const {
    const Vec3 axes = semi_axes(i);
    if (arrays_.rotations.empty()) {
        return Mat3(axes.x, 0.0, 0.0, 0.0, axes.y, 0.0, 0.0, 0.0, axes.z);
    }
    const Mat3 rotation = glm::mat3_cast(arrays_.rotations[i]);
    return Mat3(rotation[0] * axes.x, rotation[1] * axes.y, rotation[2] * axes.z);
}

Vec3 EllipsoidField::extent(std::size_t i) const {
    if (arrays_.rotations.empty()) {
        return semi_axes(i);
    }
    const Mat3 rows = glm::transpose(shape(i));
    return Vec3(glm::length(rows[0]), glm::length(rows[1]), glm::length(rows[2]));
}

std::array<double, 2> EllipsoidField::reach_along(const Vec3& from, const Vec3& direction) const {
    std::array<double, 2> reach{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    for (std::size_t i = 0; i < size(); ++i) {
        const std::array<double, 2> own = reach_along(i, from, direction);
        reach = {std::min(reach[0], own[0]), std::max(reach[1], own[1])};
    }
    return reach;
}

std::array<double, 2> EllipsoidField::reach_along(std::size_t i, const Vec3& from, const Vec3& direction) const {
    const double at = glm::dot(arrays_.centers[i] - from, direction);
    const double half = arrays_.scales.empty() ? arrays_.radii[i] : glm::length(direction * shape(i));
    return {at - half, at + half};
}

std::size_t EllipsoidField::memory() const {
    return sizeof(EllipsoidField) + owners_.capacity() * sizeof(std::size_t) +
           arrays_.centers.capacity() * sizeof(Vec3) + arrays_.radii.capacity() * sizeof(double) +
           arrays_.scales.capacity() * sizeof(Vec3) + arrays_.rotations.capacity() * sizeof(glm::dquat) +
           (arrays_.values.capacity() + arrays_.weights.capacity()) * sizeof(double);
}

} // namespace sheetsplat

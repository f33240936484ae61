// Regular volumes: their samples, places, validation and ranges.
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "base/unusable.hpp"
#include "field/lattice_frame.hpp"
#include "field/prefilter.hpp"
#include "kernel_axes.hpp"
#include "mirrored.hpp"
#include "regular_options.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {
namespace {

/// More mirrored layers than any kernel that can be drawn in a lifetime reaches.
constexpr double largest_mirrored = 4096.0;

std::string text_of_shape(const std::array<std::size_t, 3>& shape) {
    return "(" + text_of_count(shape[0]) + ", " + text_of_count(shape[1]) + ", " + text_of_count(shape[2]) + ")";
}

constexpr const char* owner = "RegularField";

/// The value of the first sample that is not missing, if at least one in a hundred has it, else the middle of the
/// range; 0 where all are missing (conventions, section 2).
template <class T>
double base_of(const std::vector<T>& samples, std::size_t present, const std::array<double, 2>& range) {
    const auto first = std::find_if(samples.begin(), samples.end(), [](T value) { return value == value; });
    if (first == samples.end()) {
        return 0.0;
    }
    const std::size_t enough = (present + 99) / 100;
    constexpr std::ptrdiff_t at_a_time = 1 << 16;
    std::size_t same = 0;
    for (auto from = first; from != samples.end() && same < enough;) {
        const auto past = samples.end() - from > at_a_time ? from + at_a_time : samples.end();
        same += static_cast<std::size_t>(std::count(from, past, *first));
        from = past;
    }
    return same >= enough ? static_cast<double>(*first) : 0.5 * range[0] + 0.5 * range[1];
}

/// How far supports reach, counted in layers of samples: BCC lattices have two for each edge.
double radius_in_layers(const RegularFieldOptions& options) {
    return options.lattice == Lattice::bcc ? options.radius * std::sqrt(2.0) : options.radius;
}

/// The number of samples that the shape stands for.
std::size_t check_shape(const std::array<std::size_t, 3>& shape, std::size_t length) {
    const auto [nk, nj, ni] = shape;
    if (nk == 0 || nj == 0 || ni == 0) {
        throw InvalidInput(Complaint{"RegularField: the array is empty", "shape " + text_of_shape(shape),
                                     "at least one sample along each axis", "give an array indexed [k, j, i]"});
    }
    constexpr std::size_t most = std::numeric_limits<std::size_t>::max();
    if (nj > most / nk || ni > most / (nk * nj)) {
        throw InvalidInput(Complaint{"RegularField: the shape cannot be used", "shape " + text_of_shape(shape),
                                     "fewer than 2^64 samples", "give the array's own shape"});
    }
    const std::size_t samples = nk * nj * ni;
    if (samples != length) {
        throw InvalidInput(Complaint{"RegularField: shape and samples do not fit together",
                                     text_of_count(length) + " samples for shape " + text_of_shape(shape),
                                     text_of_count(samples) + " samples", "give the array's own shape {nk, nj, ni}"});
    }
    return samples;
}

/// What one pass over the samples tells.
struct Survey {
    double smallest = 0.0;
    double largest = 0.0;
    bool all_finite = true;
};

template <class T>
Survey survey(const T* samples, std::size_t count) {
    if constexpr (std::is_integral_v<T>) {
        T smallest = samples[0];
        T largest = samples[0];
        for (std::size_t n = 0; n < count; ++n) {
            smallest = std::min(smallest, samples[n]);
            largest = std::max(largest, samples[n]);
        }
        return {static_cast<double>(smallest), static_cast<double>(largest), true};
    } else {
        using Bits = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
        // Infinities and NaN are the numbers whose exponent bits are all set.
        const T infinity = std::numeric_limits<T>::infinity();
        Bits exponent = 0;
        std::memcpy(&exponent, &infinity, sizeof(T));
        // Compilers may not reorder a single minimum of floating-point numbers; independent lanes become vector code.
        constexpr std::size_t lanes = 64 / sizeof(T);
        T smallest[lanes];
        T largest[lanes];
        Bits odd[lanes] = {};
        std::fill_n(smallest, lanes, infinity);
        std::fill_n(largest, lanes, -infinity);
        const auto take = [&](const T* from, std::size_t lane) {
            const T value = *from;
            Bits bits = 0;
            std::memcpy(&bits, from, sizeof(T));
            smallest[lane] = value < smallest[lane] ? value : smallest[lane];
            largest[lane] = value > largest[lane] ? value : largest[lane];
            odd[lane] |= static_cast<Bits>((bits & exponent) == exponent);
        };
        std::size_t n = 0;
        for (; n + lanes <= count; n += lanes) {
            for (std::size_t lane = 0; lane < lanes; ++lane) {
                take(samples + n + lane, lane);
            }
        }
        for (std::size_t lane = 0; n < count; ++n, ++lane) {
            take(samples + n, lane);
        }
        Survey result{static_cast<double>(*std::min_element(smallest, smallest + lanes)),
                      static_cast<double>(*std::max_element(largest, largest + lanes)), true};
        result.all_finite = std::all_of(odd, odd + lanes, [](Bits bit) { return bit == 0; });
        return result;
    }
}

/// Extent of the kernels' indices; along the first two axes of BCC in half steps, 2 i + (k mod 2).
struct Extent {
    std::array<std::size_t, 3> first{std::numeric_limits<std::size_t>::max(), std::numeric_limits<std::size_t>::max(),
                                     std::numeric_limits<std::size_t>::max()};
    std::array<std::size_t, 3> last{0, 0, 0};

    void add(std::size_t axis, std::size_t from, std::size_t to) {
        first[axis] = std::min(first[axis], from);
        last[axis] = std::max(last[axis], to);
    }
};

std::size_t half_steps(Lattice lattice, std::size_t index, std::size_t k) {
    return lattice == Lattice::bcc ? 2 * index + k % 2 : index;
}

double along(const RegularFieldOptions& options, int axis, std::size_t steps_along) {
    const auto n = static_cast<double>(steps_along);
    return options.lattice == Lattice::bcc ? options.origin[axis] + 0.5 * n * options.spacing.x
                                           : options.origin[axis] + n * options.spacing[axis];
}

/// The box of what reaches from reach(direction)[0] to reach(direction)[1] along each axis of the world.
template <class Reach>
Box box_of(Reach&& reach) {
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 direction(0.0);
        direction[axis] = 1.0;
        const std::array<double, 2> ends = reach(direction);
        box.lower[axis] = ends[0];
        box.upper[axis] = ends[1];
    }
    return box;
}

void require_moderate(const std::array<double, 2>& range) {
    if (std::max(-range[0], range[1]) > largest_sample) {
        throw InvalidInput(Complaint{
            "RegularField: the samples cannot be used", "values from " + text_of(range[0]) + " to " + text_of(range[1]),
            "magnitudes up to " + text_of(largest_sample) + ", so that their sums stay finite", "scale the samples"});
    }
}

[[noreturn]] void refuse_sample(double value, const std::array<std::size_t, 3>& shape, std::size_t n, bool skip_helps) {
    const std::size_t ni = shape[2];
    const std::size_t nj = shape[1];
    throw InvalidInput(Complaint{"RegularField: the samples cannot be used",
                                 text_of(value) + " at sample [" + text_of_count(n / ni / nj) + ", " +
                                     text_of_count(n / ni % nj) + ", " + text_of_count(n % ni) + "]",
                                 "finite numbers",
                                 skip_helps ? "pass " + option_ref("nan", "skip") + " to leave such samples out"
                                            : "replace it, or make it NaN and pass " + option_ref("nan", "skip") +
                                                  " to leave it out"});
}

/// Refuses what the policy does not allow; else range, extent and number of the samples that are not NaN.
template <class T>
struct Holes {
    Extent extent;
    std::vector<SampleRange> rows; ///< from the first to the last kernel of each row
    double smallest = 0.0;
    double largest = 0.0;
    std::size_t kernels = 0;

    Holes(const std::vector<T>& samples, const std::array<std::size_t, 3>& shape, const RegularFieldOptions& options) {
        const auto [nk, nj, ni] = shape;
        T low = std::numeric_limits<T>::infinity();
        T high = -low;
        require_memory(
            checked_product(checked_product(nk, nj, "rows of samples"), sizeof(SampleRange), "rows of samples"),
            "the rows of a volume with missing samples", "use a smaller volume");
        rows.resize(nk * nj);
        const T* row = samples.data();
        for (std::size_t k = 0; k < nk; ++k) {
            for (std::size_t j = 0; j < nj; ++j, row += ni) {
                std::size_t first = ni;
                std::size_t last = 0;
                for (std::size_t i = 0; i < ni; ++i) {
                    const T value = row[i];
                    const bool nan = std::isnan(value);
                    if (std::isinf(value) || (nan && options.nan == NanPolicy::error)) {
                        refuse_sample(static_cast<double>(value), shape,
                                      static_cast<std::size_t>(row - samples.data()) + i, nan);
                    }
                    if (!nan) {
                        low = std::min(low, value);
                        high = std::max(high, value);
                        first = std::min(first, i);
                        last = i;
                        ++kernels;
                    }
                }
                if (first < ni) {
                    rows[k * nj + j] = {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last + 1)};
                    extent.add(0, half_steps(options.lattice, first, k), half_steps(options.lattice, last, k));
                    extent.add(1, half_steps(options.lattice, j, k), half_steps(options.lattice, j, k));
                    extent.add(2, k, k);
                }
            }
        }
        if (kernels > 0) {
            smallest = static_cast<double>(low);
            largest = static_cast<double>(high);
        }
    }
};

Extent full_extent(const std::array<std::size_t, 3>& shape, Lattice lattice) {
    const auto [nk, nj, ni] = shape;
    // The last odd layer of a BCC lattice, or layer 0 where there is none, reaches farthest.
    const std::size_t farthest = nk > 1 ? 1 : 0;
    Extent result;
    result.add(0, 0, half_steps(lattice, ni - 1, farthest));
    result.add(1, 0, half_steps(lattice, nj - 1, farthest));
    result.add(2, 0, nk - 1);
    return result;
}

/// The same for a lattice whose axes are not the world's.
void check_oblique_positions(const RegularFieldOptions& options, const std::array<std::size_t, 3>& shape,
                             const KernelAxes& kernel) {
    double reach = glm::length(options.origin) + kernel.longest();
    double shortest = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        const auto last = static_cast<double>(shape[static_cast<std::size_t>(2 - axis)] - 1);
        reach += last * options.spacing[axis];
        shortest = last > 0.0 ? std::min(shortest, options.spacing[axis]) : shortest;
    }
    const std::string failed = "RegularField: the samples' positions cannot be used";
    const std::string found = "origin " + text_of(options.origin) + ", axes of the lengths " + text_of(options.spacing);
    if (!(reach < 1e150) || !(kernel.least() > 1e-150)) {
        throw InvalidInput(Complaint{failed, found, "positions below 1e150, supports wider than 1e-150",
                                     "choose another unit of length"});
    }
    if (shortest < 8.0 * std::numeric_limits<double>::epsilon() * reach) {
        throw InvalidInput(Complaint{failed, found + ": neighbouring samples fall on one float64 number",
                                     "positions that differ",
                                     "move " + option_ref("origin") + " nearer to 0, or check " + option_ref("axes")});
    }
}

void check_positions(const RegularFieldOptions& options, const Extent& extent, const Vec3& semi_axes) {
    static constexpr std::array<const char*, 3> names{"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
        const std::size_t last = extent.last[static_cast<std::size_t>(axis)];
        const double low = options.origin[axis];
        const double high = along(options, axis, last);
        const std::string failed = std::string("RegularField: the samples' positions along ") +
                                   names[static_cast<std::size_t>(axis)] + " cannot be used";
        const std::string found = "origin " + text_of(options.origin[axis]) + ", spacing " +
                                  text_of(options.lattice == Lattice::bcc ? options.spacing.x : options.spacing[axis]);
        // The diagonal of the box of all supports is a sum of squares.
        const double reach = std::max(std::abs(low), std::abs(high)) + semi_axes[axis];
        if (!(reach < 1e150)) {
            throw InvalidInput(Complaint{failed, found, "positions below 1e150", "choose another unit of length"});
        }
        if (!(semi_axes[axis] > 1e-150)) {
            throw InvalidInput(Complaint{failed, found, "supports wider than 1e-150", "choose another unit of length"});
        }
        const double step = last > 0 ? along(options, axis, last) - along(options, axis, last - 1) : 1.0;
        // Far from where neighbours could meet there is nothing to look for.
        bool distinct = true;
        if (step < 8.0 * std::numeric_limits<double>::epsilon() * reach) {
            for (std::size_t n = 0; n < last && distinct; ++n) {
                distinct = along(options, axis, n + 1) > along(options, axis, n);
            }
        }
        if (!distinct) {
            throw InvalidInput(
                Complaint{failed, found + ": neighbouring samples fall on one float64 number", "positions that differ",
                          "move " + option_ref("origin") + " nearer to 0, or check " + option_ref("spacing")});
        }
    }
}

} // namespace

RegularField::RegularField(SampleArray samples, std::array<std::size_t, 3> shape, const RegularFieldOptions& options,
                           const Progress& progress)
    : RegularField(std::move(samples), shape, options, progress, nullptr) {}

RegularField::RegularField(SampleArray samples, PrefilteredSamples found, std::array<std::size_t, 3> shape,
                           const RegularFieldOptions& options)
    : RegularField(std::move(samples), shape, options, {}, &found) {}

RegularField::RegularField(SampleArray samples, std::array<std::size_t, 3> shape, const RegularFieldOptions& options,
                           const Progress& progress, PrefilteredSamples* found)
    : shape_(shape), options_(options) {
    const auto size_of = [](const auto& array) { return array.size(); };
    const std::size_t count = check_shape(shape_, std::visit(size_of, samples));
    check_options(options_);
    kernel_.falloff = options_.falloff;
    normalization_ = options_.normalization;
    w0_ = options_.w0;
    least_weight_ = options_.least_weight;
    if (!std::isnormal(kernel_.gain()) || !std::isnormal(lattice_constant())) {
        throw InvalidInput(Complaint{
            "RegularField: radius and falloff give a kernel that float64 cannot hold",
            option_ref("radius", text_of(options_.radius)) + " and " + option_ref("falloff", text_of(options_.falloff)),
            "a radius of a few sample distances and a falloff between 1 and 20",
            "use the default, " + option_ref("radius", "2") + " and " + option_ref("falloff", "5")});
    }
    Extent extent = full_extent(shape_, options_.lattice);
    find_axes();
    if (options_.axes) {
        check_oblique_positions(options_, shape_, kernel_axes_);
    } else {
        check_positions(options_, extent, kernel_axes_.lengths);
    }
    std::visit(
        [&](const auto& array) {
            using T = typename std::decay_t<decltype(array)>::value_type;
            const Survey all = survey(array.data(), array.size());
            kernels_ = count;
            given_range_ = {all.smallest, all.largest};
            if constexpr (std::is_floating_point_v<T>) {
                if (!all.all_finite) {
                    Holes<T> holes(array, shape_, options_);
                    extent = holes.extent;
                    extents_ = std::move(holes.rows);
                    kernels_ = holes.kernels;
                    given_range_ = {holes.smallest, holes.largest};
                    has_holes_ = true;
                }
            }
            // (A BCC lattice of one layer counts as boundary zero.)
            const bool edge =
                options_.boundary == Boundary::edge && (options_.lattice == Lattice::cartesian || shape_[0] > 1);
            const bool chosen = edge && options_.normalization != Normalization::none;
            base_ = options_.base ? *options_.base : chosen ? base_of(array, kernels_, given_range_) : 0.0;
        },
        samples);
    options_.base = base_;
    require_moderate(given_range_);
    find_domain();
    if (kernels_ > 0 && !options_.axes) {
        for (int axis = 0; axis < 3; ++axis) {
            centres_world_.lower[axis] = along(options_, axis, extent.first[static_cast<std::size_t>(axis)]);
            centres_world_.upper[axis] = along(options_, axis, extent.last[static_cast<std::size_t>(axis)]);
        }
    }
    if (has_holes_ && domain_ && normalization_ == Normalization::lattice) {
        // No value may appear that lies between the data and nothing.
        normalization_ = Normalization::threshold;
        w0_ = least_weight_ = 0.5 * lattice_constant();
    }
    if (found != nullptr) {
        check_shape(shape_, std::visit(size_of, found->coefficients));
        given_ = std::make_shared<const SampleArray>(std::move(samples));
        take(std::move(*found));
    } else if (options_.prefilter) {
        const PollScope polling([&progress] { report_progress(progress, 0.0); });
        RegularFieldOptions resolved = options_;
        resolved.boundary = domain_ ? Boundary::edge : Boundary::zero;
        PrefilteredSamples made = prefiltered(samples, shape_, resolved);
        given_ = std::make_shared<const SampleArray>(std::move(samples));
        take(std::move(made));
    } else {
        value_range_ = {given_range_[0] - base_, given_range_[1] - base_};
        samples_ = with_ends(std::move(samples));
    }
    find_rows();
    if (kernels_ == 0) {
        value_range_ = {0.0, 0.0};
    } else if (options_.axes) {
        centres_world_ = box_of([&](const Vec3& direction) { return centres_along(Vec3(0.0), direction); });
    }
    if (options_.value_range) {
        value_range_ = {std::min(value_range_[0], (*options_.value_range)[0]),
                        std::max(value_range_[1], (*options_.value_range)[1])};
    }
    require_moderate(value_range_);
}

void RegularField::take(PrefilteredSamples&& found) {
    value_range_ = std::visit(
        [](const auto& array) {
            const Survey all = survey(array.data(), array.size());
            return std::array<double, 2>{all.smallest, all.largest};
        },
        found.coefficients);
    samples_ = with_ends(std::move(found.coefficients));
    prefilter_ = found.figures;
    options_.prefilter = true;
    normalization_ = options_.normalization = Normalization::none;
}

void RegularField::find_axes() {
    if (options_.axes) {
        steps_ = *options_.axes;
        options_.spacing = Vec3(glm::length(steps_[0]), glm::length(steps_[1]), glm::length(steps_[2]));
        kernel_axes_ = axes_of(options_.radius * steps_);
        return;
    }
    const bool bcc = options_.lattice == Lattice::bcc;
    const double a = options_.spacing.x;
    const Vec3 step = bcc ? Vec3(a, a, 0.5 * a) : options_.spacing;
    steps_ = Mat3(step.x, 0.0, 0.0, 0.0, step.y, 0.0, 0.0, 0.0, step.z);
    kernel_axes_.lengths = bcc ? Vec3(options_.radius * a / std::sqrt(2.0)) : options_.radius * options_.spacing;
}

void RegularField::find_domain() {
    const bool bcc = options_.lattice == Lattice::bcc;
    if (options_.boundary == Boundary::zero || (bcc && shape_[0] < 2) || kernels_ == 0) {
        return;
    }
    // A mirrored sample m layers beyond the outermost one lies m - 1/2 layers beyond the domain.
    const double layers = std::ceil(radius_in_layers(options_) + domain_in_layers) - 1.0;
    if (!(layers < largest_mirrored)) {
        throw InvalidInput(
            Complaint{unusable(owner, "radius"),
                      option_ref("radius", text_of(options_.radius)) + " with " + option_ref("boundary", "edge"),
                      "a radius below " + text_of(largest_mirrored) + " samples",
                      "pass " + option_ref("boundary", "zero") + ", or use the default radius, 2"});
    }
    const auto whole = static_cast<std::size_t>(layers);
    // Of BCC, whole edges of two layers, so that even layers stay even.
    mirrored_ = bcc ? std::array<std::size_t, 3>{2 * ((whole + 1) / 2), (whole + 2) / 2, (whole + 2) / 2}
                    : std::array<std::size_t, 3>{whole, whole, whole};
    if (options_.domain) {
        domain_ = options_.domain;
        return;
    }
    if (options_.axes) {
        const Mat3 to_index = to_indices(steps_);
        const Vec3 first = to_index * options_.origin;
        const Vec3 last =
            first +
            Vec3(static_cast<double>(shape_[2]), static_cast<double>(shape_[1]), static_cast<double>(shape_[0])) - 1.0;
        domain_.emplace(Box{first - domain_in_layers, last + domain_in_layers}, to_index);
        return;
    }
    const Extent all = full_extent(shape_, options_.lattice);
    Box domain;
    for (int axis = 0; axis < 3; ++axis) {
        const double step = bcc ? 0.5 * options_.spacing.x : options_.spacing[axis];
        domain.lower[axis] = along(options_, axis, 0) - domain_in_layers * step;
        domain.upper[axis] = along(options_, axis, all.last[static_cast<std::size_t>(axis)]) + domain_in_layers * step;
    }
    domain_ = domain;
}

Box RegularField::supports_world() const {
    return kernels_ > 0 ? box_of([&](const Vec3& direction) { return reach_along(Vec3(0.0), direction); }) : Box{};
}

double RegularField::default_slice_spacing() const {
    if (options_.axes) {
        const Vec3 all = heights(steps_);
        return std::min({all.x, all.y, all.z});
    }
    const Vec3& d = options_.spacing;
    return options_.lattice == Lattice::bcc ? 0.5 * d.x : std::min({d.x, d.y, d.z});
}

std::size_t RegularField::memory() const {
    const auto bytes = [](const auto& array) {
        return array.capacity() * sizeof(typename std::decay_t<decltype(array)>::value_type);
    };
    return sizeof(*this) + std::visit(bytes, *samples_) + (given_ ? std::visit(bytes, *given_) : 0) +
           layers_.capacity() * sizeof(std::size_t) + extents_.capacity() * sizeof(SampleRange) +
           extent_of_row_.capacity() + outermost_rows_.capacity() * sizeof(std::uint32_t) +
           std::accumulate(rows_.begin(), rows_.end(), std::size_t{0},
                           [&](std::size_t sum, const auto& rows) { return sum + bytes(rows); });
}

Vec3 RegularField::position(std::size_t i, std::size_t j, std::size_t k) const {
    if (options_.axes) {
        return options_.origin + steps_ * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
    }
    return {along(options_, 0, half_steps(options_.lattice, i, k)),
            along(options_, 1, half_steps(options_.lattice, j, k)), along(options_, 2, k)};
}

double RegularField::value(std::size_t i, std::size_t j, std::size_t k) const {
    const std::size_t n = row(j, k) + i;
    return std::visit([n](const auto& array) { return static_cast<double>(array[n]); }, *samples_) - counted_from();
}

double RegularField::step_volume() const { return std::abs(glm::determinant(steps_)); }

double RegularField::lattice_constant() const {
    // Spacing cancels: the semi-axes' product over the volume per sample is radius^3 (Cartesian),
    // and (radius a / sqrt 2)^3 / (a^3 / 2) for BCC.
    const double cube = options_.radius * options_.radius * options_.radius;
    return kernel_.unit_mass() * (options_.lattice == Lattice::bcc ? cube / std::sqrt(2.0) : cube);
}

std::array<double, 2> RegularField::reach_along(const Vec3& from, const Vec3& direction) const {
    const std::array<double, 2> range = centres_along(from, direction);
    const double reach = glm::length(kernel_axes_.row(direction));
    return {range[0] - reach, range[1] + reach};
}

std::array<double, 2> RegularField::centres_along(const Vec3& from, const Vec3& direction) const {
    std::array<double, 2> range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    const auto add = [&](std::size_t i, std::size_t j, std::size_t k) {
        const double at = glm::dot(position(i, j, k) - from, direction);
        range = {std::min(range[0], at), std::max(range[1], at)};
    };
    if (kernels_ == 0) {
        return range;
    }
    const auto [nk, nj, ni] = shape_;
    if (extents_.empty()) {
        // Of each cubic lattice that it consists of, the corners.
        const bool bcc = options_.lattice == Lattice::bcc;
        for (std::size_t odd = 0; odd < std::min<std::size_t>(bcc ? 2 : 1, nk); ++odd) {
            const std::size_t last = bcc ? nk - 1 - (nk - 1 - odd) % 2 : nk - 1;
            for (const std::size_t k : {odd, last}) {
                for (const std::size_t j : {std::size_t{0}, nj - 1}) {
                    add(0, j, k);
                    add(ni - 1, j, k);
                }
            }
        }
    } else {
        const std::size_t rows = outermost_rows_.empty() ? nj * nk : outermost_rows_.size();
        for (std::size_t n = 0; n < rows; ++n) {
            const std::size_t row = outermost_rows_.empty() ? n : outermost_rows_[n];
            const SampleRange kernels = kernels_of_row(row % nj, row / nj);
            if (kernels.begin < kernels.end) {
                add(kernels.begin, row % nj, row / nj);
                add(kernels.end - 1, row % nj, row / nj);
            }
        }
    }
    return range;
}

} // namespace sheetsplat

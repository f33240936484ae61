#include "reference/sums.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "reference/reference.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference {

namespace {

// Share of a slice's distance that a kernel's range of slices is widened by, so that rounding cannot lose one: its own
// end decides.
constexpr double margin = 1e-3;

// Columns: in boxes up to this width the end of each row is not searched for.
constexpr int narrow = 16;

std::size_t pixels_with_border(const Screen& screen) {
    return static_cast<std::size_t>(screen.width() + 2) * static_cast<std::size_t>(screen.height() + 2);
}

// Were all kernels at one point, its sums would be these at most.
void require_finite_sums(const Field& field, std::uint64_t kernels) {
    const auto* ellipsoids = as_ellipsoids(&field);
    const std::array<double, 2> values = field.value_range();
    const double weight = ellipsoids != nullptr ? ellipsoids->weight_range()[1] : 1.0;
    const double most = weight * static_cast<double>(kernels);
    const double largest = most * std::max(std::abs(values[0]), std::abs(values[1]));
    if (!is_finite(most) || !is_finite(largest)) {
        throw InvalidInput(Complaint{"the field cannot be summed",
                                     text_of_count(field.size()) + " kernels of values between " + text_of(values[0]) +
                                         " and " + text_of(values[1]) + ", weights up to " + text_of(weight),
                                     "sums of values times weights below 1e308",
                                     "divide the values or the weights by a common factor"});
    }
}

} // namespace

Sheet::Sheet(const Screen& screen, const Wanted& wanted)
    : rho(pixels_with_border(screen)), reached(pixels_with_border(screen)),
      weight(wanted.weights ? pixels_with_border(screen) : 0), counts(wanted.counts ? pixels_with_border(screen) : 0),
      gradient(wanted.gradients ? pixels_with_border(screen) : 0),
      stride_(static_cast<std::size_t>(screen.width() + 2)) {}

void Sheet::clear() {
    std::fill(rho.begin(), rho.end(), 0.0);
    std::fill(reached.begin(), reached.end(), static_cast<unsigned char>(0));
    std::fill(weight.begin(), weight.end(), 0.0);
    std::fill(counts.begin(), counts.end(), static_cast<unsigned char>(0));
    std::fill(gradient.begin(), gradient.end(), Vec3(0.0));
}

SheetSums::SheetSums(const Sheet& like)
    : d(like.rho.size()), w(like.rho.size()), reached(like.rho.size()), slope_d(like.gradient.size()),
      slope_w(like.gradient.size()), plateau(like.rho.size()) {}

void SheetSums::clear() {
    std::fill(d.begin(), d.end(), 0.0);
    std::fill(w.begin(), w.end(), 0.0);
    std::fill(reached.begin(), reached.end(), static_cast<unsigned char>(0));
    std::fill(slope_d.begin(), slope_d.end(), Vec3(0.0));
    std::fill(slope_w.begin(), slope_w.end(), Vec3(0.0));
    std::fill(plateau.begin(), plateau.end(), std::numeric_limits<double>::quiet_NaN());
}

void compare_labels(const std::vector<Sheet*>& sheets) {
    const std::size_t labels = sheets.size();
    std::vector<double> own(labels);
    std::vector<Vec3> slopes(labels);
    const bool with_slopes = !sheets.front()->gradient.empty();
    for (std::size_t at = 0; at < sheets.front()->rho.size(); ++at) {
        for (std::size_t label = 0; label < labels; ++label) {
            own[label] = sheets[label]->rho[at];
            slopes[label] = with_slopes ? sheets[label]->gradient[at] : Vec3(0.0);
        }
        for (std::size_t label = 0; label < labels; ++label) {
            double largest = 0.0;
            Vec3 slope(0.0);
            for (std::size_t other = 0; other < labels; ++other) {
                if (other != label && own[other] > largest) {
                    largest = own[other];
                    slope = slopes[other];
                }
            }
            sheets[label]->rho[at] = own[label] - largest;
            if (with_slopes) {
                sheets[label]->gradient[at] = slopes[label] - slope;
            }
        }
    }
}

Normaliser::Normaliser(const Field& field, double radius_factor)
    : normalization_(field.normalization()), w0_(field.w0()), least_weight_(field.least_weight()),
      // C is the kernel's mass, which follows its radius; the filter keeps it.
      lattice_constant_(WorldKernels(field).lattice_constant() * radius_factor * radius_factor * radius_factor) {
    if (least_weight_ > 0.0) {
        // Of lattices with holes both are C / 2.
        w0_ *= radius_factor * radius_factor * radius_factor;
        least_weight_ *= radius_factor * radius_factor * radius_factor;
    }
}

double Normaliser::rho(double d, double w) const {
    switch (normalization_) {
    case Normalization::none:
        return d;
    case Normalization::lattice:
        return d / lattice_constant_;
    case Normalization::threshold:
        return d / std::max(w0_, w);
    }
    return d;
}

Vec3 Normaliser::gradient(double d, double w, const Vec3& slope_d, const Vec3& slope_w) const {
    switch (normalization_) {
    case Normalization::none:
        return slope_d;
    case Normalization::lattice:
        return slope_d / lattice_constant_;
    case Normalization::threshold:
        // The square of W need not fit.
        return w > w0_ ? (slope_d - d / w * slope_w) / w : slope_d / w0_;
    }
    return slope_d;
}

FieldSums::FieldSums(const Field& field, const Clip& end, const Scene& scene, const Camera& camera,
                     const Screen& screen, const Slices& slices, double radius_factor, ZeroKernels zero_kernels)
    : screen_(screen), slices_(slices), sampling_(scene.sampling), reference_distance_(scene.reference_distance()),
      zero_kernels_(zero_kernels), scalar_(is_scalar(scene.mode)), base_(field.base()),
      end_(end, camera, scene.slice_distance()), eye_kernels_(field, scene, camera, screen, radius_factor),
      profile_(field.kernel().falloff), normaliser_(field, radius_factor), next_(slices.first) {
    require_finite_sums(field, WorldKernels(field).numbers());
    sort_kernels();
}

void FieldSums::sort_kernels() {
    const std::string what = "the reference's list of slices";
    const auto slices = static_cast<std::uint64_t>(slices_.count);
    require_memory(checked_product(slices + 1, sizeof(std::uint64_t) + sizeof(std::int64_t), what), what,
                   "use a larger " + option_ref("slice_spacing"));
    offsets_.assign(slices + 1, 0);
    // How many more are held at each slice than at the one before it.
    std::vector<std::int64_t> changes(slices + 1, 0);
    const auto bucket = [&](std::int64_t slice) { return static_cast<std::size_t>(slice - slices_.first); };

    // A counting sort: how many begin at each slice, where each slice's begin in the list, then the list.
    std::uint64_t drawn = 0;
    eye_kernels_.for_each([&](std::uint64_t, const EyeKernel& kernel) {
        const SliceRange met = slices_met(kernel);
        if (is_drawn(kernel, met)) {
            ++offsets_[bucket(met.first) + 1];
            ++changes[bucket(met.first)];
            --changes[bucket(met.last) + 1];
            ++drawn;
        }
    });
    std::int64_t held = 0, most_held = 0;
    for (std::size_t n = 0; n < slices; ++n) {
        offsets_[n + 1] += offsets_[n];
        held += changes[n];
        most_held = std::max(most_held, held);
    }
    const std::string kernels = "the reference's list of kernels";
    require_memory(checked_product(drawn, sizeof(std::uint64_t), kernels) +
                       checked_product(static_cast<std::uint64_t>(most_held), sizeof(Held), kernels),
                   kernels, "use fewer kernels, or another " + option_ref("backend"));
    held_.reserve(static_cast<std::size_t>(most_held));
    kernels_.resize(drawn);
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    eye_kernels_.for_each([&](std::uint64_t number, const EyeKernel& kernel) {
        const SliceRange met = slices_met(kernel);
        if (is_drawn(kernel, met)) {
            kernels_[next[bucket(met.first)]++] = number;
        }
    });
}

FieldSums::SliceRange FieldSums::slices_met(const EyeKernel& kernel) const {
    const double front = (kernel.depth() - kernel.shape.half_depth() - slices_.anchor) / slices_.spacing;
    const double back = (kernel.depth() + kernel.shape.half_depth() - slices_.anchor) / slices_.spacing;
    // Slice n lies at n + 1/2 in these units, its slab from n to n + 1.
    const double half = sampling_ == Sampling::point ? 0.5 : 0.0;
    const double first = sampling_ == Sampling::point ? std::ceil(front - half - margin) : std::floor(front - margin);
    const double last =
        sampling_ == Sampling::point ? std::floor(back - half + margin) : std::ceil(back + margin) - 1.0;
    const double lower = static_cast<double>(slices_.first), upper = static_cast<double>(slices_.last());
    if (!(first <= upper && last >= lower)) {
        return {};
    }
    return {static_cast<std::int64_t>(std::max(first, lower)), static_cast<std::int64_t>(std::min(last, upper))};
}

Interval FieldSums::depths(const EyeKernel& kernel, std::int64_t first, std::int64_t last) const {
    if (sampling_ == Sampling::point) {
        return {slices_.depth(first), slices_.depth(last)};
    }
    // A slab much longer than the support would cover far more pixels in perspective.
    return {std::max(slices_.front(first), kernel.depth() - kernel.shape.half_depth()),
            std::min(slices_.back(last), kernel.depth() + kernel.shape.half_depth())};
}

bool FieldSums::is_drawn(const EyeKernel& kernel, const SliceRange& met) const {
    if (kernel.value == 0.0 && zero_kernels_ == ZeroKernels::left_out) {
        return false;
    }
    if (met.first > met.last) {
        return false;
    }
    const Interval depth = depths(kernel, met.first, met.last);
    if (depth.empty()) {
        return false;
    }
    const double front = depth.lower - kernel.depth(), back = depth.upper - kernel.depth();
    const Interval x = kernel.shape.bounds_x(front, back), y = kernel.shape.bounds_y(front, back);
    return !screen_.columns(kernel.centre.x + x.lower, kernel.centre.x + x.upper, depth.lower, depth.upper).empty() &&
           !screen_.rows(kernel.centre.y + y.lower, kernel.centre.y + y.upper, depth.lower, depth.upper).empty();
}

void FieldSums::splat(const EyeKernel& kernel, std::int64_t n, SheetSums& sums, Sheet& sheet) const {
    const Interval depth = depths(kernel, n, n);
    if (depth.empty()) {
        return;
    }
    const bool point = sampling_ == Sampling::point, with_slope = !sums.slope_d.empty();
    const Vec3& centre = kernel.centre;
    // Less the centre's: of what the support reaches, and of the whole slab.
    const double front = depth.lower - kernel.depth(), back = depth.upper - kernel.depth();
    const double slab_front = slices_.front(n) - kernel.depth(), slab_back = slices_.back(n) - kernel.depth();
    // Where the pixels' rays are known: at the slice, or at the centre's depth.
    const double plane = point ? slices_.depth(n) : kernel.depth();
    const double half_width = screen_.half_width(plane), half_height = screen_.half_height(plane);
    const double dz = kernel.depth() - plane;

    const Interval all_x = kernel.shape.bounds_x(front, back), y = kernel.shape.bounds_y(front, back);
    const Screen::Span all_columns =
        screen_.columns(centre.x + all_x.lower, centre.x + all_x.upper, depth.lower, depth.upper);
    const Screen::Span rows = screen_.rows(centre.y + y.lower, centre.y + y.upper, depth.lower, depth.upper);
    for (int j = rows.first; j <= rows.last; ++j) {
        const double dy = screen_.ndc_y(j) * half_height - centre.y;
        const double slope_y = screen_.slope_y(j);
        Screen::Span columns = all_columns;
        if (columns.last - columns.first >= narrow) {
            const Interval x = kernel.shape.bounds_in_row(dy + slope_y * dz, slope_y, front, back);
            if (x.empty()) {
                continue;
            }
            columns = screen_.columns(centre.x + x.lower, centre.x + x.upper, depth.lower, depth.upper);
        }
        for (int i = columns.first; i <= columns.last; ++i) {
            const double dx = screen_.ndc_x(i) * half_width - centre.x;
            double g = 0.0;
            Vec3 slope(0.0);
            if (point) {
                const Vec3 q = kernel.shape.to_unit(Vec3(dx, dy, dz));
                const double r_squared = glm::dot(q, q);
                if (!(r_squared < 1.0)) {
                    continue;
                }
                g = profile_.at(r_squared);
                if (with_slope) {
                    slope = reference_distance_ * kernel.shape.slope_to_eye(profile_.slope(r_squared) * q);
                }
            } else {
                const Chord chord = kernel.shape.mean(profile_, Vec3(dx, dy, 0.0), screen_.slope_x(i), slope_y,
                                                      slab_front, slab_back, with_slope);
                if (!chord.reached) {
                    continue;
                }
                g = chord.mean;
                slope = reference_distance_ * chord.slope;
            }
            const std::size_t at = sheet.index(i, j);
            sums.d[at] += kernel.value * g;
            sums.w[at] += kernel.weight * g;
            if (kernel.weight > 0.0 && sums.plateau[at] != kernel.scalar) {
                sums.plateau[at] =
                    std::isnan(sums.plateau[at]) ? kernel.scalar : std::numeric_limits<double>::infinity();
            }
            if (with_slope) {
                sums.slope_d[at] += kernel.value * slope;
                sums.slope_w[at] += kernel.weight * slope;
            }
            sums.reached[at] = 1;
        }
    }
}

void FieldSums::add_next(Sheet& sheet, SheetSums& sums) {
    sums.clear();
    const std::int64_t n = next_++;
    const std::size_t begins = static_cast<std::size_t>(n - slices_.first);
    for (std::uint64_t at = offsets_[begins]; at < offsets_[begins + 1]; ++at) {
        const EyeKernel kernel = eye_kernels_.at(kernels_[at]);
        held_.push_back({kernel, slices_met(kernel).last});
    }
    for (const Held& held : held_) {
        splat(held.kernel, n, sums, sheet);
    }
    held_.erase(std::remove_if(held_.begin(), held_.end(), [n](const Held& held) { return held.last <= n; }),
                held_.end());
    for (int row = -1; row <= screen_.height(); ++row) {
        for (int column = -1; column <= screen_.width(); ++column) {
            add(n, column, row, sums, sheet);
        }
    }
}

void FieldSums::add(std::int64_t n, int column, int row, const SheetSums& sums, Sheet& sheet) const {
    const std::size_t at = sheet.index(column, row);
    const double w = sums.w[at];
    // D / W of a plateau is its value, and has no gradient: under a transfer function of one value rounding would be
    // lit.
    const bool plateau = normaliser_.divides_by(w) && std::isfinite(sums.plateau[at]);
    const double rho = plateau ? sums.plateau[at] : normaliser_.rho(sums.d[at], w);
    const bool inside = end_.keeps(screen_.point(column, row, slices_.depth(n)));
    // What is classified is read by gradients, too, for which a field ends nowhere.
    if (!scalar_) {
        sheet.rho[at] += rho;
    } else if (inside) {
        sheet.rho[at] += base_ + rho;
    }
    if (!sheet.gradient.empty() && !plateau) {
        sheet.gradient[at] += normaliser_.gradient(sums.d[at], w, sums.slope_d[at], sums.slope_w[at]);
    }
    if (!inside) {
        return;
    }
    if (sums.reached[at] != 0 && !(w < normaliser_.least_weight())) {
        sheet.reached[at] = 1;
        if (!sheet.counts.empty() && w > 0.0) {
            sheet.counts[at] = 1;
        }
    }
    if (!sheet.weight.empty()) {
        sheet.weight[at] += w;
    }
}

Sums sums_at(const Field& field, const Vec3& point_world) {
    const WorldKernels kernels(field);
    const Profile profile(field.kernel().falloff);
    Sums sums;
    for (std::uint64_t number = 0; number < kernels.numbers(); ++number) {
        const std::optional<WorldKernel> kernel = kernels.at(number);
        if (!kernel) {
            continue;
        }
        // q = S^-1 R^T d
        const Vec3 q = (point_world - kernel->centre) * kernel->axes / kernel->semi_axes;
        const double r_squared = glm::dot(q, q);
        if (r_squared < 1.0) {
            const double g = profile.at(r_squared);
            sums.d += kernel->weight * kernel->value * g;
            sums.w += kernel->weight * g;
            sums.empty = false;
        }
    }
    return sums;
}

} // namespace sheetsplat::reference

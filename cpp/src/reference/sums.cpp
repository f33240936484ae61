#include "reference/sums.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "reference/reference.hpp"

namespace sheetsplat::reference {

namespace {

// Share of a slice's distance that a kernel's range of slices is widened by, so that rounding cannot lose one: its own
// end decides.
constexpr double margin = 1e-3;

std::size_t pixels_with_border(const Screen& screen) {
    return static_cast<std::size_t>(screen.width() + 2) * static_cast<std::size_t>(screen.height() + 2);
}

} // namespace

Sheet::Sheet(const Screen& screen, bool weights)
    : rho(pixels_with_border(screen)), reached(pixels_with_border(screen)),
      weight(weights ? pixels_with_border(screen) : 0), stride_(static_cast<std::size_t>(screen.width() + 2)) {}

void Sheet::clear() {
    std::fill(rho.begin(), rho.end(), 0.0);
    std::fill(reached.begin(), reached.end(), static_cast<unsigned char>(0));
    std::fill(weight.begin(), weight.end(), 0.0);
}

FieldSums::FieldSums(const RegularField& field, const Camera& camera, const Screen& screen, const Slices& slices,
                     Sampling sampling, double radius_factor, ZeroKernels zero_kernels)
    : field_(field), screen_(screen), slices_(slices), sampling_(sampling), zero_kernels_(zero_kernels),
      shape_(field, camera, radius_factor),
      // C is the kernel's mass, which follows its radius.
      lattice_constant_(field.lattice_constant() * radius_factor * radius_factor * radius_factor) {
    require_memory(static_cast<std::uint64_t>(slices.count + 1) * sizeof(std::uint64_t),
                   "the reference's list of slices", "Ask for a larger slice_spacing.");
    offsets_.assign(static_cast<std::size_t>(slices.count + 1), 0);
    const auto bucket = [&](const SliceRange& met) { return static_cast<std::size_t>(met.first - slices_.first); };

    // A counting sort: how many begin at each slice, where each slice's begin in the list, then the list.
    std::uint64_t drawn = 0;
    for_each_kernel(field, [&](std::uint64_t, const Vec3& position, double value) {
        const Vec3 centre = shape_.centre_eye(position);
        if (is_drawn(centre, value)) {
            const SliceRange met = slices_met(-centre.z);
            longest_ = std::max(longest_, met.last - met.first + 1);
            ++offsets_[bucket(met) + 1];
            ++drawn;
        }
    });
    for (std::size_t n = 1; n < offsets_.size(); ++n) {
        offsets_[n] += offsets_[n - 1];
    }
    require_memory(checked_product(drawn, sizeof(std::uint64_t), "the reference's list of kernels"),
                   "the reference's list of kernels", "Render a smaller volume, or with another backend.");
    kernels_.resize(drawn);
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for_each_kernel(field, [&](std::uint64_t id, const Vec3& position, double value) {
        const Vec3 centre = shape_.centre_eye(position);
        if (is_drawn(centre, value)) {
            kernels_[next[bucket(slices_met(-centre.z))]++] = id;
        }
    });
}

FieldSums::SliceRange FieldSums::slices_met(double depth) const {
    const double front = (depth - shape_.reach().z - slices_.anchor) / slices_.spacing;
    const double back = (depth + shape_.reach().z - slices_.anchor) / slices_.spacing;
    // Slice n lies at n + 1/2 in these units, its slab from n to n + 1.
    const double half = sampling_ == Sampling::point ? 0.5 : 0.0;
    const double first = sampling_ == Sampling::point ? std::ceil(front - half - margin) : std::floor(front - margin);
    const double last =
        sampling_ == Sampling::point ? std::floor(back - half + margin) : std::ceil(back + margin) - 1.0;
    const double lower = static_cast<double>(slices_.first), upper = static_cast<double>(slices_.last());
    if (first > upper || last < lower) {
        return {};
    }
    return {static_cast<std::int64_t>(std::max(first, lower)), static_cast<std::int64_t>(std::min(last, upper))};
}

bool FieldSums::is_drawn(const Vec3& centre_eye, double value) const {
    if (value == 0.0 && zero_kernels_ == ZeroKernels::left_out) {
        return false;
    }
    const SliceRange met = slices_met(-centre_eye.z);
    if (met.first > met.last) {
        return false;
    }
    const bool point = sampling_ == Sampling::point;
    return !screen_
                .footprint(centre_eye, shape_.reach(), point ? slices_.depth(met.first) : slices_.front(met.first),
                           point ? slices_.depth(met.last) : slices_.back(met.last))
                .empty();
}

void FieldSums::splat_point(const Vec3& centre_eye, double value, std::int64_t n, SheetSums& sums, Sheet& sheet) const {
    const double depth = slices_.depth(n);
    const Screen::Footprint pixels = screen_.footprint(centre_eye, shape_.reach(), depth, depth);
    const double half_width = screen_.half_width(depth), half_height = screen_.half_height(depth);
    const double dz = -depth - centre_eye.z;
    for (int j = pixels.first_row; j <= pixels.last_row; ++j) {
        const double dy = screen_.ndc_y(j) * half_height - centre_eye.y;
        for (int i = pixels.first_column; i <= pixels.last_column; ++i) {
            const double dx = screen_.ndc_x(i) * half_width - centre_eye.x;
            const Vec3 q = shape_.to_unit(Vec3(dx, dy, dz));
            const double r_squared = glm::dot(q, q);
            if (r_squared >= 1.0) {
                continue;
            }
            const double g = shape_.profile().at(r_squared);
            const std::size_t at = sheet.index(i, j);
            sums.d[at] += value * g;
            sums.w[at] += g;
            sheet.reached[at] = 1;
        }
    }
}

void FieldSums::splat_slab(const Vec3& centre_eye, double value, std::int64_t n, SheetSums& sums, Sheet& sheet) const {
    const double centre_depth = -centre_eye.z;
    const double front = slices_.front(n), back = slices_.back(n);
    // Only the part of the slab that the support reaches: a slab much longer than it would cover far more pixels.
    const double reach = shape_.reach().z;
    const Screen::Footprint pixels = screen_.footprint(
        centre_eye, shape_.reach(), std::max(front, centre_depth - reach), std::min(back, centre_depth + reach));
    const double half_width = screen_.half_width(centre_depth), half_height = screen_.half_height(centre_depth);
    for (int j = pixels.first_row; j <= pixels.last_row; ++j) {
        const double dy = screen_.ndc_y(j) * half_height - centre_eye.y;
        for (int i = pixels.first_column; i <= pixels.last_column; ++i) {
            const double dx = screen_.ndc_x(i) * half_width - centre_eye.x;
            const Chord chord = shape_.mean(Vec3(dx, dy, 0.0), screen_.slope_x(i), screen_.slope_y(j),
                                            front - centre_depth, back - centre_depth);
            if (!chord.reached) {
                continue;
            }
            const std::size_t at = sheet.index(i, j);
            sums.d[at] += value * chord.mean;
            sums.w[at] += chord.mean;
            sheet.reached[at] = 1;
        }
    }
}

double FieldSums::normalise(double d, double w) const {
    switch (field_.normalization()) {
    case Normalization::none:
        return d;
    case Normalization::lattice:
        return d / lattice_constant_;
    case Normalization::threshold:
        return d / std::max(field_.w0(), w);
    }
    return d;
}

void FieldSums::add_to(Sheet& sheet, std::int64_t n, SheetSums& sums) const {
    std::fill(sums.d.begin(), sums.d.end(), 0.0);
    std::fill(sums.w.begin(), sums.w.end(), 0.0);
    const auto [nk, nj, ni] = field_.shape();
    const std::int64_t earliest = std::max(slices_.first, n - longest_ + 1);
    const std::uint64_t begin = offsets_[static_cast<std::size_t>(earliest - slices_.first)];
    const std::uint64_t end = offsets_[static_cast<std::size_t>(n - slices_.first) + 1];
    for (std::uint64_t at = begin; at < end; ++at) {
        const std::size_t id = kernels_[at];
        const std::size_t i = id % ni, j = id / ni % nj, k = id / (ni * nj);
        const Vec3 centre = shape_.centre_eye(field_.position(i, j, k));
        const SliceRange met = slices_met(-centre.z);
        if (n < met.first || n > met.last) {
            continue;
        }
        if (sampling_ == Sampling::point) {
            splat_point(centre, field_.value(i, j, k), n, sums, sheet);
        } else {
            splat_slab(centre, field_.value(i, j, k), n, sums, sheet);
        }
    }
    for (std::size_t pixel = 0; pixel < sheet.rho.size(); ++pixel) {
        sheet.rho[pixel] += normalise(sums.d[pixel], sums.w[pixel]);
    }
    for (std::size_t pixel = 0; pixel < sheet.weight.size(); ++pixel) {
        sheet.weight[pixel] += sums.w[pixel];
    }
}

Sums sums_at(const RegularField& field, const Vec3& point_world) {
    const Vec3 semi_axes = field.semi_axes_world();
    const Profile profile(field.kernel().falloff);
    Sums sums;
    for_each_kernel(field, [&](std::uint64_t, const Vec3& position, double value) {
        const Vec3 q = (point_world - position) / semi_axes;
        const double r_squared = glm::dot(q, q);
        if (r_squared < 1.0) {
            const double g = profile.at(r_squared);
            sums.d += value * g;
            sums.w += g;
            sums.empty = false;
        }
    });
    return sums;
}

} // namespace sheetsplat::reference

#include "reference/points.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference {

namespace {

constexpr std::size_t most_cells_along = 64;
/// Share of distances that rounding stays below.
constexpr double margin = 1e-12;
const char* const advice = "leave out shadows and ambient occlusion, or use fewer kernels";

// The box around a kernel's support, wide enough for any rounding: the kernel's own end decides.
Box box_around(const EyeKernel& kernel) {
    const double half_depth = kernel.shape.half_depth() * (1.0 + 1e-12);
    const Interval x = kernel.shape.bounds_x(-half_depth, half_depth);
    const Interval y = kernel.shape.bounds_y(-half_depth, half_depth);
    return {kernel.centre + Vec3(x.lower, y.lower, -half_depth), kernel.centre + Vec3(x.upper, y.upper, half_depth)};
}

} // namespace

Chord mean_of(const Profile& profile, const Vec3& start, const Vec3& way) {
    // u along the line is 0 where it is nearest to the centre.
    const double length = glm::length(way);
    const double u = glm::dot(start, way) / length;
    const Vec3 nearest = start - (u / length) * way;
    const double b_squared = glm::dot(nearest, nearest);
    if (!(b_squared < 1.0)) {
        return {};
    }
    const double half_chord = std::sqrt(1.0 - b_squared);
    const double first = std::max(u, -half_chord), last = std::min(u + length, half_chord);
    return first < last ? Chord{true, profile.integral(b_squared, first, last) / length} : Chord{};
}

PointSums::PointSums(const Field& field, const Scene& scene, const Camera& camera, const Screen& screen,
                     double radius_factor)
    : profile_(field.kernel().falloff), normaliser_(field, radius_factor) {
    const std::string what = "the reference's grid of kernels";
    const EyeKernels seen(field, scene, camera, screen, radius_factor);
    // Mirrored ones included.
    std::uint64_t count = 0;
    seen.for_each([&count](std::uint64_t, const EyeKernel&) { ++count; });
    if (count > 0xFFFFFFFFULL) {
        throw OutOfMemory(Complaint{"shadows and ambient occlusion cannot be drawn", text_of_count(count) + " kernels",
                                    "at most 2^32", advice});
    }
    // Twice while they are sorted.
    require_memory(checked_product(count, 2 * sizeof(EyeKernel) + sizeof(std::uint32_t), what), what, advice);
    kernels_.reserve(count);
    seen.for_each([&](std::uint64_t, const EyeKernel& kernel) {
        const Box box = box_around(kernel);
        box_ = kernels_.empty() ? box : Box{glm::min(box_.lower, box.lower), glm::max(box_.upper, box.upper)};
        kernels_.push_back(kernel);
    });
    // About one cell a kernel.
    const auto along = static_cast<std::size_t>(std::cbrt(static_cast<double>(kernels_.size())));
    cells_.fill(std::clamp(along, std::size_t{1}, most_cells_along));

    cell_size_ = (box_.upper - box_.lower) / static_cast<double>(cells_[0]);

    const std::size_t cells = cells_[0] * cells_[1] * cells_[2];
    sort_kernels(cells);
    offsets_.assign(cells + 1, 0);
    for (const EyeKernel& kernel : kernels_) {
        for_each_cell(kernel, [&](std::size_t cell) { ++offsets_[cell + 1]; });
    }
    for (std::size_t cell = 0; cell < cells; ++cell) {
        offsets_[cell + 1] += offsets_[cell];
    }
    require_memory(checked_product(offsets_.back(), sizeof(std::uint32_t), what), what, advice);
    members_.resize(offsets_.back());
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for (std::size_t number = 0; number < kernels_.size(); ++number) {
        for_each_cell(kernels_[number],
                      [&](std::size_t cell) { members_[next[cell]++] = static_cast<std::uint32_t>(number); });
    }
}

std::size_t PointSums::cell_along(int axis, double place) const {
    const double cells = static_cast<double>(cells_[static_cast<std::size_t>(axis)]);
    const double share = (place - box_.lower[axis]) / (box_.upper[axis] - box_.lower[axis]);
    return static_cast<std::size_t>(std::clamp(std::floor(share * cells), 0.0, cells - 1.0));
}

std::size_t PointSums::cell_at(const Vec3& place) const {
    return (cell_along(2, place.z) * cells_[1] + cell_along(1, place.y)) * cells_[0] + cell_along(0, place.x);
}

// By the cells of their centres: what is read together lies together.
void PointSums::sort_kernels(std::size_t cells) {
    std::vector<std::uint32_t> next(cells + 1, 0);
    for (const EyeKernel& kernel : kernels_) {
        ++next[cell_at(kernel.centre) + 1];
    }
    for (std::size_t cell = 0; cell < cells; ++cell) {
        next[cell + 1] += next[cell];
    }
    std::vector<std::uint32_t> order(kernels_.size());
    for (std::size_t number = 0; number < kernels_.size(); ++number) {
        order[next[cell_at(kernels_[number].centre)]++] = static_cast<std::uint32_t>(number);
    }
    std::vector<EyeKernel> sorted;
    sorted.reserve(kernels_.size());
    for (const std::uint32_t number : order) {
        sorted.push_back(kernels_[number]);
    }
    kernels_ = std::move(sorted);
}

PointSums::Cells PointSums::cells_of(const Box& box) const {
    Cells cells{};
    for (int axis = 0; axis < 3; ++axis) {
        cells.first[static_cast<std::size_t>(axis)] = cell_along(axis, box.lower[axis]);
        cells.last[static_cast<std::size_t>(axis)] = cell_along(axis, box.upper[axis]);
    }
    return cells;
}

template <class Visit>
void PointSums::for_each_cell(const EyeKernel& kernel, Visit&& visit) const {
    const Cells cells = cells_of(box_around(kernel));
    // A cell whose middle is farther from the support, in units of it, than its corners are from its middle, has no
    // point of it. Thin kernels leave out most of what their boxes meet.
    const KernelShape& shape = kernel.shape;
    const Vec3 half = 0.5 * cell_size_;
    double corners = 0.0;
    for (const Vec3& corner :
         {half, Vec3(-half.x, half.y, half.z), Vec3(half.x, -half.y, half.z), Vec3(half.x, half.y, -half.z)}) {
        corners = std::max(corners, glm::length(shape.to_unit(corner)));
    }
    const double steepest = glm::length(shape.to_unit(Vec3(1.0, 0.0, 0.0))) +
                            glm::length(shape.to_unit(Vec3(0.0, 1.0, 0.0))) +
                            glm::length(shape.to_unit(Vec3(0.0, 0.0, 1.0)));
    const bool one = cells.first == cells.last;
    for (std::size_t z = cells.first[2]; z <= cells.last[2]; ++z) {
        for (std::size_t y = cells.first[1]; y <= cells.last[1]; ++y) {
            for (std::size_t x = cells.first[0]; x <= cells.last[0]; ++x) {
                const Vec3 number(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z));
                const Vec3 from_centre = box_.lower + (number + 0.5) * cell_size_ - kernel.centre;
                const double rounding = margin * steepest * (glm::length(from_centre) + glm::length(half));
                if (one || !(glm::length(shape.to_unit(from_centre)) > 1.0 + corners + rounding)) {
                    visit((z * cells_[1] + y) * cells_[0] + x);
                }
            }
        }
    }
}

PointSums::Value PointSums::at(const Vec3& point_eye) const {
    const Sums sums = sums_at(point_eye);
    return {rho(sums), sums.empty || sums.w < normaliser_.least_weight()};
}

Sums PointSums::sums_at(const Vec3& point_eye) const {
    if (kernels_.empty() || point_eye != glm::clamp(point_eye, box_.lower, box_.upper)) {
        return {};
    }
    // Rounding is monotonic: a point inside a kernel's box is in one of the cells that this meets.
    const std::size_t cell = cell_at(point_eye);
    Sums sums;
    for (std::uint64_t at = offsets_[cell]; at < offsets_[cell + 1]; ++at) {
        const EyeKernel& kernel = kernels_[members_[at]];
        const Vec3 q = kernel.shape.to_unit(point_eye - kernel.centre);
        const double r_squared = glm::dot(q, q);
        if (r_squared < 1.0) {
            const double g = profile_.at(r_squared);
            sums.d += kernel.value * g;
            sums.w += kernel.weight * g;
            sums.empty = false;
        }
    }
    return sums;
}

std::vector<std::uint32_t> PointSums::members_in(const Box& box) const {
    const Cells cells = cells_of(box);
    std::vector<std::uint32_t> found;
    for (std::size_t z = cells.first[2]; z <= cells.last[2]; ++z) {
        for (std::size_t y = cells.first[1]; y <= cells.last[1]; ++y) {
            const std::size_t row = (z * cells_[1] + y) * cells_[0];
            found.insert(found.end(), members_.begin() + static_cast<std::ptrdiff_t>(offsets_[row + cells.first[0]]),
                         members_.begin() + static_cast<std::ptrdiff_t>(offsets_[row + cells.last[0] + 1]));
        }
    }
    if (cells.first != cells.last) {
        std::sort(found.begin(), found.end());
        found.erase(std::unique(found.begin(), found.end()), found.end());
    }
    return found;
}

Sums PointSums::mean_sums(const Vec3& from_eye, const Vec3& to_eye) const {
    const Box line{glm::min(from_eye, to_eye), glm::max(from_eye, to_eye)};
    if (kernels_.empty() || glm::any(glm::lessThan(line.upper, box_.lower)) ||
        glm::any(glm::greaterThan(line.lower, box_.upper))) {
        return {};
    }
    Sums sums;
    for (const std::uint32_t number : members_in(line)) {
        const EyeKernel& kernel = kernels_[number];
        const Chord chord =
            mean_of(profile_, kernel.shape.to_unit(from_eye - kernel.centre), kernel.shape.to_unit(to_eye - from_eye));
        if (chord.reached) {
            sums.d += kernel.value * chord.mean;
            sums.w += kernel.weight * chord.mean;
            sums.empty = false;
        }
    }
    return sums;
}

} // namespace sheetsplat::reference

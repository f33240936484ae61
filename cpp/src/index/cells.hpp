// Places of the spatial grid's cells: corners counted in cells of a level from the grid's corner, in Z order.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "sheetsplat/field.hpp"

namespace sheetsplat::cells {

using Corner = std::array<std::uint64_t, 3>;

/// Halvings of the root: a double holds every place of the finest cells exactly.
constexpr int max_depth = 52;
/// Finest cells to a root, along each axis.
constexpr double finest_places = static_cast<double>(std::uint64_t{1} << max_depth);

/// The place among the finest cells, clamped to the root's.
inline std::uint64_t place(double in_finest_cells) {
    return static_cast<std::uint64_t>(std::clamp(in_finest_cells, 0.0, finest_places - 1.0));
}

/// per_world: finest cells to a world unit.
inline Corner finest_corner(const Vec3& from_lower, double per_world) {
    return {place(from_lower.x * per_world), place(from_lower.y * per_world), place(from_lower.z * per_world)};
}

inline Corner coarser(const Corner& corner, int halvings) {
    return {corner[0] >> halvings, corner[1] >> halvings, corner[2] >> halvings};
}

inline Box box_of(const Vec3& lower, double root, const Corner& corner, int depth) {
    const double edge = std::ldexp(root, -depth);
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
        const auto at = static_cast<double>(corner[static_cast<std::size_t>(axis)]);
        box.lower[axis] = lower[axis] + at * edge;
        box.upper[axis] = lower[axis] + (at + 1.0) * edge;
    }
    return box;
}

/// Z order; z decides before y, and y before x.
inline bool z_less(const Corner& a, const Corner& b) {
    std::uint64_t most = 0;
    bool less = false;
    for (std::size_t axis = 3; axis-- > 0;) {
        const std::uint64_t difference = a[axis] ^ b[axis];
        // True where the highest bit of `difference` lies above that of `most`.
        if (most < difference && most < (most ^ difference)) {
            most = difference;
            less = a[axis] < b[axis];
        }
    }
    return less;
}

/// The cells along one axis that a kernel's box meets, in cells of its level: one or two.
struct Span {
    std::uint64_t lower, upper;
};

inline std::array<Span, 3> cells_of(const EllipsoidField& field, const Vec3& lower, double per_world,
                                    std::size_t kernel, int depth) {
    const Vec3 centre = (field.center(kernel) - lower) * per_world;
    const Vec3 extent = field.extent(kernel) * per_world;
    const int halvings = max_depth - depth;
    std::array<Span, 3> spans{};
    for (int axis = 0; axis < 3; ++axis) {
        const std::uint64_t home = place(centre[axis]) >> halvings;
        Span& span = spans[static_cast<std::size_t>(axis)];
        span = {place(centre[axis] - extent[axis]) >> halvings, place(centre[axis] + extent[axis]) >> halvings};
        // Rounding may let a box that is as wide as a cell touch a third one.
        span.upper = std::min(span.upper, home + 1);
        span.lower = std::max(span.lower, span.upper > home ? home : home - std::min<std::uint64_t>(home, 1));
    }
    return spans;
}

/// Calls visit(corner) for each cell of the spans.
template <typename Visit>
void for_each_corner(const std::array<Span, 3>& spans, Visit&& visit) {
    for (std::uint64_t z = spans[2].lower; z <= spans[2].upper; ++z) {
        for (std::uint64_t y = spans[1].lower; y <= spans[1].upper; ++y) {
            for (std::uint64_t x = spans[0].lower; x <= spans[0].upper; ++x) {
                visit(Corner{x, y, z});
            }
        }
    }
}

/// Number of the cell at `corner` among cells begin <= c < end, which are in Z order; `otherwise` where it is not
/// there.
inline std::uint32_t find_corner(const std::vector<Corner>& corners, std::uint32_t begin, std::uint32_t end,
                                 const Corner& corner, std::uint32_t otherwise) {
    const auto first = corners.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto last = corners.begin() + static_cast<std::ptrdiff_t>(end);
    const auto found = std::lower_bound(first, last, corner, z_less);
    return found != last && *found == corner ? static_cast<std::uint32_t>(found - corners.begin()) : otherwise;
}

} // namespace sheetsplat::cells

// Start cells of kernels in a spatial grid ([NM06] section 4.2).
#include <algorithm>
#include <array>
#include <string>

#include "base/memory.hpp"
#include "cells.hpp"
#include "index/spatial_grid.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace cells;

StartCells StartCells::of(const EllipsoidField& field, const SpatialGrid& grid) {
    const std::string what = "the cells in which kernels start";
    StartCells starts;
    starts.extra_begin_.assign(static_cast<std::size_t>(grid.levels()) + 1, 0);
    const double per_world = finest_places / grid.root_;
    for (int level = 0; level < grid.levels(); ++level) {
        const std::uint32_t first = grid.level_begin(level);
        const std::uint32_t last = grid.level_begin(level + 1);
        std::vector<Corner> extra;
        const auto sort_out = [&extra] {
            std::sort(extra.begin(), extra.end(), z_less);
            extra.erase(std::unique(extra.begin(), extra.end()), extra.end());
        };
        std::size_t sort_at = 1 << 16;
        for (std::uint32_t home = first; home < last; ++home) {
            const Corner& middle = grid.corner_[home];
            std::uint32_t met = 0; // of the 27 cells around the home
            for (const std::uint32_t* kernel = grid.home_begin(home); kernel != grid.home_end(home); ++kernel) {
                const auto spans = cells_of(field, grid.lower_, per_world, *kernel, grid.depth_of_level(level));
                for_each_corner(spans, [&](const Corner& corner) {
                    const std::uint64_t neighbour =
                        ((corner[2] + 1 - middle[2]) * 3 + corner[1] + 1 - middle[1]) * 3 + corner[0] + 1 - middle[0];
                    if (((met >> neighbour) & 1U) == 0) {
                        met |= 1U << neighbour;
                        if (find_corner(grid.corner_, first, last, corner, SpatialGrid::none) == SpatialGrid::none) {
                            extra.push_back(corner);
                        }
                    }
                });
            }
            // Many homes meet the same cells: duplicates go before they fill the memory.
            if (extra.size() > sort_at) {
                sort_out();
                sort_at = std::max(sort_at, 2 * extra.size());
                require_memory(checked_product(2 * sort_at, sizeof(Corner), what), what, "use fewer kernels at a time");
            }
        }
        sort_out();
        starts.extra_.insert(starts.extra_.end(), extra.begin(), extra.end());
        starts.extra_begin_[static_cast<std::size_t>(level) + 1] = static_cast<std::uint32_t>(starts.extra_.size());
    }
    starts.cells_ = grid.cells() + starts.extra_.size();
    return starts;
}

std::size_t StartCells::bytes() const {
    return extra_.capacity() * sizeof(Corner) + extra_begin_.capacity() * sizeof(std::uint32_t);
}

Box StartCells::cell_bounds(const SpatialGrid& grid, std::size_t cell) const {
    if (cell < grid.cells()) {
        return grid.cell_bounds(cell);
    }
    const std::size_t extra = cell - grid.cells();
    const auto after = std::upper_bound(extra_begin_.begin(), extra_begin_.end(), static_cast<std::uint32_t>(extra));
    const auto level = static_cast<int>(after - extra_begin_.begin()) - 1;
    return box_of(grid.lower_, grid.root_, extra_[extra], grid.depth_of_level(level));
}

std::uint32_t StartCells::of_kernel(const EllipsoidField& field, const SpatialGrid& grid, std::size_t kernel,
                                    const Vec3& point_world) const {
    const int level = grid.level(kernel);
    const int depth = grid.depth_of_level(level);
    const double per_world = finest_places / grid.root_;
    const std::array<Span, 3> spans = cells_of(field, grid.lower_, per_world, kernel, depth);
    Corner corner = coarser(finest_corner(point_world - grid.lower_, per_world), max_depth - depth);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        corner[axis] = std::clamp(corner[axis], spans[axis].lower, spans[axis].upper);
    }
    const auto at = static_cast<std::size_t>(level);
    const std::uint32_t extra = find_corner(extra_, extra_begin_[at], extra_begin_[at + 1], corner, SpatialGrid::none);
    return extra != SpatialGrid::none ? static_cast<std::uint32_t>(grid.cells()) + extra
                                      : find_corner(grid.corner_, grid.level_begin(level), grid.level_begin(level + 1),
                                                    corner, SpatialGrid::none);
}

} // namespace sheetsplat

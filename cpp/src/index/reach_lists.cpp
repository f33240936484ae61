#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <utility>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "cells.hpp"
#include "index/spatial_grid.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace cells;

namespace {

constexpr const char* next_step = "use fewer kernels at a time";

} // namespace

ReachLists ReachLists::of(const EllipsoidField& field, const SpatialGrid& grid) {
    const std::string what = "the lists of kernels that reach into each cell";
    ReachLists lists;
    lists.lower_ = grid.lower_;
    lists.root_ = grid.root_;
    lists.levels_ = grid.levels();
    require_memory(checked_product(grid.cells(), sizeof(Corner), what), what, next_step);
    lists.corner_ = grid.corner_;
    lists.extra_begin_.assign(static_cast<std::size_t>(grid.levels()) + 1, static_cast<std::uint32_t>(grid.cells()));
    const double per_world = finest_places / grid.root_;
    // Calls visit(kernel, corner, neighbour) for each cell that a kernel of a home reaches; neighbour < 27 tells the
    // cell's place beside the home.
    const auto for_each_listing = [&](std::size_t home, int level, auto&& visit) {
        const Corner& middle = grid.corner_[home];
        for (const std::uint32_t* kernel = grid.home_begin(home); kernel != grid.home_end(home); ++kernel) {
            const auto spans = cells_of(field, grid.lower_, per_world, *kernel, grid.depth_of_level(level));
            for_each_corner(spans, [&](const Corner& corner) {
                const std::uint64_t neighbour =
                    ((corner[2] + 1 - middle[2]) * 3 + corner[1] + 1 - middle[1]) * 3 + corner[0] + 1 - middle[0];
                visit(*kernel, corner, neighbour);
            });
        }
    };

    // Cells that are nobody's home, level by level.
    std::uint64_t listed = 0;
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
            std::uint32_t met = 0;
            for_each_listing(home, level, [&](std::uint32_t, const Corner& corner, std::uint64_t neighbour) {
                ++listed;
                if (((met >> neighbour) & 1U) == 0) {
                    met |= 1U << neighbour;
                    if (find_corner(grid.corner_, first, last, corner, SpatialGrid::none) == SpatialGrid::none) {
                        extra.push_back(corner);
                    }
                }
            });
            // Many homes meet the same cells, which are sorted out before they fill the memory.
            if (extra.size() > sort_at) {
                sort_out();
                sort_at = std::max(sort_at, 2 * extra.size());
                require_memory(checked_product(2 * sort_at, sizeof(Corner), what), what, next_step);
            }
        }
        sort_out();
        const std::uint64_t cells = lists.corner_.size() + extra.size();
        if (cells >= SpatialGrid::none || listed > std::numeric_limits<std::uint32_t>::max()) {
            throw Unsupported(Complaint{"ReachLists: the lists cannot be numbered",
                                        text_of_count(cells) + " cells with " + text_of_count(listed) + " entries",
                                        "at most 4294967294 cells and 4294967295 entries",
                                        "split the field into several"});
        }
        require_memory(checked_product(cells, sizeof(Corner), what), what, next_step);
        lists.corner_.insert(lists.corner_.end(), extra.begin(), extra.end());
        lists.extra_begin_[static_cast<std::size_t>(level) + 1] = static_cast<std::uint32_t>(cells);
    }
    const std::size_t cells = lists.corner_.size();
    require_memory(listed * sizeof(std::uint32_t) + cells * (sizeof(std::uint32_t) + 1), what, next_step);
    lists.level_.resize(cells);
    for (int level = 0; level < grid.levels(); ++level) {
        const auto fill = [&](std::uint32_t begin, std::uint32_t end) {
            std::fill(lists.level_.begin() + static_cast<std::ptrdiff_t>(begin),
                      lists.level_.begin() + static_cast<std::ptrdiff_t>(end), static_cast<std::int8_t>(level));
        };
        fill(grid.level_begin(level), grid.level_begin(level + 1));
        fill(lists.extra_begin_[static_cast<std::size_t>(level)],
             lists.extra_begin_[static_cast<std::size_t>(level) + 1]);
    }
    lists.offsets_.assign(cells + 1, 0);
    const auto visit_listings = [&](auto&& visit) {
        for (std::size_t home = 0; home < grid.cells(); ++home) {
            const int level = lists.level_[home];
            std::array<std::uint32_t, 27> found;
            found.fill(SpatialGrid::none);
            for_each_listing(home, level, [&](std::uint32_t kernel, const Corner& corner, std::uint64_t neighbour) {
                std::uint32_t& cell = found[neighbour];
                if (cell == SpatialGrid::none) {
                    cell = lists.find(grid, corner, level);
                }
                visit(cell, kernel);
            });
        }
    };
    visit_listings([&](std::uint32_t cell, std::uint32_t) { ++lists.offsets_[cell]; });
    std::uint32_t sum = 0;
    for (std::uint32_t& offset : lists.offsets_) {
        sum += std::exchange(offset, sum);
    }
    lists.entries_.resize(sum);
    // Each offset moves to its list's end, which is where the next list begins.
    visit_listings([&](std::uint32_t cell, std::uint32_t kernel) { lists.entries_[lists.offsets_[cell]++] = kernel; });
    std::move_backward(lists.offsets_.begin(), lists.offsets_.end() - 1, lists.offsets_.end());
    lists.offsets_.front() = 0;
    return lists;
}

std::size_t ReachLists::bytes() const {
    return (offsets_.capacity() + entries_.capacity() + extra_begin_.capacity()) * sizeof(std::uint32_t) +
           level_.capacity() + corner_.capacity() * sizeof(Corner);
}

Box ReachLists::cell_bounds(std::size_t cell) const {
    return box_of(lower_, root_, corner_[cell], levels_ - 1 - level_[cell]);
}

std::uint32_t ReachLists::find(const SpatialGrid& grid, const Corner& corner, int level) const {
    const auto at = static_cast<std::size_t>(level);
    const std::uint32_t otherwise =
        extra_begin_[at] == extra_begin_[at + 1]
            ? SpatialGrid::none
            : find_corner(corner_, extra_begin_[at], extra_begin_[at + 1], corner, SpatialGrid::none);
    return otherwise != SpatialGrid::none
               ? otherwise
               : find_corner(corner_, grid.level_begin(level), grid.level_begin(level + 1), corner, SpatialGrid::none);
}

std::uint32_t ReachLists::start_cell(const EllipsoidField& field, const SpatialGrid& grid, std::size_t kernel,
                                     const Vec3& point_world) const {
    const int level = grid.level(kernel);
    const int depth = grid.depth_of_level(level);
    const double per_world = finest_places / root_;
    const std::array<Span, 3> spans = cells_of(field, lower_, per_world, kernel, depth);
    Corner corner = coarser(finest_corner(point_world - lower_, per_world), max_depth - depth);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        corner[axis] = std::clamp(corner[axis], spans[axis].lower, spans[axis].upper);
    }
    return find(grid, corner, level);
}

} // namespace sheetsplat

#include "index/spatial_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "cell_builder.hpp"
#include "cells.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace cells;

namespace {

/// A power of two that is more than the extent of all supports.
double root_edge(const EllipsoidField& field) {
    // Sizes near the least numbers there are would leave no room for finer cells, but have the same picture in coarse
    // ones.
    constexpr int least_exponent = -900;
    const Vec3 extent = field.supports_world().extent();
    const double largest = std::max({extent.x, extent.y, extent.z, 2.0 * field.scale_range()[1]});
    int exponent = 0;
    std::frexp(largest, &exponent);
    return std::ldexp(1.0, std::max(exponent, least_exponent));
}

} // namespace

SpatialGrid SpatialGrid::of(const EllipsoidField& field) {
    const std::size_t n = field.size();
    if (n > std::numeric_limits<std::uint32_t>::max()) {
        throw Unsupported(Complaint{"SpatialGrid: the field cannot be indexed", text_of_count(n) + " kernels",
                                    "at most 4294967295 kernels in one field", "split it into several fields"});
    }
    SpatialGrid grid;
    if (n == 0) {
        return grid;
    }
    constexpr std::uint64_t most_bytes_a_kernel = 32;
    const char* const what = "the spatial grid of a field's kernels";
    require_memory(checked_product(n, most_bytes_a_kernel, what), what, "use fewer kernels at a time");
    grid.lower_ = field.supports_world().lower;
    grid.root_ = root_edge(field);

    std::vector<std::uint32_t> settled_order;
    std::vector<CellBuilder::Settled> settled;
    {
        CellBuilder builder(field, grid.lower_, grid.root_);
        settled_order = std::move(builder.order);
        settled = std::move(builder.cells);
    }
    int deepest = 0;
    for (const CellBuilder::Settled& cell : settled) {
        deepest = std::max<int>(deepest, cell.depth);
    }
    const auto level_of = [deepest](const CellBuilder::Settled& cell) {
        return static_cast<std::size_t>(deepest - cell.depth);
    };
    std::vector<std::uint32_t> kernels_before(static_cast<std::size_t>(deepest) + 2, 0);
    grid.level_begin_.assign(static_cast<std::size_t>(deepest) + 2, 0);
    for (const CellBuilder::Settled& cell : settled) {
        ++grid.level_begin_[level_of(cell) + 1];
        kernels_before[level_of(cell) + 1] += cell.kernels;
    }
    for (std::size_t level = 0; level <= static_cast<std::size_t>(deepest); ++level) {
        grid.level_begin_[level + 1] += grid.level_begin_[level];
        kernels_before[level + 1] += kernels_before[level];
    }
    grid.order_.resize(n);
    grid.home_.resize(n);
    grid.offset_.resize(settled.size() + 1, static_cast<std::uint32_t>(n));
    grid.corner_.resize(settled.size());
    grid.supports_.resize(settled.size());
    std::vector<std::uint32_t> next_cell(grid.level_begin_.begin(), grid.level_begin_.end() - 1);
    const std::uint32_t* kernel = settled_order.data();
    const double per_world = finest_places / grid.root_;
    std::size_t steps = 0;
    for (const CellBuilder::Settled& cell : settled) {
        poll_at(++steps);
        const std::size_t level = level_of(cell);
        const std::uint32_t number = next_cell[level]++;
        grid.corner_[number] =
            coarser(finest_corner(field.center(*kernel) - grid.lower_, per_world), max_depth - cell.depth);
        grid.offset_[number] = kernels_before[level];
        Box box{field.center(*kernel), field.center(*kernel)};
        for (std::uint32_t i = 0; i < cell.kernels; ++i, ++kernel) {
            const Vec3& centre = field.center(*kernel);
            const Vec3 extent = field.extent(*kernel);
            box = Box{glm::min(box.lower, centre - extent), glm::max(box.upper, centre + extent)};
            grid.order_[kernels_before[level]++] = *kernel;
            grid.home_[*kernel] = number;
        }
        grid.supports_[number] = box;
    }
    return grid;
}

std::size_t SpatialGrid::bytes() const {
    return (order_.capacity() + home_.capacity() + offset_.capacity() + level_begin_.capacity()) *
               sizeof(std::uint32_t) +
           corner_.capacity() * sizeof(Corner) + supports_.capacity() * sizeof(Box);
}

double SpatialGrid::cell_size(int level) const { return std::ldexp(root_, -depth_of_level(level)); }

int SpatialGrid::level_of_cell(std::size_t cell) const {
    const auto after = std::upper_bound(level_begin_.begin(), level_begin_.end(), static_cast<std::uint32_t>(cell));
    return static_cast<int>(after - level_begin_.begin()) - 1;
}

Box SpatialGrid::cell_bounds(std::size_t cell) const {
    return box_of(lower_, root_, corner_[cell], depth_of_level(level_of_cell(cell)));
}

} // namespace sheetsplat

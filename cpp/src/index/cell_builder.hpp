// Assigns each kernel of a field to its cell, its home.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cells.hpp"
#include "index/spatial_grid.hpp"

namespace sheetsplat::cells {

/// Settles each kernel in the deepest cell that is large enough for it and that `least_in_cell` kernels share.
class CellBuilder {
  public:
    struct Settled {
        std::uint32_t kernels;
        std::uint8_t depth;
    };

    /// lower, root: corner and edge of the one cell that holds all supports, world units.
    CellBuilder(const EllipsoidField& field, const Vec3& lower, double root);

    std::vector<std::uint32_t> order; ///< cell by cell, cells as they were settled: in Z order within each depth
    std::vector<Settled> cells;

  private:
    /// Kernels that wait for a cell: a chain through next_.
    struct Pool {
        std::uint32_t first, last, kernels;
    };

    [[nodiscard]] std::uint32_t kernel_at(std::size_t at) const { return static_cast<std::uint32_t>(keyed_[at]); }
    [[nodiscard]] std::uint32_t key_at(std::size_t at) const { return static_cast<std::uint32_t>(keyed_[at] >> 32); }
    [[nodiscard]] Corner finest(std::uint32_t kernel) const {
        return finest_corner(field_.center(kernel) - lower_, per_world_);
    }
    /// Kernels begin <= at < end of keyed_ share the cell at `depth`.
    void refine(std::size_t begin, std::size_t end, int depth);
    /// The depth to which a run of kernels that are together at `depth` stays together; max_depth where none of them
    /// has a use for finer cells or too few are left to fill one.
    [[nodiscard]] int shared_depth(std::size_t begin, std::size_t end, int depth) const;
    void sort(std::size_t begin, std::size_t end, int depth, int levels);
    void sort_by_digits(std::size_t begin, std::size_t n, unsigned bits);
    void add(std::uint32_t kernel, int depth) { append({kernel, kernel, 1}, depth); }
    void append(const Pool& more, int depth);
    /// Leaves all cells deeper than `depth` on the way to the kernel that was added last.
    void close(int depth);
    void settle(int depth);

    const EllipsoidField& field_;
    Vec3 lower_;
    double per_world_;
    std::size_t steps_ = 0;
    std::vector<std::uint64_t> keyed_;   ///< key in the upper half, kernel in the lower
    std::vector<std::uint64_t> scratch_; ///< of the sort
    std::vector<std::uint32_t> next_;
    std::vector<std::uint8_t> deepest_; ///< depth at which a kernel's box still spans two cells at most
    std::array<Pool, max_depth + 1> pool_{};
    std::uint64_t open_ = 0; ///< a bit for each depth whose pool holds a kernel
};

} // namespace sheetsplat::cells

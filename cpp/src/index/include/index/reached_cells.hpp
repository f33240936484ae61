// Where in a Cartesian lattice none of its drawn samples is near, in boxes of some samples.
#pragma once

#include <cstddef>

#include "index/bit_rows.hpp"
#include "index/visible_runs.hpp"

namespace sheetsplat {

class ReachedCells {
  public:
    /// Of the runs of a field: cells that hold a point with a sample of theirs no farther than `reach` along each axis,
    /// in samples; and others near those. Throws OutOfMemory.
    ReachedCells(const RegularField& field, const VisibleRuns& runs, double reach);

    /// Of a point in index space; where it lies outside the lattice, of the nearest one that does not.
    [[nodiscard]] bool reached(const Vec3& index) const {
        const std::size_t i = cell_of(index.x, cells_.ni());
        return (cells_.row(cell_of(index.y, cells_.nj()), cell_of(index.z, cells_.nk()))[i / word_bits] >>
                    (i % word_bits) &
                1U) != 0;
    }

  private:
    static constexpr std::size_t edge = 4; ///< samples of a cell

    [[nodiscard]] static std::size_t cell_of(double at, std::size_t cells) {
        constexpr double per_sample = 1.0 / static_cast<double>(edge);
        const double cell = at * per_sample, last = static_cast<double>(cells - 1);
        return static_cast<std::size_t>(cell > 0.0 ? (cell < last ? cell : last) : 0.0);
    }

    BitRows cells_;
};

} // namespace sheetsplat

// The view-independent, run-length index of the drawn samples of a regular field ([NM05] section 4.5).
// A sample is left out only where it cannot matter (conventions, section 2).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "index/visibility.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// Samples begin <= i < end of row (j, k).
struct Run {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
};

/// Runs of drawn samples, row by row (row = k * nj + j), in memory order.
class VisibleRuns {
  public:
    VisibleRuns() = default;
    /// Throws OutOfMemory; Unsupported for more than 2^32 - 1 samples in one field; InvalidInput. A NaN sample is never
    /// drawn. Beside the result it takes a quarter of a byte for each sample (rows are padded to 64 samples).
    static VisibleRuns of(const RegularField& field, const VisibilityQuery& query);

    /// The samples that any of some runs hold, of lattices of one shape: one or more. Throws OutOfMemory.
    static VisibleRuns of_any(const std::vector<const VisibleRuns*>& all);

    [[nodiscard]] std::size_t samples() const { return samples_; } ///< drawn
    [[nodiscard]] std::size_t bytes() const;
    [[nodiscard]] std::size_t rows() const { return row_offset_.empty() ? 0 : row_offset_.size() - 1; }
    [[nodiscard]] const Run* begin(std::size_t row) const { return runs_.data() + row_offset_[row]; }
    [[nodiscard]] const Run* end(std::size_t row) const { return runs_.data() + row_offset_[row + 1]; }

  private:
    std::vector<std::uint32_t> row_offset_;
    std::vector<Run> runs_;
    std::size_t samples_ = 0;
};

/// Bounds of W / C over all points inside a lattice without borders: 1 -+ the ripple (0.8 % at radius 2, falloff 5); 0
/// where supports leave gaps. Proven bounds, not samples: wider than the truth, by some 10^-4 where kernels overlap as
/// those of conventions, section 2 do.
struct Ripple {
    double lower = 1.0, upper = 1.0;
};
Ripple lattice_ripple(const RegularField& field);
/// A bound of W / C from above, however far a filter widens the kernels, all of them alike: it multiplies the Fourier
/// coefficients of Gaussians of the same mass, all of them positive, by at most 1, so that their sum is at most what it
/// was at a lattice point.
double largest_filtered_sum(const RegularField& field);
/// The most that rho can be for kernels of value 1, whichever of them are drawn. filter_gain: as VisibilityQuery has
/// it.
double largest_weight(const RegularField& field, double filter_gain);

} // namespace sheetsplat

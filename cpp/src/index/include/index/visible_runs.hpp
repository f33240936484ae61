// The view-independent, run-length index of the drawn samples of a regular field ([NM05] section 4.5).
// A sample is left out only where it cannot matter (conventions, section 2).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/field.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace sheetsplat {

/// What decides which samples are drawn. A NaN sample never is.
struct VisibilityQuery {
    const TransferFunction* transfer_function = nullptr; ///< null: every value is visible (modes xray and mip)
    /// The weight sum is needed where something is visible (threshold, opacity at 0 > 0): samples of value 0 are drawn
    /// too. A coverage output needs the weights everywhere: cull = false.
    bool weights_matter = false;
    /// How far gradient stencils reach from a visible point, world units; 0 without a gradient. In perspective a step
    /// of depth runs along the ray and is as much longer.
    double stencil_world = 0.0;
    bool cull = true; ///< false: every kernel is drawn
    /// Isosurface: visible is where the interval of reconstructable values, widened by 0, holds iso_value; then the
    /// transfer function is not asked.
    bool isosurface = false;
    double iso_value = 0.0;
    bool alone = true; ///< false: other fields add to this one, so that only value 0 can be dropped
    /// World units: a crossing, a pre-integrated interval or a slab reaches this far in depth (where several do, the
    /// sum of theirs).
    double slice_spacing = 0.0;
};

/// Samples begin <= i < end of row (j, k).
struct Run {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
};

/// Runs of drawn samples, row by row (row = k * nj + j), in memory order.
class VisibleRuns {
  public:
    VisibleRuns() = default;
    /// Throws OutOfMemory; Unsupported for more than 2^32 - 1 samples in one field; InvalidInput for a query whose
    /// lengths are negative or not numbers. Beside the result it takes a quarter of a byte for each sample (rows are
    /// padded to 64 samples).
    static VisibleRuns of(const RegularField& field, const VisibilityQuery& query);

    [[nodiscard]] std::size_t samples() const { return samples_; } ///< drawn
    [[nodiscard]] std::size_t bytes() const;
    [[nodiscard]] std::size_t rows() const { return row_offset_.empty() ? 0 : row_offset_.size() - 1; }
    [[nodiscard]] const Run* begin(std::size_t row) const { return runs_.data() + row_offset_[row]; }
    [[nodiscard]] const Run* end(std::size_t row) const { return runs_.data() + row_offset_[row + 1]; }
    /// Largest |value| of a drawn sample; 0 where none is.
    [[nodiscard]] double largest_value() const { return largest_value_; }

  private:
    std::vector<std::uint32_t> row_offset_;
    std::vector<Run> runs_;
    std::size_t samples_ = 0;
    double largest_value_ = 0.0;
};

/// Bounds of W / C over all points inside a lattice without borders: 1 -+ the ripple (0.8 % at radius 2, falloff 5); 0
/// where supports leave gaps. Proven bounds, not samples: wider than the truth, by some 10^-4 where kernels overlap as
/// those of conventions, section 2 do.
struct Ripple {
    double lower = 1.0, upper = 1.0;
};
Ripple lattice_ripple(const RegularField& field);

} // namespace sheetsplat

// Mode mip of a lattice without sheets: rays look up the points where rho can be larger than what they have found so
// far. At a point, kernels of values at most v with weights w_i >= 0 sum up to sum f_i w_i <= v sum w_i, and the sum of
// weights has a bound that holds everywhere (lattice_ripple); so the greatest value of the samples that reach into a
// block of points, times that bound, is a bound of rho there.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "backend_cpu/lattice_reach.hpp"
#include "base/threads.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::backend_cpu {

/// The greatest values of a Cartesian lattice, block by block.
class LatticeMaxima {
  public:
    /// Index coordinates along each edge of a block.
    static constexpr int block_edge = 4;
    /// Largest radius of kernels, in sample distances.
    static constexpr double largest_radius = 4.0;

    /// Whether a field's kernels are of the shape that is looked up.
    [[nodiscard]] static bool fit(const RegularField& field);
    /// field: must fit. poll: as ThreadPool::run takes it. Throws OutOfMemory.
    static LatticeMaxima of(const RegularField& field, ThreadPool& pool, const std::function<void()>& poll = {});

    /// Blocks along i, j and k. Block b holds the points block_edge (b - 1) <= p < block_edge b of an index coordinate.
    [[nodiscard]] const std::array<int, 3>& blocks() const { return blocks_; }
    /// The greatest value of the samples that reach into each block, as a share of greatest(), rounded up; 0 where none
    /// is above 0. [k][j][i]
    [[nodiscard]] const float* shares() const { return shares_.data(); }
    /// The upper end of the field's range of values; at most 0 where there is nothing to be seen.
    [[nodiscard]] double greatest() const { return greatest_; }
    /// A bound of the sum of max(0, exp(-k r^2) - exp(-k)) over all samples, at any point.
    [[nodiscard]] double weight_bound() const { return weight_bound_; }
    [[nodiscard]] std::size_t bytes() const { return shares_.capacity() * sizeof(float); }

  private:
    std::array<int, 3> blocks_{};
    std::vector<float> shares_;
    double greatest_ = 0.0, weight_bound_ = 0.0;
};

/// A lattice whose maxima are looked up in one view.
struct MaximaView {
    const RegularField* field = nullptr;
    const LatticeMaxima* maxima = nullptr;
    const LatticeReach* places = nullptr;
    std::int64_t slices = 0;
    double value_scale = 1.0; ///< of FieldView
    double scalar_step = 1.0; ///< what the picture's numbers are multiplied by
};

} // namespace sheetsplat::backend_cpu

// Mode mip of a lattice without sheets: rays look up the points where rho can be larger than what they have found so
// far, by bounds of blocks (facts/maxima_blocks). Whether they do is the plan's effect ray_maxima.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "backend_cpu/lattice_reach.hpp"
#include "base/threads.hpp"
#include "facts/maxima_blocks.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::backend_cpu {

/// The greatest values of a Cartesian lattice, block by block.
class LatticeMaxima {
  public:
    /// field: MaximaBlocks must fit. poll: as ThreadPool::run takes it. Throws OutOfMemory.
    static LatticeMaxima of(const RegularField& field, ThreadPool& pool, const std::function<void()>& poll = {});

    /// Blocks along i, j and k (MaximaBlocks).
    [[nodiscard]] const std::array<int, 3>& blocks() const { return blocks_; }
    /// The greatest value of the samples that reach into each block, as a share of greatest(), rounded up; 0 where none
    /// is above 0. [k][j][i]
    [[nodiscard]] const float* shares() const { return shares_.data(); }
    /// The upper end of the field's range of values; at most 0 where there is nothing to be seen.
    [[nodiscard]] double greatest() const { return greatest_; }
    /// MaximaBlocks::weight_bound.
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

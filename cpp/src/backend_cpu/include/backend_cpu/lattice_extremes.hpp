// Modes mip and minimum of a lattice without sheets: rays look up the points where rho can be larger (or smaller) than
// what they have found so far, by bounds of blocks (facts/extreme_blocks). Whether they do is the plan's effect
// ray_extremes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "backend_cpu/lattice_reach.hpp"
#include "backend_cpu/shading.hpp"
#include "base/threads.hpp"
#include "facts/extreme_blocks.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::backend_cpu {

/// Bounds of rho of a Cartesian lattice, block by block. Of mode mip they are those of -rho, so that what is looked for
/// is the smallest number in both modes.
class LatticeExtremes {
  public:
    /// field: ExtremeBlocks must fit. sign: of rho, 1 or -1. filled: all samples that could reach the points that are
    /// asked for are there. poll: as ThreadPool::run takes it. Throws OutOfMemory.
    static LatticeExtremes of(const RegularField& field, double sign, bool filled, ThreadPool& pool,
                              const std::function<void()>& poll = {});

    /// Blocks along i, j and k (ExtremeBlocks).
    [[nodiscard]] const std::array<int, 3>& blocks() const { return blocks_; }
    /// Of each block what rho is not less than, as a share of scale(), rounded down. [k][j][i]
    [[nodiscard]] const float* bounds() const { return bounds_.data(); }
    /// The least of them.
    [[nodiscard]] float least() const { return least_; }
    /// A sum of samples by weights as sheets are summed from, more than 0.
    [[nodiscard]] double scale() const { return scale_; }
    [[nodiscard]] std::size_t bytes() const { return bounds_.capacity() * sizeof(float); }

  private:
    std::array<int, 3> blocks_{};
    std::vector<float> bounds_;
    float least_ = 0.0F;
    double scale_ = 1.0;
};

/// A lattice whose extremes are looked up in one view.
struct ExtremesView {
    const RegularField* field = nullptr;
    double sign = 1.0; ///< of rho: -1 where its largest number is looked for
    const LatticeExtremes* bounds = nullptr;
    const LatticeReach* places = nullptr;
    const Frame* frame = nullptr;
    const std::vector<KeptHalfSpace>* kept = nullptr; ///< all of them; none without a clip
    double value_scale = 1.0;                         ///< of FieldView
    double scalar_step = 1.0;                         ///< what the picture's numbers are multiplied by
};

} // namespace sheetsplat::backend_cpu

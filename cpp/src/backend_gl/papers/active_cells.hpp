// The grid with start cells of [NM06] section 4.2: the cells of a traversal whose kernels a slice can meet, whole cells
// at a time; and what a pass over them is drawn with.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "view/cell_walk.hpp"

namespace sheetsplat::backend_gl {

/// One walk over whole cells: what becomes of single kernels is left to the device.
class ActiveCells {
  public:
    explicit ActiveCells(const CellTraversal& traversal) : traversal_(&traversal) {}

    /// Numbers in traversal.cells() of the cells whose kernels the next batch can meet. The first call is for batch 0.
    const std::vector<std::size_t>& next() {
        const auto& cells = traversal_->cells();
        active_.erase(std::remove_if(active_.begin(), active_.end(),
                                     [&](std::size_t number) { return cells[number].last_batch < batch_; }),
                      active_.end());
        for (; upcoming_ < cells.size() && cells[upcoming_].first_batch <= batch_; ++upcoming_) {
            active_.push_back(upcoming_);
        }
        ++batch_;
        return active_;
    }

  private:
    const CellTraversal* traversal_;
    std::vector<std::size_t> active_;
    std::size_t upcoming_ = 0;
    std::int32_t batch_ = 0;
};

/// One pass over the targets that are bound.
struct SlabPass {
    std::int64_t first_slab = 0;
    double axis_x = 0.0, axis_y = 0.0; ///< pixel of the targets where the optical axis meets them
    int target_width = 0, target_height = 0;
    float tag = 0.0F;    ///< depth of what is drawn, in normalised device coordinates
    double margin = 0.0; ///< pixels by which a rasteriser may cut a polygon short
};

} // namespace sheetsplat::backend_gl

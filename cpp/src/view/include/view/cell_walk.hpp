// Front-to-back traversal of the cells of a spatial grid ([NM06] section 4.2): a kernel is drawn by the cell in which
// its first slice lies, and by no other; a cell is active from the first slice of its kernels to the last.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "index/spatial_grid.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat {

/// Which kernels begin in which cell, cells in the order in which a view meets them. Immutable.
class CellTraversal {
  public:
    /// A cell and the kernels that begin in it, in the order of their first batches.
    struct Cell {
        std::uint32_t begin = 0, end = 0;
        std::int32_t first_batch = 0, last_batch = -1;
        EllipsoidView::ScreenBounds bounds{}; ///< of all its kernels
    };
    struct Entry {
        std::uint32_t kernel;
        std::int32_t first_batch;
        std::uint32_t last_batch : 24; ///< fewer than 2^24: there are at most 10^7 slices
        std::uint32_t narrow : 1;      ///< meets the first stride of slabs alone: half of what a batch covers is enough
        std::uint32_t group : 7;       ///< SectionGroup
    };

    /// sprite_px: largest radius of a point sprite. may_narrow: kernels that meet the slabs of one stride alone are
    /// marked. starts: the cells in which kernels may start; null: every kernel begins in its home, which saves their
    /// memory. visible: one flag a kernel. Kernels beyond the picture and its border of one pixel, or whose slices do
    /// not exist, are left out. wider_slices, wider_px: by how much kernels reach further than their supports. Throws
    /// OutOfMemory. 12 bytes a kernel.
    static CellTraversal of(const EllipsoidView& view, const SpatialGrid& grid, const StartCells* starts,
                            const std::vector<std::uint8_t>& visible, BatchLayout layout, int wider_slices,
                            int wider_px, bool may_narrow, double sprite_px, double precise_aspect);

    [[nodiscard]] const std::vector<Cell>& cells() const { return cells_; }
    [[nodiscard]] const Entry* entries() const { return entries_.data(); }
    [[nodiscard]] std::size_t kernels() const { return entries_.size(); }
    [[nodiscard]] std::size_t bytes() const {
        return cells_.capacity() * sizeof(Cell) + entries_.capacity() * sizeof(Entry);
    }
    /// Batches after which a kernel that reaches further is drawn again.
    [[nodiscard]] int again() const { return again_; }

  private:
    std::vector<Cell> cells_; ///< by first batch
    std::vector<Entry> entries_;
    int again_ = 2;
};

/// One walk along the slices.
class CellWalk {
  public:
    explicit CellWalk(const CellTraversal& traversal) : traversal_(&traversal) {}

    /// The kernels of the next batch: draw(entry) for each. hidden(cell bounds) tells whether nothing of a
    /// cell can be seen any more; it then leaves the walk.
    template <class Hidden, class Draw>
    void next(Hidden&& hidden, Draw&& draw) {
        const auto& cells = traversal_->cells();
        while (upcoming_ < cells.size() && cells[upcoming_].first_batch <= batch_) {
            active_.push_back({upcoming_, cells[upcoming_].begin, {}});
            ++upcoming_;
        }
        std::size_t kept = 0;
        for (std::size_t a = 0; a < active_.size(); ++a) {
            Active& active = active_[a];
            const CellTraversal::Cell& cell = cells[active.cell];
            if (cell.last_batch < batch_ || hidden(cell.bounds)) {
                continue;
            }
            std::size_t staying = 0;
            for (const CellTraversal::Entry& entry : active.staying) {
                const std::int32_t again = traversal_->again();
                const std::int32_t since = (batch_ - entry.first_batch) % again;
                if (since == 0) {
                    draw(entry);
                }
                // The batch that draws it next, if there is one.
                if (batch_ - since + again <= static_cast<std::int32_t>(entry.last_batch)) {
                    active.staying[staying++] = entry;
                }
            }
            active.staying.resize(staying);
            const CellTraversal::Entry* entries = traversal_->entries();
            for (; active.next < cell.end && entries[active.next].first_batch <= batch_; ++active.next) {
                const CellTraversal::Entry& entry = entries[active.next];
                draw(entry);
                if (batch_ + traversal_->again() <= static_cast<std::int32_t>(entry.last_batch)) {
                    active.staying.push_back(entry);
                }
            }
            if (kept != a) {
                active_[kept] = std::move(active);
            }
            ++kept;
        }
        active_.resize(kept);
        ++batch_;
    }

  private:
    struct Active {
        std::size_t cell = 0;
        std::uint32_t next = 0;
        std::vector<CellTraversal::Entry> staying; ///< begun, and reaching further than one drawing covers
    };
    const CellTraversal* traversal_;
    std::vector<Active> active_;
    std::size_t upcoming_ = 0;
    std::int32_t batch_ = 0;
};

} // namespace sheetsplat

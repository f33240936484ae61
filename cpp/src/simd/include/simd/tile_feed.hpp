// Which kernels reach into which tile, and how they look from there. What is sorted by tiles here depends on the view
// and on which kernels are drawn, not on how they are classified, lit or composited.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "index/visible_runs.hpp"
#include "simd/sections.hpp"
#include "simd/threads.hpp"
#include "simd/tile.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/frame.hpp"

namespace sheetsplat::simd {

/// The tiles of a picture: as equal as whole pixels allow, row by row.
class TileLayout {
  public:
    /// largest: edge in pixels, >= 1.
    TileLayout(Size size, int largest);

    [[nodiscard]] std::size_t tiles() const {
        return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
    }
    [[nodiscard]] int columns() const { return columns_; }
    [[nodiscard]] int rows() const { return rows_; }
    [[nodiscard]] TileShape shape(std::size_t tile) const;
    /// First pixel of a column or row of tiles; of column columns(): the picture's width.
    [[nodiscard]] int left(int column) const {
        return static_cast<int>(static_cast<std::int64_t>(size_.width) * column / columns_);
    }
    [[nodiscard]] int top(int row) const {
        return static_cast<int>(static_cast<std::int64_t>(size_.height) * row / rows_);
    }
    /// Columns (rows) of tiles whose sheets hold the centre of some pixel between two places, in pixels of the picture;
    /// first > last where none does.
    struct Range {
        int first, last;
    };
    [[nodiscard]] Range columns_between(double low, double high) const;
    [[nodiscard]] Range rows_between(double low, double high) const;
    [[nodiscard]] Size size() const { return size_; }

  private:
    Size size_{};
    int columns_ = 1, rows_ = 1;
};

/// Items tile by tile, in the order in which they were emitted.
template <class Item>
struct Buckets {
    std::vector<std::size_t> offset; ///< tiles + 1
    std::vector<Item> items;
    [[nodiscard]] const Item* begin(std::size_t tile) const { return items.data() + offset[tile]; }
    [[nodiscard]] const Item* end(std::size_t tile) const { return items.data() + offset[tile + 1]; }
    [[nodiscard]] std::size_t bytes() const {
        return offset.capacity() * sizeof(std::size_t) + items.capacity() * sizeof(Item);
    }
};

/// Samples begin <= i < end of row (j, k) of a lattice, drawn or not.
struct RowPart {
    std::uint32_t row;
    std::uint32_t begin, end;
};

/// The parts of a lattice's rows that reach into each tile, of all rows that hold a drawn sample. Throws OutOfMemory.
Buckets<RowPart> bucket_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame,
                             const TileLayout& layout, ThreadPool& pool);

/// The drawn kernels that reach into each tile. Throws OutOfMemory.
Buckets<std::uint32_t> bucket_kernels(const EllipsoidView& view, const std::vector<std::uint8_t>& visible,
                                      const TileLayout& layout, ThreadPool& pool);

} // namespace sheetsplat::simd

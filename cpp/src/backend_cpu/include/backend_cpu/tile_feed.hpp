// Which kernels reach into which tile, and how they look from there. What is sorted by tiles here depends on the view
// and on which kernels are drawn, not on how they are classified, lit or composited.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "backend_cpu/sections.hpp"
#include "backend_cpu/tile.hpp"
#include "base/threads.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/field_view.hpp"

namespace sheetsplat::backend_cpu {

/// The tiles of a picture: as equal as whole pixels allow, row by row.
class TileLayout {
  public:
    /// largest: edge in pixels, >= 1. drawn: a flag a tile, which is left out where it is 0; empty: all are drawn.
    TileLayout(Size size, int largest, std::vector<std::uint8_t> drawn = {});

    [[nodiscard]] std::size_t tiles() const {
        return static_cast<std::size_t>(columns()) * static_cast<std::size_t>(rows());
    }
    [[nodiscard]] int columns() const { return across_.tiles; }
    [[nodiscard]] int rows() const { return down_.tiles; }
    [[nodiscard]] TileShape shape(std::size_t tile) const;
    [[nodiscard]] bool draws(std::size_t tile) const { return drawn_.empty() || drawn_[tile] != 0; }
    [[nodiscard]] const std::vector<std::uint8_t>& drawn() const { return drawn_; }
    /// The same tiles, of which those with a flag are drawn.
    [[nodiscard]] TileLayout only(std::vector<std::uint8_t> drawn) const;
    /// First pixel of a column or row of tiles; of column columns(): the picture's width.
    [[nodiscard]] int left(int column) const { return across_.begin(column); }
    [[nodiscard]] int top(int row) const { return down_.begin(row); }

    /// Columns (rows) of tiles; first > last where there are none.
    struct Range {
        std::int32_t first = 0, last = -1;
    };

    /// Tiles along one axis.
    struct Axis {
        int pixels = 1, tiles = 1;
        /// The first and the last tile whose sheets hold pixel p, at p + 1: a tile's sheets hold one pixel more on both
        /// sides, those of the outermost tiles pixels -1 and `pixels`.
        std::vector<std::int32_t> first_of, last_of;

        Axis(int pixels_in, int largest);
        [[nodiscard]] int begin(int tile) const {
            return static_cast<int>(static_cast<std::int64_t>(pixels) * tile / tiles);
        }
        /// Those whose sheets hold the centre of some pixel between two places, in pixels of the picture (pixel p's
        /// centre is at p + 1/2). Inlined, so that it is compiled for the instruction set of its caller.
        [[nodiscard]] inline Range between(double low, double high) const;
    };
    [[nodiscard]] const Axis& across() const { return across_; }
    [[nodiscard]] const Axis& down() const { return down_; }

  private:
    Axis across_, down_;
    std::vector<std::uint8_t> drawn_;
};

inline TileLayout::Range TileLayout::Axis::between(double low, double high) const {
    // Half a pixel to -1/2 ... pixels + 1/2, the centres of the outermost pixels that sheets hold.
    const double most = static_cast<double>(pixels);
    if (!(low <= most + 0.5) || !(high >= -0.5) || !(low <= high)) {
        return {};
    }
    // Truncation rounds down what is not negative: places are moved by one pixel.
    const double from = low < -0.5 ? 0.5 : low + 1.0, to = high > most + 0.5 ? most + 1.5 : high + 1.0;
    // The first centre at or after `from`: ceil(from - 1/2); the last one at or before `to`: floor(to - 1/2).
    auto first = static_cast<std::int32_t>(from + 0.5);
    first -= static_cast<double>(first) - 0.5 >= from ? 1 : 0;
    const auto last = static_cast<std::int32_t>(to - 0.5);
    if (first > last) {
        return {};
    }
    return {first_of[static_cast<std::size_t>(first)], last_of[static_cast<std::size_t>(last)]};
}

/// Root mean square of the errors of the drawn tiles, by their pixels.
/// Error of the numbers of modes mip and minimum over the largest that is shown, which is known once they are drawn.
double error_of_extremes(const DrawPlan& plan, const std::vector<float>& shown, double epsilon);

double picture_error(const TileLayout& layout, const std::vector<double>& errors);

/// Flags of the fewest tiles without which the drawn ones keep the bound: their errors together, and, so that no corner
/// of a picture is much worse, each one a few times the bound.
std::vector<std::uint8_t> doubtful_tiles(const TileLayout& layout, const std::vector<double>& errors, double bound);

/// Tiles that something reaches into.
struct TileRect {
    TileLayout::Range columns, rows;
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

/// The parts of a lattice's rows that reach into each drawn tile, of all rows that hold a drawn sample. poll: as
/// ThreadPool::run takes it. Throws OutOfMemory.
Buckets<RowPart> bucket_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame,
                             const TileLayout& layout, ThreadPool& pool, const std::function<void()>& poll = {});

/// Finds the tiles of kernels begin ... end - 1; of those that are not drawn, none.
using RectsFunction = void (*)(const EllipsoidView& view, const std::vector<std::uint8_t>& visible,
                               const TileLayout& layout, std::size_t begin, std::size_t end, TileRect* rects);

/// The drawn kernels that reach into each drawn tile. Throws OutOfMemory.
Buckets<std::uint32_t> bucket_kernels(const EllipsoidView& view, const std::vector<std::uint8_t>& visible,
                                      const TileLayout& layout, RectsFunction rects, ThreadPool& pool,
                                      const std::function<void()>& poll = {});

} // namespace sheetsplat::backend_cpu

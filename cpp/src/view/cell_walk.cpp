#include "view/cell_walk.hpp"

#include <limits>

#include "base/memory.hpp"

namespace sheetsplat {

namespace {

using ScreenBounds = EllipsoidView::ScreenBounds;

/// The picture with its border, pixels from the optical axis.
struct Window {
    double left, right, top, bottom;

    [[nodiscard]] bool misses(const ScreenBounds& b) const {
        return !b.unbounded && (b.left > right || b.right < left || b.top > bottom || b.bottom < top);
    }
};

ScreenBounds joined(const ScreenBounds& a, const ScreenBounds& b) {
    return {std::min(a.left, b.left), std::max(a.right, b.right), std::min(a.top, b.top), std::max(a.bottom, b.bottom),
            a.unbounded || b.unbounded};
}

constexpr double infinity = std::numeric_limits<double>::infinity();

} // namespace

CellTraversal CellTraversal::of(const EllipsoidView& view, const SpatialGrid& grid, const StartCells* starts,
                                const std::vector<std::uint8_t>& visible, BatchLayout layout, int wider_slices,
                                int wider_px, bool may_narrow, double sprite_px, double precise_aspect) {
    CellTraversal result;
    result.again_ = layout.covered / layout.stride;
    const Frame& frame = view.frame();
    if (frame.slices == 0 || grid.cells() == 0) {
        return result;
    }
    // One more than the border, for rounding.
    const double border = Tile::border + 1.0 + wider_px;
    const Window window{-frame.axis_x - border, frame.size.width - frame.axis_x + border, -frame.axis_y - border,
                        frame.size.height - frame.axis_y + border};
    const std::size_t all_cells = starts == nullptr ? grid.cells() : starts->cells();
    std::vector<std::uint32_t> count(all_cells + 1, 0);
    struct Found {
        Entry entry;
        std::uint32_t cell;
    };
    const std::uint64_t all = view.field().size();
    require_memory(all * (sizeof(Found) + sizeof(Entry)), "the kernels of a view, by cells",
                   "use fewer kernels at a time, or a transfer function that shows less");
    std::vector<Found> found;
    std::vector<Cell> cells(all_cells);
    for (Cell& cell : cells) {
        cell.first_batch = std::numeric_limits<std::int32_t>::max();
        cell.bounds = {infinity, -infinity, infinity, -infinity, false};
    }
    for (std::size_t home = 0; home < grid.cells(); ++home) {
        for (const std::uint32_t* id = grid.home_begin(home); id != grid.home_end(home); ++id) {
            if (visible[*id] == 0) {
                continue;
            }
            const EllipsoidView::Depths depths = view.depths(*id);
            const EllipsoidView::Span span = view.span(depths, wider_slices);
            if (span.first > span.last) {
                continue;
            }
            const ScreenBounds bounds = view.support_bounds(*id, view.front_of(span.first), view.back_of(span.last));
            if (window.misses(bounds)) {
                continue;
            }
            const std::uint32_t start = starts == nullptr
                                            ? static_cast<std::uint32_t>(home)
                                            : starts->of_kernel(view.field(), grid, *id, view.first_point_world(*id));
            const std::int64_t first = span.first / layout.stride;
            const std::int64_t last = span.last / layout.stride;
            const bool narrow = may_narrow && layout.covered > layout.stride && first == last;
            const Entry entry{*id, static_cast<std::int32_t>(first), static_cast<std::uint32_t>(last) & 0xFFFFFFU,
                              narrow ? 1U : 0U,
                              static_cast<std::uint32_t>(view.group(*id, depths, sprite_px, precise_aspect)) & 0x7FU};
            found.push_back({entry, start});
            ++count[start + 1];
            Cell& cell = cells[start];
            cell.first_batch = std::min(cell.first_batch, entry.first_batch);
            cell.last_batch = std::max(cell.last_batch, static_cast<std::int32_t>(entry.last_batch));
            cell.bounds = joined(cell.bounds, bounds);
        }
    }
    for (std::size_t cell = 0; cell < all_cells; ++cell) {
        count[cell + 1] += count[cell];
        cells[cell].begin = count[cell];
        cells[cell].end = count[cell + 1];
    }
    result.entries_.resize(found.size());
    for (const Found& one : found) {
        result.entries_[count[one.cell]++] = one.entry;
    }
    for (const Cell& cell : cells) {
        if (cell.begin < cell.end) {
            result.cells_.push_back(cell);
            std::sort(result.entries_.begin() + cell.begin, result.entries_.begin() + cell.end,
                      [](const Entry& a, const Entry& b) {
                          return a.first_batch != b.first_batch ? a.first_batch < b.first_batch : a.kernel < b.kernel;
                      });
        }
    }
    result.cells_.shrink_to_fit();
    std::stable_sort(result.cells_.begin(), result.cells_.end(),
                     [](const Cell& a, const Cell& b) { return a.first_batch < b.first_batch; });
    return result;
}

} // namespace sheetsplat

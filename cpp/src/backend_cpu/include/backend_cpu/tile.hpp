// What the stages of the slice loop hand to each other for one image tile.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace sheetsplat::backend_cpu {

class LatticeReach;

/// Where a tile lies and how its planes are laid out. Sheets have a border of one pixel on every side: pixel (x, y) of
/// the tile is element (y + 1) * stride + (x + 1) of a sheet, and element y * stride + x of a plane of the picture.
struct TileShape {
    int x = 0, y = 0;          ///< first pixel in the picture
    int width = 0, height = 0; ///< pixels, without the border
    /// Elements from row to row, in sheets and picture planes alike; at least width + 2 + padding, and a multiple of
    /// padding.
    int stride = 0;
    /// Elements that vectors may run over the right end of a row, and past the end of a plane: the most lanes there
    /// are. What stands there in sheets is 0 or harmless, in picture planes it is never read.
    static constexpr int padding = 16;

    [[nodiscard]] double pixels() const { return static_cast<double>(width) * static_cast<double>(height); }
    [[nodiscard]] std::size_t sheet_elements() const {
        return static_cast<std::size_t>(stride) * static_cast<std::size_t>(height + 2) + padding;
    }
    [[nodiscard]] std::size_t picture_elements() const {
        return static_cast<std::size_t>(stride) * static_cast<std::size_t>(height) + padding;
    }
};

/// Pixels x0 <= x < x1, y0 <= y < y1.
struct Rect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    [[nodiscard]] bool empty() const { return x0 >= x1 || y0 >= y1; }
    [[nodiscard]] Rect cut_to(const Rect& other) const {
        return {std::max(x0, other.x0), std::max(y0, other.y0), std::min(x1, other.x1), std::min(y1, other.y1)};
    }
    void add(const Rect& other) {
        if (other.empty()) {
            return;
        }
        if (empty()) {
            *this = other;
            return;
        }
        x0 = std::min(x0, other.x0);
        y0 = std::min(y0, other.y0);
        x1 = std::max(x1, other.x1);
        y1 = std::max(y1, other.y1);
    }
};

/// A group's sheets of the finished slices around slice n.
template <class T>
struct SheetWindow {
    /// rho of slices n - 1, n, n + 1 and n + 2 in the sheets' unit (DrawPlan::unit_of); never null: a slice that
    /// nothing reaches, or that does not exist, is a sheet of zeros. n + 2 is there for intervals only.
    const T* rho[4] = {nullptr, nullptr, nullptr, nullptr};
    /// W of slices n and n + 1, in sheets too; 0 where a point is empty. Null unless the plan has empty_test or
    /// coverage, or the mode counts slices by it.
    const T* weight[2] = {nullptr, nullptr};
    /// Where empty_test goes without weights: the group's lattices, whose places tell which points of rho 0 are empty.
    const std::vector<LatticeReach>* reach = nullptr;
    /// Derivatives of rho of slices n and n + 1 over columns, rows and slices (in perspective along the pixel's ray),
    /// one step of each. Null unless the plan has analytic_gradient.
    const T* slope[2][3] = {};
    /// Pixels of the tile (without border) outside of which the group shows nothing.
    Rect shown{0, 0, std::numeric_limits<int>::max(), std::numeric_limits<int>::max()};
};

/// The finished slices around slice n; the base: of the first group.
template <class T>
struct SlabWindow : SheetWindow<T> {
    std::int64_t n = 0;                           ///< counted as Frame does; -1: before the first one (intervals only)
    const SheetWindow<T>* later_groups = nullptr; ///< of all groups after the first one
    /// Pixels of the tile (without border) outside of which slice n (for intervals: n and n + 1 both) is empty.
    Rect rect;
};

/// Of a group, the faces of cuts through which pixels' rays come (CutFaces): planes of a tile.
template <class T>
struct FacePlanes {
    const T* slice = nullptr;  ///< where: the last slice in front of it
    const T* behind = nullptr; ///< and how far it lies behind that, in slice distances
    const T* normal[3] = {};
};

/// A tile's picture while it is made: planes of TileShape::picture_elements().
template <class T>
struct TilePicture {
    T* red = nullptr; ///< premultiplied
    T* green = nullptr;
    T* blue = nullptr;
    T* alpha = nullptr;
    T* scalar = nullptr;          ///< scalar modes; minimum: infinite until a slice counts
    T* counted = nullptr;         ///< mode average: slices that count
    T* depth = nullptr;           ///< infinite until opacity reaches one half; null unless asked for
    T* coverage = nullptr;        ///< null unless asked for
    const T* last_kept = nullptr; ///< the last slice in front of the depth limit; null without one
    /// Of a part of a whole: the slices that it draws, with the intervals behind them; null where it draws all.
    const T* first_owned = nullptr;
    const T* last_owned = nullptr;
    std::vector<FacePlanes<T>> faces; ///< a group each; none unless the plan has cut_faces
    /// Sums over a tile of squares of how much of an error of rho lit pixels show (Slab::doubt), a lane each.
    alignas(64) T doubts[TileShape::padding] = {};
    int* row_alive = nullptr; ///< a row: pixels that still change: alpha < A_stop, and not yet at the depth limit
    int alive = 0;            ///< sum of row_alive
};

} // namespace sheetsplat::backend_cpu

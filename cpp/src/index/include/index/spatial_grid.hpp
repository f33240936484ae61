// The view-independent spatial grid of scattered ellipsoids ([NM06] section 4.2), and which of them can be seen.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "index/visibility.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// Kernels in cubic cells of several sizes, so that every kernel, however large, meets at most 8 cells of its own level
/// (2 along each axis), and every cell but the coarsest is home to at least `least_in_cell` kernels. Cells without
/// kernels do not exist. Cells are numbered level by level, from level 0, the finest, on; inside a level in Z order, so
/// that neighbours in number are neighbours in space.
class SpatialGrid {
  public:
    /// Places where fewer kernels share a cell give them to the next coarser one.
    static constexpr std::size_t least_in_cell = 8;

    SpatialGrid() = default;
    /// Finished, it takes at most 20 bytes a kernel (and a few hundred); while it is built, at most 32 a kernel. Time
    /// is linear in the number of kernels, whatever their sizes and places. Throws OutOfMemory before anything is
    /// allocated; Unsupported for more than 2^32 - 1 kernels.
    static SpatialGrid of(const EllipsoidField& field);

    [[nodiscard]] std::size_t kernels() const { return order_.size(); }
    [[nodiscard]] std::size_t cells() const { return corner_.size(); }
    [[nodiscard]] std::size_t bytes() const;

    /// 0 for a field without kernels; at most 53. There may be levels without cells.
    [[nodiscard]] int levels() const { return static_cast<int>(level_begin_.size()) - 1; }
    /// First cell of a level; of level levels(): cells().
    [[nodiscard]] std::uint32_t level_begin(int level) const { return level_begin_[static_cast<std::size_t>(level)]; }
    /// Edge of a level's cells, world units: each level's is twice that of the finer one before it.
    [[nodiscard]] double cell_size(int level) const;
    [[nodiscard]] int level_of_cell(std::size_t cell) const;
    /// Level of a kernel: that of its home.
    [[nodiscard]] int level(std::size_t kernel) const { return level_of_cell(home_[kernel]); }

    /// Home: every kernel once, in the cell (of its level) that holds its centre.
    [[nodiscard]] std::uint32_t home(std::size_t kernel) const { return home_[kernel]; }
    [[nodiscard]] const std::uint32_t* home_begin(std::size_t cell) const { return order_.data() + offset_[cell]; }
    [[nodiscard]] const std::uint32_t* home_end(std::size_t cell) const { return order_.data() + offset_[cell + 1]; }
    /// All kernels, cell by cell.
    [[nodiscard]] const std::vector<std::uint32_t>& order() const { return order_; }

    /// The cell's own box.
    [[nodiscard]] Box cell_bounds(std::size_t cell) const;
    /// Box around the supports of the kernels whose home it is.
    [[nodiscard]] const Box& home_supports(std::size_t cell) const { return supports_[cell]; }

  private:
    friend class StartCells;
    /// Place of a cell in its level: whole cells from the grid's corner.
    using Corner = std::array<std::uint64_t, 3>;
    static constexpr std::uint32_t none = 0xFFFFFFFFU; ///< no such cell

    [[nodiscard]] int depth_of_level(int level) const { return levels() - 1 - level; }

    Vec3 lower_{0.0};                   ///< corner of the grid, world
    double root_ = 1.0;                 ///< edge of the one cell that would hold all supports; a power of two
    std::vector<std::uint32_t> order_;  ///< kernels, cell by cell
    std::vector<std::uint32_t> home_;   ///< cell of each kernel
    std::vector<std::uint32_t> offset_; ///< into order_, one for each cell and one more
    std::vector<Corner> corner_;
    std::vector<Box> supports_;
    std::vector<std::uint32_t> level_begin_{0};
};

/// The cells in which a kernel can start ([NM06] section 4.2): the 1 to 8 cells of its level that its bounding box
/// meets. Cells of the grid come first, with the same numbers as in the grid; cells that are no kernel's home follow.
class StartCells {
  public:
    /// For fields of at most 2^28 kernels. 24 bytes for each cell that is no kernel's home; while they are found, up to
    /// about 100 for each cell of the level that has most of them. Throws OutOfMemory before anything is allocated.
    static StartCells of(const EllipsoidField& field, const SpatialGrid& grid);

    [[nodiscard]] std::size_t cells() const { return cells_; }
    [[nodiscard]] std::size_t bytes() const;
    /// The cell in which a kernel starts, where point_world is the point of its support that is nearest to the viewer:
    /// of the cells in which it can start the one that contains the point, or the nearest one where rounding puts the
    /// point outside all of them. field, grid: those that were given to `of`.
    [[nodiscard]] std::uint32_t of_kernel(const EllipsoidField& field, const SpatialGrid& grid, std::size_t kernel,
                                          const Vec3& point_world) const;
    [[nodiscard]] Box cell_bounds(const SpatialGrid& grid, std::size_t cell) const;

  private:
    std::size_t cells_ = 0;
    std::vector<SpatialGrid::Corner> extra_; ///< cells that are no kernel's home, in Z order inside a level
    std::vector<std::uint32_t> extra_begin_; ///< first of them, level by level; one more at the end
};

/// One flag a kernel: 0 where it cannot matter (conventions, section 2), 1 elsewhere. What is dropped is invisible
/// whichever of the other kernels are drawn. Time is linear in the number of kernels, whatever their sizes and places.
/// Throws OutOfMemory, InvalidInput. grid: SpatialGrid::of(field).
[[nodiscard]] std::vector<std::uint8_t> visible_kernels(const EllipsoidField& field, const SpatialGrid& grid,
                                                        const VisibilityQuery& visibility);

} // namespace sheetsplat

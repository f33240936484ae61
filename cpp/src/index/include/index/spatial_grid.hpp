// The view-independent spatial grid of scattered ellipsoids ([NM06] section 4.2), and which of them can be seen.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/field.hpp"
#include "sheetsplat/transfer_function.hpp"

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
    /// All kernels, cell by cell; those of a cell are order()[home_offset(cell)] to order()[home_offset(cell + 1) - 1].
    [[nodiscard]] const std::vector<std::uint32_t>& order() const { return order_; }
    [[nodiscard]] std::uint32_t home_offset(std::size_t cell) const { return offset_[cell]; }

    /// The cell's own box.
    [[nodiscard]] Box cell_bounds(std::size_t cell) const;
    /// Box around the supports of the kernels whose home it is.
    [[nodiscard]] const Box& home_supports(std::size_t cell) const { return supports_[cell]; }
    /// Smallest and largest value f of these.
    [[nodiscard]] const std::array<double, 2>& home_values(std::size_t cell) const { return values_[cell]; }

  private:
    friend class ReachLists;
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
    std::vector<std::array<double, 2>> values_;
    std::vector<std::uint32_t> level_begin_{0};
};

/// For each cell the kernels that reach into it, flattened for the GPU. A kernel is in the lists of those cells of its
/// level that its support's box meets: 1 to 8 of them. The first cells are the grid's, with the grid's numbers; cells
/// that are nobody's home follow.
class ReachLists {
  public:
    /// The result takes 4 bytes for each time that a kernel is listed and 29 for each cell; beside it, up to about 100
    /// for each cell of the level that has most of them. Throws OutOfMemory before anything is allocated; Unsupported
    /// for more than 2^32 - 1 entries.
    static ReachLists of(const EllipsoidField& field, const SpatialGrid& grid);

    [[nodiscard]] std::size_t cells() const { return level_.size(); }
    [[nodiscard]] std::size_t bytes() const;
    /// Entries of a cell: entries()[offsets()[cell]] to entries()[offsets()[cell + 1] - 1], in the grid's order.
    [[nodiscard]] const std::vector<std::uint32_t>& offsets() const { return offsets_; }
    [[nodiscard]] const std::vector<std::uint32_t>& entries() const { return entries_; }
    [[nodiscard]] int level_of_cell(std::size_t cell) const { return level_[cell]; }
    [[nodiscard]] Box cell_bounds(std::size_t cell) const;
    /// Of the cells that list a kernel, the one that holds a point of its support's box (rounding may put a point of
    /// its surface outside: then the nearest of them). With the point of the support that is nearest to the viewer
    /// (first_point), this is the cell that draws the kernel ([NM06] section 4.2); field and grid: those of `of`.
    [[nodiscard]] std::uint32_t start_cell(const EllipsoidField& field, const SpatialGrid& grid, std::size_t kernel,
                                           const Vec3& point_world) const;

  private:
    using Corner = SpatialGrid::Corner;
    /// The cell at a corner, with or without a home; SpatialGrid::none where nothing reaches.
    [[nodiscard]] std::uint32_t find(const SpatialGrid& grid, const Corner& corner, int level) const;

    std::vector<std::uint32_t> offsets_{0};
    std::vector<std::uint32_t> entries_;
    std::vector<std::int8_t> level_;
    std::vector<Corner> corner_;
    std::vector<std::uint32_t> extra_begin_; ///< first of the cells without a home, level by level; one more at the end
    Vec3 lower_{0.0};
    double root_ = 1.0;
    int levels_ = 0;
};

/// The point of a kernel's support that is nearest to a viewer far away in direction `towards_viewer` (any length but
/// 0): c + M M^T e / |M^T e|.
[[nodiscard]] Vec3 first_point(const EllipsoidField& field, std::size_t kernel, const Vec3& towards_viewer);

/// What decides which kernels are drawn.
struct EllipsoidVisibility {
    const TransferFunction* transfer_function = nullptr; ///< null: every value is visible (modes xray and mip)
    /// The weight sum is needed where something is visible: kernels of value 0 are drawn too. Normalisation threshold
    /// implies it.
    bool weights_matter = false;
    bool cull = true; ///< false: every kernel is drawn (a coverage output needs the weights everywhere)
    /// Isosurface: visible is where two points of a pixel's ray lie on different sides of iso_value; then the transfer
    /// function is not asked.
    bool isosurface = false;
    double iso_value = 0.0;
    bool alone = true; ///< false: other fields add to this one, so that only kernels that add nothing can be dropped
    /// World units, >= 0: how far apart the supports of two kernels may lie that matter to one another all the same
    /// (the sum of what stencils of gradients, crossings, pre-integrated intervals and slabs reach, and of twice what a
    /// filter widens a support by).
    double reach_world = 0.0;
};

/// One flag a kernel: 0 where it cannot matter (conventions, section 2), 1 elsewhere. What is dropped is invisible
/// whichever of the other kernels are drawn. Time is linear in the number of kernels, whatever their sizes and places.
/// Throws OutOfMemory; InvalidInput for a reach_world that is negative or no number. grid: SpatialGrid::of(field).
[[nodiscard]] std::vector<std::uint8_t> visible_kernels(const EllipsoidField& field, const SpatialGrid& grid,
                                                        const EllipsoidVisibility& visibility);

} // namespace sheetsplat

// The fragment-centric way to a slice ([NM06] section 5.1), to be compared with splatting: each pixel looks in a grid
// of lists for the kernels that reach its place, and adds them up by itself.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "gl/objects.hpp"
#include "plan/make_plan.hpp"
#include "splatting.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat::lab {

/// A uniform grid of cubes with, for each of them, the kernels whose supports meet it. Edges are half the mean extent
/// of the kernels' boxes, longer where that would make too many cells or entries.
struct ReachGrid {
    Vec3 lower{0.0};                                 ///< world
    double edge = 1.0;                               ///< of a cell, world units
    std::array<int, 3> shape{0, 0, 0};               ///< cells along x, y and z; x is fastest in `lists`
    std::vector<std::array<std::uint32_t, 2>> lists; ///< of each cell: its first entry, and how many there are
    std::vector<std::uint32_t> entries;              ///< places in `kernels`

    /// Throws OutOfMemory.
    static ReachGrid of(const EllipsoidField& field, const std::vector<std::uint32_t>& kernels);
};

/// Made and destroyed with the context current.
class Gather {
  public:
    /// Lists and uploads the kernels of a view. counting: of the field's values.
    Gather(const gl::Api& gl, const EllipsoidView& view, const CellTraversal& traversal, const Counting& counting);
    /// Writes the finished slabs of a pass wherever active cells lie.
    void splat(backend_gl::Splatting& splatting, std::size_t part, std::int64_t pass) const;
    [[nodiscard]] std::size_t bytes() const { return lists_.bytes() + entries_.bytes() + records_.bytes(); }

  private:
    void use(const backend_gl::TileScope& scope, const EllipsoidView& view, const backend_gl::SlabPass& pass) const;

    Vec3 lower_{0.0};
    double edge_ = 1.0;
    std::array<int, 3> shape_{0, 0, 0};
    gl::Texture lists_, entries_, records_;
};

/// Throws Unsupported where pixels cannot look for a scene's kernels.
void adjust_for_gather(DrawPlan& plan, const Scene& scene);

} // namespace sheetsplat::lab

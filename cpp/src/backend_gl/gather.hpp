// The fragment-centric way to a slice ([NM06] section 5.1), to be compared with splatting: each pixel looks in a grid
// of lists for the kernels that reach its place, and adds them up by itself.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "active_cells.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "plan/make_plan.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat::backend_gl {

class Resources;

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

/// Orthographic cameras, point sampling, no filter, packing wide. Made and destroyed with the context current.
class Gather {
  public:
    explicit Gather(const gl::Api& gl) : gl_(&gl) {}

    /// Lists and uploads the kernels of a view.
    void prepare(const EllipsoidView& view, const CellTraversal& traversal);
    /// The program that writes four finished slabs wherever rectangles are drawn with it, ready for use.
    const gl::Program& use(Resources& resources, const DrawPlan& plan, const EllipsoidView& view,
                           const SlabPass& pass) const;
    [[nodiscard]] std::size_t bytes() const { return lists_.bytes() + entries_.bytes() + records_.bytes(); }

  private:
    const gl::Api* gl_;
    Vec3 lower_{0.0};
    double edge_ = 1.0;
    std::array<int, 3> shape_{0, 0, 0};
    gl::Texture lists_, entries_, records_;
};

} // namespace sheetsplat::backend_gl

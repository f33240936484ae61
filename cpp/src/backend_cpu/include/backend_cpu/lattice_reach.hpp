// Which points of a slice some kernel of a lattice without holes reaches: those whose nearest sample is nearer than the
// kernels' radius, in index space, where supports are balls (conventions, section 2). Nothing is summed for it.
#pragma once

#include <cstdint>
#include <vector>

#include <glm/mat3x3.hpp>

#include "backend_cpu/tile.hpp"
#include "facts/frame.hpp"
#include "view/field_view.hpp"

namespace sheetsplat::backend_cpu {

/// A Cartesian lattice in one view.
class LatticeReach {
  public:
    /// Adds those of a field: one, of a BCC field two. frame: must outlive them.
    static void add(const FieldView& view, const Frame& frame, std::vector<LatticeReach>& to);

    /// Index coordinates of the first pixel of a tile on slice n, and their changes from column to column and row to
    /// row.
    struct Places {
        Vec3 first, by_column, by_row;
    };
    [[nodiscard]] Places places(const TileShape& tile, std::int64_t n) const;
    [[nodiscard]] bool has_slice(std::int64_t n) const { return n >= 0 && n < frame_->slices; }

    enum class Pixels { none, some, all };
    /// Which pixels of the tile are reached: some where it takes a closer look to tell.
    [[nodiscard]] Pixels pixels(const TileShape& tile, const Places& places) const;

    /// Whether some point between samples is not reached.
    [[nodiscard]] bool has_gaps() const;
    [[nodiscard]] const Vec3& last() const { return last_; } ///< sample along each axis
    [[nodiscard]] double radius() const { return radius_; }  ///< of supports, in index space

  private:
    LatticeReach(const Vec3& first_eye, const glm::dmat3& steps, const Vec3& last, double radius, const Frame& frame);

    const Frame* frame_;
    glm::dmat3 to_index_;
    Vec3 first_eye_, last_;
    double radius_;
};

} // namespace sheetsplat::backend_cpu

// Splats of scattered ellipsoids: rectangles along the axes of their sections, or point sprites of small spheres
// ([NM06] section 4).
#pragma once

#include <array>
#include <vector>

#include "splatting.hpp"

namespace sheetsplat::backend_gl {

class EllipsoidSplats {
  public:
    explicit EllipsoidSplats(Splatting& splatting);
    /// Draws the batch of a pass: kernels of one field (a number in job.ellipsoids).
    void splat(std::size_t part, std::int64_t pass);

  private:
    /// Kernels of one group that are drawn together, as the processor sliced them, or as indices of those that the
    /// device keeps (DrawPlan::resident_sections).
    struct Gathered {
        std::vector<SectionRecord> records;
        std::vector<SectionRest> rests; ///< of the precise groups
        std::vector<std::uint32_t> indices;
    };
    /// Draws what was gathered for one group, and forgets it.
    void draw_group(std::size_t part, std::size_t number, std::int64_t pass);
    void draw(const EllipsoidView& view, const Gathered& gathered, SectionGroup group, const SplatTarget& target,
              std::int64_t pass) const;
    void bind_attributes(SectionGroup group, std::size_t first) const;

    Splatting& splatting_;
    const TileScope& scope_;
    std::vector<CellWalk> walks_;
    std::array<Gathered, 2 * section_groups> groups_; ///< wide ones, then narrow ones
};

} // namespace sheetsplat::backend_gl

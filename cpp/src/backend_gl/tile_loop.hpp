// One tile of a picture: for each batch splat, (copy,) shade and composite ([NM05] figure 5).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "classification.hpp"
#include "ellipsoid_splats.hpp"
#include "lattice_splats.hpp"
#include "papers/opacity_buffer.hpp"
#include "shading_pass.hpp"
#include "splatting.hpp"
#include "tile_scope.hpp"
#include "touched_pixels.hpp"

namespace sheetsplat::backend_gl {

class TileLoop {
  public:
    /// classification: null where the mode has none.
    TileLoop(const TileScope& scope, const Classification* classification);

    /// progress: called after each pass with the share of this tile that is done.
    void run(const std::function<void(double)>& progress);

    /// What was drawn.
    [[nodiscard]] const Splatting& splatting() const { return splatting_; }
    /// Passes that were not left out.
    [[nodiscard]] std::size_t shaded() const { return shaded_; }

  private:
    /// Returns whether anything was splatted.
    bool splat(std::int64_t pass);
    /// Makes the sheet that a pass reads before that of its batch what nothing reaches.
    void fill_before(std::int64_t pass) const;

    const TileScope& scope_;
    std::vector<float> empty_; ///< of each group: rho, less its pivots, where no kernel reaches
    TouchedPixels touched_;
    OpacityCulling opacity_;
    Splatting splatting_;
    LatticeSplats lattices_;
    EllipsoidSplats ellipsoids_;
    ShadingPass shading_;
    std::size_t shaded_ = 0;
};

} // namespace sheetsplat::backend_gl

// One tile of a picture: for each batch splat, (copy,) shade and composite ([NM05] figure 5).
#pragma once

#include <functional>

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

  private:
    void splat(std::int64_t pass);

    const TileScope& scope_;
    TouchedPixels touched_;
    OpacityCulling opacity_;
    Splatting splatting_;
    LatticeSplats lattices_;
    EllipsoidSplats ellipsoids_;
    ShadingPass shading_;
};

} // namespace sheetsplat::backend_gl

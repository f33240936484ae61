// Splats of lattices: point sprites where all kernels have one size on the screen, else rectangles.
#pragma once

#include <vector>

#include "splatting.hpp"

namespace sheetsplat::backend_gl {

class LatticeSplats {
  public:
    explicit LatticeSplats(Splatting& splatting);
    /// Draws the batch of a pass: kernels of one lattice (a number in job.regular).
    void splat(std::size_t part, std::int64_t pass);

  private:
    void draw(const gl::Program& program, const FieldView& view, const VertexMaker& maker, std::int64_t first_slab,
              std::size_t count) const;
    void bind_attributes(std::size_t first) const;

    Splatting& splatting_;
    const TileScope& scope_;
    std::vector<VertexMaker> makers_;
};

} // namespace sheetsplat::backend_gl

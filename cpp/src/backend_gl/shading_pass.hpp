// Classifies, shades and composites the finished slices of a pass, front to back ([NM05] section 4.2).
#pragma once

#include "classification.hpp"
#include "gl/objects.hpp"
#include "tile_scope.hpp"
#include "touched_pixels.hpp"
#include "view/shading_inputs.hpp"

namespace sheetsplat::backend_gl {

class ShadingPass {
  public:
    /// classification: null where the mode has none.
    ShadingPass(const TileScope& scope, const Classification* classification);
    void shade(const TouchedPixels& touched, std::int64_t pass) const;
    /// Binds what the program of a pass reads beside sheets and picture, and sets its uniforms. The program is in use.
    void bind_inputs(const gl::Program& program, std::int64_t pass) const;

  private:
    const TileScope& scope_;
    const Classification* classification_;
    const ShadingInputs inputs_;
    gl::Texture ends_;  ///< where fields of groups end in different places: of each pixel and group a run as below
    gl::Texture faces_; ///< of cuts: of each pixel and group a normal and a place
    gl::Texture kept_;  ///< where anything is cut off: of each pixel the first slice that it keeps, and the last one
};

} // namespace sheetsplat::backend_gl

// The uniforms of lib/slices_of_one.glsl and lib/slices_of_groups.glsl: everything that the shading of a slab depends
// on beside the sheets.
#pragma once

#include "classification.hpp"
#include "tile_scope.hpp"
#include "view/shading_inputs.hpp"

namespace sheetsplat::backend_gl {

/// classification: null where the mode has none.
void set_shading(const gl::Program& program, const TileScope& scope, const ShadingInputs& inputs,
                 const Classification* classification, std::int64_t pass);

} // namespace sheetsplat::backend_gl

// Pre-shaded splatting: kernels are classified and lit one by one, and their colours summed. What image-aligned sheet
// buffers with post-shading were made to overcome ([NM05] section 1): kept as a mode for comparison, never chosen by a
// plan.
#pragma once

#include <functional>

#include "backend_gl/gl_renderer.hpp"
#include "resources.hpp"

namespace sheetsplat::backend_gl {

/// Draws one tile; the picture is left in targets.image(). Orthographic, point sampling, Cartesian fields.
/// Returns the splats that were drawn.
std::size_t draw_preshaded(const Job& job, const gl::Api& gl, Resources& resources, const Targets& targets,
                           const Tile& tile, const std::function<void(double)>& progress);

/// The surfaces that draw_preshaded needs.
TargetShape preshaded_shape(const Tile& tile);

} // namespace sheetsplat::backend_gl

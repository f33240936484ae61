// Pre-shaded splatting: kernels are classified and lit one by one, and their colours summed. What image-aligned sheet
// buffers with post-shading were made to overcome ([NM05] section 1).
#pragma once

#include <functional>

#include "backend_gl/gl_renderer.hpp"
#include "resources.hpp"

namespace sheetsplat::lab {

/// Draws one tile and returns the surfaces that hold it; adds the splats that were drawn to `drawn`.
const backend_gl::Targets& draw_preshaded(const backend_gl::Job& job, const gl::Api& gl,
                                          backend_gl::Resources& resources, const Tile& tile,
                                          const std::function<void(double)>& progress, std::size_t& drawn);

/// Throws Unsupported for scenes other than Cartesian volumes in mode composite, orthographic, point-sampled and
/// without effects beyond the papers.
void adjust_for_preshaded(DrawPlan& plan, const Scene& scene);

} // namespace sheetsplat::lab

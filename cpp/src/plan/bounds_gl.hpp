// What backend gl cannot draw within its error bound.
#pragma once

#include <string>

#include "parts.hpp"

namespace sheetsplat {

/// Why sheets stay 32-bit; empty where 16 bits keep their bound over the whole picture, on a device that gains by them.
std::string why_float32(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities,
                        const DrawPlan& plan);

/// Adds the expected errors of sums and gradients to the budget. Throws Unsupported where the sheets' precision does
/// not keep its bound.
void check_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                     const Capabilities& capabilities, DrawPlan& plan);

/// Throws Unsupported for more transfer functions or surfaces than the shading program has room for.
void check_parts(const Scene& scene, const DrawPlan& plan);

/// Throws Unsupported for more lights than shaders and buffers hold.
void check_lights(const Scene& scene, const Capabilities& capabilities, const DrawPlan& plan);

/// Throws Unsupported for kernels that float32 cannot place or resolve.
void check_kernels(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities, const DrawPlan& plan);

/// Throws Unsupported where the slicing of [NM06], step by step, cannot draw a scene.
void check_paper_slicing(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                         const Effects& effects, const DrawPlan& plan, bool float64);

} // namespace sheetsplat

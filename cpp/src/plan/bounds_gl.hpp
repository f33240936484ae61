// What backend gl cannot draw within its error bound.
#pragma once

#include <string>

#include "parts.hpp"

namespace sheetsplat {

/// Why sheets stay 32-bit; empty where 16 bits keep their bound over the whole picture, on a device that gains by them.
std::string why_float32(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities,
                        const DrawPlan& plan);

/// Adds the expected errors of sums and gradients to the budget. Throws Unsupported beyond a limit of the sheets.
void check_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                     const Capabilities& capabilities, DrawPlan& plan);

/// Throws Unsupported for the coverage of fields that add up where samples of one are missing.
void check_coverage(const Scene& scene, const DrawPlan& plan);

/// Throws Unsupported where the slicing of [NM06], step by step, does not go with what else the scene calls for.
void check_paper_slicing(const ViewFacts& view, const RendererOptions& options, const Effects& effects,
                         const DrawPlan& plan);

} // namespace sheetsplat

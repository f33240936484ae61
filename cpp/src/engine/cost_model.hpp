// What a picture costs, before it is drawn.
#pragma once

#include "facts/view_facts.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Counts that a picture's time grows with.
struct Work {
    double kernels = 0.0;
    double slices_each = 0.0; ///< that a kernel meets, on the average
    double radius_px = 0.0;   ///< of a kernel, on the average
    double splats = 0.0;      ///< pixels of all sections
    double pixels = 0.0;      ///< times slices
    /// What a pixel of a section and one of a slice cost, in those of point sampling and of a flat composite.
    double splat_price = 1.0, shade_price = 1.0;
    double number_price = 1.0; ///< of everything: float64 takes longer
};

/// All kernels count, drawn or not.
Work work_of(const Scene& scene, const ViewFacts& view);

/// What a scene's sampling, classification and light cost.
void set_prices(Work& work, const Scene& scene, Projection projection, bool float64);

/// Seconds of the same view with pixels and slice distances so many times larger, on one of today's processors.
double expected_seconds(const Work& work, double larger_pixels, double larger_spacing, int threads);

} // namespace sheetsplat

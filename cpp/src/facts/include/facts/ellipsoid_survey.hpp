// What a plan needs to know of scattered ellipsoids: what is the same in every view, and what a view makes of it.
#pragma once

#include <cstdint>
#include <limits>

#include "facts/crowd.hpp"
#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The same in every view. World units.
struct KernelFacts {
    double largest_aspect = 1.0; ///< longest over shortest semi-axis of one kernel
    double mean_overlap = 0.0;   ///< kernels that overlap at a point, on the average over the box of all supports
    /// Smallest and largest of the kernels' shortest semi-axes; 1 for a field without kernels.
    double thinnest = 1.0, thickest = 1.0;
    Crowd crowd;
};
/// Linear in the number of kernels.
KernelFacts survey_kernels(const EllipsoidField& field);

/// Of one view.
struct EllipsoidFacts {
    std::size_t unresolved = 0;  ///< kernels smaller than a pixel or thinner than a slice distance
    double largest_change = 0.0; ///< bound on the share by which the filter changes a semi-axis, squared
    /// Smallest semi-axis of a kernel in pixels at its centre's depth; in perspective a bound from below where it is
    /// larger than 1.
    double smallest_px = std::numeric_limits<double>::infinity();
};
/// kernels: survey_kernels(field). Looks at single kernels only where bounds do not tell.
EllipsoidFacts survey_ellipsoids(const EllipsoidField& field, const KernelFacts& kernels, const Camera& camera,
                                 const Frame& frame);

} // namespace sheetsplat

// What a plan needs to know of a view, in plain numbers: one value, made by one function from scene, camera and frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>

#include "facts/extreme_blocks.hpp"
#include "facts/field_survey.hpp"
#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The picture's pixels and slices. Lengths in world units.
struct FrameFacts {
    Size size{};
    std::int64_t first_slice = 0;
    std::int64_t slices = 0;
    double slice_spacing = 1.0;
    double reference_length = 1.0;
    double smallest_pixel = 1.0, largest_pixel = 1.0; ///< width over all slices
    double largest_slant = 1.0;                       ///< largest s = 1 / cos(theta) over the picture
    bool cut_by_near = false;                         ///< slices are missing in front because of the near plane
    double nearest_depth = 0.0;                       ///< of the first slice
    /// Depth up to which slices, slabs and crossings lie.
    double farthest_depth = std::numeric_limits<double>::infinity();

    /// Smallest distance of two samples of a slice stack: of neighbouring pixels or slices.
    [[nodiscard]] double smallest_step() const { return std::min(smallest_pixel, slice_spacing); }
};

/// Kernels of all fields.
struct KernelCounts {
    std::size_t all = 0;
    std::size_t unresolved = 0;      ///< smaller than a pixel or thinner than a slice spacing
    bool ellipsoids = false;         ///< some field is scattered
    std::size_t most_ellipsoids = 0; ///< kernels of the largest scattered field
};

/// Shapes of kernels over all fields.
struct KernelShapes {
    double smallest_falloff = 8.0;
    double largest_aspect = 1.0;    ///< longest over shortest semi-axis of one ellipsoid
    double largest_filtering = 0.0; ///< largest square of what the filter adds over a semi-axis
    bool sheared = false;           ///< sections of some lattice lean (unequal spacing, seen at an angle)
};

/// Sizes on the screen, pixels.
struct ScreenSizes {
    double largest_lattice = 1.0; ///< half the extent of a lattice's kernel (perspective: at the nearest slice)
    double smallest = std::numeric_limits<double>::infinity(); ///< shortest semi-axis of any kernel
    /// Shortest semi-axis of an ellipsoid at its centre's depth.
    double smallest_ellipsoid = std::numeric_limits<double>::infinity();
    double largest_ellipsoid = 0.0; ///< longest semi-axis of an ellipsoid at the nearest slice
    /// The same at a distance of one unit of length (orthographic: at any).
    double largest_ellipsoid_at_unit = 0.0;

    [[nodiscard]] double largest() const { return std::max(largest_lattice, largest_ellipsoid); }
};

/// How thick slabs are against kernels.
struct SlabFacts {
    double widest = 1.0;    ///< largest sqrt(k) |w| ds / h over the lattices, w: a ray's direction in the unit sphere
    double thickest = 0.0;  ///< longest way of a ray through a slab over the half-depth of any kernel, or a bound of it
    ThinInSlabs ellipsoids; ///< sampling slab: those much thinner than a slab
};

/// Kernels that overlap at a point.
struct OverlapFacts {
    double typical = 33.5; ///< a bound (lattices) or the mean of the field where it is largest
    double densest = 0.0;  ///< scattered kernels where they are densest: an estimate
    double alike = 0.0;    ///< scattered kernels of one size at one place
};

struct ViewFacts {
    FrameFacts frame;
    KernelCounts kernels;
    KernelShapes shapes;
    ScreenSizes screen_px;
    SlabFacts slabs;
    OverlapFacts overlap;
    std::map<const Field*, WeightFacts> weights;    ///< of weighted fields
    std::map<const Field*, double> lattice_peaks{}; ///< of lattices: largest W / C
    std::optional<ExtremeFacts> extremes{};         ///< modes mip and minimum of one lattice whose blocks bound rho
};

/// Linear in the number of scattered kernels where bounds do not tell.
ViewFacts view_facts(const Scene& scene, const Camera& camera, const Frame& frame, FieldSurveys& surveys);

} // namespace sheetsplat

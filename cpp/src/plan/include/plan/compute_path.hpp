// What the compute path of backend gl keeps in a work group's memory for a plan, and what it does not draw.
#pragma once

#include <string>

#include "base/capabilities.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Sheets of a tile in shared memory (glsl/tile.comp): for each group `planes` sums of four slabs a point, twice.
struct ComputeShape {
    int groups = 1;
    int planes = 1;       ///< values; weights; three slopes; three slopes of weights
    int border = 0;       ///< points on each side that gradients of their neighbours read
    bool divided = false; ///< some fields are divided by their own weights before they are added
    bool scattered = false;

    /// Bytes of shared memory for a tile of so many points along an edge.
    [[nodiscard]] int bytes(int edge) const;
    /// Points along an edge: 16 or 8, or 0 where neither fits.
    [[nodiscard]] int edge(const Capabilities& capabilities) const;
};
ComputeShape compute_shape(const DrawPlan& plan, const Scene& scene);

/// Turns of loops that the kernels of a call may take where a driver ends loops after `most`: shading takes others.
constexpr double turns_of_kernels(int most) { return 0.6 * most; }

/// Why the scattered kernels of a scene, if all of them are drawn, are too many for a driver that ends loops; "" where
/// they are not.
std::string why_too_many(const Scene& scene, const Capabilities& capabilities);

/// Why a plan cannot be drawn by compute programs; "" where it can.
std::string why_not_computed(const Scene& scene, const Capabilities& capabilities, const DrawPlan& plan);

} // namespace sheetsplat

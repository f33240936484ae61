// Bounds of rho for modes mip and minimum of a lattice, block by block, and how many slice points they leave. At a
// point, kernels of values at most v with weights w_i >= 0 sum up to sum f_i w_i <= v sum w_i. The sum of weights has
// an upper bound that holds everywhere, and a lower one inside the lattice (lattice_ripple); so the greatest value of
// the samples that reach into a block of points, times one of them, is a bound of rho there. For the least value
// likewise.
#pragma once

#include <cstddef>
#include <vector>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Blocks of points of a Cartesian lattice. Block b of an axis holds the points edge (b - 1) <= p < edge b of its index
/// coordinate.
struct ExtremeBlocks {
    static constexpr int edge = 4;
    /// Largest radius of kernels, in sample distances.
    static constexpr double largest_radius = 4.0;

    /// Whether a field's kernels are such as can be looked up at points, in float32 too.
    [[nodiscard]] static bool fit(const RegularField& field);
    /// Blocks that samples of an axis reach into, from the first one on.
    [[nodiscard]] static int count_along(std::size_t samples, double radius);
    struct Samples {
        std::size_t begin, end;
    };
    /// The samples of an axis that reach into block b.
    [[nodiscard]] static Samples reaching_into(int b, std::size_t samples, double radius);
    /// Whether all samples that could reach into block b are there.
    [[nodiscard]] static bool is_inside(int b, std::size_t samples, double radius);
    /// Whether all samples that could reach a point that shows are there, in each block: those of a volume with its
    /// mirrored samples, which ends within them.
    [[nodiscard]] static bool filled(const Scene& scene);
    /// The sum of max(0, exp(-k r^2) - exp(-k)) over all samples where W / C is `ripple`.
    [[nodiscard]] static double weights(const RegularField& field, double ripple);
};

/// What a few rays of a view meet; 0 where they meet no kernel.
struct ExtremeFacts {
    /// Of their slice points, the share at which bounds allow a larger (or smaller) rho than the ray's largest (or
    /// smallest): those that have to be looked up, at least.
    double left = 0.0;
    /// The share that is asked for bounds before nothing can be beyond what was found.
    double asked = 0.0;
    /// Of the samples of the blocks that they cross, the share that is not 0: those that sheets are summed from.
    double drawn = 0.0;
};
/// field: must fit; peak: largest W / C; sign: of rho, whose smallest number is looked for; filled: all samples that
/// could reach the points that show are there; kept: half spaces outside of which nothing shows.
ExtremeFacts extreme_facts(const RegularField& field, double peak, double sign, bool filled,
                           const std::vector<Clip::Plane>& kept, const Camera& camera, const Frame& frame);

} // namespace sheetsplat

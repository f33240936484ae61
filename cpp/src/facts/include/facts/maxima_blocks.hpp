// Bounds of rho for mode mip of a lattice, block by block, and how many slice points they leave. At a point, kernels of
// values at most v with weights w_i >= 0 sum up to sum f_i w_i <= v sum w_i, and the sum of weights has a bound that
// holds everywhere (lattice_ripple); so the greatest value of the samples that reach into a block of points, times that
// bound, is a bound of rho there.
#pragma once

#include <cstddef>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// Blocks of points of a Cartesian lattice. Block b of an axis holds the points edge (b - 1) <= p < edge b of its index
/// coordinate.
struct MaximaBlocks {
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
    /// A bound of the sum of max(0, exp(-k r^2) - exp(-k)) over all samples, at any point. peak: largest W / C.
    [[nodiscard]] static double weight_bound(const RegularField& field, double peak);
};

/// What a few rays of a view meet; 0 where they meet no kernel.
struct MaximaFacts {
    /// Of their slice points, the share at which bounds exceed the largest rho of the ray: those that mode mip has to
    /// look at, at least.
    double above = 0.0;
    /// Of the samples of the blocks that they cross, the share that is not 0: those that sheets are summed from.
    double drawn = 0.0;
};
/// field: must fit; peak: largest W / C.
MaximaFacts maxima_facts(const RegularField& field, double peak, const Camera& camera, const Frame& frame);

} // namespace sheetsplat

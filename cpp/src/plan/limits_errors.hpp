// The error model's numbers found by measurement, each with the test that holds it.
#pragma once

namespace sheetsplat::error_limits {

// ---- sums and gradients (tests: PlanOfCpu.ErrorsExpectedFollowThePrecision, GlFloat16.EndsAt)

/// Rounding of a sum that grows from 0 to its size: a third of the last step's in theory, seen at up to a half.
constexpr double rounded_sum = 0.6;
/// Noise of gradients over that of sums, in 16 bits, where noise exceeds weak gradients and turns normals, most where
/// quotients hardly change.
constexpr double gradient_noise_16 = 2.0;
constexpr double quotient_noise_16 = 10.0;

// ---- light of gradients, tile by tile (test: test_precision_of_tiles.py)

/// What light shows of the rounding of rho, over that of a number: of a sum of kernels, over the root of how many
/// overlap; of a place in a tile, in pixels; of rho as it is stored. As errors of 22,000 random pictures had it, with a
/// margin of 3 to 10; of ordinary volumes they are 5 to 50 times as large as the error.
struct LitRounding {
    double sum, place, number;
};
constexpr LitRounding of_quotients{0.25, 6.0, 0.2}, of_sums{0.2, 0.5, 0.4};
/// ... of kernels near their ends, of mode composite; of means over slabs: over the largest weight over w0.
/// Beyond the widest range float32 has no digits left, and float64 all that are needed.
constexpr double of_ends = 0.05, of_slabs = 0.05, widest_range = 1e4;
/// Semi-axis, pixels, below which a kernel's place counts no more.
constexpr double smallest_placed_px = 0.05;

// ---- light looked up in volumes (test: test_shadows_and_occlusion_within_the_stated_error)

/// Root mean square error over what a step takes away, of shadows and of ambient occlusion: seen were at most 0.004 and
/// 0.008. `hard` times as much where light follows what changes within a step or two: kernels, steps of the transfer
/// function, kernels that end with a jump or that a filter widens, radii of ambient occlusion. The renderer measures
/// the error of the pictures that it makes.
constexpr double shadow_error = 0.01, occlusion_error = 0.025;
constexpr double hard = 8.0;
/// Root mean square over a picture, of all that shadows do.
constexpr double most_of_whole = 0.3;

} // namespace sheetsplat::error_limits

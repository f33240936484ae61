// Numbers found by measurement that all backends share, each with the test that holds it, and limits of memory.
// "seen at 7e-4 (P99.9) at 30": where the quantity was 30, the error against backend reference was measured as 7e-4;
// P99.9: 99.9th percentile over the pixels of the largest channel difference.
#pragma once

#include <cstdint>

namespace sheetsplat {

/// Root mean square error that float32 pictures may have (conventions, section 9). Test: test_limits.py.
constexpr double float32_bound = 1e-4;
/// The same of scenes whose opacities and colours are at most so steep, over a slice and the transfer function's width,
/// and whose reference length is at most so many pixels. Test:
/// PlanOfCpu.BoundIsThatOfGentleScenesUpToTheirSteepnessAndMagnification.
constexpr double gentle_bound = 2e-5, gentle_steepness = 10.0, gentle_pixels = 100.0;
/// Estimated error over the bound: of a tile beside others that have less, and of pictures that are refused. Estimates
/// were measured at 3 to 1000 times the error. Test: test_precision_of_tiles.py.
constexpr double most_of_a_tile = 4.0, refused_beyond = 4.0;
/// Rounding of one number, with what sums of several add.
constexpr double float32_epsilon = 6e-8;
constexpr double float64_epsilon = 1.2e-16;

/// Below this share of the reference length a pixel or a slice spacing loses gradients in differences of float32 sums.
/// Test: GlChooses.FineGradientsBelow.
constexpr double fine_gradient_below = 1.0 / 8.0;
/// Slices of a composite in plain float32: compensated sums on gl, float64 on cpu (plan/limits.cpp). Test:
/// test_limits.py.
constexpr std::int64_t most_plain_slices = 1 << 14;
/// Kernels of weight 0 are drawn with this weight, so that points that they reach do not count as empty. Test:
/// EllipsoidView.ScalesValuesAndWeights.
constexpr double least_drawn_weight = 1e-30;
/// What sums are divided by: far above least_drawn_weight. Test: test_limits.py.
constexpr double least_divisor = 1e-22;
/// Kernels larger than this cannot be placed, pixels. Test: test_limits.py.
constexpr double largest_splat_px = 1e12;
/// The square of what a filter adds over a semi-axis below which a filter changes nothing within any bound. Test:
/// PlanOfEllipsoids.SaysWhatTheFilterIsFor.
constexpr double least_filtering = 1e-6;

/// Elements (of 4 bytes) of one light volume: 96 MiB. Of ambient occlusion, a mean over directions and distances that
/// hardly changes from one slice to the next: 16 MiB. Of all volumes together: 256 MiB, which a device must hold in one
/// buffer texture. Tests: PlanOfCpu.CountsTheMemoryOfLight, GlRefuses.Beyond/light_elements.
constexpr std::int64_t most_light_elements = 24 << 20;
constexpr std::int64_t most_occlusion_elements = 4 << 20;
constexpr std::int64_t most_light_elements_of_all = 64 << 20;

} // namespace sheetsplat

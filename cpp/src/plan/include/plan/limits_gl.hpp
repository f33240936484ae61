// What backend gl keeps its error bound for: numbers found by measurement, each with the test that holds it.
// "seen at 1e-3 at 300": where the quantity was 300, an error of 1e-3 against backend reference was measured; P99.9:
// 99.9th percentile over the pixels of the largest channel difference.
#pragma once

#include <cstddef>
#include <cstdint>

#include "plan/limits_common.hpp"

namespace sheetsplat::gl_limits {

// ---- numbers of things that programs and buffers hold (tests: GlRefuses.Beyond/<name>)

constexpr std::size_t most_lights = 64;
/// Each of them is looked up in eight places at every point.
constexpr std::size_t most_shadowing_lights = 16;
/// Transfer functions of a scene: each has a layer of the sheets, and arrays of the shading program an element.
constexpr std::size_t most_groups = 16;
/// Iso values times transfer functions: the shader keeps a bit for each.
constexpr std::size_t most_surfaces = 32;
/// Slices of a composite without the compensated sums that OpenGL 4.0 allows.
constexpr std::int64_t most_imprecise_slices = 1 << 17;
/// exp(-k r^2) - exp(-k) is known to 1e-7 / k of itself: smallest falloff k.
constexpr double smallest_falloff = 0.05;
/// Where only slices count that a kernel reaches, exp(-k) must be a number of float32, whose least is exp(-87): largest
/// falloff k.
constexpr double largest_counted_falloff = 80.0;

// ---- sheets of 16 bits (conventions, section 9; tests: GlFloat16.EndsAt/bound, GlFloat16.EndsAt/worst)

constexpr double float16_bound = 1.0 / 510.0; ///< root mean square error
constexpr double float16_worst = 1.0 / 85.0;  ///< where colours are steepest
/// w0 or weights: below, quotients would see the steps of small weights. Test: GlFloat16.EndsAt/scale.
constexpr double least_float16_scale = 0.1;
/// What sums in a sheet may come to. Tests: GlFloat16.EndsAt/sum, GlRefuses.Beyond/sum.
constexpr double largest_float16 = 6e4;
constexpr double largest_float32 = 1e36;

// ---- where ellipsoids are placed

/// Longest over shortest semi-axis from which on float64 places them: sections in float32 are known to 6e-8 of it; a
/// picture of 1:100,000 was seen 1e-3 off at its worst pixels. Test: GlChooses.PreciseFrom.
constexpr double least_precise_aspect = 4096.0;
/// ... and where there is no float64, beyond which they are refused. Test: GlRefuses.Beyond/plain_aspect.
constexpr double largest_plain_aspect = 32768.0;
/// Semi-axis, pixels, below which float64 places them: float32 resolves places to 6e-8 of a pixel. Test:
/// GlChooses.PreciseFrom.
constexpr double least_plain_px = 1e-2;
/// ... and where there is no float64, below which they are refused: at 1e-5 seen at 1e-2 (P99.9). Test:
/// GlRefuses.Beyond/plain_px.
constexpr double smallest_plain_px = 1e-4;
/// A record on the device serves all slices of a kernel, and resolves its sections to 6e-8 of the aspect. Test:
/// GlChooses.ResidentUpTo.
constexpr double largest_resident_aspect = 1024.0;
/// Kernels of one field whose sections stay on the device: 112 bytes each. Test: GlChooses.ResidentUpTo.
constexpr std::size_t most_resident_kernels = 1U << 20;

// ---- paper_slicing, whose textures hold float32 (tests: GlRefuses.Beyond/paper_<name>)

/// Bilinear mixing is off by up to falloff / 2 / cells squared: 4e-6. Test: PaperSlicing.DrawsTheReferencesPicture.
constexpr double largest_paper_falloff = 32.0;
constexpr int paper_cells_at_8 = 1024;
/// A quaternion in float32 turns a needle by 6e-8 of its length: at 1:1,000 seen at 1e-4 (P99.9).
constexpr double largest_paper_aspect = 1024.0;
/// Half a field's extent over its smallest semi-axis. Centres in float32 are known to 6e-8 of the former: seen were
/// 4e-8 times the quotient where they are moved in float64, 1.5e-7 where in float32.
constexpr double largest_paper_extent = 2048.0;
constexpr double largest_paper_extent_in_float32 = 512.0;
/// Semi-axis, pixels: seen right at 1e8, 1e-2 off at 1e9.
constexpr double largest_paper_px = 1e7;

// ---- kernels that are alike or crowded (tests: GlRefuses.Beyond/<name>)

/// Kernels of one size at one place without light: at 100,000 seen at 8e-4 (P99.9).
constexpr double most_alike_unlit = 1e5;

// ---- gradients of quotients (tests: GlRefuses.Beyond/<name>)

/// A limit of gentle scenes, which have the smaller error bound, and one of all others.
struct BySteepness {
    double gentle, steep;
};
/// Values over the window beyond which quotients that are lit are counted from the middle of the values: at 1.9
/// seen at 2.9e-5 (RMSE), at 31 at 4e-4 (P99.9), and then at 2e-5. Test: GlChooses.CountsFromTheMiddleFrom.
/// Surfaces are where values change.
constexpr double largest_plain_lit_ratio = 1.0, largest_plain_surface_ratio = 2.0;
/// Values over the largest difference from their middle beyond which they are counted from it too: what is lit where
/// they hardly change is rounding. Where all are one, from so many at a point on: 60 kernels at 1.1 windows seen
/// at 2.1e-5 (RMSE), 2e-5 allowed. Test: GlChooses.CountsFromTheMiddleWhereValuesAreAlike.
constexpr double plain_lit_change = 32.0, plain_lit_crowd = 4.0;
/// gradient_opacity, in windows per reference length, where quotients are divided: where the kernels that overlap have
/// one value their gradient is rounding alone. At 1e-4 seen at 7e-4 (P99.9).
constexpr double least_full_gradient = 2e-4;

// ---- sizes on the screen

/// Semi-axis of an ellipsoid in perspective, pixels at a distance of one unit of length: seen right at 1e15; at 1e21
/// squares leave float32. Test: GlRefuses.Beyond/deep_px.
constexpr double largest_deep_px = 1e15;
/// Radius, pixels, beyond which the square of a distance leaves float32 and a kernel is no product of two Gaussians.
/// Test: GlChooses.SeparableUpTo.
constexpr double largest_separable_px = 1e6;
/// weights_in_slabs times kernels at a point: of an average seen at 7e-5 (RMSE) at 7.7e5, 1e-4 at 6e6 and 3e-4 at 9e7;
/// of a lit picture at 7e-4 (P99.9) at 7e5, of a plain one at 2.4e-5 (RMSE) at 1.9e5. Gentle scenes are held to 2e-5,
/// others to 1e-4. Test: GlRefuses.Beyond/weights_in_slabs.
constexpr BySteepness widest_weights_in_slabs{1.5e5, 3e5};
/// A ray's way through a slab over its thickness, in scalar modes, where that is as many times the half-depth of a
/// kernel: of x-rays seen at 6e-5 (RMSE, of the largest value) at 97, 2.7e-4 at 584. Test: GlRefuses.Beyond/sideways.
constexpr double longest_in_slab = 100.0;
/// Share of a kernel's radius that its place on the screen may be off. Test: GlRefuses.Beyond/place.
constexpr double largest_place_error = 1e-3;

/// On a rasteriser in software elimination pays where pixels can become opaque within so many slices: measured 0.65 to
/// 0.76 of the time. Test: GlChooses.EliminationInSoftwareWhereOpaqueWithinSixteenSlices.
constexpr std::int64_t soon_opaque_slices = 16;

} // namespace sheetsplat::gl_limits

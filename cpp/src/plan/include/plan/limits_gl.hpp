// What backend gl keeps its error bound for: numbers found by measurement, each with the test that holds it.
// "seen at 1e-3 at 300": where the quantity was 300, an error of 1e-3 against backend reference was measured; P99.9:
// 99.9th percentile over the pixels of the largest channel difference.
#pragma once

#include <cstddef>
#include <cstdint>

#include "plan/limits_common.hpp"

namespace sheetsplat::gl_limits {

// ---- sheets of 16 bits (conventions, section 9; tests: GlFloat16.EndsAt/bound, GlFloat16.EndsAt/worst)

constexpr double float16_bound = 1.0 / 510.0; ///< root mean square error
constexpr double float16_worst = 1.0 / 85.0;  ///< where colours are steepest
/// w0 or weights: below, quotients would see the steps of small weights. Test: GlFloat16.EndsAt/scale.
constexpr double least_float16_scale = 0.1;
/// What sums in a sheet may come to. Test: GlFloat16.EndsAt/sum.
constexpr double largest_float16 = 6e4;

// ---- where ellipsoids are placed

/// Longest over shortest semi-axis from which on float64 places them: sections in float32 are known to 6e-8 of it; a
/// picture of 1:100,000 was seen 1e-3 off at its worst pixels. Test: GlChooses.PreciseFrom.
constexpr double least_precise_aspect = 4096.0;
/// Semi-axis, pixels, below which float64 places them: float32 resolves places to 6e-8 of a pixel. Test:
/// GlChooses.PreciseFrom.
constexpr double least_plain_px = 1e-2;
/// A record on the device serves all slices of a kernel, and resolves its sections to 6e-8 of the aspect. Test:
/// GlChooses.ResidentUpTo.
constexpr double largest_resident_aspect = 1024.0;
/// Kernels of one field whose sections stay on the device: 112 bytes each. Test: GlChooses.ResidentUpTo.
constexpr std::size_t most_resident_kernels = 1U << 20;

/// Cells of paper_slicing's texture of a Gaussian of falloff 8: bilinear mixing is off by up to falloff / 2 / cells
/// squared, 4e-6. Test: PaperSlicing.DrawsTheReferencesPicture.
constexpr int paper_cells_at_8 = 1024;

// ---- ways of drawing

/// Radius, pixels, beyond which the square of a distance leaves float32 and a kernel is no product of two Gaussians.
/// Test: GlChooses.SeparableUpTo.
constexpr double largest_separable_px = 1e6;
/// On a rasteriser in software elimination pays where pixels can become opaque within so many slices: measured 0.65 to
/// 0.76 of the time. Test: GlChooses.EliminationInSoftwareWhereOpaqueWithinSixteenSlices.
constexpr std::int64_t soon_opaque_slices = 16;

} // namespace sheetsplat::gl_limits

// What backend cpu keeps its error bound for: numbers found by measurement, each with the test that holds it.
// "seen at 1e-3 at 300": where the quantity was 300, an error of 1e-3 against backend reference was measured; P99.9:
// 99.9th percentile over the pixels of the largest channel difference.
#pragma once

#include "plan/limits_common.hpp"

namespace sheetsplat::cpu_limits {

// ---- beyond these a scene is drawn in float64 (tests: CpuFloat32.EndsAt/<name>)

/// Longest over shortest semi-axis of an ellipsoid: its sections are known to epsilon times that.
constexpr double largest_aspect = 512.0;
/// Semi-axis, pixels: places are counted from the corner of an image tile, and known to some 4e-6 pixels.
constexpr double least_px = 0.05;
/// Radius, pixels: float32 resolves squares of distances beside that of a pixel.
constexpr double largest_px = 1e6;
/// A ray's way through a slab over half a kernel: beyond, differences of erf lose what a thin kernel adds. At 370 seen
/// at 1.2e-4 (RMSE).
constexpr double thickest_slab = 100.0;
/// weights_in_slabs: seen were 4e-7 (P99.9) times it at 600.
constexpr double widest_weights_in_slabs = 300.0;
/// The profile exp(-k r^2) - exp(-k) is a difference of nearly equal numbers: at 0.07 and 0.2 seen at the bound.
constexpr double least_falloff = 0.5;
/// Falloff, where empty points are distinguished from those of 0: steeper kernels leave nothing in the sheets near
/// their ends.
constexpr double steepest_falloff = 20.0;
/// What sums may come to.
constexpr double largest_sum = 1e30;
/// Kernels of one size at one place, which round alike, times values over what is resolved.
constexpr double most_alike = 5000.0;
/// Slice spacing in perspective, world units, and its inverse: beyond, squares of lengths leave float32.
constexpr double largest_unit = 1e8;

// ---- beyond these a scene is refused (tests: CpuFloat64.EndsAt/<name>)

constexpr double largest_sum_float64 = 1e250;
/// The same share of the digits as in float32. At 4e16 and 2e18 seen at 3e-3 and 5e-4 (P99.9).
constexpr double widest_weights_in_slabs_float64 = widest_weights_in_slabs * (float32_epsilon / float64_epsilon);
constexpr double least_falloff_float64 = 1e-8;
constexpr double steepest_falloff_float64 = 600.0;

// ---- errors and memory

/// Gaussians of a column each follow from the one before: relative error, as seen. Test:
/// PlanOfCpu.ErrorsExpectedOfScatteredKernels.
constexpr double walked_noise = 2e-7;
/// Largest error of gradient_opacity that no picture shows. Test: CpuFloat32.EndsAt/gradient_opacity.
constexpr double least_seen = 1e-4;
/// Bytes of a kernel while it is drawn: a flag, and its place in the lists of one or two tiles. Test:
/// PlanOfCpu.CountsItsMemory.
constexpr std::uint64_t kernel_bytes = 24;

// ---- ways of drawing: speed alone (test: PlanOfCpu.ExtremesAreLookedUpWhereThatTakesLess)

/// Seconds, one thread. Modes mip and minimum by rays: a slice point whose bound is asked for, one that is looked up,
/// by samples that are read for it. By sheets: a kernel, a section of it, and a pixel of a section.
constexpr double asked_seconds = 1.5e-9;
constexpr double looked_up_seconds = 30e-9, looked_up_sample_seconds = 1.1e-9;
constexpr double kernel_seconds = 20e-9, section_seconds = 25e-9, splat_seconds = 0.4e-9;
/// Mode minimum by sheets: a slice point, which counts whether anything is drawn there or not.
constexpr double counted_seconds = 1e-9;
/// The same over that where sections lean or scale from slab to slab.
constexpr double general_price = 2.0;

} // namespace sheetsplat::cpu_limits

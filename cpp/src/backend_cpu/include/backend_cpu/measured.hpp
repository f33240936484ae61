// Constants of this backend that were found by measurement or by an error bound: one table, each entry with the test
// that holds it (tests/cpp/backend_cpu). Those of speed alone may be set to anything within their stated range:
// pictures stay the same within rounding, which the named test checks.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sheetsplat::backend_cpu {

// Tiles. CpuRenderer.TilesLeaveNoSeam

/// Edge of a tile: a channel of the ring takes 330 kB in float32; larger and smaller tiles were measured slower.
constexpr int usual_tile = 62;
/// Rows of kernels have room for so many pixels, with the tile's border and whole vectors (most_edge).
constexpr int largest_tile = 126;
constexpr int smallest_tile = 24;
/// Tiles, at least, as long as they are not smaller than smallest_tile: enough for a dozen threads. It must not depend
/// on how many threads there are, since rounding depends on the corner of a tile.
constexpr std::int64_t enough_tiles = 48;
/// Most pixels along an edge of a tile's sheets, rounded up to whole vectors.
constexpr int most_edge = 160;

// Slices. TileLoop.AsksAfterEverySliceAndEndsWhereItIsTold, Matrix.IsTheReferencesPictureWithoutAFloatingPointException

/// Slices that one drawing of a kernel covers; a kernel that meets more is drawn again.
constexpr int covered_slices = 8;
/// Slices whose kernels of a lattice are fed at once: what is hidden by then is not fed. More than covered_slices. Most
/// batches of a tile, so that few kernels over very many slices take little room.
constexpr int batch_slices = 16;
constexpr int most_batches = 512;
/// Neighbouring samples of a row that are fed or left out together.
constexpr std::uint32_t fed_together = 16;
/// Lattices that are summed with the kernels of another one, at most.
constexpr std::size_t most_beside = 3;
/// Sheets of the ring: what a drawing covers, and the four slices around an interval.
constexpr int ring_slots = 16;

// Questions whether to go on, some milliseconds apart. Faults.MeasuresHowSoonAPictureEnds

/// Kernels that are splatted between two questions; scattered kernels and samples of a lattice that are fed.
constexpr unsigned splats_between_polls = 512;
constexpr std::ptrdiff_t kernels_between_polls = 8192;
constexpr std::size_t samples_between_polls = 32768;
/// Seconds between two calls of the progress callback.
constexpr double between_calls = 0.004;

// Splat loops of ellipses. CpuRenderer.ThinEllipsoidsKeepTheirRows, CpuRenderer.ExtremeKernelsRaiseNothing

/// Rows that one Gaussian is walked along before it is computed anew: errors grow with the square, to some 50
/// roundings.
template <class T>
constexpr int walked_rows = sizeof(T) == 4 ? 20 : 48;
/// Powers of two that a vector may span before its least lanes vanish: less than the format has, by what a walk adds.
template <class T>
constexpr T deepest_span = sizeof(T) == 4 ? T(118) : T(1000);

// Splat loop of products. tests/python/backends/test_cpu_lattices.py

/// Kernels of one shape that reach farther from their centres are walked along columns.
constexpr int largest_lean_px = 20;
/// Powers of two that any factor of a kernel that leans may come to: the format has room for each, and for the product
/// of the first two, which the third makes one that is no more than 1.
template <class T>
constexpr T deepest_lean = sizeof(T) == 4 ? T(100) : T(900);

// Sums over slices. tests/python/backends/test_cpu_scalar_modes.py

/// Rows times slices of a kernel, at most: factors that are kept for sixteen kernels at once.
constexpr int most_factors = 256;
/// Kernels that are summed before their sum is added to the picture.
constexpr std::size_t summed_together = 8192;

// Slabs. tests/python/quality/test_slab_means.py; CpuRenderer.XRayOfOneKernelIsItsChordSum

/// From so many of the Gaussian's own lengths on means over slabs are differences of its integral; errors of means are
/// at most 2.2e-7 (float64 7e-16) over it. Below that they are a series whose terms are right to the rounding of T.
template <class T>
constexpr T shortest_slab = sizeof(T) == 4 ? T(0.25) : T(1e-3);

/// Up to so many slabs of a kernel are gone through on every ray: looking for its first and last one takes longer.
constexpr int few_slabs = 5;

/// Terms of the Gaussian's integral as a polynomial, and the largest falloff for which what is left out is below the
/// rounding of T.
template <class T>
constexpr int slab_terms = sizeof(T) == 4 ? 13 : 24;
constexpr double largest_integrated_falloff = 8.0;

// Transfer functions. ShadeSlab.is_the_formula_in_float32 (functions of few and of many stretches)

/// Stretches of a pre-integrated transfer function that are gone through one after the other; of more each ramp looks
/// for its first and last one.
constexpr std::size_t most_stretches_to_walk = 12;
/// Factor by which 1 - opacity changes over a stretch, at most: -ln(1 - opacity) then differs from a polynomial of
/// degree 2 by 2e-8, in float64 from one of degree 7 by 2e-16 (interpolation at Chebyshev's nodes: 2 / (n + 1) times
/// the power -(n + 1) of 322, and of 82). Fewer terms are loaded in less time than longer stretches save.
template <class T>
constexpr double most_change = sizeof(T) == 4 ? 1.0125 : 1.05;
/// Cells a stretch, so that a search rarely goes on beyond the first stretch of its cell; and cells in all.
constexpr std::size_t cells_per_stretch = 16;
constexpr std::size_t most_cells = 1U << 14;

// Sorting by tiles. Feed.SectionsAreTheKernels, Feed.BucketsDoNotDependOnThreads

/// Samples of a row that are sorted together where slabs reach through the eye.
constexpr std::uint32_t part_length = 32;
/// Kernels ahead that are fetched into the cache: those of one tile are anywhere in memory.
constexpr std::ptrdiff_t fetched_ahead = 12;

} // namespace sheetsplat::backend_cpu

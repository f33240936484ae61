// The loop over a tile in float64, once for each instruction set.
#include "simd/tile_task.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tile_double.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "hwy/highway.h"
#include "tile_loop-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::simd::HWY_NAMESPACE {

void run_tile_double(const LoopSetup<double>& setup, const TileShape& shape, TileScratch<double>& scratch,
                    const std::function<bool()>& between) {
    run_tile(setup, shape, scratch, between);
}

} // namespace sheetsplat::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace sheetsplat::simd {

TileFunction<double> tile_function_double(InstructionSet set) {
    switch (set) {
    case InstructionSet::baseline:
        return &HWY_STATIC_DISPATCH(run_tile_double);
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return &N_SSE4::run_tile_double;
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return &N_AVX2::run_tile_double;
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return &N_AVX3::run_tile_double;
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return &N_NEON::run_tile_double;
#endif
    default:
        return nullptr;
    }
}

} // namespace sheetsplat::simd

#endif

// The loop over a tile in float32, once for each instruction set.
#include "backend_cpu/tile_task.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tile_float.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "feed-inl.hpp"
#include "hwy/highway.h"
#include "tile_loop-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

const TileFunctions<float>* functions_float() {
    static constexpr TileFunctions<float> functions{&feed_rows<float>, &tile_rects, &feed_kernels<float>,
                                                    &run_tile<float>};
    return &functions;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace sheetsplat::backend_cpu {

const TileFunctions<float>* tile_functions_float(InstructionSet set) {
    switch (set) {
    case InstructionSet::baseline:
        return HWY_STATIC_DISPATCH(functions_float)();
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return N_SSE4::functions_float();
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return N_AVX2::functions_float();
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return N_AVX3::functions_float();
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return N_NEON::functions_float();
#endif
    default:
        return nullptr;
    }
}

} // namespace sheetsplat::backend_cpu

#endif

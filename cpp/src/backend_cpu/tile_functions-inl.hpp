// What is compiled for each number type and instruction set.

#include "feed_kernels-inl.hpp"
#include "feed_rows-inl.hpp"
#include "hwy/highway.h"
#include "ray_extremes-inl.hpp"
#include "tile_loop-inl.hpp"

#if defined(SHEETSPLAT_CPU_TILE_FUNCTIONS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_TILE_FUNCTIONS_INL
#undef SHEETSPLAT_CPU_TILE_FUNCTIONS_INL
#else
#define SHEETSPLAT_CPU_TILE_FUNCTIONS_INL
#endif

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
void shade_tile(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                TilePicture<T>& picture) {
    shade_slab(shading, shape, window, picture);
}

template <class T>
const TileFunctions<T>* functions() {
    static constexpr TileFunctions<T> all{&feed_rows<T>, &tile_rects,       &feed_kernels<T>,
                                          &run_tile<T>,  &find_extremes<T>, &shade_tile<T>};
    return &all;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_TILE_FUNCTIONS_INL

// Kernels of one shape that are measured together, in vectors that hold a kernel a lane.

#if defined(SHEETSPLAT_CPU_KERNEL_BATCH_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_KERNEL_BATCH_INL
#undef SHEETSPLAT_CPU_KERNEL_BATCH_INL
#else
#define SHEETSPLAT_CPU_KERNEL_BATCH_INL
#endif

#include <algorithm>
#include <cstdint>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Kernels that are handed to a splat loop at once, at most.
constexpr int batch_room = 16;

/// Where kernels of a batch are, the pixels that they can touch, and the last slices that they meet: a lane each.
template <class T>
struct KernelBatch {
    static constexpr int room = batch_room;
    using D = hn::CappedTag<T, room>;
    using V = hn::Vec<D>;
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));

    HWY_ALIGN T a1[room], a2[room], s[room], first[room];
    HWY_ALIGN T x0[room], y0[room], x1[room], y1[room], last_slice[room];

    /// Of 1 to `room` kernels; in lanes that are left the last one again.
    HWY_INLINE void gather(const Section<T>* sections, const std::uint32_t* numbers, int number) {
        for (int kernel = 0; kernel < room; ++kernel) {
            const Section<T>& section = sections[numbers[std::min(kernel, number - 1)]];
            a1[kernel] = section.a1;
            a2[kernel] = section.a2;
            s[kernel] = section.s;
            first[kernel] = static_cast<T>(section.first);
        }
    }
    /// Of lanes from `kernel` on. half_depth: in slices; most: the view's last slice.
    HWY_INLINE void set_last(int kernel, T half_depth, std::int32_t most) {
        const D d;
        const V one = hn::Set(d, T(1));
        const V further = hn::Floor(hn::Mul(hn::Add(one, hn::Load(d, s + kernel)), hn::Set(d, half_depth)));
        const V met = hn::Add(hn::Load(d, first + kernel), hn::Max(further, hn::Neg(one)));
        hn::Store(hn::Min(met, hn::Set(d, static_cast<T>(most))), d, last_slice + kernel);
    }
    /// Of pixels that are less than half_x, half_y from a kernel's centre, those in a rectangle.
    HWY_INLINE void set_box(int kernel, V x, V y, V half_x, V half_y, const Rect& seen) {
        const D d;
        const auto clamped = [&](V at, int low, int high) {
            return hn::Min(hn::Max(at, hn::Set(d, static_cast<T>(low))), hn::Set(d, static_cast<T>(high)));
        };
        const V one = hn::Set(d, T(1));
        hn::Store(clamped(hn::Ceil(hn::Sub(x, half_x)), seen.x0, seen.x1), d, x0 + kernel);
        hn::Store(clamped(hn::Ceil(hn::Sub(y, half_y)), seen.y0, seen.y1), d, y0 + kernel);
        hn::Store(clamped(hn::Add(hn::Floor(hn::Add(x, half_x)), one), seen.x0, seen.x1), d, x1 + kernel);
        hn::Store(clamped(hn::Add(hn::Floor(hn::Add(y, half_y)), one), seen.y0, seen.y1), d, y1 + kernel);
    }

    [[nodiscard]] HWY_INLINE std::int32_t last(int kernel) const {
        return static_cast<std::int32_t>(last_slice[kernel]);
    }
    [[nodiscard]] HWY_INLINE Rect box(int kernel) const {
        return {static_cast<int>(x0[kernel]), static_cast<int>(y0[kernel]), static_cast<int>(x1[kernel]),
                static_cast<int>(y1[kernel])};
    }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_KERNEL_BATCH_INL

// What shadows and ambient occlusion leave of the light, from the volumes of view/light_volume.

#if defined(SHEETSPLAT_CPU_LIGHT_VOLUME_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#undef SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#else
#define SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// The numbers values[first] and values[first + step] of each lane. pairs: step is 1.
template <bool pairs, class D, class I, class V = hn::Vec<D>>
HWY_INLINE void load_two(D d, const float* values, I first, std::int32_t step, V& one, V& other) {
    using T = hn::TFromD<D>;
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    if constexpr (pairs && sizeof(T) == 4) {
        // Half as many loads, each of two numbers.
        const hn::Rebind<std::int32_t, D> di;
        const hn::RepartitionToWide<decltype(di)> wide;
        const auto at = [&](auto half) SHEETSPLAT_CPU_INLINE {
            const auto bytes = hn::ShiftLeft<2>(hn::PromoteTo(wide, half));
            return hn::BitCast(d, hn::GatherOffset(wide, reinterpret_cast<const std::int64_t*>(values), bytes));
        };
        const V lower = at(hn::LowerHalf(first)), upper = at(hn::UpperHalf(hn::Half<decltype(di)>(), first));
        one = hn::ConcatEven(d, upper, lower);
        other = hn::ConcatOdd(d, upper, lower);
        return;
    }
#endif
    const hn::Rebind<float, D> df;
    const auto in_format = [&](auto found) {
        if constexpr (sizeof(T) == 4) {
            return found;
        } else {
            return hn::PromoteTo(d, found);
        }
    };
    one = in_format(hn::GatherIndex(df, values, first));
    other = in_format(hn::GatherIndex(df, values + step, first));
}

/// Numbers of a light volume at places (u, v, w), counted in its elements; outside, those of the nearest face.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V look_up(D d, const LightVolume& volume, const V (&place)[3]) {
    const hn::Rebind<std::int32_t, D> di;
    const V zero = hn::Zero(d);
    V part[3];
    decltype(hn::Zero(di)) first = hn::Zero(di);
    std::int32_t steps[3];
    std::int32_t size = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const int count = volume.counts[axis];
        const V inside = hn::Min(hn::Max(place[axis], zero), hn::Set(d, static_cast<T>(count - 1)));
        const V whole = hn::Min(hn::Floor(inside), hn::Set(d, static_cast<T>(std::max(count - 2, 0))));
        part[axis] = hn::Sub(inside, whole);
        decltype(first) number;
        if constexpr (sizeof(T) == 4) {
            number = hn::ConvertTo(di, whole);
        } else {
            number = hn::DemoteTo(di, whole);
        }
        first = hn::Add(first, hn::Mul(number, hn::Set(di, size)));
        steps[axis] = count > 1 ? size : 0;
        size *= count;
    }
    const float* values = volume.values.data();
    const auto mix = [&](V from, V to, V share) { return hn::MulAdd(share, hn::Sub(to, from), from); };
    const auto along_rows = [&](std::int32_t offset) SHEETSPLAT_CPU_INLINE {
        V from, to;
        if (HWY_LIKELY(steps[0] == 1)) {
            load_two<true>(d, values + offset, first, 1, from, to);
        } else {
            load_two<false>(d, values + offset, first, steps[0], from, to);
        }
        return mix(from, to, part[0]);
    };
    const V near = mix(along_rows(0), along_rows(steps[1]), part[1]);
    const V far = mix(along_rows(steps[2]), along_rows(steps[1] + steps[2]), part[1]);
    return mix(near, far, part[2]);
}

/// Where a row's pixels are in a light volume: start + x per_column + share (per_share + x per_both).
template <class T>
struct VolumeRow {
    const LightVolume* volume = nullptr;
    T start[3], per_column[3], per_share[3], per_both[3];

    VolumeRow(const VolumeLookup& lookup, bool perspective, int column, int row, double depth, double spacing)
        : volume(lookup.volume) {
        for (int axis = 0; axis < 3; ++axis) {
            const double across = column * lookup.by_column[axis] + row * lookup.by_row[axis];
            const double deeper = lookup.by_depth[axis];
            const double from =
                lookup.constant[axis] + (perspective ? depth * (across + deeper) : across + depth * deeper);
            start[axis] = static_cast<T>(from);
            per_column[axis] = static_cast<T>((perspective ? depth : 1.0) * lookup.by_column[axis]);
            per_share[axis] = static_cast<T>(spacing * (perspective ? across + deeper : deeper));
            per_both[axis] = static_cast<T>(perspective ? spacing * lookup.by_column[axis] : 0.0);
        }
    }

    template <class D, class V = hn::Vec<D>>
    HWY_INLINE V place(D d, int axis, V column, V share) const {
        const V along = hn::MulAdd(column, hn::Set(d, per_both[axis]), hn::Set(d, per_share[axis]));
        return hn::MulAdd(share, along, hn::MulAdd(column, hn::Set(d, per_column[axis]), hn::Set(d, start[axis])));
    }
    template <class D, class V = hn::Vec<D>>
    HWY_INLINE V at(D d, V column, V share) const {
        const V places[3] = {place(d, 0, column, share), place(d, 1, column, share), place(d, 2, column, share)};
        return look_up(d, *volume, places);
    }
};

/// What shadows and ambient occlusion leave of the light at one vector of pixels.
template <class D>
struct Dimming {
    static constexpr bool anything = true;
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;
    D d;
    const std::vector<VolumeRow<T>>& rows; ///< a light each, or none
    const VolumeRow<T>* open;              ///< null: no occlusion
    T strength;
    V column, share;

    [[nodiscard]] HWY_INLINE V light(std::size_t number) const {
        return number < rows.size() && rows[number].volume != nullptr ? rows[number].at(d, column, share)
                                                                      : hn::Set(d, T(1));
    }
    [[nodiscard]] HWY_INLINE V ambient() const {
        const V one = hn::Set(d, T(1));
        return open == nullptr ? one
                               : hn::NegMulAdd(hn::Set(d, strength), hn::Sub(one, open->at(d, column, share)), one);
    }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_LIGHT_VOLUME_INL

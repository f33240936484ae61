// What shadows and ambient occlusion leave of the light, from the volumes of light/light_volume.

#if defined(SHEETSPLAT_CPU_LIGHT_VOLUME_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#undef SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#else
#define SHEETSPLAT_CPU_LIGHT_VOLUME_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// The numbers values[first] and values[first + step] of each lane, for four places of `values`. Where step is 1 each
/// two are loaded as one: gathers of the instruction sets take as long as all of their loads.
template <class D, class I, class V = hn::Vec<D>>
HWY_INLINE void load_pairs(D d, const float* const (&values)[4], I first, std::int32_t step, V (&one)[4],
                           V (&other)[4]) {
    using T = hn::TFromD<D>;
    constexpr std::size_t lanes = hn::MaxLanes(D());
    if constexpr (sizeof(T) == 4) {
        if (HWY_LIKELY(step == 1)) {
            HWY_ALIGN std::int32_t at[lanes];
            HWY_ALIGN float pairs[4][2 * lanes];
            hn::Store(first, hn::Rebind<std::int32_t, D>(), at);
            for (std::size_t lane = 0; lane < lanes; ++lane) {
                for (int corner = 0; corner < 4; ++corner) {
                    std::memcpy(&pairs[corner][2 * lane], values[corner] + at[lane], 2 * sizeof(float));
                }
            }
            for (int corner = 0; corner < 4; ++corner) {
                hn::LoadInterleaved2(d, pairs[corner], one[corner], other[corner]);
            }
            return;
        }
    }
    const hn::Rebind<float, D> df;
    const auto in_format = [&](auto found) {
        if constexpr (sizeof(T) == 4) {
            return found;
        } else {
            return hn::PromoteTo(d, found);
        }
    };
    for (int corner = 0; corner < 4; ++corner) {
        one[corner] = in_format(hn::GatherIndex(df, values[corner], first));
        other[corner] = in_format(hn::GatherIndex(df, values[corner] + step, first));
    }
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
    const float* const corners[4] = {values, values + steps[1], values + steps[2], values + steps[1] + steps[2]};
    V from[4], to[4];
    load_pairs(d, corners, first, steps[0], from, to);
    const auto mix = [&](V a, V b, V share) { return hn::MulAdd(share, hn::Sub(b, a), a); };
    const auto along_row = [&](int corner) { return mix(from[corner], to[corner], part[0]); };
    const V near = mix(along_row(0), along_row(1), part[1]);
    const V far = mix(along_row(2), along_row(3), part[1]);
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

// Passes over the pixels of a slab that make no colours: scalars, coverage, and the absorption of light. Source:
// conventions, sections 4 and 7.

#if defined(SHEETSPLAT_CPU_SLAB_PASSES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SLAB_PASSES_INL
#undef SHEETSPLAT_CPU_SLAB_PASSES_INL
#else
#define SHEETSPLAT_CPU_SLAB_PASSES_INL
#endif

#include <cstddef>

#include "hwy/highway.h"
#include "slab-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Calls visit(x, y, columns that clipping keeps) for vectors of the slice, row by row.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_kept(const Slab<T>& slab, const Visit& visit) {
    constexpr int lanes = Slab<T>::lanes;
    const Rect& rect = slab.window.rect;
    for (int y = rect.y0; y < rect.y1; ++y) {
        const Columns kept = cuts ? slab.columns_of_group(y, 0, slab.columns_kept(y, 0)) : Columns{rect.x0, rect.x1};
        for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
            visit(x, y, kept);
        }
    }
}

/// Calls visit(x, y, numbers) for a sheet, row by row; cuts: 0 where the point is cut off.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_in_sheet(const Slab<T>& slab, const T* sheet, const Visit& visit) {
    const typename Slab<T>::D d;
    for_each_kept<cuts>(slab, [&](int x, int y, const Columns& kept) {
        auto value = hn::LoadU(d, sheet + slab.in_sheet(y) + x);
        if constexpr (cuts) {
            value = hn::IfThenElseZero(slab.owned(d, slab.kept(d, hn::Eq(value, value), 0, y, x, kept), y, x), value);
        }
        visit(x, y, value);
    });
}

/// Adds a sheet, times a step along the pixel's ray, to a plane: x-ray and coverage. weights: those below 0 are of
/// points that are empty all the same (divide_group()).
template <bool cuts, class T>
HWY_NOINLINE void add_sheet(const Slab<T>& slab, const T* sheet, T step, T* plane, bool weights) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    for_each_in_sheet<cuts>(slab, sheet, [&](int x, int y, V value) {
        if (hn::AllTrue(d, hn::Eq(value, hn::Zero(d)))) {
            return;
        }
        V length = hn::Set(d, step);
        if (slab.shading.perspective) {
            length = hn::Mul(length, slab.ray(d, x, y).slant);
        }
        T* to = plane + slab.in_plane(y) + x;
        hn::StoreU(hn::MulAdd(weights ? hn::Abs(value) : value, length, hn::LoadU(d, to)), d, to);
    });
}

/// Calls visit(x, y, lanes) for vectors with points of the slice that some kernel reaches and that are kept.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_reached(const Slab<T>& slab, const Visit& visit) {
    const typename Slab<T>::D d;
    for_each_kept<cuts>(slab, [&](int x, int y, const Columns& kept) {
        auto reached = slab.weighs(d, hn::LoadU(d, slab.sheets.weight[0] + slab.in_sheet(y) + x));
        if constexpr (cuts) {
            reached = slab.owned(d, slab.kept(d, reached, 0, y, x, kept), y, x);
        }
        if (!hn::AllFalse(d, reached)) {
            visit(x, y, reached);
        }
    });
}

/// The largest or the smallest scalar.
template <bool cuts, class T>
HWY_NOINLINE void find_extreme(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const V step = hn::Set(d, slab.shading.scalar_step);
    for_each_reached<cuts>(slab, [&](int x, int y, M reached) {
        T* to = slab.picture.scalar + slab.in_plane(y) + x;
        const V found = hn::LoadU(d, to);
        const V value = hn::Mul(slab.rho(d, 1, y, x), step);
        hn::StoreU(hn::IfThenElse(reached, extreme(slab.shading.mode, found, value), found), d, to);
    });
}

/// Adds scalars up, and counts them.
template <bool cuts, class T>
HWY_NOINLINE void add_counted(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const V step = hn::Set(d, slab.shading.scalar_step), one = hn::Set(d, T(1));
    for_each_reached<cuts>(slab, [&](int x, int y, M reached) {
        const std::ptrdiff_t at = slab.in_plane(y) + x;
        const auto add = [&](T* plane, V value) {
            hn::StoreU(hn::Add(hn::LoadU(d, plane + at), hn::IfThenElseZero(reached, value)), d, plane + at);
        };
        add(slab.picture.scalar, hn::Mul(slab.rho(d, 1, y, x), step));
        add(slab.picture.counted, one);
    });
}

/// Adds the slice's -ln(1 - alpha), at most densest_slice, to plane alpha. kind: Slices.
template <class Kind, class T>
HWY_NOINLINE void absorb(const Slab<T>& slab, const Kind& kind) {
    constexpr int lanes = Slab<T>::lanes;
    constexpr T densest_slice = T(20);
    const typename Slab<T>::D d;
    for (int y = slab.window.rect.y0; y < slab.window.rect.y1; ++y) {
        const Columns kept = slab.columns_of_group(y, 0, slab.columns_kept(y, 0));
        for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
            const auto seen = slab.owned(d, kind.may(x, y, kept, kept), y, x);
            if (hn::AllFalse(d, seen)) {
                continue;
            }
            Color<typename Slab<T>::D> color;
            typename Slab<T>::V weight;
            const auto whole = hn::IfThenElseZero(seen, hn::Set(d, T(1)));
            const auto lost = kind.template absorption<false>(x, y, seen, whole, color, weight);
            T* sum = slab.picture.alpha + slab.in_plane(y) + x;
            hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::Min(lost, hn::Set(d, densest_slice))), d, sum);
        }
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SLAB_PASSES_INL

// A row of pixels on its way through the effects beyond the papers, and how it begins: which points may show, and what
// their colours and opacities are.

#if defined(SHEETSPLAT_CPU_EFFECT_ROW_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_EFFECT_ROW_INL
#undef SHEETSPLAT_CPU_EFFECT_ROW_INL
#else
#define SHEETSPLAT_CPU_EFFECT_ROW_INL
#endif

#include <algorithm>
#include <cstddef>

#include "hwy/highway.h"
#include "slab-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Pixels of one row. Each effect is a loop of its own over the row, so that an effect that is off costs nothing and
/// there are as many loops as effects, not as combinations of them.
template <class T>
struct EffectRow {
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    static constexpr int room = 128;
    int y = 0;
    int begin = 0, past = 0; ///< columns; number x - begin belongs to column x
    HWY_ALIGN T seen[room];  ///< 1: may show; else 0
    HWY_ALIGN T share[room]; ///< where the point that is shaded lies, in slice distances behind slice n
    HWY_ALIGN T faded[room]; ///< what gradient opacity leaves
    HWY_ALIGN T against_x[room];
    HWY_ALIGN T against_y[room];
    HWY_ALIGN T against_z[room];
    HWY_ALIGN T alpha[room]; ///< of the slices as they are composited
    HWY_ALIGN T red[room];
    HWY_ALIGN T green[room];
    HWY_ALIGN T blue[room];
    HWY_ALIGN T weight[room]; ///< what the colours count among those of other groups
    HWY_ALIGN T doubt[room];  ///< of what is lit: how much an error of the gradient of 1 changes colours (Slab::doubt)

    [[nodiscard]] HWY_INLINE Normal<D> against(D d, int number) const {
        return {hn::Load(d, against_x + number), hn::Load(d, against_y + number), hn::Load(d, against_z + number)};
    }
    [[nodiscard]] HWY_INLINE Color<D> color(D d, int number) const {
        return {hn::Load(d, red + number), hn::Load(d, green + number), hn::Load(d, blue + number)};
    }
    HWY_INLINE void set_color(D d, int number, const Color<D>& color) {
        hn::Store(color.red, d, red + number);
        hn::Store(color.green, d, green + number);
        hn::Store(color.blue, d, blue + number);
    }
    HWY_INLINE void fill(T* numbers, T value) const {
        const D d;
        for (int number = 0; number < past - begin; number += Slab<T>::lanes) {
            hn::Store(hn::Set(d, value), d, numbers + number);
        }
    }

    /// Calls visit(column, number in the row, lanes) for vectors with any number above 0 in `wanted`, one of the
    /// arrays.
    template <class Visit>
    HWY_INLINE void for_each(const T* wanted, const Visit& visit) const {
        const D d;
        for (int x = begin; x < past; x += Slab<T>::lanes) {
            const auto there = hn::Gt(hn::Load(d, wanted + (x - begin)), hn::Zero(d));
            if (!hn::AllFalse(d, there)) {
                visit(x, x - begin, there);
            }
        }
    }

    /// Fills `seen` with what of may(x) still changes, and `share` there with share_of(x, lanes). Returns whether any
    /// point may show.
    template <class May, class ShareOf>
    HWY_INLINE bool see_by(const Slab<T>& slab, const May& may, const ShareOf& share_of) {
        const D d;
        bool any = false;
        for (int x = begin; x < past; x += Slab<T>::lanes) {
            auto lanes = may(x);
            if (!hn::AllFalse(d, lanes)) {
                lanes = slab.unfinished(d, lanes, y, x);
                hn::Store(share_of(x, lanes), d, share + (x - begin));
                any = any || !hn::AllFalse(d, lanes);
            }
            hn::Store(hn::IfThenElseZero(lanes, hn::Set(d, T(1))), d, seen + (x - begin));
        }
        return any;
    }

    /// Fills `alpha` and the colours of what is seen by looks(x, number, lanes, colour), which returns opacities; of
    /// the rest they are 0. Returns whether any is above 0.
    template <class Looks>
    HWY_INLINE bool classify_by(const Looks& looks) {
        const D d;
        fill(alpha, T(0));
        bool any = false;
        for_each(seen, [&](int x, int number, auto lanes) {
            Color<D> found{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
            const V opacity = looks(x, number, lanes, found);
            hn::Store(opacity, d, alpha + number);
            set_color(d, number, found);
            any = any || !hn::AllFalse(d, hn::Gt(opacity, hn::Zero(d)));
        });
        return any;
    }
};

/// Finds the points of a row that may show. kind: a class of classified-inl.hpp.
template <class Kind, class T>
HWY_NOINLINE bool see(const Slab<T>& slab, const Kind& kind, EffectRow<T>& row, const Columns& here,
                      const Columns& after) {
    const int first = std::min(here.x0, after.x0), past = std::max(here.x1, after.x1);
    return row.see_by(
        slab,
        [&](int x) {
            return x + Slab<T>::lanes > first && x < past ? kind.may(x, row.y, here, after)
                                                          : hn::FirstN(typename Slab<T>::D(), 0);
        },
        [&](int x, auto lanes) { return kind.share(x, row.y, lanes); });
}

/// Colours and opacities of what is seen; mixed: of one of several groups, absorptions and weights in place of
/// opacities. Returns whether anything shows.
template <bool perspective, bool mixed, class Kind, class T>
HWY_NOINLINE bool classify(const Kind& kind, EffectRow<T>& row) {
    const typename Slab<T>::D d;
    return row.classify_by([&](int x, int number, auto seen, auto& color) {
        const auto faded = hn::IfThenElseZero(seen, hn::Load(d, row.faded + number));
        if constexpr (mixed) {
            typename Slab<T>::V weight;
            const auto absorption = kind.template absorption<perspective>(x, row.y, seen, faded, color, weight);
            hn::Store(weight, d, row.weight + number);
            return absorption;
        } else {
            return kind.template opacity<perspective>(x, row.y, seen, faded, color);
        }
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_EFFECT_ROW_INL

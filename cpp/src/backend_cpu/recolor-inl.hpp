// Colours by other fields: what a group shows takes those of the groups that supply them. Source: conventions,
// section 4.

#if defined(SHEETSPLAT_CPU_RECOLOR_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_RECOLOR_INL
#undef SHEETSPLAT_CPU_RECOLOR_INL
#else
#define SHEETSPLAT_CPU_RECOLOR_INL
#endif

#include <cstddef>
#include <optional>
#include <type_traits>
#include <vector>

#include "classified-inl.hpp"
#include "effect_row-inl.hpp"
#include "hwy/highway.h"
#include "point_sums-inl.hpp"
#include "slab-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// A field that colours of another one are taken from, in a row.
template <class T>
struct SuppliedColor {
    using D = typename Slab<T>::D;
    Slab<T> slab;
    Columns kept_here, kept_after;
    std::optional<PointSums<T>> here, after; ///< where it has no sheets

    /// Of slice n + ahead; where it has no sheets, in some lanes.
    HWY_INLINE hn::Vec<D> rho(D d, int ahead, int y, int x, hn::Mask<D> lanes) const {
        const std::optional<PointSums<T>>& sums = ahead == 0 ? here : after;
        return sums ? sums->at(x, lanes) : slab.rho(d, 1 + ahead, y, x);
    }
};

/// Puts the colours of other fields in the place of a group's own, of what has an opacity, where any is not empty.
/// ramps: of the interval behind the slice; else at `share` slice distances behind it.
template <bool ramps, bool between, class T>
HWY_NOINLINE void recolor(const Slab<T>& of, EffectRow<T>& row) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const V zero = hn::Zero(d);
    const GroupRange range = of.group.colors;
    if (range.first == range.last) {
        return;
    }
    const auto columns = [&](const Slab<T>& slab, int ahead) {
        return slab.columns_of_group(row.y, ahead, {row.begin, row.past});
    };
    std::vector<SuppliedColor<T>> supplied;
    for (std::size_t number = range.first; number < range.last; ++number) {
        const Slab<T> slab(of.shading, of.shape, of.window, of.picture, number);
        supplied.push_back({slab, columns(slab, 0), columns(slab, 1), {}, {}});
        if (slab.group.summed_at_points) {
            supplied.back().here.emplace(slab, row.y, 0);
            supplied.back().after.emplace(slab, row.y, 1);
        }
    }
    row.for_each(row.alpha, [&](int x, int place, auto visible) {
        Color<typename Slab<T>::D> sum{zero, zero, zero};
        auto any = hn::FirstN(d, 0);
        for (const SuppliedColor<T>& of_field : supplied) {
            const Slab<T>& slab = of_field.slab;
            auto there = slab.within(d, visible, x, of_field.kept_here);
            V rho = of_field.rho(d, 0, row.y, x, there), next = zero;
            there = slab.reached(d, there, 0, row.y, x, rho);
            Color<typename Slab<T>::D> own;
            if constexpr (between) {
                const auto behind = slab.within(d, visible, x, of_field.kept_after);
                next = of_field.rho(d, 1, row.y, x, behind);
                there = hn::Or(there, slab.reached(d, behind, 1, row.y, x, next));
            }
            if constexpr (ramps) {
                ramp_absorption(d, slab.group.ramps, rho, next, there, own);
            } else {
                if constexpr (between) {
                    const V share = hn::Load(d, row.share + place);
                    rho = hn::MulAdd(share, hn::Sub(next, rho), rho);
                }
                with_table(slab, [&](const auto& table) {
                    typename std::decay_t<decltype(table)>::Place found;
                    table.opacity(d, rho, found);
                    own = table.color(d, found);
                });
            }
            sum = {hn::Add(sum.red, hn::IfThenElseZero(there, own.red)),
                   hn::Add(sum.green, hn::IfThenElseZero(there, own.green)),
                   hn::Add(sum.blue, hn::IfThenElseZero(there, own.blue))};
            any = hn::Or(any, there);
        }
        const Color<typename Slab<T>::D> before = row.color(d, place);
        row.set_color(d, place,
                      {hn::IfThenElse(any, sum.red, before.red), hn::IfThenElse(any, sum.green, before.green),
                       hn::IfThenElse(any, sum.blue, before.blue)});
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RECOLOR_INL

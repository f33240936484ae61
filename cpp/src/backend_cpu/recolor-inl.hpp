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

/// The fields whose colours take the place of a group's own, in a slab.
template <class T>
class SuppliedColors {
  public:
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;

    /// of: the group's slab.
    explicit SuppliedColors(const Slab<T>& of) {
        const GroupRange range = of.group.colors;
        fields_.reserve(range.last - range.first);
        for (std::size_t number = range.first; number < range.last; ++number) {
            fields_.push_back({Slab<T>(of.shading, of.shape, of.window, of.picture, number), {}, {}, {}, {}});
        }
    }

    [[nodiscard]] bool none() const { return fields_.empty(); }

    /// To be called before colours of a row are asked for, as often as one likes. between: slice n + 1 is looked at.
    template <bool between>
    HWY_INLINE void begin_row(int y, const Columns& columns) {
        if (y != y_) {
            find_row<between>(y, columns);
        }
    }

    /// In lanes `visible` from column x on: the fields' colours where any is not empty, else `own`. ramps: of the
    /// interval behind the slice; else at `share` slice distances behind it.
    template <bool ramps, bool between>
    HWY_NOINLINE Color<D> in_place_of(int x, M visible, V share, const Color<D>& own) const {
        const D d;
        const V zero = hn::Zero(d);
        Color<D> sum{zero, zero, zero};
        auto any = hn::FirstN(d, 0);
        for (const Field& field : fields_) {
            const Slab<T>& slab = field.slab;
            auto there = slab.within(d, visible, x, field.kept_here);
            V rho = field.rho(d, 0, y_, x, there), next = zero;
            there = slab.reached(d, there, 0, y_, x, rho);
            Color<D> color;
            if constexpr (between) {
                const auto behind = slab.within(d, visible, x, field.kept_after);
                next = field.rho(d, 1, y_, x, behind);
                there = hn::Or(there, slab.reached(d, behind, 1, y_, x, next));
            }
            if constexpr (ramps) {
                ramp_absorption(d, slab.group.ramps, rho, next, there, color);
            } else {
                if constexpr (between) {
                    rho = hn::MulAdd(share, hn::Sub(next, rho), rho);
                }
                with_table(slab, [&](const auto& table) {
                    typename std::decay_t<decltype(table)>::Place found;
                    table.opacity(d, rho, found);
                    color = table.color(d, found);
                });
            }
            sum = {hn::Add(sum.red, hn::IfThenElseZero(there, color.red)),
                   hn::Add(sum.green, hn::IfThenElseZero(there, color.green)),
                   hn::Add(sum.blue, hn::IfThenElseZero(there, color.blue))};
            any = hn::Or(any, there);
        }
        return {hn::IfThenElse(any, sum.red, own.red), hn::IfThenElse(any, sum.green, own.green),
                hn::IfThenElse(any, sum.blue, own.blue)};
    }

  private:
    struct Field {
        Slab<T> slab;
        Columns kept_here, kept_after;
        std::optional<PointSums<T>> here, after; ///< where it has no sheets

        /// Of slice n + ahead; where it has no sheets, in some lanes.
        HWY_INLINE V rho(D d, int ahead, int y, int x, M lanes) const {
            const std::optional<PointSums<T>>& sums = ahead == 0 ? here : after;
            return sums ? sums->at(x, lanes) : slab.rho(d, 1 + ahead, y, x);
        }
    };

    template <bool between>
    HWY_NOINLINE void find_row(int y, const Columns& columns) {
        y_ = y;
        for (Field& field : fields_) {
            field.kept_here = field.slab.columns_of_group(y, 0, columns);
            if constexpr (between) {
                field.kept_after = field.slab.columns_of_group(y, 1, columns);
            }
            if (field.slab.group.summed_at_points) {
                field.here.emplace(field.slab, y, 0);
                if constexpr (between) {
                    field.after.emplace(field.slab, y, 1);
                }
            }
        }
    }

    std::vector<Field> fields_;
    int y_ = -1;
};

/// Gives what has an opacity in a row the colours of other fields, if it takes any.
template <bool ramps, bool between, class T>
HWY_NOINLINE void recolor(SuppliedColors<T>& colors, EffectRow<T>& row) {
    if (colors.none()) {
        return;
    }
    const typename Slab<T>::D d;
    colors.template begin_row<between>(row.y, {row.begin, row.past});
    row.for_each(row.alpha, [&](int x, int number, auto visible) {
        row.set_color(d, number,
                      colors.template in_place_of<ramps, between>(x, visible, hn::Load(d, row.share + number),
                                                                  row.color(d, number)));
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RECOLOR_INL

// Several groups of fields, each classified and lit by itself, and several or translucent isosurfaces. Rows of pixels
// go through the loops of effects-inl.hpp once a group. Source: conventions, sections 4 and 7.

#if defined(SHEETSPLAT_CPU_GROUPS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_GROUPS_INL
#undef SHEETSPLAT_CPU_GROUPS_INL
#else
#define SHEETSPLAT_CPU_GROUPS_INL
#endif

#include <algorithm>
#include <cstddef>
#include <vector>

#include "effect_row-inl.hpp"
#include "effects-inl.hpp"
#include "hwy/highway.h"
#include "light-inl.hpp"
#include "math-inl.hpp"
#include "slab-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
struct Type {
    using type = T;
};

/// Calls pass(Type<...>()) with the table that the group's transfer function fits.
template <class T, class Pass>
HWY_INLINE void by_table(const GroupShading<T>& group, const Pass& pass) {
    using D = typename Slab<T>::D;
    if (group.transfer.stretches <= Slab<T>::lanes) {
        pass(Type<TableInLanes<D>>());
    } else {
        pass(Type<TableInMemory<D>>());
    }
}

/// A group's part of a slab.
template <class T>
struct GroupSlab {
    Slab<T> slab;
    GradientScale<T> scale;

    GroupSlab(const Slab<T>& first, std::size_t number)
        : slab(first.shading, first.shape, first.window, first.picture, number),
          scale(slab.shading, slab.group, slab.window.n) {}
};

template <class T>
std::vector<GroupSlab<T>> group_slabs(const Slab<T>& first) {
    std::vector<GroupSlab<T>> slabs;
    slabs.reserve(first.shading.groups.size());
    for (std::size_t number = 0; number < first.shading.groups.size(); ++number) {
        slabs.emplace_back(first, number);
    }
    return slabs;
}

// Slices and intervals ------------------------------------------------------------------------------------------------

/// What the groups have taken of a row's light so far, and the mean of their colours by their weights.
template <class T>
struct Mixture {
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    HWY_ALIGN T absorbed[EffectRow<T>::room];
    HWY_ALIGN T weight[EffectRow<T>::room];
    HWY_ALIGN T red[EffectRow<T>::room];
    HWY_ALIGN T green[EffectRow<T>::room];
    HWY_ALIGN T blue[EffectRow<T>::room];

    HWY_INLINE void clear(const EffectRow<T>& row) {
        for (T* numbers : {absorbed, weight, red, green, blue}) {
            row.fill(numbers, T(0));
        }
    }

    HWY_NOINLINE void add(const EffectRow<T>& row) {
        const D d;
        row.for_each(row.alpha, [&](int, int number, auto there) {
            const V own = hn::IfThenElseZero(there, hn::Load(d, row.weight + number));
            const V sum = hn::Add(hn::Load(d, weight + number), own);
            // The first group's colours come out as they are.
            const V share = hn::Div(own, hn::IfThenElse(hn::Gt(sum, hn::Zero(d)), sum, hn::Set(d, T(1))));
            const Color<D> color = row.color(d, number);
            const auto add_to = [&](T* mean, V channel) {
                const V so_far = hn::Load(d, mean + number);
                hn::Store(hn::MulAdd(share, hn::Sub(channel, so_far), so_far), d, mean + number);
            };
            add_to(red, color.red);
            add_to(green, color.green);
            add_to(blue, color.blue);
            hn::Store(sum, d, weight + number);
            hn::Store(hn::Add(hn::Load(d, absorbed + number), hn::Load(d, row.alpha + number)), d, absorbed + number);
        });
    }

    /// Puts opacities and colours into the row.
    HWY_NOINLINE void finish(EffectRow<T>& row) const {
        const D d;
        row.fill(row.alpha, T(0));
        row.for_each(absorbed, [&](int, int number, auto) {
            hn::Store(opacity_of_absorption(d, hn::Load(d, absorbed + number)), d, row.alpha + number);
            row.set_color(d, number,
                          {hn::Load(d, red + number), hn::Load(d, green + number), hn::Load(d, blue + number)});
        });
    }
};

/// Of Kind Slices or Intervals: what a group takes of a row, and its colours. Returns whether there is anything.
template <class Kind, bool perspective, class T>
HWY_INLINE bool take(const GroupSlab<T>& of, EffectRow<T>& row, const Columns& here, const Columns& after) {
    if (!Kind::see(of.slab, row, here, after)) {
        return false;
    }
    find_gradients_of<perspective, Kind::between>(of.slab, row, of.scale);
    fade(of.slab, row, of.scale);
    if (!Kind::template absorb<perspective>(of.slab, row)) {
        return false;
    }
    shade_colors<perspective>(of.slab, row, of.scale);
    return true;
}

/// Mode composite.
template <bool perspective, class T>
HWY_NOINLINE void mix_groups(const Slab<T>& first) {
    const std::vector<GroupSlab<T>> slabs = group_slabs(first);
    EffectRow<T> row;
    Mixture<T> mixture;
    const auto draw = [&](const Columns& here, const Columns& after) {
        mixture.clear(row);
        bool any = false;
        for (const GroupSlab<T>& of : slabs) {
            bool some = false;
            if (first.shading.preintegration) {
                some = take<Intervals, perspective>(of, row, here, after);
            } else {
                by_table(of.slab.group, [&](auto table) {
                    some = take<Slices<typename decltype(table)::type>, perspective>(of, row, here, after);
                });
            }
            if (some) {
                mixture.add(row);
                any = true;
            }
        }
        if (any) {
            mixture.finish(row);
            put<false>(first, row);
        }
    };
    if (first.shading.preintegration) {
        for_each_row<true>(first, row, draw);
    } else {
        for_each_row<false>(first, row, draw);
    }
}

// Isosurfaces ---------------------------------------------------------------------------------------------------------

/// Where a row's rays cross surfaces between two slices. Surfaces are numbered group by group, as they are listed.
template <class T>
struct CrossedRow {
    HWY_ALIGN T open[EffectRow<T>::room];   ///< 1: there may be a crossing behind `share`; else 0
    HWY_ALIGN T share[EffectRow<T>::room];  ///< the last crossing, in slice distances behind slice n
    HWY_ALIGN T number[EffectRow<T>::room]; ///< its surface; -1: none
};

/// Finds the rays that cross anything.
template <class T>
HWY_NOINLINE bool see_crossings(const std::vector<GroupSlab<T>>& slabs, EffectRow<T>& row, CrossedRow<T>& crossed,
                                const Columns& here, const Columns& after) {
    const typename Slab<T>::D d;
    const Slab<T>& first = slabs.front().slab;
    const bool any = row.see_if(first, T(0), [&](int x) {
        auto some = hn::FirstN(d, 0);
        for (const GroupSlab<T>& of : slabs) {
            const auto front = of.slab.rho(d, 1, row.y, x), back = of.slab.rho(d, 2, row.y, x);
            for (const ShadingSurface<T>& surface : of.slab.group.surfaces) {
                const auto iso = hn::Set(d, surface.value);
                some = hn::Or(some, hn::Xor(hn::Lt(front, iso), hn::Lt(back, iso)));
            }
        }
        return first.kept(d, first.kept(d, some, 0, row.y, x, here), 1, row.y, x, after);
    });
    if (any) {
        std::copy(row.seen, row.seen + EffectRow<T>::room, crossed.open);
        row.fill(crossed.share, T(-1));
        row.fill(crossed.number, T(-1));
    }
    return any;
}

/// Goes on to the next crossing of each ray that still changes: the nearest behind the last one, of those at one place
/// the first in the order of numbers. Rays without one are closed. Returns whether there is any.
template <class T>
HWY_NOINLINE bool find_next(const std::vector<GroupSlab<T>>& slabs, const EffectRow<T>& row, CrossedRow<T>& crossed) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const Slab<T>& first = slabs.front().slab;
    const V stop = hn::Set(d, first.shading.stop), one = hn::Set(d, T(1));
    bool any = false;
    row.for_each(crossed.open, [&](int x, int number, auto open) {
        open = hn::And(open, hn::Lt(hn::LoadU(d, first.picture.alpha + first.in_plane(row.y) + x), stop));
        const V last_share = hn::Load(d, crossed.share + number), last_number = hn::Load(d, crossed.number + number);
        V share = hn::Set(d, T(2)), next = hn::Set(d, T(-1));
        T count = T(0);
        for (const GroupSlab<T>& of : slabs) {
            const V front = of.slab.rho(d, 1, row.y, x), back = of.slab.rho(d, 2, row.y, x);
            for (const ShadingSurface<T>& surface : of.slab.group.surfaces) {
                const V iso = hn::Set(d, surface.value), own = hn::Set(d, count);
                const auto found = hn::And(open, hn::Xor(hn::Lt(front, iso), hn::Lt(back, iso)));
                const V place = crossing(d, front, back, iso, found);
                const auto later =
                    hn::Or(hn::Gt(place, last_share), hn::And(hn::Eq(place, last_share), hn::Gt(own, last_number)));
                const auto nearer = hn::And(hn::And(found, later), hn::Lt(place, share));
                share = hn::IfThenElse(nearer, place, share);
                next = hn::IfThenElse(nearer, own, next);
                count += T(1);
            }
        }
        const auto found = hn::Ge(next, hn::Zero(d));
        hn::Store(hn::IfThenElseZero(found, one), d, crossed.open + number);
        hn::Store(hn::IfThenElse(found, share, one), d, crossed.share + number);
        hn::Store(next, d, crossed.number + number);
        any = any || !hn::AllFalse(d, found);
    });
    return any;
}

/// The rays whose next crossing is one of a group's surfaces, the first of which has a number.
template <class T>
HWY_NOINLINE bool see_group(const GroupSlab<T>& of, T first_number, const CrossedRow<T>& crossed, EffectRow<T>& row) {
    const typename Slab<T>::D d;
    const auto low = hn::Set(d, first_number);
    const auto high = hn::Set(d, first_number + static_cast<T>(of.slab.group.surfaces.size()));
    bool any = false;
    row.fill(row.seen, T(0));
    row.for_each(crossed.open, [&](int, int number, auto open) {
        const auto own = hn::Load(d, crossed.number + number);
        const auto seen = hn::And(open, hn::And(hn::Ge(own, low), hn::Lt(own, high)));
        hn::Store(hn::IfThenElseZero(seen, hn::Set(d, T(1))), d, row.seen + number);
        hn::Store(hn::Load(d, crossed.share + number), d, row.share + number);
        any = any || !hn::AllFalse(d, seen);
    });
    return any;
}

/// Mode isosurface, surfaces from front to back.
template <bool perspective, class T>
HWY_NOINLINE void find_all_crossings(const Slab<T>& first) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const std::vector<GroupSlab<T>> slabs = group_slabs(first);
    EffectRow<T> row;
    CrossedRow<T> crossed;
    const auto put_crossings = [&](const GroupSlab<T>& of, T first_number) {
        if (!see_group(of, first_number, crossed, row)) {
            return;
        }
        find_gradients_of<perspective, true>(of.slab, row, of.scale);
        row.classify_by([&](int, int number, auto seen, auto& color) {
            const V which = hn::Load(d, crossed.number + number);
            V opacity = hn::Zero(d);
            T own = first_number;
            for (const ShadingSurface<T>& surface : of.slab.group.surfaces) {
                const auto this_one = hn::And(seen, hn::Eq(which, hn::Set(d, own)));
                opacity = hn::IfThenElse(this_one, hn::Set(d, surface.opacity), opacity);
                const auto colors = iso_color(d, surface);
                color = {hn::IfThenElse(this_one, colors.red, color.red),
                         hn::IfThenElse(this_one, colors.green, color.green),
                         hn::IfThenElse(this_one, colors.blue, color.blue)};
                own += T(1);
            }
            return opacity;
        });
        shade_colors<perspective>(of.slab, row, of.scale);
        row.for_each(row.alpha, [&](int x, int number, auto visible) {
            const std::ptrdiff_t at = first.in_plane(row.y) + x;
            first.put_behind(d, at, row.y, visible, hn::LoadU(d, first.picture.alpha + at),
                             hn::Load(d, row.alpha + number), row.color(d, number),
                             [&] { return first.depth_behind(d, hn::Load(d, row.share + number)); });
        });
    };
    for_each_row<true>(first, row, [&](const Columns& here, const Columns& after) {
        if (!see_crossings(slabs, row, crossed, here, after)) {
            return;
        }
        while (find_next(slabs, row, crossed)) {
            T first_number = T(0);
            for (const GroupSlab<T>& of : slabs) {
                put_crossings(of, first_number);
                first_number += static_cast<T>(of.slab.group.surfaces.size());
            }
        }
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_GROUPS_INL

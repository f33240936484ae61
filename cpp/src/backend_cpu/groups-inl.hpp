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
#include <type_traits>
#include <vector>

#include "classified-inl.hpp"
#include "effect_row-inl.hpp"
#include "effects-inl.hpp"
#include "hwy/highway.h"
#include "light-inl.hpp"
#include "math-inl.hpp"
#include "slab-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// A group's part of a slab.
template <class T>
struct GroupSlab {
    Slab<T> slab;
    GradientScale<T> scale;
    SuppliedColors<T> colors;

    GroupSlab(const Slab<T>& first, std::size_t number)
        : slab(first.shading, first.shape, first.window, first.picture, number),
          scale(slab.shading, slab.group, slab.window.n), colors(slab) {}
};

/// Those of all groups; shown: of groups that may show something.
template <class T>
std::vector<GroupSlab<T>> group_slabs(const Slab<T>& first, bool shown) {
    std::vector<GroupSlab<T>> slabs;
    const std::vector<GroupShading<T>>& groups = first.shading.groups;
    slabs.reserve(groups.size());
    for (std::size_t number = 0; number < groups.size(); ++number) {
        const SheetWindow<T>& sheets = number == 0 ? first.window : first.window.later_groups[number - 1];
        if (!shown || (groups[number].classified && !sheets.shown.cut_to(first.window.rect).empty())) {
            slabs.emplace_back(first, number);
        }
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
    HWY_ALIGN T doubt[EffectRow<T>::room];

    HWY_INLINE void clear(const EffectRow<T>& row) {
        for (T* numbers : {absorbed, weight, red, green, blue, doubt}) {
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
            add_to(doubt, hn::Load(d, row.doubt + number));
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
            hn::Store(hn::Load(d, doubt + number), d, row.doubt + number);
        });
    }
};

/// What a group takes of a row, and its colours. Returns whether there is anything.
template <bool perspective, class Kind, class T>
HWY_INLINE bool take(GroupSlab<T>& of, const Kind& kind, EffectRow<T>& row, const Columns& here, const Columns& after) {
    const Columns shown = of.slab.columns_shown(row.y, {row.begin, row.past});
    if (shown.x0 >= shown.x1) {
        return false;
    }
    const Columns own = of.slab.columns_of_group(row.y, 0, of.slab.columns_shown(row.y, here));
    const Columns own_after =
        Kind::between ? of.slab.columns_of_group(row.y, 1, of.slab.columns_shown(row.y, after)) : own;
    if (!see(of.slab, kind, row, own, own_after)) {
        return false;
    }
    find_gradients_of<perspective, Kind::between>(of.slab, row, of.scale);
    fade(of.slab, row, of.scale);
    if (!classify<perspective, true>(kind, row)) {
        return false;
    }
    recolor<Kind::between, Kind::between>(of.colors, row);
    shade_colors<perspective>(of.slab, row, of.scale);
    return true;
}

/// Mode composite.
template <bool perspective, class T>
HWY_NOINLINE void mix_groups(const Slab<T>& first) {
    std::vector<GroupSlab<T>> slabs = group_slabs(first, true);
    EffectRow<T> row;
    Mixture<T> mixture;
    const auto draw = [&](const Columns& here, const Columns& after) {
        mixture.clear(row);
        bool any = false;
        for (GroupSlab<T>& of : slabs) {
            bool some = false;
            const auto take_of = [&](const auto& kind) { some = take<perspective>(of, kind, row, here, after); };
            if (first.shading.preintegration) {
                take_of(Intervals<T>(of.slab));
            } else {
                with_slices(of.slab, take_of);
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

// Scalars -------------------------------------------------------------------------------------------------------------

/// Scalar modes of groups that end in different places: at each point the groups add up inside whose end it lies.
template <class T>
HWY_NOINLINE void sum_groups(const Slab<T>& first) {
    using V = typename Slab<T>::V;
    constexpr int lanes = Slab<T>::lanes;
    const typename Slab<T>::D d;
    const std::vector<GroupSlab<T>> slabs = group_slabs(first, false);
    const Shading<T>& shading = first.shading;
    const V step = hn::Set(d, shading.scalar_step), one = hn::Set(d, T(1)), zero = hn::Zero(d);
    std::vector<Columns> own(slabs.size());
    for (int y = first.window.rect.y0; y < first.window.rect.y1; ++y) {
        const Columns kept = first.columns_kept(y, 0);
        for (std::size_t group = 0; group < slabs.size(); ++group) {
            own[group] = slabs[group].slab.columns_of_group(y, 0, kept);
        }
        for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
            const auto visible = first.owned(d, first.kept(d, hn::Eq(zero, zero), 0, y, x, kept), y, x);
            auto counts = hn::FirstN(d, 0);
            V sum = zero;
            for (std::size_t group = 0; group < slabs.size(); ++group) {
                const Slab<T>& slab = slabs[group].slab;
                const auto inside = slab.within(d, visible, x, own[group]);
                const V value = hn::Add(slab.rho(d, 1, y, x), hn::Set(d, slab.group.base));
                sum = hn::Add(sum, hn::IfThenElseZero(inside, value));
                const auto reached = !counts_weighted_slices(shading.mode)
                                         ? inside
                                         : slab.weighs(d, hn::LoadU(d, slab.sheets.weight[0] + slab.in_sheet(y) + x));
                counts = hn::Or(counts, hn::And(inside, reached));
            }
            if (hn::AllFalse(d, counts)) {
                continue;
            }
            const std::ptrdiff_t at = first.in_plane(y) + x;
            const V value = hn::Mul(sum, step), so_far = hn::LoadU(d, first.picture.scalar + at);
            V result = so_far;
            if (is_extreme(shading.mode)) {
                result = extreme(shading.mode, so_far, value);
            } else {
                const bool slanted = traits_of(shading.mode).integrates && shading.perspective;
                result = hn::MulAdd(value, slanted ? first.ray(d, x, y).slant : one, so_far);
            }
            hn::StoreU(hn::IfThenElse(counts, result, so_far), d, first.picture.scalar + at);
            if (traits_of(shading.mode).mean) {
                T* count = first.picture.counted + at;
                hn::StoreU(hn::Add(hn::LoadU(d, count), hn::IfThenElseZero(counts, one)), d, count);
            }
        }
    }
}

// Isosurfaces ---------------------------------------------------------------------------------------------------------

/// Of a row's rays, a group's crossings between two slices that are left: the nearest is that of the surface `rank`,
/// the others follow in the order of ranks, upwards where rho rises.
template <class T>
struct GroupCrossings {
    HWY_ALIGN T rank[EffectRow<T>::room];
    HWY_ALIGN T left[EffectRow<T>::room]; ///< how many
};

/// Where a row's rays cross surfaces between two slices.
template <class T>
struct CrossedRow {
    HWY_ALIGN T open[EffectRow<T>::room];  ///< 1: there may be a crossing behind `share`; else 0
    HWY_ALIGN T share[EffectRow<T>::room]; ///< the crossing that is drawn, in slice distances behind slice n
    HWY_ALIGN T group[EffectRow<T>::room]; ///< and its group; -1: none
    HWY_ALIGN T rank[EffectRow<T>::room];  ///< and its surface in the group's table
    std::vector<GroupCrossings<T>> groups;
};

/// Elements of an array at whole numbers.
template <class D, class V = hn::Vec<D>, class T = hn::TFromD<D>>
HWY_INLINE V elements(D d, const std::vector<T>& from, V places) {
    return hn::GatherIndex(d, from.data(), hn::ConvertTo(hn::RebindToSigned<D>(), places));
}

/// How many of the surfaces' values are at most a value.
template <class D, class V = hn::Vec<D>, class T = hn::TFromD<D>>
HWY_INLINE V values_up_to(D d, const SurfaceTable<T>& table, V value) {
    const V one = hn::Set(d, T(1)), half = hn::Set(d, T(0.5)), first = hn::Set(d, table.first);
    const V most = hn::Set(d, static_cast<T>(table.size() - 1));
    const V inside = hn::Min(hn::Max(value, first), hn::Set(d, table.last));
    const V cell =
        hn::Min(hn::Floor(hn::Mul(hn::Sub(inside, first), hn::Set(d, table.per_unit))), hn::Set(d, table.last_cell));
    V low = elements(d, table.before, cell), high = elements(d, table.before, hn::Add(cell, one));
    for (int halving = 0; halving < table.halvings; ++halving) {
        const V middle = hn::Min(hn::Floor(hn::Mul(hn::Add(low, high), half)), most);
        const auto open = hn::Lt(low, high);
        const auto up_to = hn::Le(elements(d, table.values, middle), value);
        low = hn::IfThenElse(hn::And(open, up_to), hn::Add(middle, one), low);
        high = hn::IfThenElse(hn::AndNot(up_to, open), middle, high);
    }
    return low;
}

/// Finds the rays that cross anything.
template <class T>
HWY_NOINLINE bool see_crossings(const Slab<T>& first, const std::vector<GroupSlab<T>>& slabs, EffectRow<T>& row,
                                CrossedRow<T>& crossed, const Columns& here, const Columns& after) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const auto may = [&](int x) {
        auto some = hn::FirstN(d, 0);
        for (std::size_t number = 0; number < slabs.size(); ++number) {
            const Slab<T>& slab = slabs[number].slab;
            const Columns shown = slab.columns_shown(row.y, {row.begin, row.past});
            if (x + Slab<T>::lanes <= shown.x0 || x >= shown.x1) {
                hn::Store(zero, d, crossed.groups[number].left + (x - row.begin));
                continue;
            }
            const SurfaceTable<T>& table = slab.group.surface_table;
            const V front = slab.rho(d, 1, row.y, x), back = slab.rho(d, 2, row.y, x);
            const V least = hn::Min(front, back), greatest = hn::Max(front, back);
            // Crossed are values above the least and at most the greatest of both ends.
            V rank = zero, left = zero;
            const auto crossed_here =
                hn::And(hn::Ge(greatest, hn::Set(d, table.first)), hn::Lt(least, hn::Set(d, table.last)));
            if (table.size() > 0 && !hn::AllFalse(d, crossed_here)) {
                const V from = values_up_to(d, table, least), to = values_up_to(d, table, greatest);
                left = hn::Sub(to, from);
                rank =
                    hn::IfThenElseZero(hn::Gt(left, zero), hn::IfThenElse(hn::Lt(front, back), from, hn::Sub(to, one)));
                if (!slab.group.kept.empty()) {
                    auto inside = slab.within(d, hn::Gt(left, zero), x, slab.columns_of_group(row.y, 0, here));
                    inside = slab.within(d, inside, x, slab.columns_of_group(row.y, 1, after));
                    left = hn::IfThenElseZero(inside, left);
                }
                some = hn::Or(some, hn::Gt(left, zero));
            }
            hn::Store(rank, d, crossed.groups[number].rank + (x - row.begin));
            hn::Store(left, d, crossed.groups[number].left + (x - row.begin));
        }
        return first.kept(d, first.kept(d, some, 0, row.y, x, here), 1, row.y, x, after);
    };
    const bool any = row.see_by(first, may, [&](int, auto) { return zero; });
    if (any) {
        std::copy(row.seen, row.seen + EffectRow<T>::room, crossed.open);
    }
    return any;
}

/// Goes on to the next crossing of each ray that still changes: the nearest that is left, of those at one place that of
/// the first group. Rays without one are closed. Returns whether there is any.
template <class T>
HWY_NOINLINE bool find_next(const Slab<T>& first, const std::vector<GroupSlab<T>>& slabs, const EffectRow<T>& row,
                            CrossedRow<T>& crossed) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const V stop = hn::Set(d, first.shading.stop), one = hn::Set(d, T(1)), zero = hn::Zero(d);
    bool any = false;
    row.for_each(crossed.open, [&](int x, int number, auto open) {
        open = hn::And(open, hn::Lt(hn::LoadU(d, first.picture.alpha + first.in_plane(row.y) + x), stop));
        V share = hn::Set(d, T(2)), group = hn::Set(d, T(-1)), rank = zero;
        for (std::size_t of = 0; of < slabs.size(); ++of) {
            const GroupCrossings<T>& own = crossed.groups[of];
            const auto found = hn::And(open, hn::Gt(hn::Load(d, own.left + number), zero));
            if (hn::AllFalse(d, found)) {
                continue;
            }
            const Slab<T>& slab = slabs[of].slab;
            const V own_rank = hn::Load(d, own.rank + number);
            const V place = crossing(d, slab.rho(d, 1, row.y, x), slab.rho(d, 2, row.y, x),
                                     elements(d, slab.group.surface_table.values, own_rank), found);
            const auto nearer = hn::And(found, hn::Lt(place, share));
            share = hn::IfThenElse(nearer, place, share);
            group = hn::IfThenElse(nearer, hn::Set(d, static_cast<T>(of)), group);
            rank = hn::IfThenElse(nearer, own_rank, rank);
        }
        for (std::size_t of = 0; of < slabs.size(); ++of) {
            GroupCrossings<T>& own = crossed.groups[of];
            const Slab<T>& slab = slabs[of].slab;
            const auto taken = hn::Eq(group, hn::Set(d, static_cast<T>(of)));
            if (hn::AllFalse(d, taken)) {
                continue;
            }
            const auto rises = hn::Lt(slab.rho(d, 1, row.y, x), slab.rho(d, 2, row.y, x));
            const V left = hn::Sub(hn::Load(d, own.left + number), hn::IfThenElseZero(taken, one));
            const V step = hn::IfThenElse(rises, one, hn::Neg(one));
            // (Of the last one there is no next rank.)
            const auto on = hn::And(taken, hn::Gt(left, zero));
            hn::Store(left, d, own.left + number);
            hn::Store(hn::Add(hn::Load(d, own.rank + number), hn::IfThenElseZero(on, step)), d, own.rank + number);
        }
        const auto found = hn::Ge(group, zero);
        hn::Store(hn::IfThenElseZero(found, one), d, crossed.open + number);
        hn::Store(hn::IfThenElse(found, share, one), d, crossed.share + number);
        hn::Store(group, d, crossed.group + number);
        hn::Store(rank, d, crossed.rank + number);
        any = any || !hn::AllFalse(d, found);
    });
    return any;
}

/// The rays whose crossing is one of a group's surfaces.
template <class T>
HWY_NOINLINE bool see_group(std::size_t group, const CrossedRow<T>& crossed, EffectRow<T>& row) {
    const typename Slab<T>::D d;
    const auto own = hn::Set(d, static_cast<T>(group));
    bool any = false;
    row.fill(row.seen, T(0));
    row.for_each(crossed.open, [&](int, int number, auto open) {
        const auto seen = hn::And(open, hn::Eq(hn::Load(d, crossed.group + number), own));
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
    std::vector<GroupSlab<T>> slabs = group_slabs(first, true);
    EffectRow<T> row;
    CrossedRow<T> crossed;
    crossed.groups.resize(slabs.size());
    const auto put_crossings = [&](std::size_t group) {
        if (!see_group(group, crossed, row)) {
            return;
        }
        GroupSlab<T>& of = slabs[group];
        const SurfaceTable<T>& table = of.slab.group.surface_table;
        find_gradients_of<perspective, true>(of.slab, row, of.scale);
        row.classify_by([&](int x, int number, auto seen, auto& color) {
            const V rank = hn::IfThenElseZero(seen, hn::Load(d, crossed.rank + number));
            color = {elements(d, table.red, rank), elements(d, table.green, rank), elements(d, table.blue, rank)};
            const auto rises = hn::Lt(of.slab.rho(d, 1, row.y, x), of.slab.rho(d, 2, row.y, x));
            const V opacity = hn::IfThenElse(rises, elements(d, table.rising_opacities, rank),
                                             elements(d, table.falling_opacities, rank));
            return hn::IfThenElseZero(seen, opacity);
        });
        recolor<false, true>(of.colors, row);
        shade_colors<perspective>(of.slab, row, of.scale);
        row.for_each(row.alpha, [&](int x, int number, auto visible) {
            const std::ptrdiff_t at = first.in_plane(row.y) + x;
            const V share = first.put_behind(d, at, row.y, visible, hn::LoadU(d, first.picture.alpha + at),
                                             hn::Load(d, row.alpha + number), row.color(d, number),
                                             [&] { return first.depth_behind(d, hn::Load(d, row.share + number)); });
            if (first.shading.lit) {
                first.doubt(d, share, hn::Load(d, row.doubt + number));
            }
        });
    };
    for_each_row<true>(first, row, [&](const Columns& here, const Columns& after) {
        if (!see_crossings(first, slabs, row, crossed, here, after)) {
            return;
        }
        while (find_next(first, slabs, row, crossed)) {
            for (std::size_t group = 0; group < slabs.size(); ++group) {
                put_crossings(group);
            }
        }
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_GROUPS_INL

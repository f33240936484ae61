// Classifies, shades and composites one finished slice, or the interval behind it, over the pixels of a tile.
// Source: IMAGE FORMATION sections 4 to 7; [EKE01] for intervals.

#if defined(SHEETSPLAT_SIMD_SHADE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_SIMD_SHADE_INL
#undef SHEETSPLAT_SIMD_SHADE_INL
#else
#define SHEETSPLAT_SIMD_SHADE_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
struct Color {
    hn::Vec<D> red, green, blue;
};

// Transfer function ------------------------------------------------------------------------------------------------

/// Looks of one vector of values by a table that lies in the lanes of registers: as many stretches as lanes at most.
template <class D>
class TableInLanes {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;
    using DI = hn::RebindToSigned<D>;
    using TI = hn::TFromD<DI>;

  public:
    explicit TableInLanes(const TransferTable<T>& table) : table_(table) {}

    struct Place {
        decltype(hn::IndicesFromVec(D(), hn::Zero(DI()))) stretch;
        V beyond; ///< how far beyond the stretch's start
    };

    /// Opacity per reference length.
    HWY_INLINE V opacity(D d, V rho, Place& place) const {
        const DI di;
        auto stretch = hn::Zero(di);
        for (int n = 1; n < table_.stretches; ++n) {
            const auto there = hn::Ge(rho, hn::Set(d, table_.lanes[0][n]));
            stretch = hn::IfThenElse(hn::RebindMask(di, there), hn::Set(di, static_cast<TI>(n)), stretch);
        }
        place.stretch = hn::IndicesFromVec(d, stretch);
        place.beyond = hn::Max(hn::Sub(rho, look_up(d, 0, place)), hn::Zero(d));
        return hn::Min(hn::Max(linear(d, 2, place), hn::Zero(d)), hn::Set(d, T(1)));
    }
    HWY_INLINE Color<D> color(D d, const Place& place) const {
        return {linear(d, 4, place), linear(d, 6, place), linear(d, 8, place)};
    }

  private:
    HWY_INLINE V look_up(D d, int number, const Place& place) const {
        return hn::TableLookupLanes(hn::LoadU(d, table_.lanes[number]), place.stretch);
    }
    HWY_INLINE V linear(D d, int number, const Place& place) const {
        return hn::MulAdd(place.beyond, look_up(d, number + 1, place), look_up(d, number, place));
    }

    const TransferTable<T>& table_;
};

/// A register whose blocks of 16 bytes come from where `offsets` of the first lane of each block says.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE hn::Vec<D> load_blocks(D d, const T* table, const std::int32_t* offsets) {
#if HWY_TARGET == HWY_SCALAR
    return hn::Load(d, table + offsets[0]);
#else
    if constexpr (hn::MaxLanes(D()) * sizeof(T) <= 16) {
        return hn::LoadU(d, table + offsets[0]);
    } else {
        const hn::Half<D> half;
        return hn::Combine(d, load_blocks(half, table, offsets + hn::MaxLanes(D()) / 2),
                           load_blocks(half, table, offsets));
    }
#endif
}

/// Four consecutive numbers of each lane's record.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void load_four(D d, const T* table, const std::int32_t* offsets, V& a, V& b, V& c, V& e) {
#if HWY_TARGET == HWY_SCALAR
    a = load_blocks(d, table, offsets);
    b = load_blocks(d, table + 1, offsets);
    c = load_blocks(d, table + 2, offsets);
    e = load_blocks(d, table + 3, offsets);
#else
    const V first = load_blocks(d, table, offsets), second = load_blocks(d, table, offsets + 1);
    if constexpr (sizeof(T) == 8) {
        a = hn::InterleaveLower(d, first, second);
        b = hn::InterleaveUpper(d, first, second);
        const V first_on = load_blocks(d, table + 2, offsets), second_on = load_blocks(d, table + 2, offsets + 1);
        c = hn::InterleaveLower(d, first_on, second_on);
        e = hn::InterleaveUpper(d, first_on, second_on);
    } else {
        const hn::RepartitionToWide<hn::RebindToUnsigned<D>> wide;
        const V third = load_blocks(d, table, offsets + 2), fourth = load_blocks(d, table, offsets + 3);
        const auto low = hn::BitCast(wide, hn::InterleaveLower(d, first, second));
        const auto low_on = hn::BitCast(wide, hn::InterleaveLower(d, third, fourth));
        const auto high = hn::BitCast(wide, hn::InterleaveUpper(d, first, second));
        const auto high_on = hn::BitCast(wide, hn::InterleaveUpper(d, third, fourth));
        a = hn::BitCast(d, hn::InterleaveLower(wide, low, low_on));
        b = hn::BitCast(d, hn::InterleaveUpper(wide, low, low_on));
        c = hn::BitCast(d, hn::InterleaveLower(wide, high, high_on));
        e = hn::BitCast(d, hn::InterleaveUpper(wide, high, high_on));
    }
#endif
}

/// Records of one vector of values, one a lane.
template <class D>
struct LaneRecords {
    HWY_ALIGN std::int32_t at[hn::MaxLanes(D())];
};

/// Where to begin to look: at or before the stretch that each value is in.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void look_in_cells(D d, const Cells<T>& cells, V rho, LaneRecords<D>& records) {
    const hn::Rebind<std::int32_t, D> di;
    constexpr std::size_t lanes = hn::MaxLanes(D());
    const V inside = hn::Min(hn::Max(rho, hn::Set(d, cells.first)), hn::Set(d, cells.last));
    const V cell = hn::Min(hn::Mul(hn::Sub(inside, hn::Set(d, cells.first)), hn::Set(d, cells.per_unit)),
                           hn::Set(d, cells.last_cell));
    HWY_ALIGN std::int32_t numbers[lanes];
    if constexpr (sizeof(T) == 4) {
        hn::StoreU(hn::ConvertTo(di, cell), di, numbers);
    } else {
        hn::StoreU(hn::DemoteTo(di, cell), di, numbers);
    }
    for (std::size_t lane = 0; lane < lanes; ++lane) {
        records.at[lane] = cells.records[static_cast<std::size_t>(numbers[lane])];
    }
}

/// Points may lie inside a cell: onwards to the stretch that a value is in. The second number of a record of `size`
/// is where its stretch ends.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void go_on(D d, const T* table, std::int32_t size, V rho, LaneRecords<D>& records) {
    constexpr std::size_t lanes = hn::MaxLanes(D());
    HWY_ALIGN T values[lanes];
    hn::StoreU(rho, d, values);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
        while (values[lane] >= table[records.at[lane] + 1]) {
            records.at[lane] += size;
        }
    }
}

/// Looks of one vector of values by records in memory, found through cells.
template <class D>
class TableInMemory {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;

  public:
    explicit TableInMemory(const TransferTable<T>& table) : table_(table) {}

    struct Place {
        LaneRecords<D> records;
        V beyond;
    };

    HWY_INLINE V opacity(D d, V rho, Place& place) const {
        const T* records = table_.records.data();
        look_in_cells(d, table_.cells, rho, place.records);
        V from, to, opacity, slope;
        load_four(d, records, place.records.at, from, to, opacity, slope);
        if (HWY_UNLIKELY(!hn::AllFalse(d, hn::Ge(rho, to)))) {
            go_on(d, records, TransferTable<T>::record, rho, place.records);
            load_four(d, records, place.records.at, from, to, opacity, slope);
        }
        place.beyond = hn::Max(hn::Sub(rho, from), hn::Zero(d));
        return hn::Min(hn::Max(hn::MulAdd(place.beyond, slope, opacity), hn::Zero(d)), hn::Set(d, T(1)));
    }
    HWY_INLINE Color<D> color(D d, const Place& place) const {
        V red, red_slope, green, green_slope, blue, blue_slope, none, none_slope;
        load_four(d, table_.records.data() + 4, place.records.at, red, red_slope, green, green_slope);
        load_four(d, table_.records.data() + 8, place.records.at, blue, blue_slope, none, none_slope);
        return {hn::MulAdd(place.beyond, red_slope, red), hn::MulAdd(place.beyond, green_slope, green),
                hn::MulAdd(place.beyond, blue_slope, blue)};
    }

  private:
    const TransferTable<T>& table_;
};

/// 1 - (1 - a)^exponent, a from 0 to 1.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V opacity_over(D d, V a, V exponent) {
    const V one = hn::Set(d, hn::TFromD<D>(1));
    const auto below_one = hn::Lt(a, one);
    const V alpha = veil(d, hn::Mul(exponent, absorption(d, hn::IfThenElseZero(below_one, a))));
    return hn::IfThenElse(below_one, alpha, one);
}

// Ramps between slices ----------------------------------------------------------------------------------------------

/// Gauss-Legendre nodes on [0, 1], of each pair the smaller one, exact enough for logarithms over a factor of two: the
/// error falls as 5.8 to the power -2 nodes.
template <class T>
struct RampNodes;
template <>
struct RampNodes<float> {
    static constexpr int pairs = 2;
    static constexpr float place[] = {0.3300094782F, 0.06943184420F};
    static constexpr float share[] = {0.3260725774F, 0.1739274226F};
};
template <>
struct RampNodes<double> {
    static constexpr int pairs = 5;
    static constexpr double place[] = {0.425562830509184395, 0.283302302935376405, 0.160295215850487797,
                                       0.0674683166555077446, 0.0130467357414141399};
    static constexpr double share[] = {0.147762112357376435, 0.134633359654998178, 0.109543181257991022,
                                       0.0747256745752902966, 0.0333356721543440688};
};

/// Means of the absorption -ln(1 - a) and of its product with the share of the way.
template <class D>
struct Moments {
    hn::Vec<D> plain, weighted;
};

/// Over a way on which opacity is linear; clear: 1 - opacity, with its own digits.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Moments<D> moments(D d, V opacity_from, V opacity_to, V clear_from, V clear_to) {
    using T = hn::TFromD<D>;
    using Nodes = RampNodes<T>;
    const V one = hn::Set(d, T(1));
    const V opacity_step = hn::Sub(opacity_to, opacity_from);
    const V clear_step = hn::Sub(clear_to, clear_from);
    const auto at = [&](V x) {
        const V opacity = hn::MulAdd(opacity_step, x, opacity_from);
        // Small opacities and small rests of transparency each have digits that the other has lost.
        const auto thin = hn::Lt(opacity, hn::Set(d, T(0.25)));
        const V left = hn::IfThenElse(thin, hn::Sub(one, opacity), hn::MulAdd(clear_step, x, clear_from));
        const V lost = hn::IfThenElseZero(thin, hn::Sub(hn::Sub(one, left), opacity));
        return hn::Neg(ln_with_rest(d, left, lost));
    };
    V plain = hn::Zero(d), weighted = hn::Zero(d);
    for (int pair = 0; pair < Nodes::pairs; ++pair) {
        const V place = hn::Set(d, Nodes::place[pair]);
        const V there = hn::Sub(one, place);
        const V near = at(place), far = at(there);
        const V share = hn::Set(d, Nodes::share[pair]);
        plain = hn::MulAdd(share, hn::Add(near, far), plain);
        weighted = hn::MulAdd(share, hn::MulAdd(there, far, hn::Mul(place, near)), weighted);
    }
    const V least = hn::Min(clear_from, clear_to), most = hn::Max(clear_from, clear_to);
    const auto bent = hn::Gt(most, hn::Add(least, least));
    if (!hn::AllFalse(d, bent)) {
        // The logarithm bends too much for a quadrature; its own integrals do not cancel here.
        const V step = hn::IfThenElse(bent, clear_step, one);
        const V from = hn::Mul(clear_from, ln(d, clear_from)), to = hn::Mul(clear_to, ln(d, clear_to));
        const V half = hn::Set(d, T(0.5)), quarter = hn::Set(d, T(0.25));
        const V over = hn::Sub(to, from);
        const V first = hn::Sub(hn::Div(over, step), one);
        const V squares = hn::Mul(hn::Sub(clear_to, clear_from), hn::Add(clear_to, clear_from));
        V second = hn::Mul(half, hn::NegMulAdd(clear_from, from, hn::Mul(clear_to, to)));
        second = hn::NegMulAdd(quarter, squares, second);
        second = hn::Div(hn::NegMulAdd(clear_from, hn::Sub(over, step), second), hn::Mul(step, step));
        plain = hn::IfThenElse(bent, hn::Neg(first), plain);
        weighted = hn::IfThenElse(bent, hn::Neg(second), weighted);
    }
    return {plain, weighted};
}

/// Mean absorption per reference length over a linear ramp, and its product with the colour.
template <class D>
struct RampSum {
    hn::Vec<D> absorption;
    Color<D> color;
};

/// A stretch's numbers, one vector each: the same in all lanes, or each lane's own.
template <class D>
struct RampNumbers {
    hn::Vec<D> from, to, per_width, opacity, opacity_step, clearness, clearness_step;
    Color<D> color, color_step;
};

/// Adds what a ramp has from `begin` to `end`, both inside of the stretch, times its share.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_part(D d, const RampNumbers<D>& s, V begin, V end, V share, RampSum<D>& sum) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    // The outermost stretches reach to the largest numbers: differences from there are large, not infinite.
    const V at_begin = hn::Min(hn::Mul(hn::Sub(begin, s.from), s.per_width), one);
    const V at_end = hn::Min(hn::Mul(hn::Sub(end, s.from), s.per_width), one);
    // Rounding must not make an opacity of 1 - 2^-24 one of 1, nor one of 0 less.
    const auto opacity = [&](V x) { return hn::Max(hn::MulAdd(s.opacity_step, x, s.opacity), zero); };
    const auto clearness = [&](V x) {
        return hn::Max(hn::MulAdd(s.clearness_step, x, s.clearness), hn::Set(d, T(0x1p-25)));
    };
    const Moments<D> mean = moments(d, opacity(at_begin), opacity(at_end), clearness(at_begin), clearness(at_end));
    sum.absorption = hn::MulAdd(share, mean.plain, sum.absorption);
    const auto add = [&](V color, V step, V& to) {
        const V first = hn::MulAdd(step, at_begin, color), last = hn::MulAdd(step, at_end, color);
        to = hn::MulAdd(share, hn::MulAdd(first, mean.plain, hn::Mul(hn::Sub(last, first), mean.weighted)), to);
    };
    add(s.color.red, s.color_step.red, sum.color.red);
    add(s.color.green, s.color_step.green, sum.color.green);
    add(s.color.blue, s.color_step.blue, sum.color.blue);
}

/// A vector of ramps from `low` to `high`; flat: as good as one value.
template <class D>
struct Ramps {
    hn::Vec<D> low, high, per_span;
    hn::Mask<D> flat, wanted;
};

/// Stretch by stretch, where there are few.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void walk_stretches(D d, const RampTable<T>& table, const Ramps<D>& ramps, RampSum<D>& sum) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    constexpr T largest = std::numeric_limits<T>::max();
    const T lowest = hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(ramps.wanted, ramps.low, hn::Set(d, largest))));
    const T highest = hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElse(ramps.wanted, ramps.high, hn::Set(d, -largest))));
    for (const RampStretch<T>& s : table.stretches) {
        if (s.to < lowest || s.from > highest || (s.opacity == T(0) && s.opacity_step == T(0))) {
            continue;
        }
        const V from = hn::Set(d, s.from), to = hn::Set(d, s.to);
        const V begin = hn::Min(hn::Max(ramps.low, from), to), end = hn::Max(hn::Min(ramps.high, to), from);
        const auto inside = hn::And(hn::Ge(ramps.low, from), hn::Lt(ramps.low, to));
        V share =
            hn::IfThenElse(ramps.flat, hn::IfThenElseZero(inside, one), hn::Mul(hn::Sub(end, begin), ramps.per_span));
        share = hn::IfThenElseZero(ramps.wanted, share);
        if (hn::AllFalse(d, hn::Gt(share, zero))) {
            continue;
        }
        add_part(
            d,
            RampNumbers<D>{from,
                           to,
                           hn::Set(d, s.per_width),
                           hn::Set(d, s.opacity),
                           hn::Set(d, s.opacity_step),
                           hn::Set(d, s.clearness),
                           hn::Set(d, s.clearness_step),
                           {hn::Set(d, s.color[0]), hn::Set(d, s.color[1]), hn::Set(d, s.color[2])},
                           {hn::Set(d, s.color_step[0]), hn::Set(d, s.color_step[1]), hn::Set(d, s.color_step[2])}},
            begin, end, share, sum);
    }
}

/// The first and the last stretch of each ramp, and by integrals what lies between them.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void add_ends(D d, const RampTable<T>& table, const Ramps<D>& ramps, RampSum<D>& sum) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const T* numbers = table.records.data();
    const auto find = [&](V rho, LaneRecords<D>& records, RampNumbers<D>& s) {
        look_in_cells(d, table.cells, rho, records);
        V none;
        load_four(d, numbers, records.at, s.from, s.to, s.per_width, none);
        if (!hn::AllFalse(d, hn::Ge(rho, s.to))) {
            go_on(d, numbers, RampTable<T>::record, rho, records);
            load_four(d, numbers, records.at, s.from, s.to, s.per_width, none);
        }
        load_four(d, numbers + 4, records.at, s.opacity, s.opacity_step, s.clearness, s.clearness_step);
        load_four(d, numbers + 8, records.at, s.color.red, s.color_step.red, s.color.green, s.color_step.green);
        load_four(d, numbers + 12, records.at, s.color.blue, s.color_step.blue, none, none);
    };
    LaneRecords<D> first_records, last_records;
    RampNumbers<D> first, last;
    find(ramps.low, first_records, first);
    const auto longer = hn::AndNot(ramps.flat, hn::And(ramps.wanted, hn::Ge(ramps.high, first.to)));
    const V end = hn::Min(ramps.high, first.to);
    const V share = hn::IfThenElse(ramps.flat, one, hn::Mul(hn::Sub(end, ramps.low), ramps.per_span));
    add_part(d, first, ramps.low, end, hn::IfThenElseZero(ramps.wanted, share), sum);
    if (hn::AllFalse(d, longer)) {
        return;
    }
    find(ramps.high, last_records, last);
    // (Ramps that end where they began may be in the outermost stretch, which starts at the smallest number.)
    const V way = hn::IfThenElseZero(longer, hn::Sub(ramps.high, last.from));
    add_part(d, last, last.from, ramps.high, hn::Mul(way, ramps.per_span), sum);
    // From where the stretch after the first one starts to where the last one does.
    const V factor = hn::IfThenElseZero(longer, ramps.per_span);
    V none, whole[2][4], rest[2][4];
    for (int side = 0; side < 2; ++side) {
        const T* from = numbers + (side == 0 ? RampTable<T>::record : 0);
        const LaneRecords<D>& records = side == 0 ? first_records : last_records;
        load_four(d, from + 12, records.at, none, none, whole[side][0], rest[side][0]);
        load_four(d, from + 16, records.at, whole[side][1], rest[side][1], whole[side][2], rest[side][2]);
        load_four(d, from + 20, records.at, whole[side][3], rest[side][3], none, none);
    }
    const auto add = [&](int which, V& to) {
        const V between = hn::Add(hn::Sub(whole[1][which], whole[0][which]), hn::Sub(rest[1][which], rest[0][which]));
        to = hn::MulAdd(between, factor, to);
    };
    add(0, sum.absorption);
    add(1, sum.color.red);
    add(2, sum.color.green);
    add(3, sum.color.blue);
    sum.absorption = hn::Max(sum.absorption, zero);
}

/// Mean absorption per reference length over the linear ramp between two values, and the colour that goes with it.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V ramp_absorption(D d, const RampTable<T>& table, V rho_from, V rho_to, hn::Mask<D> wanted,
                             Color<D>& color) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const V low = hn::Min(rho_from, rho_to), high = hn::Max(rho_from, rho_to);
    const V span = hn::Sub(high, low);
    // Where the reciprocal would overflow the ramp is as good as one value.
    const auto flat = hn::Lt(span, hn::Set(d, std::numeric_limits<T>::min() * T(16)));
    const Ramps<D> ramps{low, high, hn::Div(one, hn::IfThenElse(flat, one, span)), flat, wanted};
    RampSum<D> sum{zero, {zero, zero, zero}};
    if (table.records.empty()) {
        walk_stretches(d, table, ramps, sum);
    } else {
        add_ends(d, table, ramps, sum);
    }
    const V divisor = hn::IfThenElse(hn::Gt(sum.absorption, zero), sum.absorption, one);
    color = {hn::Div(sum.color.red, divisor), hn::Div(sum.color.green, divisor), hn::Div(sum.color.blue, divisor)};
    return sum.absorption;
}

// Light ---------------------------------------------------------------------------------------------------------------

/// What a slab's gradients are scaled with, so that their squares stay within the number format.
template <class T>
struct GradientScale {
    T across[2] = {T(0), T(0)}; ///< slices n and n + 1
    T along = T(0);
    T weakest = T(0);
    T full = T(1); ///< from this gradient on, gradient opacity takes nothing

    GradientScale(const Shading<T>& shading, std::int64_t n) {
        double scale[2];
        for (int ahead = 0; ahead < 2; ++ahead) {
            const double depth = shading.first_depth + static_cast<double>(n + ahead) * shading.slice_spacing;
            // At and behind the eye there are no slices: differences are 0 there.
            scale[ahead] = !shading.perspective ? shading.gradient_across
                           : depth > 0.0        ? shading.gradient_across / depth
                                                : 0.0;
        }
        const double largest = std::max({scale[0], scale[1], shading.gradient_along});
        const double unit = largest > 0.0 ? 1.0 / largest : 1.0;
        across[0] = static_cast<T>(scale[0] * unit);
        across[1] = static_cast<T>(scale[1] * unit);
        along = static_cast<T>(shading.gradient_along * unit);
        const auto positive = [&](double gradient) {
            return static_cast<T>(
                std::clamp(gradient * unit, static_cast<double>(std::numeric_limits<T>::min()), 1e30));
        };
        weakest = positive(shading.weakest_gradient);
        full = positive(shading.full_gradient);
    }
};

/// The pixel's ray: slopes and their secant; in orthographic views 0 and 1.
template <class D>
struct Ray {
    hn::Vec<D> x, y, slant;
};

/// Minus the gradient.
template <class D>
struct Normal {
    hn::Vec<D> x, y, z;
};

/// Minus the gradient at pixels of the slice `here`; pointers to the first pixel.
template <bool perspective, class D, class T = hn::TFromD<D>>
HWY_INLINE Normal<D> against_gradient(D d, const T* before, const T* here, const T* after, std::ptrdiff_t stride,
                                      T across_scale, T along_scale, const Ray<D>& ray) {
    const auto across = hn::Set(d, across_scale);
    const auto x = hn::Mul(hn::Sub(hn::LoadU(d, here - 1), hn::LoadU(d, here + 1)), across);
    const auto y = hn::Mul(hn::Sub(hn::LoadU(d, here + stride), hn::LoadU(d, here - stride)), across);
    const auto z = hn::Mul(hn::Sub(hn::LoadU(d, after), hn::LoadU(d, before)), hn::Set(d, along_scale));
    if constexpr (perspective) {
        return {x, y, hn::MulAdd(ray.x, x, hn::MulAdd(ray.y, y, z))};
    } else {
        return {x, y, z};
    }
}

/// The same from sums of the kernels' own derivatives over columns, rows and slices, which stand in the place of half
/// the differences.
template <bool perspective, class D, class T = hn::TFromD<D>>
HWY_INLINE Normal<D> against_slope(D d, const T* const* slope, std::ptrdiff_t at, T across_scale, T along_scale,
                                   const Ray<D>& ray) {
    const auto across = hn::Set(d, T(2) * across_scale);
    const auto x = hn::Neg(hn::Mul(hn::LoadU(d, slope[0] + at), across));
    const auto y = hn::Mul(hn::LoadU(d, slope[1] + at), across);
    const auto z = hn::Mul(hn::LoadU(d, slope[2] + at), hn::Set(d, T(2) * along_scale));
    if constexpr (perspective) {
        return {x, y, hn::MulAdd(ray.x, x, hn::MulAdd(ray.y, y, z))};
    } else {
        return {x, y, z};
    }
}

/// Numbers of a light volume at places (u, v, w), counted in its elements; outside, those of the nearest face.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V look_up(D d, const LightVolume& volume, const V (&place)[3]) {
    const hn::Rebind<std::int32_t, D> di;
    const hn::Rebind<float, D> df;
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
    const auto value = [&](int corner) {
        const std::int32_t offset = ((corner & 1) != 0 ? steps[0] : 0) + ((corner & 2) != 0 ? steps[1] : 0) +
                                    ((corner & 4) != 0 ? steps[2] : 0);
        const auto found = hn::GatherIndex(df, values + offset, first);
        if constexpr (sizeof(T) == 4) {
            return found;
        } else {
            return hn::PromoteTo(d, found);
        }
    };
    const auto mix = [&](V from, V to, V share) { return hn::MulAdd(share, hn::Sub(to, from), from); };
    const V near = mix(mix(value(0), value(1), part[0]), mix(value(2), value(3), part[0]), part[1]);
    const V far = mix(mix(value(4), value(5), part[0]), mix(value(6), value(7), part[0]), part[1]);
    return mix(near, far, part[2]);
}

/// Light that nothing stands in the way of.
struct Undimmed {
    static constexpr bool anything = false;
};

/// Phong. weakest: g0 in the unit of the gradient, above 0. Lanes outside of `wanted` may come out as anything finite.
/// dimmed: what is left of each light and of ambient light.
template <bool perspective, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>, class Dimmed = Undimmed>
HWY_INLINE Color<D> shade(D d, const Shading<T>& shading, const Color<D>& color, const Normal<D>& against, T weakest,
                          const Ray<D>& ray, hn::Mask<D> wanted, const Dimmed& dimmed = {}) {
    const V zero = hn::Zero(d);
    const V size =
        hn::Sqrt(hn::MulAdd(against.x, against.x, hn::MulAdd(against.y, against.y, hn::Mul(against.z, against.z))));
    const V per_size = hn::Div(hn::Set(d, T(1)), hn::Max(size, hn::Set(d, weakest)));
    const Normal<D> normal{hn::Mul(against.x, per_size), hn::Mul(against.y, per_size), hn::Mul(against.z, per_size)};
    V to_viewer = normal.z, per_slant = zero;
    if constexpr (perspective) {
        if (shading.specular) {
            per_slant = hn::Div(hn::Set(d, T(1)), ray.slant);
            to_viewer = hn::Mul(hn::NegMulAdd(normal.x, ray.x, hn::NegMulAdd(normal.y, ray.y, normal.z)), per_slant);
        }
    }
    V ambient = hn::Set(d, shading.ambient);
    if constexpr (Dimmed::anything) {
        ambient = hn::Mul(ambient, dimmed.ambient());
    }
    Color<D> matt{ambient, ambient, ambient};
    Color<D> shine{zero, zero, zero};
    for (const ShadingLight<T>& light : shading.lights) {
        const V x = hn::Set(d, light.direction[0]), y = hn::Set(d, light.direction[1]),
                z = hn::Set(d, light.direction[2]);
        const V towards = hn::MulAdd(normal.x, x, hn::MulAdd(normal.y, y, hn::Mul(normal.z, z)));
        V facing = shading.two_sided ? hn::Abs(towards) : hn::Max(towards, zero);
        if constexpr (Dimmed::anything) {
            // (What looks away needs no look at what is in the way.)
            if (!hn::AllFalse(d, hn::And(wanted, hn::Gt(facing, zero)))) {
                facing = hn::Mul(facing, dimmed.light(static_cast<std::size_t>(&light - shading.lights.data())));
            }
        }
        matt.red = hn::MulAdd(facing, hn::Set(d, light.diffuse[0]), matt.red);
        if (!shading.gray) {
            matt.green = hn::MulAdd(facing, hn::Set(d, light.diffuse[1]), matt.green);
            matt.blue = hn::MulAdd(facing, hn::Set(d, light.diffuse[2]), matt.blue);
        }
        if (!shading.specular) {
            continue;
        }
        // (2 f N' - L) V with N' turned along with f is 2 (N L) (N V) - L V on either side.
        V light_to_viewer = z;
        if constexpr (perspective) {
            light_to_viewer = hn::Mul(hn::NegMulAdd(x, ray.x, hn::NegMulAdd(y, ray.y, z)), per_slant);
        }
        const V mirrored = hn::MulSub(hn::Add(towards, towards), to_viewer, light_to_viewer);
        const bool even = shading.shininess == T(0);
        const auto seen = even ? hn::And(wanted, hn::Gt(facing, zero))
                               : hn::And(wanted, hn::And(hn::Gt(facing, zero), hn::Gt(mirrored, zero)));
        if (hn::AllFalse(d, seen)) {
            continue;
        }
        V highlight = facing;
        if (!even) {
            const V base = hn::IfThenElseZero(seen, hn::Min(mirrored, hn::Set(d, T(1))));
            highlight = hn::Mul(facing, pow_below_one(d, base, hn::Set(d, shading.shininess)));
        }
        shine.red = hn::MulAdd(highlight, hn::Set(d, light.specular[0]), shine.red);
        if (!shading.gray) {
            shine.green = hn::MulAdd(highlight, hn::Set(d, light.specular[1]), shine.green);
            shine.blue = hn::MulAdd(highlight, hn::Set(d, light.specular[2]), shine.blue);
        }
    }
    if (shading.gray) {
        matt.green = matt.blue = matt.red;
        shine.green = shine.blue = shine.red;
    }
    return {hn::MulAdd(color.red, matt.red, shine.red), hn::MulAdd(color.green, matt.green, shine.green),
            hn::MulAdd(color.blue, matt.blue, shine.blue)};
}

// Effects -------------------------------------------------------------------------------------------------------------

/// Columns x0 <= x < x1.
struct Columns {
    int x0 = 0, x1 = 0;
};

/// Pixels of a row on their way through the effects that are on. Each effect goes through the row by itself, so that
/// none is asked for pixel by pixel and none that is off costs anything.
template <class T>
struct EffectRow {
    static constexpr int room = 128;
    int y = 0;
    int begin = 0, past = 0; ///< columns; number x - begin belongs to column x
    HWY_ALIGN T seen[room];  ///< 1: may show; else 0
    HWY_ALIGN T share[room]; ///< where the point that is shaded lies, in slice distances behind slice n
    HWY_ALIGN T faded[room]; ///< what gradient opacity leaves
    HWY_ALIGN T against_x[room];
    HWY_ALIGN T against_y[room];
    HWY_ALIGN T against_z[room];
    HWY_ALIGN T alpha[room];
    HWY_ALIGN T red[room];
    HWY_ALIGN T green[room];
    HWY_ALIGN T blue[room];
};

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
    HWY_INLINE V at(D d, V column, V share) const {
        const auto place = [&](int axis) {
            const V along = hn::MulAdd(column, hn::Set(d, per_both[axis]), hn::Set(d, per_share[axis]));
            return hn::MulAdd(share, along, hn::MulAdd(column, hn::Set(d, per_column[axis]), hn::Set(d, start[axis])));
        };
        const V places[3] = {place(0), place(1), place(2)};
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

// Rows ----------------------------------------------------------------------------------------------------------------

/// One call of shade_slab.
template <class T>
class SlabShader {
    using D = hn::CappedTag<T, TileShape::padding>;
    using V = hn::Vec<D>;
    using M = hn::Mask<D>;

  public:
    SlabShader(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window, TilePicture<T>& picture)
        : shading_(shading), shape_(shape), window_(window), picture_(picture) {}

    HWY_INLINE void run() const {
        if (window_.rect.empty()) {
            return;
        }
        if (picture_.coverage != nullptr && window_.n >= 0) {
            add_coverage();
        }
        switch (shading_.mode) {
        case Mode::xray:
            add_scalar();
            return;
        case Mode::mip:
            raise_scalar();
            return;
        case Mode::isosurface:
            if (shading_.by_effects) {
                shading_.perspective ? go_through_effects<Crossings, true>() : go_through_effects<Crossings, false>();
            } else {
                shading_.perspective ? find_crossings<true>() : find_crossings<false>();
            }
            return;
        case Mode::composite:
            break;
        }
        if (shading_.by_effects) {
            choose_effects();
        } else if (shading_.preintegration) {
            shading_.perspective ? add_intervals<true>() : add_intervals<false>();
        } else if (shading_.transfer.stretches <= static_cast<int>(hn::MaxLanes(D()))) {
            add_slices_by<TableInLanes<D>>();
        } else {
            add_slices_by<TableInMemory<D>>();
        }
    }

    /// Adds the slice's -ln(1 - alpha) to plane alpha, at most densest_slice.
    HWY_INLINE void absorb() const {
        if (shading_.transfer.stretches <= static_cast<int>(hn::MaxLanes(D()))) {
            absorb_by<TableInLanes<D>>();
        } else {
            absorb_by<TableInMemory<D>>();
        }
    }

  private:
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));
    static constexpr T densest_slice = T(20);

    template <class Table>
    HWY_NOINLINE void absorb_by() const {
        const D d;
        const Table table(shading_.transfer);
        const V zero = hn::Zero(d), one = hn::Set(d, T(1)), densest = hn::Set(d, densest_slice);
        const V below = hn::Set(d, shading_.transfer.below), above = hn::Set(d, shading_.transfer.above);
        const V exponent = hn::Set(d, shading_.exponent);
        for (int y = window_.rect.y0; y < window_.rect.y1; ++y) {
            const Columns kept = columns_kept(y, 0);
            for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
                const V rho = hn::LoadU(d, window_.rho[1] + in_sheet(y) + x);
                M visible = within(d, hn::And(hn::Gt(rho, below), hn::Lt(rho, above)), x, kept);
                if (shading_.empty_test) {
                    visible = hn::And(visible, hn::Ne(hn::LoadU(d, window_.weight[0] + in_sheet(y) + x), zero));
                }
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                typename Table::Place place;
                const V a = hn::IfThenElseZero(visible, table.opacity(d, rho, place));
                const auto clear = hn::Lt(a, one);
                const V thin = hn::Mul(exponent, absorption(d, hn::IfThenElseZero(clear, a)));
                T* sum = picture_.alpha + in_plane(y) + x;
                hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::IfThenElse(clear, hn::Min(thin, densest), densest)), d, sum);
            }
        }
    }

    template <class Table>
    HWY_INLINE void add_slices_by() const {
        if (shading_.lit) {
            shading_.perspective ? add_slices<Table, true, true>() : add_slices<Table, true, false>();
        } else {
            shading_.perspective ? add_slices<Table, false, true>() : add_slices<Table, false, false>();
        }
    }

    /// Element of a sheet and of a plane at the start of a row.
    [[nodiscard]] std::ptrdiff_t in_sheet(int y) const {
        return static_cast<std::ptrdiff_t>(y + 1) * shape_.stride + 1;
    }
    [[nodiscard]] std::ptrdiff_t in_plane(int y) const { return static_cast<std::ptrdiff_t>(y) * shape_.stride; }

    /// Planes are read and written in whole cache lines.
    [[nodiscard]] int first_column() const { return window_.rect.x0 / lanes * lanes; }
    /// Lanes that are inside of the rectangle: right of it sheets have borders and paddings.
    HWY_INLINE M inside(D d, M mask, int x) const {
        const int skipped = window_.rect.x0 - x, left = window_.rect.x1 - x;
        if (HWY_UNLIKELY(skipped > 0)) {
            mask = hn::AndNot(hn::FirstN(d, static_cast<std::size_t>(skipped)), mask);
        }
        if (left < lanes) {
            mask = hn::And(mask, hn::FirstN(d, static_cast<std::size_t>(left)));
        }
        return mask;
    }

    HWY_INLINE Ray<D> ray(D d, int x, int y) const {
        const V pixel = hn::Set(d, static_cast<T>(shading_.pixel));
        const V column = hn::Iota(d, static_cast<T>(shape_.x + x - shading_.axis_x));
        const V over = hn::Mul(column, pixel);
        const V up = hn::Set(d, static_cast<T>((shading_.axis_y - (shape_.y + y)) * shading_.pixel));
        return {over, up, hn::Sqrt(hn::MulAdd(over, over, hn::MulAdd(up, up, hn::Set(d, T(1)))))};
    }
    template <bool perspective>
    HWY_INLINE Ray<D> ray_if(D d, int x, int y) const {
        if constexpr (perspective) {
            return ray(d, x, y);
        } else {
            return {hn::Zero(d), hn::Zero(d), hn::Set(d, T(1))};
        }
    }

    /// Puts alpha > 0, 0 outside of `visible`, behind what a plane holds; counts the pixels that end.
    HWY_INLINE void put_behind(D d, std::ptrdiff_t at, int y, M visible, V so_far, V alpha,
                               const Color<D>& color) const {
        const V share = hn::Mul(hn::Sub(hn::Set(d, T(1)), so_far), alpha);
        const V opacity = hn::Add(so_far, share);
        const auto add = [&](T* plane, V channel) {
            hn::StoreU(hn::MulAdd(share, channel, hn::LoadU(d, plane + at)), d, plane + at);
        };
        add(picture_.red, color.red);
        add(picture_.green, color.green);
        add(picture_.blue, color.blue);
        hn::StoreU(opacity, d, picture_.alpha + at);
        if (picture_.depth != nullptr) {
            const V half = hn::Set(d, T(0.5));
            const auto reached = hn::And(visible, hn::And(hn::Lt(so_far, half), hn::Ge(opacity, half)));
            const double depth = shading_.first_depth + static_cast<double>(window_.n) * shading_.slice_spacing;
            hn::StoreU(hn::IfThenElse(reached, hn::Set(d, static_cast<T>(depth)), hn::LoadU(d, picture_.depth + at)), d,
                       picture_.depth + at);
        }
        end_pixels(d, y, hn::And(visible, hn::Ge(opacity, hn::Set(d, shading_.stop))));
    }
    HWY_INLINE void end_pixels(D d, int y, M ended) const {
        if (!hn::AllFalse(d, ended)) {
            const int count = static_cast<int>(hn::CountTrue(d, ended));
            picture_.row_alive[y] -= count;
            picture_.alive -= count;
        }
    }

    template <class Table, bool lit, bool perspective>
    HWY_NOINLINE void add_slices() const {
        const D d;
        const Table table(shading_.transfer);
        const GradientScale<T> scale(shading_, window_.n);
        const V zero = hn::Zero(d);
        const V below = hn::Set(d, shading_.transfer.below), above = hn::Set(d, shading_.transfer.above);
        const V stop = hn::Set(d, shading_.stop);
        const V exponent = hn::Set(d, shading_.exponent);
        const Rect& rect = window_.rect;
        for (int y = rect.y0; y < rect.y1; ++y) {
            if (picture_.row_alive[y] == 0) {
                continue;
            }
            const T* row = window_.rho[1] + in_sheet(y);
            for (int x = first_column(); x < rect.x1; x += lanes) {
                const V rho = hn::LoadU(d, row + x);
                M visible = hn::And(hn::Gt(rho, below), hn::Lt(rho, above));
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                const std::ptrdiff_t at = in_plane(y) + x;
                const V so_far = hn::LoadU(d, picture_.alpha + at);
                visible = inside(d, hn::And(visible, hn::Lt(so_far, stop)), x);
                if (shading_.empty_test) {
                    visible = hn::And(visible, hn::Ne(hn::LoadU(d, window_.weight[0] + in_sheet(y) + x), zero));
                }
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                typename Table::Place place;
                const Ray<D> ray = ray_if<perspective>(d, x, y);
                V alpha = hn::IfThenElseZero(visible, table.opacity(d, rho, place));
                if (shading_.correct) {
                    alpha = opacity_over(d, alpha, perspective ? hn::Mul(exponent, ray.slant) : exponent);
                }
                visible = hn::Gt(alpha, zero);
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                Color<D> color = table.color(d, place);
                if constexpr (lit) {
                    const Normal<D> against = against_gradient<perspective>(
                        d, window_.rho[0] + in_sheet(y) + x, row + x, window_.rho[2] + in_sheet(y) + x, shape_.stride,
                        scale.across[0], scale.along, ray);
                    color = shade<perspective>(d, shading_, color, against, scale.weakest, ray, visible);
                }
                put_behind(d, at, y, visible, so_far, alpha, color);
            }
        }
    }

    /// Minus the gradient a share of the way from slice n to slice n + 1.
    template <bool perspective>
    HWY_INLINE Normal<D> between_slices(D d, std::ptrdiff_t at, const GradientScale<T>& scale, const Ray<D>& ray,
                                        V share) const {
        const auto of = [&](int ahead) {
            return against_gradient<perspective>(d, window_.rho[ahead] + at, window_.rho[ahead + 1] + at,
                                                 window_.rho[ahead + 2] + at, shape_.stride, scale.across[ahead],
                                                 scale.along, ray);
        };
        const Normal<D> front = of(0), back = of(1);
        const auto mix = [&](V from, V to) { return hn::MulAdd(share, hn::Sub(to, from), from); };
        return {mix(front.x, back.x), mix(front.y, back.y), mix(front.z, back.z)};
    }

    template <bool perspective>
    HWY_NOINLINE void add_intervals() const {
        const D d;
        const GradientScale<T> scale(shading_, window_.n);
        const V zero = hn::Zero(d);
        const V below = hn::Set(d, shading_.transfer.below), above = hn::Set(d, shading_.transfer.above);
        const V stop = hn::Set(d, shading_.stop);
        const V exponent = hn::Set(d, shading_.exponent);
        const Rect& rect = window_.rect;
        for (int y = rect.y0; y < rect.y1; ++y) {
            if (picture_.row_alive[y] == 0) {
                continue;
            }
            for (int x = first_column(); x < rect.x1; x += lanes) {
                const std::ptrdiff_t in_sheets = in_sheet(y) + x;
                const V front = hn::LoadU(d, window_.rho[1] + in_sheets);
                const V back = hn::LoadU(d, window_.rho[2] + in_sheets);
                M visible = hn::And(hn::Gt(hn::Max(front, back), below), hn::Lt(hn::Min(front, back), above));
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                const std::ptrdiff_t at = in_plane(y) + x;
                const V so_far = hn::LoadU(d, picture_.alpha + at);
                visible = inside(d, hn::And(visible, hn::Lt(so_far, stop)), x);
                if (shading_.empty_test) {
                    visible = hn::And(visible, hn::Or(hn::Ne(hn::LoadU(d, window_.weight[0] + in_sheets), zero),
                                                      hn::Ne(hn::LoadU(d, window_.weight[1] + in_sheets), zero)));
                }
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                const Ray<D> ray = ray_if<perspective>(d, x, y);
                Color<D> color;
                const V mean = ramp_absorption(d, shading_.ramps, front, back, visible, color);
                const V alpha = veil(d, hn::Mul(perspective ? hn::Mul(exponent, ray.slant) : exponent, mean));
                visible = hn::Gt(alpha, zero);
                if (hn::AllFalse(d, visible)) {
                    continue;
                }
                if (shading_.lit) {
                    const Normal<D> against = between_slices<perspective>(d, in_sheets, scale, ray, hn::Set(d, T(0.5)));
                    color = shade<perspective>(d, shading_, color, against, scale.weakest, ray, visible);
                }
                put_behind(d, at, y, visible, so_far, alpha, color);
            }
        }
    }

    template <bool perspective>
    HWY_NOINLINE void find_crossings() const {
        const D d;
        const GradientScale<T> scale(shading_, window_.n);
        const V zero = hn::Zero(d), one = hn::Set(d, T(1));
        const V iso = hn::Set(d, shading_.iso_value);
        const V stop = hn::Set(d, shading_.stop);
        const double depth = shading_.first_depth + static_cast<double>(window_.n) * shading_.slice_spacing;
        const Rect& rect = window_.rect;
        for (int y = rect.y0; y < rect.y1; ++y) {
            if (picture_.row_alive[y] == 0) {
                continue;
            }
            for (int x = first_column(); x < rect.x1; x += lanes) {
                const std::ptrdiff_t in_sheets = in_sheet(y) + x;
                const V front = hn::LoadU(d, window_.rho[1] + in_sheets);
                const V back = hn::LoadU(d, window_.rho[2] + in_sheets);
                M found = hn::Xor(hn::Lt(front, iso), hn::Lt(back, iso));
                if (hn::AllFalse(d, found)) {
                    continue;
                }
                const std::ptrdiff_t at = in_plane(y) + x;
                const V so_far = hn::LoadU(d, picture_.alpha + at);
                found = inside(d, hn::And(found, hn::Lt(so_far, stop)), x);
                if (hn::AllFalse(d, found)) {
                    continue;
                }
                const V step = hn::IfThenElse(found, hn::Sub(back, front), one);
                const V way = hn::IfThenElseZero(found, hn::Sub(iso, front));
                const V share = hn::Min(hn::Max(hn::Div(way, step), zero), one);
                Color<D> color{hn::Set(d, shading_.iso_color[0]), hn::Set(d, shading_.iso_color[1]),
                               hn::Set(d, shading_.iso_color[2])};
                if (shading_.lit) {
                    const Ray<D> ray = ray_if<perspective>(d, x, y);
                    const Normal<D> against = between_slices<perspective>(d, in_sheets, scale, ray, share);
                    color = shade<perspective>(d, shading_, color, against, scale.weakest, ray, found);
                }
                put_surface(d, at, y, found, share, depth, color);
            }
        }
    }

    /// Adds a sheet, times a step along the pixel's ray, to a plane.
    template <bool clip>
    HWY_INLINE void add_sheet(const T* sheet, T step, T* plane) const {
        const D d;
        const Rect& rect = window_.rect;
        for (int y = rect.y0; y < rect.y1; ++y) {
            const Columns kept = clip ? columns_kept(y, 0) : Columns{rect.x0, rect.x1};
            for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
                V value = hn::LoadU(d, sheet + in_sheet(y) + x);
                if constexpr (clip) {
                    value = hn::IfThenElseZero(within(d, hn::Eq(value, value), x, kept), value);
                }
                if (hn::AllTrue(d, hn::Eq(value, hn::Zero(d)))) {
                    continue;
                }
                V length = hn::Set(d, step);
                if (shading_.perspective) {
                    length = hn::Mul(length, ray(d, x, y).slant);
                }
                T* to = plane + in_plane(y) + x;
                hn::StoreU(hn::MulAdd(value, length, hn::LoadU(d, to)), d, to);
            }
        }
    }
    HWY_NOINLINE void add_scalar() const {
        shading_.clip ? add_sheet<true>(window_.rho[1], shading_.scalar_step, picture_.scalar)
                      : add_sheet<false>(window_.rho[1], shading_.scalar_step, picture_.scalar);
    }
    HWY_NOINLINE void add_coverage() const {
        shading_.clip ? add_sheet<true>(window_.weight[0], shading_.coverage_step, picture_.coverage)
                      : add_sheet<false>(window_.weight[0], shading_.coverage_step, picture_.coverage);
    }

    template <bool clip>
    HWY_INLINE void raise() const {
        const D d;
        const V step = hn::Set(d, shading_.scalar_step);
        const Rect& rect = window_.rect;
        for (int y = rect.y0; y < rect.y1; ++y) {
            const Columns kept = clip ? columns_kept(y, 0) : Columns{rect.x0, rect.x1};
            for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
                T* to = picture_.scalar + in_plane(y) + x;
                V value = hn::Mul(hn::LoadU(d, window_.rho[1] + in_sheet(y) + x), step);
                if constexpr (clip) {
                    value = hn::IfThenElseZero(within(d, hn::Eq(value, value), x, kept), value);
                }
                hn::StoreU(hn::Max(hn::LoadU(d, to), value), d, to);
            }
        }
    }
    HWY_NOINLINE void raise_scalar() const { shading_.clip ? raise<true>() : raise<false>(); }

    // Clipping ----------------------------------------------------------------------------------------------------

    /// Of a row of slice n + ahead what clipping keeps: half spaces, so that it is one stretch. In float64.
    [[nodiscard]] Columns columns_kept(int y, int ahead) const {
        const Rect& rect = window_.rect;
        double first = rect.x0, past = rect.x1;
        const double depth = shading_.first_depth + static_cast<double>(window_.n + ahead) * shading_.slice_spacing;
        const double wide = shading_.pixel * (shading_.perspective ? depth : 1.0);
        const double up = (shading_.axis_y - (shape_.y + y)) * wide;
        for (const KeptHalfSpace& half : shading_.kept) {
            const double step = half.normal.x * wide;
            const double at_0 = half.normal.x * ((shape_.x - shading_.axis_x) * wide) + half.normal.y * up -
                                half.normal.z * depth + half.distance;
            if (std::abs(step) * 1024.0 <= std::abs(at_0) || step == 0.0) {
                // No column of a tile lies where this changes.
                past = at_0 >= 0.0 ? past : first;
            } else if (step > 0.0) {
                first = std::max(first, std::ceil(-at_0 / step));
            } else {
                past = std::min(past, std::floor(at_0 / -step) + 1.0);
            }
        }
        if (!(first < past)) {
            return {rect.x0, rect.x0};
        }
        return {static_cast<int>(first), static_cast<int>(past)};
    }

    /// Lanes that are in a stretch of columns.
    HWY_INLINE M within(D d, M mask, int x, const Columns& columns) const {
        const int skipped = columns.x0 - x, left = columns.x1 - x;
        if (skipped > 0) {
            mask = hn::AndNot(hn::FirstN(d, static_cast<std::size_t>(std::min(skipped, lanes))), mask);
        }
        if (left < lanes) {
            mask = hn::And(mask, hn::FirstN(d, static_cast<std::size_t>(std::max(left, 0))));
        }
        return mask;
    }

    // Effects -----------------------------------------------------------------------------------------------------

    HWY_NOINLINE void choose_effects() const {
        if (shading_.preintegration) {
            if (shading_.second_order) {
                shading_.perspective ? go_through_effects<SecondOrder, true>()
                                     : go_through_effects<SecondOrder, false>();
            } else {
                shading_.perspective ? go_through_effects<Intervals, true>() : go_through_effects<Intervals, false>();
            }
        } else if (shading_.transfer.stretches <= static_cast<int>(hn::MaxLanes(D()))) {
            shading_.perspective ? go_through_effects<Slices<TableInLanes<D>>, true>()
                                 : go_through_effects<Slices<TableInLanes<D>>, false>();
        } else {
            shading_.perspective ? go_through_effects<Slices<TableInMemory<D>>, true>()
                                 : go_through_effects<Slices<TableInMemory<D>>, false>();
        }
    }

    template <class Kind, bool perspective>
    HWY_NOINLINE void go_through_effects() const {
        const GradientScale<T> scale(shading_, window_.n);
        const Rect& rect = window_.rect;
        EffectRow<T> row;
        for (row.y = rect.y0; row.y < rect.y1; ++row.y) {
            if (picture_.row_alive[row.y] == 0) {
                continue;
            }
            const Columns whole{rect.x0, rect.x1};
            const Columns here = shading_.clip ? columns_kept(row.y, 0) : whole;
            const Columns after = shading_.clip && Kind::between ? columns_kept(row.y, 1) : whole;
            for (row.begin = first_column(); row.begin < rect.x1; row.begin += EffectRow<T>::room) {
                row.past = std::min(row.begin + EffectRow<T>::room, rect.x1);
                if (!see(Kind(), row, here, after)) {
                    continue;
                }
                if (shading_.gradient) {
                    shading_.analytic_gradient ? find_gradients<perspective, true, Kind::between>(row, scale)
                                               : find_gradients<perspective, false, Kind::between>(row, scale);
                }
                if constexpr (Kind::has_opacity) {
                    fade(row, scale);
                }
                if (!classify<perspective>(Kind(), row)) {
                    continue;
                }
                if (shading_.shadows || shading_.occlusion) {
                    light_dimmed<perspective>(row, scale);
                } else if (shading_.lit) {
                    light<perspective>(row, scale);
                }
                if (shading_.depth_cue) {
                    cue(row);
                }
                put(Kind(), row);
            }
        }
    }

    template <class TableType>
    struct Slices {
        using Table = TableType;
        static constexpr bool between = false; ///< points lie between two slices
        static constexpr bool has_opacity = true;
    };
    struct Intervals {
        static constexpr bool between = true;
        static constexpr bool has_opacity = true;
    };
    struct SecondOrder : Intervals {};
    struct Crossings {
        static constexpr bool between = true;
        static constexpr bool has_opacity = false;
    };

    /// Calls visit(column, number in the row, lanes that are seen) for vectors with any.
    template <class Visit>
    HWY_INLINE void for_each_seen(const T* seen, const EffectRow<T>& row, const Visit& visit) const {
        const D d;
        for (int x = row.begin; x < row.past; x += lanes) {
            const M there = hn::Gt(hn::Load(d, seen + (x - row.begin)), hn::Zero(d));
            if (!hn::AllFalse(d, there)) {
                visit(x, x - row.begin, there);
            }
        }
    }

    /// Fills `seen` with what may show in its place, of lanes that still change. Returns whether any does.
    template <class May>
    HWY_INLINE bool see_if(EffectRow<T>& row, T share, const May& may) const {
        const D d;
        const V stop = hn::Set(d, shading_.stop), one = hn::Set(d, T(1));
        bool any = false;
        for (int x = row.begin; x < row.past; x += lanes) {
            hn::Store(hn::Set(d, share), d, row.share + (x - row.begin));
            M seen = may(d, x);
            if (!hn::AllFalse(d, seen)) {
                seen = inside(d, hn::And(seen, hn::Lt(hn::LoadU(d, picture_.alpha + in_plane(row.y) + x), stop)), x);
                any = any || !hn::AllFalse(d, seen);
            }
            hn::Store(hn::IfThenElseZero(seen, one), d, row.seen + (x - row.begin));
        }
        return any;
    }

    /// Points of slice n (n + 1) that a kernel reaches, as far as that is looked at, and that are kept.
    HWY_INLINE M open(D d, M mask, int y, int x, int ahead, const Columns& kept) const {
        mask = within(d, mask, x, kept);
        return shading_.empty_test
                   ? hn::And(mask, hn::Ne(hn::LoadU(d, window_.weight[ahead] + in_sheet(y) + x), hn::Zero(d)))
                   : mask;
    }

    template <class Table>
    HWY_NOINLINE bool see(Slices<Table> /*kind*/, EffectRow<T>& row, const Columns& here,
                          const Columns& /*after*/) const {
        return see_if(row, T(0), [&](D d, int x) {
            const V rho = hn::LoadU(d, window_.rho[1] + in_sheet(row.y) + x);
            return open(d,
                        hn::And(hn::Gt(rho, hn::Set(d, shading_.transfer.below)),
                                hn::Lt(rho, hn::Set(d, shading_.transfer.above))),
                        row.y, x, 0, here);
        });
    }

    HWY_INLINE M open_ends(D d, M mask, int y, int x, const Columns& here, const Columns& after) const {
        return hn::Or(open(d, mask, y, x, 0, here), open(d, mask, y, x, 1, after));
    }

    HWY_NOINLINE bool see(Intervals /*kind*/, EffectRow<T>& row, const Columns& here, const Columns& after) const {
        return see_if(row, T(0.5), [&](D d, int x) {
            const V front = hn::LoadU(d, window_.rho[1] + in_sheet(row.y) + x);
            const V back = hn::LoadU(d, window_.rho[2] + in_sheet(row.y) + x);
            return open_ends(d,
                             hn::And(hn::Gt(hn::Max(front, back), hn::Set(d, shading_.transfer.below)),
                                     hn::Lt(hn::Min(front, back), hn::Set(d, shading_.transfer.above))),
                             row.y, x, here, after);
        });
    }

    /// rho in the middle of an interval: of the cubic through four slices.
    HWY_INLINE V middle(D d, V front, V back, std::ptrdiff_t at) const {
        const V outer = hn::Add(hn::LoadU(d, window_.rho[0] + at), hn::LoadU(d, window_.rho[3] + at));
        return hn::Mul(hn::MulSub(hn::Set(d, T(9)), hn::Add(front, back), outer), hn::Set(d, T(0.0625)));
    }

    HWY_NOINLINE bool see(SecondOrder /*kind*/, EffectRow<T>& row, const Columns& here, const Columns& after) const {
        return see_if(row, T(0.5), [&](D d, int x) {
            const std::ptrdiff_t at = in_sheet(row.y) + x;
            const V front = hn::LoadU(d, window_.rho[1] + at), back = hn::LoadU(d, window_.rho[2] + at);
            const V between = middle(d, front, back, at);
            const V most = hn::Max(between, hn::Max(front, back)), least = hn::Min(between, hn::Min(front, back));
            return open_ends(d,
                             hn::And(hn::Gt(most, hn::Set(d, shading_.transfer.below)),
                                     hn::Lt(least, hn::Set(d, shading_.transfer.above))),
                             row.y, x, here, after);
        });
    }

    HWY_NOINLINE bool see(Crossings /*kind*/, EffectRow<T>& row, const Columns& here, const Columns& after) const {
        const D d;
        const V iso = hn::Set(d, shading_.iso_value), zero = hn::Zero(d), one = hn::Set(d, T(1));
        const auto ends = [&](int x, V& front, V& back) {
            front = hn::LoadU(d, window_.rho[1] + in_sheet(row.y) + x);
            back = hn::LoadU(d, window_.rho[2] + in_sheet(row.y) + x);
        };
        const bool any = see_if(row, T(0), [&](D, int x) {
            V front, back;
            ends(x, front, back);
            const M crossed = hn::Xor(hn::Lt(front, iso), hn::Lt(back, iso));
            return within(d, within(d, crossed, x, here), x, after);
        });
        for_each_seen(row.seen, row, [&](int x, int number, M found) {
            V front, back;
            ends(x, front, back);
            const V step = hn::IfThenElse(found, hn::Sub(back, front), one);
            const V way = hn::IfThenElseZero(found, hn::Sub(iso, front));
            hn::Store(hn::Min(hn::Max(hn::Div(way, step), zero), one), d, row.share + number);
        });
        return any;
    }

    template <bool perspective, bool analytic, bool between>
    HWY_NOINLINE void find_gradients(EffectRow<T>& row, const GradientScale<T>& scale) const {
        const D d;
        for_each_seen(row.seen, row, [&](int x, int number, M) {
            const Ray<D> ray = ray_if<perspective>(d, x, row.y);
            const std::ptrdiff_t at = in_sheet(row.y) + x;
            const auto of = [&](int ahead) {
                if constexpr (analytic) {
                    return against_slope<perspective>(d, window_.slope[ahead], at, scale.across[ahead], scale.along,
                                                      ray);
                } else {
                    return against_gradient<perspective>(d, window_.rho[ahead] + at, window_.rho[ahead + 1] + at,
                                                         window_.rho[ahead + 2] + at, shape_.stride,
                                                         scale.across[ahead], scale.along, ray);
                }
            };
            Normal<D> against = of(0);
            if constexpr (between) {
                const Normal<D> back = of(1);
                const V share = hn::Load(d, row.share + number);
                const auto mix = [&](V from, V to) { return hn::MulAdd(share, hn::Sub(to, from), from); };
                against = {mix(against.x, back.x), mix(against.y, back.y), mix(against.z, back.z)};
            }
            hn::Store(against.x, d, row.against_x + number);
            hn::Store(against.y, d, row.against_y + number);
            hn::Store(against.z, d, row.against_z + number);
        });
    }
    [[nodiscard]] HWY_INLINE Normal<D> against_of(D d, const EffectRow<T>& row, int number) const {
        return {hn::Load(d, row.against_x + number), hn::Load(d, row.against_y + number),
                hn::Load(d, row.against_z + number)};
    }

    /// What gradient opacity leaves; 1 without it.
    HWY_NOINLINE void fade(EffectRow<T>& row, const GradientScale<T>& scale) const {
        const D d;
        const V one = hn::Set(d, T(1));
        if (!shading_.gradient_opacity) {
            for (int number = 0; number < row.past - row.begin; number += lanes) {
                hn::Store(one, d, row.faded + number);
            }
            return;
        }
        const V full = hn::Set(d, scale.full);
        for_each_seen(row.seen, row, [&](int, int number, M) {
            const Normal<D> against = against_of(d, row, number);
            const V size = hn::Sqrt(
                hn::MulAdd(against.x, against.x, hn::MulAdd(against.y, against.y, hn::Mul(against.z, against.z))));
            hn::Store(hn::Div(hn::Min(size, full), full), d, row.faded + number);
        });
    }

    /// Keeps colours, and opacities of the slices as they are composited; returns whether any is above 0.
    HWY_INLINE bool keep(EffectRow<T>& row, int number, V alpha, const Color<D>& color) const {
        const D d;
        hn::Store(alpha, d, row.alpha + number);
        hn::Store(color.red, d, row.red + number);
        hn::Store(color.green, d, row.green + number);
        hn::Store(color.blue, d, row.blue + number);
        return !hn::AllFalse(d, hn::Gt(alpha, hn::Zero(d)));
    }
    [[nodiscard]] HWY_INLINE Color<D> color_of(D d, const EffectRow<T>& row, int number) const {
        return {hn::Load(d, row.red + number), hn::Load(d, row.green + number), hn::Load(d, row.blue + number)};
    }
    /// Calls looks(column, number, lanes, colour), which returns opacities, for what is seen; of the rest they are 0.
    template <class Looks>
    HWY_INLINE bool classify_by(EffectRow<T>& row, const Looks& looks) const {
        const D d;
        const V zero = hn::Zero(d);
        for (int number = 0; number < row.past - row.begin; number += lanes) {
            hn::Store(zero, d, row.alpha + number);
        }
        bool any = false;
        for_each_seen(row.seen, row, [&](int x, int number, M seen) {
            Color<D> color{zero, zero, zero};
            const V alpha = looks(x, number, seen, color);
            any = keep(row, number, alpha, color) || any;
        });
        return any;
    }

    template <bool perspective>
    HWY_INLINE V exponent_at(D d, int x, int y) const {
        const V exponent = hn::Set(d, shading_.exponent);
        if constexpr (perspective) {
            return hn::Mul(exponent, ray(d, x, y).slant);
        } else {
            return exponent;
        }
    }

    template <bool perspective, class Table>
    HWY_NOINLINE bool classify(Slices<Table> /*kind*/, EffectRow<T>& row) const {
        const D d;
        const Table table(shading_.transfer);
        return classify_by(row, [&](int x, int number, M seen, Color<D>& color) {
            typename Table::Place place;
            const V rho = hn::LoadU(d, window_.rho[1] + in_sheet(row.y) + x);
            V alpha = hn::IfThenElseZero(seen, table.opacity(d, rho, place));
            alpha = hn::Mul(alpha, hn::IfThenElseZero(seen, hn::Load(d, row.faded + number)));
            if (shading_.correct) {
                alpha = opacity_over(d, alpha, exponent_at<perspective>(d, x, row.y));
            }
            color = table.color(d, place);
            return alpha;
        });
    }

    template <bool perspective>
    HWY_NOINLINE bool classify(Intervals /*kind*/, EffectRow<T>& row) const {
        const D d;
        return classify_by(row, [&](int x, int number, M seen, Color<D>& color) {
            const V front = hn::LoadU(d, window_.rho[1] + in_sheet(row.y) + x);
            const V back = hn::LoadU(d, window_.rho[2] + in_sheet(row.y) + x);
            const V faded = hn::IfThenElseZero(seen, hn::Load(d, row.faded + number));
            const V mean = hn::Mul(ramp_absorption(d, shading_.ramps, front, back, seen, color), faded);
            return veil(d, hn::Mul(exponent_at<perspective>(d, x, row.y), mean));
        });
    }

    template <bool perspective>
    HWY_NOINLINE bool classify(SecondOrder /*kind*/, EffectRow<T>& row) const {
        const D d;
        const V zero = hn::Zero(d), one = hn::Set(d, T(1)), half = hn::Set(d, T(0.5));
        return classify_by(row, [&](int x, int number, M seen, Color<D>& color) {
            const std::ptrdiff_t at = in_sheet(row.y) + x;
            const V front = hn::LoadU(d, window_.rho[1] + at), back = hn::LoadU(d, window_.rho[2] + at);
            const V between = middle(d, front, back, at);
            const V faded = hn::IfThenElseZero(seen, hn::Load(d, row.faded + number));
            const V over_all = hn::Mul(exponent_at<perspective>(d, x, row.y), faded);
            const V over_half = hn::Mul(over_all, half);
            Color<D> whole, first, second;
            const auto opacity = [&](V from, V to, V over, Color<D>& looks) {
                return veil(d, hn::Mul(over, ramp_absorption(d, shading_.ramps, from, to, seen, looks)));
            };
            const V whole_alpha = opacity(front, back, over_all, whole);
            const V first_alpha = opacity(front, between, over_half, first);
            const V second_alpha = hn::Mul(opacity(between, back, over_half, second), hn::Sub(one, first_alpha));
            const V four = hn::Set(d, T(4)), third = hn::Set(d, T(1) / T(3));
            const auto step = [&](V halves, V once) { return hn::Mul(hn::MulSub(four, halves, once), third); };
            const V alpha = hn::Min(step(hn::Add(first_alpha, second_alpha), whole_alpha), one);
            // Where next to nothing is left of the opacity, its inverse would leave the format.
            const M some = hn::And(seen, hn::Gt(alpha, hn::Set(d, T(1e-30))));
            const V per_alpha = hn::Div(one, hn::IfThenElse(some, alpha, one));
            const auto mix = [&](V c, V c1, V c2) {
                const V halves = hn::MulAdd(first_alpha, c1, hn::Mul(second_alpha, c2));
                return hn::Mul(hn::Max(step(halves, hn::Mul(whole_alpha, c)), zero), per_alpha);
            };
            color = {mix(whole.red, first.red, second.red), mix(whole.green, first.green, second.green),
                     mix(whole.blue, first.blue, second.blue)};
            return hn::IfThenElseZero(some, alpha);
        });
    }

    template <bool perspective>
    HWY_NOINLINE bool classify(Crossings /*kind*/, EffectRow<T>& row) const {
        const D d;
        return classify_by(row, [&](int, int, M seen, Color<D>& color) {
            color = {hn::Set(d, shading_.iso_color[0]), hn::Set(d, shading_.iso_color[1]),
                     hn::Set(d, shading_.iso_color[2])};
            return hn::IfThenElseZero(seen, hn::Set(d, T(1)));
        });
    }

    HWY_INLINE void keep_color(EffectRow<T>& row, int number, const Color<D>& color) const {
        const D d;
        hn::Store(color.red, d, row.red + number);
        hn::Store(color.green, d, row.green + number);
        hn::Store(color.blue, d, row.blue + number);
    }

    template <bool perspective>
    HWY_NOINLINE void light(EffectRow<T>& row, const GradientScale<T>& scale) const {
        const D d;
        for_each_seen(row.alpha, row, [&](int x, int number, M visible) {
            keep_color(row, number,
                       shade<perspective>(d, shading_, color_of(d, row, number), against_of(d, row, number),
                                          scale.weakest, ray_if<perspective>(d, x, row.y), visible));
        });
    }

    template <bool perspective>
    HWY_NOINLINE void light_dimmed(EffectRow<T>& row, const GradientScale<T>& scale) const {
        const D d;
        const double depth = shading_.first_depth + static_cast<double>(window_.n) * shading_.slice_spacing;
        const auto in = [&](const VolumeLookup& lookup) {
            return VolumeRow<T>(lookup, perspective, shape_.x, shape_.y + row.y, depth, shading_.slice_spacing);
        };
        std::vector<VolumeRow<T>> rows;
        if (shading_.shadows) {
            for (const VolumeLookup& lookup : shading_.shadow_of) {
                rows.push_back(in(lookup));
            }
        }
        const VolumeRow<T> openness = in(shading_.openness);
        for_each_seen(row.alpha, row, [&](int x, int number, M visible) {
            const Dimming<D> dimming{d,
                                     rows,
                                     shading_.occlusion ? &openness : nullptr,
                                     shading_.occlusion_strength,
                                     hn::Iota(d, static_cast<T>(x)),
                                     hn::Load(d, row.share + number)};
            Color<D> color = color_of(d, row, number);
            if (shading_.lit) {
                color = shade<perspective>(d, shading_, color, against_of(d, row, number), scale.weakest,
                                           ray_if<perspective>(d, x, row.y), visible, dimming);
            } else {
                const V ambient = dimming.ambient();
                color = {hn::Mul(color.red, ambient), hn::Mul(color.green, ambient), hn::Mul(color.blue, ambient)};
            }
            keep_color(row, number, color);
        });
    }

    HWY_NOINLINE void cue(EffectRow<T>& row) const {
        const D d;
        const double depth = shading_.first_depth + static_cast<double>(window_.n) * shading_.slice_spacing;
        const auto share_of = [](double share) { return static_cast<T>(std::clamp(share, -1e30, 1e30)); };
        const V at_slice = hn::Set(d, share_of((depth - shading_.cue_start) * shading_.cue_per_depth));
        const V per_slice = hn::Set(d, share_of(shading_.slice_spacing * shading_.cue_per_depth));
        const V strength = hn::Set(d, shading_.cue_strength), zero = hn::Zero(d), one = hn::Set(d, T(1));
        for_each_seen(row.alpha, row, [&](int, int number, M) {
            const V way = hn::MulAdd(hn::Load(d, row.share + number), per_slice, at_slice);
            const V share = hn::Mul(hn::Min(hn::Max(way, zero), one), strength);
            const Color<D> color = color_of(d, row, number);
            const auto mix = [&](V from, T to) { return hn::MulAdd(share, hn::Sub(hn::Set(d, to), from), from); };
            keep_color(row, number,
                       {mix(color.red, shading_.cue_color[0]), mix(color.green, shading_.cue_color[1]),
                        mix(color.blue, shading_.cue_color[2])});
        });
    }

    template <class Kind>
    HWY_NOINLINE void put(Kind /*kind*/, const EffectRow<T>& row) const {
        const D d;
        for_each_seen(row.alpha, row, [&](int x, int number, M visible) {
            const std::ptrdiff_t at = in_plane(row.y) + x;
            put_behind(d, at, row.y, visible, hn::LoadU(d, picture_.alpha + at), hn::Load(d, row.alpha + number),
                       color_of(d, row, number));
        });
    }
    HWY_NOINLINE void put(Crossings /*kind*/, const EffectRow<T>& row) const {
        const D d;
        const double depth = shading_.first_depth + static_cast<double>(window_.n) * shading_.slice_spacing;
        for_each_seen(row.alpha, row, [&](int x, int number, M found) {
            put_surface(d, in_plane(row.y) + x, row.y, found, hn::Load(d, row.share + number), depth,
                        color_of(d, row, number));
        });
    }

    /// What is opaque, in front of all.
    HWY_INLINE void put_surface(D d, std::ptrdiff_t at, int y, M found, V share, double depth,
                                const Color<D>& color) const {
        const auto store = [&](T* plane, V value) {
            hn::StoreU(hn::IfThenElse(found, value, hn::LoadU(d, plane + at)), d, plane + at);
        };
        store(picture_.red, color.red);
        store(picture_.green, color.green);
        store(picture_.blue, color.blue);
        store(picture_.alpha, hn::Set(d, T(1)));
        if (picture_.depth != nullptr) {
            store(picture_.depth, hn::MulAdd(share, hn::Set(d, static_cast<T>(shading_.slice_spacing)),
                                             hn::Set(d, static_cast<T>(depth))));
        }
        end_pixels(d, y, found);
    }

    const Shading<T>& shading_;
    const TileShape& shape_;
    const SlabWindow<T>& window_;
    TilePicture<T>& picture_;
};

/// Adds slice n, or with preintegration and isosurfaces the interval from slice n to n + 1, to the picture of a tile.
/// Scalars and coverage come out in world units. All planes and sheets must hold numbers, paddings too (planes:
/// start them with 0, depth with infinity).
template <class T>
HWY_INLINE void shade_slab(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                           TilePicture<T>& picture) {
    SlabShader<T>(shading, shape, window, picture).run();
}

/// Adds what slice n takes of light that goes straight through it, as -ln(1 - alpha), to the plane alpha of a tile.
template <class T>
HWY_INLINE void absorb_slab(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                            TilePicture<T>& picture) {
    SlabShader<T>(shading, shape, window, picture).absorb();
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_SIMD_SHADE_INL

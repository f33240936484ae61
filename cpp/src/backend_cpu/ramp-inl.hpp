// Pre-integration: absorption and colour of the linear ramp between the values of two slices. Source: conventions
// section 4; [EKE01].

#if defined(SHEETSPLAT_CPU_RAMP_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_RAMP_INL
#undef SHEETSPLAT_CPU_RAMP_INL
#else
#define SHEETSPLAT_CPU_RAMP_INL
#endif

#include <limits>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

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
        // Near 0 the opacity is the more precise of the two, near 1 the clearness is.
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
            find_onwards(d, numbers, RampTable<T>::record, rho, records);
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

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RAMP_INL

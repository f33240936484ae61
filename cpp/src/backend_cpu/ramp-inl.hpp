// Pre-integration: absorption and colour of the linear ramp between the values of two slices. Source: conventions
// section 4; [EKE01].

#if defined(SHEETSPLAT_CPU_RAMP_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_RAMP_INL
#undef SHEETSPLAT_CPU_RAMP_INL
#else
#define SHEETSPLAT_CPU_RAMP_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
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

/// Values at which ramps end, and where there are many stretches those that they are in: where they begin and end, how
/// far into them the values are, colours, and absorption as a polynomial of that.
template <class D>
struct RampPlace {
    using V = hn::Vec<D>;
    static constexpr int terms = RampTable<hn::TFromD<D>>::degree + 1;
    V rho, x;
    V from, to, per_width;
    Color<D> color, color_step;
    V terms_of_absorption[(terms + 4) / 4 * 4]; ///< (Four are loaded at once.)
    LaneRecords<D> records;
};

template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void find_place(D d, const RampTable<T>& table, V rho, RampPlace<D>& place) {
    place.rho = rho;
    if (table.records.empty()) {
        return;
    }
    const T* numbers = table.records.data();
    Color<D>& color = place.color;
    Color<D>& step = place.color_step;
    const auto load_limits = [&]() {
        load_four(d, numbers, place.records.at, place.from, place.to, place.per_width, color.blue);
    };
    look_in_cells(d, table.cells, rho, place.records);
    load_limits();
    if (!hn::AllFalse(d, hn::Ge(rho, place.to))) {
        find_onwards(d, numbers, RampTable<T>::record, table.cells.records.back(), rho, place.records);
        load_limits();
    }
    load_four(d, numbers + 4, place.records.at, color.red, step.red, color.green, step.green);
    V* terms = place.terms_of_absorption;
    static_assert(RampTable<T>::first_term == 9, "three terms come with what they follow");
    load_four(d, numbers + 8, place.records.at, step.blue, terms[0], terms[1], terms[2]);
    for (int n = 3; n < RampPlace<D>::terms; n += 4) {
        load_four(d, numbers + RampTable<T>::first_term + n, place.records.at, terms[n], terms[n + 1], terms[n + 2],
                  terms[n + 3]);
    }
    // The outermost stretches reach to the largest numbers: differences from there are large, not infinite.
    place.x = hn::Min(hn::Mul(hn::Sub(rho, place.from), place.per_width), hn::Set(d, T(1)));
}

/// Adds what a ramp has between two places x of one stretch, times its share.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_within(D d, const RampPlace<D>& stretch, V a, V b, V share, RampSum<D>& sum) {
    // The mean of x^n is (a^n + a^(n-1) b + ... + b^n) / (n + 1), in which nothing cancels; terms hold the divisor.
    V powers = hn::Add(a, b), power = a;
    V plain = hn::MulAdd(stretch.terms_of_absorption[1], powers, stretch.terms_of_absorption[0]);
    V weighted = hn::Mul(stretch.terms_of_absorption[0], hn::Mul(powers, hn::Set(d, T(0.5))));
    for (int n = 1; n < RampPlace<D>::terms; ++n) {
        power = hn::Mul(power, a);
        powers = hn::MulAdd(b, powers, power);
        const V& term = stretch.terms_of_absorption[n];
        weighted =
            hn::MulAdd(hn::Mul(term, hn::Set(d, static_cast<T>(n + 1) / static_cast<T>(n + 2))), powers, weighted);
        if (n + 1 < RampPlace<D>::terms) {
            plain = hn::MulAdd(stretch.terms_of_absorption[n + 1], powers, plain);
        }
    }
    plain = hn::Max(plain, hn::Zero(d));
    sum.absorption = hn::MulAdd(share, plain, sum.absorption);
    const auto add = [&](V color, V step, V& to) {
        to = hn::MulAdd(share, hn::MulAdd(color, plain, hn::Mul(step, weighted)), to);
    };
    add(stretch.color.red, stretch.color_step.red, sum.color.red);
    add(stretch.color.green, stretch.color_step.green, sum.color.green);
    add(stretch.color.blue, stretch.color_step.blue, sum.color.blue);
}

/// From the stretch that a ramp begins in to the one that it ends in, and by integrals what lies between them.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void add_between(D d, const RampTable<T>& table, const RampPlace<D>& first, const RampPlace<D>& last,
                              const Ramps<D>& ramps, RampSum<D>& sum) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const auto up = hn::Ge(last.rho, first.rho);
    const V low = hn::IfThenElse(up, first.to, last.to);
    const auto longer = hn::AndNot(ramps.flat, hn::And(ramps.wanted, hn::Ge(ramps.high, low)));
    // The stretch's own end on the way to the other one; where both are the same, the other place.
    const V whole = hn::IfThenElseZero(ramps.wanted, one);
    const V end = hn::IfThenElse(longer, hn::IfThenElseZero(up, one), hn::IfThenElse(ramps.flat, first.x, last.x));
    const V way = hn::IfThenElseZero(longer, hn::Abs(hn::Sub(hn::IfThenElse(up, first.to, first.from), first.rho)));
    add_within(d, first, first.x, end, hn::IfThenElse(longer, hn::Mul(way, ramps.per_span), whole), sum);
    if (hn::AllFalse(d, longer)) {
        return;
    }
    const V begin = hn::IfThenElse(up, zero, one);
    const V rest = hn::IfThenElseZero(longer, hn::Abs(hn::Sub(last.rho, hn::IfThenElse(up, last.from, last.to))));
    add_within(d, last, last.x, begin, hn::Mul(rest, ramps.per_span), sum);
    // From where the stretch after the lower one starts to where the upper one does.
    constexpr auto record = static_cast<std::int32_t>(RampTable<T>::record);
    LaneRecords<D> lower, upper;
    for (std::size_t lane = 0; lane < hn::MaxLanes(D()); ++lane) {
        lower.at[lane] = std::min(first.records.at[lane], last.records.at[lane]) + record;
        upper.at[lane] = std::max(first.records.at[lane], last.records.at[lane]);
    }
    const V factor = hn::IfThenElseZero(longer, ramps.per_span);
    V from[2][4], lost[2][4];
    for (int side = 0; side < 2; ++side) {
        const T* numbers = table.records.data() + RampTable<T>::first_integral;
        const LaneRecords<D>& records = side == 0 ? lower : upper;
        load_four(d, numbers, records.at, from[side][0], lost[side][0], from[side][1], lost[side][1]);
        load_four(d, numbers + 4, records.at, from[side][2], lost[side][2], from[side][3], lost[side][3]);
    }
    const auto add = [&](int which, V& to) {
        const V between = hn::Add(hn::Sub(from[1][which], from[0][which]), hn::Sub(lost[1][which], lost[0][which]));
        to = hn::MulAdd(between, factor, to);
    };
    add(0, sum.absorption);
    add(1, sum.color.red);
    add(2, sum.color.green);
    add(3, sum.color.blue);
    sum.absorption = hn::Max(sum.absorption, zero);
}

/// Over the linear ramp between the values of two places, per reference length.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE RampSum<D> ramp_sum(D d, const RampTable<T>& table, const RampPlace<D>& first, const RampPlace<D>& last,
                               hn::Mask<D> wanted) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const V low = hn::Min(first.rho, last.rho), high = hn::Max(first.rho, last.rho);
    const V span = hn::Sub(high, low);
    // Where the reciprocal would overflow the ramp is as good as one value.
    const auto flat = hn::Lt(span, hn::Set(d, std::numeric_limits<T>::min() * T(16)));
    const Ramps<D> ramps{low, high, hn::Div(one, hn::IfThenElse(flat, one, span)), flat, wanted};
    RampSum<D> sum{zero, {zero, zero, zero}};
    if (table.records.empty()) {
        walk_stretches(d, table, ramps, sum);
    } else {
        add_between(d, table, first, last, ramps, sum);
    }
    return sum;
}

/// Mean absorption per reference length, and the colour that goes with it.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V absorption_of(D d, const RampSum<D>& sum, Color<D>& color) {
    const V divisor = hn::IfThenElse(hn::Gt(sum.absorption, hn::Zero(d)), sum.absorption, hn::Set(d, hn::TFromD<D>(1)));
    color = {hn::Div(sum.color.red, divisor), hn::Div(sum.color.green, divisor), hn::Div(sum.color.blue, divisor)};
    return sum.absorption;
}

/// Of the linear ramp between two values.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V ramp_absorption(D d, const RampTable<T>& table, V rho_from, V rho_to, hn::Mask<D> wanted,
                             Color<D>& color) {
    RampPlace<D> first, last;
    find_place(d, table, rho_from, first);
    find_place(d, table, rho_to, last);
    return absorption_of(d, ramp_sum(d, table, first, last, wanted), color);
}

/// Of the ramp from `first` by way of `middle` to `last`: its two halves, and the whole one as if there were no middle.
template <class D>
struct RampHalves {
    RampSum<D> whole, front, back;
};
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE RampHalves<D> ramp_halves(D d, const RampTable<T>& table, V first_rho, V middle_rho, V last_rho,
                                     hn::Mask<D> wanted) {
    RampPlace<D> first, middle, last;
    find_place(d, table, first_rho, first);
    find_place(d, table, middle_rho, middle);
    find_place(d, table, last_rho, last);
    RampHalves<D> found;
    found.front = ramp_sum(d, table, first, middle, wanted);
    found.back = ramp_sum(d, table, middle, last, wanted);
    // Where the middle lies between the ends, the whole ramp is what the halves have, each as long as it is.
    const V to_middle = hn::Abs(hn::Sub(middle_rho, first_rho)), onwards = hn::Abs(hn::Sub(last_rho, middle_rho));
    const V both = hn::Add(to_middle, onwards);
    const auto inside =
        hn::And(hn::Ge(middle_rho, hn::Min(first_rho, last_rho)), hn::Le(middle_rho, hn::Max(first_rho, last_rho)));
    const auto some = hn::Gt(both, hn::Set(d, std::numeric_limits<T>::min() * T(16)));
    const V share = hn::Div(hn::IfThenElseZero(some, to_middle), hn::IfThenElse(some, both, hn::Set(d, T(1))));
    const auto mixed = [&](V front, V back) {
        return hn::MulAdd(share, front, hn::Mul(hn::Sub(hn::Set(d, T(1)), share), back));
    };
    found.whole = {mixed(found.front.absorption, found.back.absorption),
                   {mixed(found.front.color.red, found.back.color.red),
                    mixed(found.front.color.green, found.back.color.green),
                    mixed(found.front.color.blue, found.back.color.blue)}};
    const auto outside = hn::AndNot(inside, wanted);
    if (!hn::AllFalse(d, outside)) {
        const RampSum<D> own = ramp_sum(d, table, first, last, outside);
        const auto chosen = [&](V of_halves, V of_its_own) { return hn::IfThenElse(outside, of_its_own, of_halves); };
        found.whole = {chosen(found.whole.absorption, own.absorption),
                       {chosen(found.whole.color.red, own.color.red), chosen(found.whole.color.green, own.color.green),
                        chosen(found.whole.color.blue, own.color.blue)}};
    }
    return found;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RAMP_INL

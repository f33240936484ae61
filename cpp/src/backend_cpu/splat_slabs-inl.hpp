// The splat loop of slab sampling: means over each pixel's chord through a kernel. Source: conventions, section 3.

#if defined(SHEETSPLAT_CPU_SPLAT_SLABS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_SLABS_INL
#undef SHEETSPLAT_CPU_SPLAT_SLABS_INL
#else
#define SHEETSPLAT_CPU_SPLAT_SLABS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "splat_spheres-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Gauss-Legendre nodes on [-1, 1], one of each pair.
template <class T>
struct Nodes4 {
    static constexpr int pairs = 2;
    static constexpr T node[2] = {T(0.33998104358485626), T(0.86113631159405258)};
    static constexpr T share[2] = {T(0.65214515486254614), T(0.34785484513745386)};
};
template <class T>
struct Nodes6 {
    static constexpr int pairs = 3;
    static constexpr T node[3] = {T(0.23861918608319691), T(0.66120938646626451), T(0.93246951420315203)};
    static constexpr T share[3] = {T(0.46791393457269104), T(0.36076157304813861), T(0.17132449237917036)};
};

/// The integral of exp(-t^2) over t > 0.
template <class T>
constexpr T half_root_pi = T(0.88622692545275801);

template <class Nodes, bool slopes, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V quadrature(D d, V low, V high, V nearest, V scale, V beside, V& moment) {
    const V half = hn::Mul(hn::Sub(high, low), hn::Set(d, T(0.5)));
    const V middle = hn::Sub(hn::Mul(hn::Add(high, low), hn::Set(d, T(0.5))), nearest);
    V sum = hn::Zero(d), weighted = hn::Zero(d);
    for (int n = 0; n < Nodes::pairs; ++n) {
        const V off = hn::Mul(half, hn::Set(d, Nodes::node[n]));
        const V a = hn::Sub(middle, off), b = hn::Add(middle, off);
        const V bell_a = exp2_nonpositive(d, hn::Mul(scale, hn::Mul(a, a)));
        const V bell_b = exp2_nonpositive(d, hn::Mul(scale, hn::Mul(b, b)));
        sum = hn::MulAdd(hn::Set(d, Nodes::share[n]), hn::Add(bell_a, bell_b), sum);
        if constexpr (slopes) {
            weighted = hn::MulAdd(hn::Set(d, Nodes::share[n]), hn::MulAdd(a, bell_a, hn::Mul(b, bell_b)), weighted);
        }
    }
    if constexpr (slopes) {
        moment = hn::Mul(hn::Mul(weighted, half), beside);
    }
    return hn::Mul(hn::Mul(sum, half), beside);
}

/// Integral of p exp2(scale p^2) times `beside` over p = low - nearest ... high - nearest; scale = -log2(e) rate^2.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V moment_over(D d, V low, V high, V nearest, V scale, V rate, V beside) {
    const V a = hn::Sub(low, nearest), b = hn::Sub(high, nearest);
    const V over =
        hn::Sub(exp2_nonpositive(d, hn::Mul(scale, hn::Mul(a, a))), exp2_nonpositive(d, hn::Mul(scale, hn::Mul(b, b))));
    return hn::Div(hn::Mul(hn::Mul(over, beside), hn::Set(d, T(0.5))), hn::Mul(rate, rate));
}

template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V closed_form(D d, V low, V high, V nearest, V rate, V beside) {
    const V a = erf(d, hn::Mul(rate, hn::Sub(low, nearest)));
    const V b = erf(d, hn::Mul(rate, hn::Sub(high, nearest)));
    return hn::Mul(hn::Mul(beside, hn::Set(d, half_root_pi<T>)), hn::Div(hn::Sub(b, a), rate));
}

/// Adds a kernel's value (and weight). Where a steep profile has nothing left, or a difference of two erf cancels, rays
/// that meet the support still do: the point is not empty. Returns what add_bell does.
template <Sums sums, bool slopes, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V add_reached(D d, V bell, hn::Mask<D> met, V value, V weight, const Target<T>& to, std::ptrdiff_t at) {
    if constexpr (sums != Sums::from_first) {
        add_bell<Sums::values, slopes>(d, bell, value, weight, to.value + at, nullptr, to.sheet);
    }
    if constexpr (sums != Sums::values) {
        const V least = hn::IfThenElseZero(met, hn::Set(d, std::numeric_limits<T>::min()));
        const V added = hn::Max(hn::Mul(weight, hn::Max(bell, hn::Zero(d))), least);
        if constexpr (sums == Sums::from_first) {
            return add_from_first<slopes>(d, added, value, to.value + at, to.weight + at, to.sheet);
        }
        hn::StoreU(hn::Add(hn::LoadU(d, to.weight + at), added), d, to.weight + at);
    }
    return value;
}

/// The mean of a Gaussian over a slab that a ray crosses inside the support. At q in the slab's middle, with q changing
/// by w from slice to slice along the ray,
///     mean of exp(-k |q + z w|^2) over |z| < 1/2 = exp(-k |q|^2) mean of exp(-k w^2 z^2) cosh(2 k q.w z),
/// the second factor being a power series in (k q.w)^2 whose terms are all positive.
template <class T>
struct SlabSeries {
    static constexpr int terms = sizeof(T) == 4 ? 9 : 18;
    T c[terms];

    /// Whether the series has enough terms. k: falloff; w: length.
    [[nodiscard]] static HWY_INLINE bool holds(T k, T w) { return k * w <= longest_series<T>; }

    HWY_INLINE SlabSeries(T k, T w) {
        // m_j, means of t^2j exp(-s t^2) over 0 < t < 1: (2 j + 1) m_j = exp(-s) + 2 s m_(j + 1), from where what is
        // further on does not show.
        const double s = 0.25 * static_cast<double>(k) * static_cast<double>(w) * static_cast<double>(w);
        const double end = std::exp(-s);
        double m = end * factors.per_odd[terms + ahead];
        for (int j = terms + ahead - 1; j >= 0; --j) {
            m = (end + 2.0 * s * m) * factors.per_odd[j];
            if (j < terms) {
                c[j] = static_cast<T>(m * factors.per_factorial[j]);
            }
        }
    }

  private:
    static constexpr int ahead = 12;
    struct Factors {
        double per_odd[terms + ahead + 1] = {}, per_factorial[terms] = {}; ///< 1 / (2 j + 1), 1 / (2 j)!
        constexpr Factors() {
            double product = 1.0;
            for (int j = 0; j <= terms + ahead; ++j) {
                per_odd[j] = 1.0 / (2.0 * j + 1.0);
                if (j < terms) {
                    product *= j > 0 ? (2.0 * j - 1.0) * 2.0 * j : 1.0;
                    per_factorial[j] = 1.0 / product;
                }
            }
        }
    };
    static constexpr Factors factors{};
};

/// Of a kernel in an orthographic view: the pixels of each row that its silhouette holds, and those that a slab of it
/// can touch, a pixel more on each side.
template <class T>
struct SlabBounds {
    std::int16_t first[most_edge], past[most_edge]; ///< by row, from that of the box on

    HWY_INLINE SlabBounds(const Section<T>& section, const RowShape<T>& shape, const Rect& box)
        : section_(section), shape_(shape), box_(box) {
        // |q x w|^2 < w^2 where a ray meets the support, a quadratic in x; u: the change of q x w from pixel to pixel.
        const double w1 = shape.d1, w2 = shape.d2, w3 = shape.ds, X = shape.X;
        const double speed2 = w1 * w1 + w2 * w2 + w3 * w3, q3 = section.s;
        const double per_u2 = 1.0 / std::max(X * X * (w2 * w2 + w3 * w3), 1e-300);
        for (int y = box.y0; y < box.y1; ++y) {
            const double q1 = static_cast<double>(shape.Y1) * y + static_cast<double>(section.a1);
            const double q2 = static_cast<double>(shape.Y2) * y + static_cast<double>(section.a2);
            const double c1 = q2 * w3 - q3 * w2, c2 = q3 * w1 - q1 * w3, c3 = q1 * w2 - q2 * w1;
            const double slope = X * (w2 * c3 - w3 * c2), rest = c1 * c1 + c2 * c2 + c3 * c3 - speed2;
            const double nearest = -slope * per_u2, inside = nearest * nearest - rest * per_u2;
            const double half = std::sqrt(std::max(inside, 0.0));
            const int row = y - box.y0;
            // (Where rounding of the sums in T could count, rows stay.)
            const bool met = inside > -0.01 * speed2 * per_u2;
            first[row] = pixel(nearest - half - 1.0, box.x0, box.x1);
            past[row] = met ? pixel(nearest + half + 2.0, box.x0, box.x1) : first[row];
        }
    }

    /// Of slice section.first + along.
    [[nodiscard]] HWY_INLINE Rect of_slab(double along) const {
        const double d1 = shape_.d1, d2 = shape_.d2, ds = shape_.ds, Y1 = shape_.Y1, Y2 = shape_.Y2;
        const double s = section_.s + along * ds;
        // From the slab's ends, where they are in the support, or where the support ends.
        const double a = std::clamp(s - 0.5 * ds, -1.0, 1.0), b = std::clamp(s + 0.5 * ds, -1.0, 1.0);
        const double height = std::min(std::abs(a), std::abs(b));
        const double radius = a * b <= 0.0 ? 1.0 : std::sqrt(1.0 - height * height);
        const auto middle = [&](double at) {
            const double z = along + (at - s) / ds;
            const double y = -(static_cast<double>(section_.a2) + z * d2) / Y2;
            const double x = -(static_cast<double>(section_.a1) + z * d1 + Y1 * y) / static_cast<double>(shape_.X);
            return std::pair<double, double>{x, y};
        };
        const auto [ax, ay] = middle(a);
        const auto [bx, by] = middle(b);
        const double reach_y = radius / std::abs(Y2);
        const double reach_x = std::sqrt(radius * radius + Y1 * Y1 * reach_y * reach_y) / static_cast<double>(shape_.X);
        return {pixel(std::min(ax, bx) - reach_x - 1.0, box_.x0, box_.x1),
                pixel(std::min(ay, by) - reach_y - 1.0, box_.y0, box_.y1),
                pixel(std::max(ax, bx) + reach_x + 2.0, box_.x0, box_.x1),
                pixel(std::max(ay, by) + reach_y + 2.0, box_.y0, box_.y1)};
    }

  private:
    [[nodiscard]] static HWY_INLINE std::int16_t pixel(double at, int low, int high) {
        return static_cast<std::int16_t>(std::min(std::max(at, static_cast<double>(low)), static_cast<double>(high)));
    }

    const Section<T>& section_;
    const RowShape<T>& shape_;
    const Rect box_;
};

/// Means over slabs along the rays of the pixels: a series where they cross the slab inside the support, else closed
/// form over the chord where it is long against the Gaussian, quadrature where the difference of two erf would cancel.
template <Sums sums, bool perspective, class T, bool slopes>
HWY_INLINE int add_slabs(Splat<T, slopes>& splat, const Section<T>& section, T weight_t, const RowShape<T>& shape,
                         int count, const Rect& box) {
    if (!splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    // (Wider vectors would cross the end of the support in most places.)
    const hn::CappedTag<T, 8> d;
    using V = hn::Vec<decltype(d)>;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const V zero = hn::Zero(d), one = hn::Set(d, T(1)), half_slab = hn::Set(d, T(0.5));
    const V k = hn::Set(d, -splat.profile.falloff_log2), edge = hn::Set(d, splat.profile.edge);
    const V root_k = hn::Set(d, splat.profile.root_falloff);
    const V value = hn::Set(d, section.value), weight = hn::Set(d, weight_t);
    const Steepness<sums, T> steepness(splat.steep(), section.value, weight_t);
    const V w3 = hn::Set(d, shape.ds);
    // Orthographic: rays are alike.
    const T k_t = splat.profile.root_falloff * splat.profile.root_falloff;
    const T way2 = shape.d1 * shape.d1 + shape.d2 * shape.d2 + shape.ds * shape.ds, way = std::sqrt(way2);
    const T rate_t = splat.profile.root_falloff * way;
    const bool in_series = !perspective && !slopes && SlabSeries<T>::holds(k_t, way);
    const SlabSeries<T> series(k_t, in_series ? way : T(0));
    const SlabBounds<T> bounds(section, shape, perspective ? Rect{} : box);
    int drawn = 0;
    for (int slice = 0; slice < count; ++slice) {
        const std::int32_t n = splat.n + slice;
        const T along = static_cast<T>(n - section.first);
        const Rect part = perspective ? box : bounds.of_slab(static_cast<double>(along));
        if (part.empty()) {
            continue;
        }
        const T t = perspective ? splat.depth_of(n) : T(1);
        const T X = shape.X * t, Y1 = shape.Y1 * t, Y2 = shape.Y2 * t;
        // Along a pixel's ray q changes by w from slice to slice; in perspective rays part.
        const T spread = perspective ? static_cast<T>(splat.setup.slice_spacing) : T(0);
        const T a1 = section.a1 + along * shape.d1, a2 = section.a2 + along * shape.d2;
        const T height = section.s + along * shape.ds;
        const V q3 = hn::Set(d, height);
        const Target<T>& to = splat.targets[slice];
        bool any = false;
        for (int y = part.y0; y < part.y1; ++y) {
            const T row = static_cast<T>(y);
            const T across = Y2 * row + a2;
            const V q2 = hn::Set(d, across), b = hn::Set(d, Y1 * row + a1);
            const V others2 = hn::Set(d, across * across + height * height);
            const V others = hn::Set(d, across * shape.d2 + height * shape.ds);
            const int x0 = perspective ? part.x0 : std::max<int>(part.x0, bounds.first[y - box.y0]);
            const int x1 = perspective ? part.x1 : std::min<int>(part.x1, bounds.past[y - box.y0]);
            const V w2 = hn::Set(d, spread * shape.Y2 * row + shape.d2);
            const V w1_row = hn::Set(d, spread * shape.Y1 * row + shape.d1);
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * to.stride;
            for (int x = x0; x < x1; x += lanes) {
                const V column = hn::Iota(d, static_cast<T>(x));
                const V q1 = hn::MulAdd(hn::Set(d, X), column, b);
                if (in_series) {
                    const V along_ray = hn::MulAdd(q1, hn::Set(d, shape.d1), others);
                    const V squared = hn::MulAdd(q1, q1, others2);
                    // Where the slab ends: |q +- w / 2|^2.
                    const V farthest = hn::Add(hn::Add(squared, hn::Abs(along_ray)), hn::Set(d, T(0.25) * way2));
                    if (hn::AllTrue(d, hn::Le(farthest, one))) {
                        any = true;
                        const V turn = hn::Mul(hn::Set(d, k_t), along_ray);
                        const V mean = hn::Mul(exp2_nonpositive(d, hn::Mul(k, squared)),
                                               polynomial(d, hn::Mul(turn, turn), series.c));
                        add_reached<sums, slopes>(d, hn::Sub(mean, edge), hn::Gt(one, zero), value, weight, to, at + x);
                        continue;
                    }
                }
                const V w1 = hn::MulAdd(hn::Set(d, spread * shape.X), column, w1_row);
                // The ray's nearest approach to the centre, by the cross product: nothing cancels there.
                const V c1 = hn::MulSub(q2, w3, hn::Mul(q3, w2));
                const V c2 = hn::MulSub(q3, w1, hn::Mul(q1, w3));
                const V c3 = hn::MulSub(q1, w2, hn::Mul(q2, w1));
                const V speed2 = hn::MulAdd(w1, w1, hn::MulAdd(w2, w2, hn::Mul(w3, w3)));
                const V per_speed2 = hn::Div(one, speed2);
                const V p2 = hn::Mul(hn::MulAdd(c1, c1, hn::MulAdd(c2, c2, hn::Mul(c3, c3))), per_speed2);
                const V nearest = hn::Neg(hn::Mul(hn::MulAdd(q1, w1, hn::MulAdd(q2, w2, hn::Mul(q3, w3))), per_speed2));
                const V half_chord = hn::Sqrt(hn::Mul(hn::Max(hn::Sub(one, p2), zero), per_speed2));
                const V low = hn::Min(hn::Max(hn::Sub(nearest, half_chord), hn::Neg(half_slab)), half_slab);
                const V high = hn::Min(hn::Max(hn::Add(nearest, half_chord), low), half_slab);
                const V length = hn::Sub(high, low);
                if (hn::AllTrue(d, hn::Le(length, zero))) {
                    continue;
                }
                any = true;
                const V rate = hn::Mul(root_k, hn::Sqrt(speed2)); // Gaussian's own lengths per slab
                const V widest = hn::Mul(rate, length);
                const V beside = exp2_nonpositive(d, hn::Mul(k, p2));
                V mean;
                // Of the way along the ray from its nearest approach, times the Gaussian: where slopes are summed.
                V moment = zero;
                if (!perspective && rate_t <= thinnest_slab<T>) {
                    mean = quadrature<Nodes4<T>, slopes>(d, low, high, nearest, hn::Mul(k, speed2), beside, moment);
                } else if (hn::AllTrue(d, hn::Lt(widest, hn::Set(d, thin_slab<T>)))) {
                    mean = quadrature<Nodes6<T>, slopes>(d, low, high, nearest, hn::Mul(k, speed2), beside, moment);
                } else {
                    mean = closed_form(d, low, high, nearest, rate, beside);
                    if constexpr (slopes) {
                        moment = moment_over(d, low, high, nearest, hn::Mul(k, speed2), rate, beside);
                    }
                }
                const V rest = hn::Sub(mean, hn::Mul(edge, length));
                const V apart = add_reached<sums, slopes>(d, rest, hn::Gt(length, zero), value, weight, to, at + x);
                if constexpr (slopes) {
                    // The mean of q times the Gaussian: at the ray's nearest approach q is w x (q x w) / w^2.
                    const V share = hn::Mul(mean, per_speed2);
                    const V m1 = hn::MulAdd(moment, w1, hn::Mul(share, hn::MulSub(w2, c3, hn::Mul(w3, c2))));
                    const V m2 = hn::MulAdd(moment, w2, hn::Mul(share, hn::MulSub(w3, c1, hn::Mul(w1, c3))));
                    const V m3 = hn::MulAdd(moment, w3, hn::Mul(share, hn::MulSub(w1, c2, hn::Mul(w2, c1))));
                    const Slope<hn::CappedTag<T, 8>> slope{hn::Mul(m1, hn::Set(d, X)),
                                                           hn::MulAdd(m1, hn::Set(d, Y1), hn::Mul(m2, hn::Set(d, Y2))),
                                                           hn::MulAdd(m1, w1, hn::MulAdd(m2, w2, hn::Mul(m3, w3)))};
                    const V there = hn::IfThenElseZero(hn::Gt(length, zero), hn::Set(d, steepness.scale));
                    add_slope<sums>(d, there, slope, steepness.beside_weight(d, apart), to, at + x);
                }
            }
        }
        if (any) {
            splat.single[slice].add(part);
            ++drawn;
        }
    }
    return drawn;
}

/// Means over the slabs of a leaning kernel in an orthographic view. Along each ray, with s the way from its nearest
/// approach in the unit sphere and p that approach's distance, the lowered profile's integral
///     exp(-k p^2) (integral of exp(-k t^2) over 0 < t < s)  -  exp(-k) s
/// is taken at the slabs' ends, or where the ray leaves the kernel: neighbouring slabs share one, and what depends on
/// the ray alone is found once for all slabs.
template <Sums sums, class D, class T, bool slopes>
HWY_INLINE int leaning_slabs(D d, Splat<T, slopes>& splat, const Section<T>& section, T weight_t,
                             const RowShape<T>& shape, int count, const Rect& box, const SlabBounds<T>& bounds) {
    using V = hn::Vec<D>;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const V zero = hn::Zero(d), one = hn::Set(d, T(1)), two = hn::Set(d, T(2));
    const V value = hn::Set(d, section.value), weight = hn::Set(d, weight_t);
    const V minus_k = hn::Set(d, -splat.profile.falloff_log2);
    const T way2 = shape.d1 * shape.d1 + shape.d2 * shape.d2 + shape.ds * shape.ds, way_t = std::sqrt(way2);
    const T per_way_t = T(1) / way_t;
    const V way = hn::Set(d, way_t), per_way = hn::Set(d, per_way_t), per_way2 = hn::Set(d, per_way_t * per_way_t);
    const V edge = hn::Set(d, splat.profile.edge * per_way_t);
    const V w1 = hn::Set(d, shape.d1), w2 = hn::Set(d, shape.d2), w3 = hn::Set(d, shape.ds);
    const T along = static_cast<T>(splat.n - section.first);
    const T a1 = section.a1 + along * shape.d1, a2 = section.a2 + along * shape.d2;
    const T q3_t = section.s + along * shape.ds;
    bool any[covered_slices] = {};
    for (int y = box.y0; y < box.y1; ++y) {
        const int x0 = bounds.first[y - box.y0], x1 = bounds.past[y - box.y0];
        const T q2_t = shape.Y2 * static_cast<T>(y) + a2;
        const V b = hn::Set(d, shape.Y1 * static_cast<T>(y) + a1);
        const V q2 = hn::Set(d, q2_t), q3 = hn::Set(d, q3_t);
        const T c1 = q2_t * shape.ds - q3_t * shape.d2;
        const V c1_squared = hn::Set(d, c1 * c1), others = hn::Set(d, q2_t * shape.d2 + q3_t * shape.ds);
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * splat.targets[0].stride;
        for (int x = x0 & ~(lanes - 1); x < x1; x += lanes) {
            const V q1 = hn::MulAdd(hn::Set(d, shape.X), hn::Iota(d, static_cast<T>(x)), b);
            // By the cross product: nothing cancels there.
            const V c2 = hn::MulSub(q3, w1, hn::Mul(q1, w3)), c3 = hn::MulSub(q1, w2, hn::Mul(q2, w1));
            const V p2 = hn::Mul(hn::MulAdd(c2, c2, hn::MulAdd(c3, c3, c1_squared)), per_way2);
            const V inside = hn::Sub(one, p2);
            const auto met = hn::Gt(inside, zero);
            if (hn::AllFalse(d, met)) {
                continue;
            }
            const V half_chord = hn::Sqrt(hn::Max(inside, zero)), back = hn::Neg(half_chord);
            const V here = hn::Mul(hn::MulAdd(q1, w1, others), per_way);
            const V far = hn::Set(d, T(1e6));
            const T entered = hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(met, hn::Sub(back, here), far)));
            const T left = hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElse(met, hn::Sub(half_chord, here), hn::Neg(far))));
            const int first = whole(std::floor(entered * per_way_t + T(0.5)), 0, count);
            const int past = whole(std::ceil(left * per_way_t - T(0.5)) + T(1), 0, count);
            const V bell = hn::Mul(exp2_nonpositive(d, hn::Mul(minus_k, p2)), per_way);
            V end;
            const auto integral_to = [&](int number) SHEETSPLAT_CPU_INLINE {
                const V at = hn::MulAdd(hn::Set(d, static_cast<T>(number) - T(0.5)), way, here);
                end = hn::Min(hn::Max(at, back), half_chord);
                const V place = hn::MulSub(hn::Mul(end, end), two, one);
                return hn::Mul(end, hn::MulSub(bell, polynomial(d, place, splat.profile.integral), edge));
            };
            V before = integral_to(first);
            for (int slice = first; slice < past; ++slice) {
                const V begin = end, after = integral_to(slice + 1);
                any[slice] = true;
                add_reached<sums, slopes>(d, hn::Sub(after, before), hn::Gt(end, begin), value, weight,
                                          splat.targets[slice], row + x);
                before = after;
            }
        }
    }
    int drawn = 0;
    for (int slice = 0; slice < count; ++slice) {
        if (any[slice]) {
            const Rect part = bounds.of_slab(static_cast<double>(along) + slice);
            splat.single[slice].add(part.empty() ? box : part);
            ++drawn;
        }
    }
    return drawn;
}

template <Sums sums, class T, bool slopes>
HWY_INLINE int add_leaning_slabs(Splat<T, slopes>& splat, const Section<T>& section, T weight, const RowShape<T>& shape,
                                 int count, const Rect& box) {
    if (!splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    const SlabBounds<T> bounds(section, shape, box);
    // Wide vectors hold rays that cross other slabs.
    const T way2 = shape.d1 * shape.d1 + shape.d2 * shape.d2 + shape.ds * shape.ds;
    const bool alike = std::abs(shape.X * shape.d1) * T(8) < way2;
    if (alike && box.x1 - box.x0 > 24) {
        return leaning_slabs<sums>(hn::CappedTag<T, 16>(), splat, section, weight, shape, count, box, bounds);
    }
    return leaning_slabs<sums>(hn::CappedTag<T, 8>(), splat, section, weight, shape, count, box, bounds);
}

/// The slabs of a kernel along rays that are one of its axes: where they end along it, from back to front as q3 falls,
/// and the Gaussian's integral from 0 to there, over a slab's thickness.
template <class T>
struct SlabEnds {
    static constexpr int room = covered_slices + 16;
    HWY_ALIGN T place[room];
    HWY_ALIGN T integral[room];
    HWY_ALIGN T lowered[room]; ///< what the profile is lowered by, integrated likewise
    T per_thickness;

    template <class D>
    HWY_INLINE SlabEnds(D d, T first_end, T step, int ends, T root_k, T edge) : per_thickness(T(-1) / step) {
        using V = hn::Vec<D>;
        const V whole = hn::Set(d, half_root_pi<T> * per_thickness / root_k);
        for (int end = 0; end < ends; end += static_cast<int>(hn::Lanes(d))) {
            const V at = hn::MulAdd(hn::Set(d, step), hn::Iota(d, static_cast<T>(end)), hn::Set(d, first_end));
            hn::Store(at, d, place + end);
            hn::Store(hn::Mul(whole, erf(d, hn::Mul(hn::Set(d, root_k), at))), d, integral + end);
            hn::Store(hn::Mul(hn::Set(d, edge * per_thickness), at), d, lowered + end);
        }
    }
};

/// As separable_rows, of means over slabs: a difference of the profile's integral between the ends of each slab or, on
/// rays that leave the kernel inside it, to where they do.
template <Sums sums, class D, class T>
HWY_INLINE void upright_slabs(D d, const Target<T>* to, int count, const SlabEnds<T>& ends, const T* bell_y,
                              const T* place_y2, T X, T at_x, T falloff_log2, T root_k, T edge_t, T value_t, T weight_t,
                              int x0, int x1, int y0, int y1) {
    using V = hn::Vec<D>;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const V zero = hn::Zero(d), one = hn::Set(d, T(1));
    const V value = hn::Set(d, value_t), weight = hn::Set(d, weight_t);
    const V whole = hn::Set(d, half_root_pi<T> * ends.per_thickness / root_k);
    const V edge = hn::Set(d, edge_t * ends.per_thickness), rate = hn::Set(d, root_k);
    for (int x = x0; x < x1; x += lanes) {
        const V q1 = hn::MulAdd(hn::Set(d, X), hn::Iota(d, static_cast<T>(x - x0)), hn::Set(d, at_x));
        const V q1_squared = hn::Mul(q1, q1);
        const V bell_x = exp2_nonpositive(d, hn::Mul(hn::Set(d, -falloff_log2), q1_squared));
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0) * to[0].stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += to[0].stride) {
            const V squared = hn::Sub(hn::Sub(one, hn::Set(d, place_y2[y])), q1_squared);
            const V half_chord = hn::Sqrt(hn::Max(squared, zero));
            const auto met = hn::Gt(squared, zero);
            if (hn::AllFalse(d, met)) {
                continue;
            }
            const V bell = hn::Mul(bell_x, hn::Set(d, bell_y[y]));
            const V here = hn::Mul(bell, whole);
            const V last = hn::MulSub(here, erf(d, hn::Mul(rate, half_chord)), hn::Mul(edge, half_chord));
            const V back = hn::Neg(half_chord);
            const auto integral_to = [&](int end) {
                const V place = hn::Set(d, ends.place[end]);
                const V inside = hn::MulSub(bell, hn::Set(d, ends.integral[end]), hn::Set(d, ends.lowered[end]));
                return hn::IfThenElse(hn::Ge(place, half_chord), last,
                                      hn::IfThenElse(hn::Le(place, back), hn::Neg(last), inside));
            };
            V before = integral_to(0);
            for (int slice = 0; slice < count; ++slice) {
                const V after = integral_to(slice + 1);
                const V rest = hn::Sub(before, after);
                const auto reached = hn::And(met, hn::And(hn::Lt(hn::Set(d, ends.place[slice + 1]), half_chord),
                                                          hn::Gt(hn::Set(d, ends.place[slice]), back)));
                add_reached<sums, false>(d, rest, reached, value, weight, to[slice], at);
                before = after;
            }
        }
    }
}

/// Kernels whose sections are upright ellipses in one place, in orthographic views: the profile is a product, and what
/// depends on depth is the same for all pixels whose rays stay inside the kernel.
template <Sums sums, class T, bool slopes>
HWY_INLINE int add_upright_slabs(Splat<T, slopes>& splat, const Section<T>& section, T weight, const RowShape<T>& shape,
                                 int count, const Rect& box) {
    if (!splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    const T k = splat.profile.falloff_log2, root_k = splat.profile.root_falloff, edge = splat.profile.edge;
    HWY_ALIGN T bell_y[most_edge];
    HWY_ALIGN T place_y2[most_edge];
    const T at_y = section.a2 + shape.Y2 * static_cast<T>(box.y0);
    bells(hn::CappedTag<T, 8>(), k, at_y, shape.Y2, box.y1 - box.y0, bell_y);
    for (int y = 0; y < box.y1 - box.y0; ++y) {
        const T place = at_y + shape.Y2 * static_cast<T>(y);
        place_y2[y] = place * place;
    }
    const T first_end = section.s + (static_cast<T>(splat.n - section.first) - T(0.5)) * shape.ds;
    const SlabEnds<T> ends(hn::CappedTag<T, 16>(), first_end, shape.ds, count + 1, root_k, edge);
    in_narrowest<T>(box.x1 - box.x0, [&](auto d) {
        const int start = start_of<T>(box.x0, box.x1, static_cast<int>(hn::Lanes(d)));
        upright_slabs<sums>(d, splat.targets, count, ends, bell_y, place_y2, shape.X,
                            section.a1 + shape.X * static_cast<T>(start), k, root_k, edge, section.value, weight, start,
                            box.x1, box.y0, box.y1);
    });
    splat.through[count - 1].add(box);
    return count;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_SLABS_INL

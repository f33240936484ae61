// The splat loops of slab sampling: means over each pixel's chord through a kernel. Source: conventions, section 3.

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
#include <iterator>
#include <limits>
#include <utility>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "splat_spheres-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// The integral of exp(-t^2) over t > 0.
template <class T>
constexpr T half_root_pi = T(0.88622692545275801);

/// Adds a kernel's shares. Where a steep profile has nothing left, or a difference of integrals cancels, rays that meet
/// the support still do: the point is not empty.
template <Sums sums, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_reached(D d, V bell, hn::Mask<D> met, const Shares<D>& shares, const Target<T>& to,
                            std::ptrdiff_t at) {
    const V t = hn::Max(bell, hn::Zero(d));
    const auto add = [&](V share, T* sheet) { hn::StoreU(hn::MulAdd(share, t, hn::LoadU(d, sheet)), d, sheet); };
    add(shares.value, to.value + at);
    if constexpr (sums != Sums::values) {
        const V least = hn::IfThenElseZero(met, hn::Set(d, std::numeric_limits<T>::min()));
        const V added = hn::Max(hn::Mul(shares.weight, t), least);
        hn::StoreU(hn::Add(hn::LoadU(d, to.weight + at), added), d, to.weight + at);
    }
    if constexpr (sums == Sums::pairs) {
        add(shares.other, to.other + at);
    }
}

/// A kernel on slice n, where it is drawn from: q of column x and row y is (X x + Y1 y + a1, Y2 y + a2, s), and along
/// the pixel's ray it changes by (spread (X x + Y1 y) + d1, spread Y2 y + d2, ds) from slice to slice.
template <class T>
struct SlabKernel {
    T X, Y1, Y2, a1, a2, s; ///< in perspective X, Y1 and Y2 are those of slice n
    T d1, d2, ds;
    T spread; ///< in perspective a slice distance over the depth of slice n, else 0

    template <bool slopes>
    HWY_INLINE SlabKernel(const Splat<T, slopes>& splat, const Section<T>& section, const RowShape<T>& shape) {
        const bool perspective = splat.setup.perspective;
        const T depth = perspective ? splat.depth_of(splat.n) : T(1);
        const T along = static_cast<T>(splat.n - section.first);
        X = shape.X * depth;
        Y1 = shape.Y1 * depth;
        Y2 = shape.Y2 * depth;
        a1 = section.a1 + along * shape.d1;
        a2 = section.a2 + along * shape.d2;
        s = section.s + along * shape.ds;
        d1 = shape.d1;
        d2 = shape.d2;
        ds = shape.ds;
        spread = perspective ? static_cast<T>(splat.setup.slice_spacing) / depth : T(0);
    }
    [[nodiscard]] HWY_INLINE bool perspective() const { return spread != T(0); }
    /// How q1 and q2 change along the ray at a column and a row.
    [[nodiscard]] HWY_INLINE T first_way(T x, T y) const { return spread * (X * x + Y1 * y) + d1; }
    [[nodiscard]] HWY_INLINE T second_way(T y) const { return spread * Y2 * y + d2; }
};

/// The pixels of each row that a kernel's silhouette holds, and in orthographic views those that a slab of it can
/// touch, a pixel more on each side.
template <class T>
struct SlabBounds {
    std::int16_t first[most_edge], past[most_edge]; ///< by row, from that of the box on

    HWY_INLINE SlabBounds(const SlabKernel<T>& kernel, const Rect& box) : kernel_(kernel), box_(box) {
        // |q x w|^2 < w^2 where a ray meets the support, a quadratic in x; u: the change of q x w from pixel to pixel.
        const double X = kernel.X, w3 = kernel.ds, q3 = kernel.s, turn = static_cast<double>(kernel.spread) * X;
        for (int y = box.y0; y < box.y1; ++y) {
            const double up = y;
            const double w2 = static_cast<double>(kernel.spread) * static_cast<double>(kernel.Y2) * up +
                              static_cast<double>(kernel.d2);
            const double w1 = static_cast<double>(kernel.spread) * static_cast<double>(kernel.Y1) * up +
                              static_cast<double>(kernel.d1);
            const double q1 = static_cast<double>(kernel.Y1) * up + static_cast<double>(kernel.a1);
            const double q2 = static_cast<double>(kernel.Y2) * up + static_cast<double>(kernel.a2);
            const double u2 = q3 * turn - X * w3, u3 = X * w2 - q2 * turn;
            const double c1 = q2 * w3 - q3 * w2, c2 = q3 * w1 - q1 * w3, c3 = q1 * w2 - q2 * w1;
            const double speed2 = w1 * w1 + w2 * w2 + w3 * w3;
            const double of_u = u2 * u2 + u3 * u3, square = of_u - turn * turn;
            const int row = y - box.y0;
            if (!(square > 1e-6 * of_u)) {
                // Near the eye the silhouette may have no end.
                first[row] = static_cast<std::int16_t>(box.x0);
                past[row] = static_cast<std::int16_t>(box.x1);
                continue;
            }
            const double per_square = 1.0 / square;
            const double slope = c2 * u2 + c3 * u3 - w1 * turn, rest = c1 * c1 + c2 * c2 + c3 * c3 - speed2;
            const double nearest = -slope * per_square, inside = nearest * nearest - rest * per_square;
            const double half = std::sqrt(std::max(inside, 0.0));
            // (Where rounding of the sums in T could count, rows stay.)
            const bool met = inside > -0.01 * speed2 * per_square;
            first[row] = pixel(nearest - half - 1.0, box.x0, box.x1);
            past[row] = met ? pixel(nearest + half + 2.0, box.x0, box.x1) : first[row];
        }
    }

    /// Of a slab so many behind the first one.
    [[nodiscard]] HWY_INLINE Rect of_slab(int number) const {
        if (kernel_.perspective()) {
            return box_;
        }
        const double d1 = kernel_.d1, d2 = kernel_.d2, ds = kernel_.ds, Y1 = kernel_.Y1, Y2 = kernel_.Y2;
        const double X = kernel_.X, along = number, s = static_cast<double>(kernel_.s) + along * ds;
        // From the slab's ends, where they are in the support, or where the support ends.
        const double a = std::clamp(s - 0.5 * ds, -1.0, 1.0), b = std::clamp(s + 0.5 * ds, -1.0, 1.0);
        const double height = std::min(std::abs(a), std::abs(b));
        const double radius = a * b <= 0.0 ? 1.0 : std::sqrt(1.0 - height * height);
        const auto middle = [&](double at) {
            const double z = along + (at - s) / ds;
            const double y = -(static_cast<double>(kernel_.a2) + z * d2) / Y2;
            const double x = -(static_cast<double>(kernel_.a1) + z * d1 + Y1 * y) / X;
            return std::pair<double, double>{x, y};
        };
        const auto [ax, ay] = middle(a);
        const auto [bx, by] = middle(b);
        const double reach_y = radius / std::abs(Y2);
        const double reach_x = std::sqrt(radius * radius + Y1 * Y1 * reach_y * reach_y) / X;
        const Rect rect{pixel(std::min(ax, bx) - reach_x - 1.0, box_.x0, box_.x1),
                        pixel(std::min(ay, by) - reach_y - 1.0, box_.y0, box_.y1),
                        pixel(std::max(ax, bx) + reach_x + 2.0, box_.x0, box_.x1),
                        pixel(std::max(ay, by) + reach_y + 2.0, box_.y0, box_.y1)};
        return rect.empty() ? box_ : rect;
    }

  private:
    [[nodiscard]] static HWY_INLINE std::int16_t pixel(double at, int low, int high) {
        return static_cast<std::int16_t>(std::min(std::max(at, static_cast<double>(low)), static_cast<double>(high)));
    }

    const SlabKernel<T>& kernel_;
    const Rect box_;
};

/// The rays of a vector of pixels in the unit sphere. Places along a ray are counted from its nearest approach to the
/// centre.
template <class D, class V = hn::Vec<D>>
struct SlabRays {
    V p2;           ///< squared distance of the nearest approach
    V here;         ///< place of slice n
    V way, per_way; ///< from slice to slice
    V half_chord;   ///< 0 where a ray does not meet the support
    // Where slopes are summed: two coordinates of the nearest approach, and of the ray's direction.
    V near1, near2, along1, along2;
};

/// Of a slab: the mean of the lowered profile, and where slopes are summed those of the Gaussian inside the support and
/// of it times the place.
template <class D, class V = hn::Vec<D>>
struct SlabMean {
    V lowered, plain, moment;
    hn::Mask<D> reached;
};

/// A polynomial, constant term first, as its even and its odd powers: two short sums side by side.
template <class D, class V, std::size_t n>
HWY_INLINE V even_and_odd(D d, V x, const hn::TFromD<D> (&c)[n]) {
    const V squared = hn::Mul(x, x);
    constexpr std::size_t last = n - 1;
    V sums[2] = {hn::Set(d, c[last]), hn::Set(d, c[last - 1])};
    for (std::size_t term = 2; term < n; ++term) {
        V& sum = sums[term % 2];
        sum = hn::MulAdd(sum, squared, hn::Set(d, c[last - term]));
    }
    return last % 2 == 0 ? hn::MulAdd(sums[1], x, sums[0]) : hn::MulAdd(sums[0], x, sums[1]);
}

/// The Gaussian's integral from a ray's nearest approach on, lowered likewise, where the polynomial stands for it.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
struct PolynomialIntegral {
    const PartProfile<T>& profile;
    [[nodiscard]] HWY_INLINE V operator()(D d, V at, V bell, V edge) const {
        const V place = hn::MulSub(hn::Mul(at, at), hn::Set(d, T(2)), hn::Set(d, T(1)));
        return hn::Mul(at, hn::MulSub(bell, even_and_odd(d, place, profile.integral), edge));
    }
};
/// The same of steep profiles.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
struct ClosedIntegral {
    const PartProfile<T>& profile;
    [[nodiscard]] HWY_INLINE V operator()(D d, V at, V bell, V edge) const {
        const V whole = hn::Mul(bell, hn::Set(d, half_root_pi<T> / profile.root_falloff));
        return hn::MulSub(whole, erf(d, hn::Mul(hn::Set(d, profile.root_falloff), at)), hn::Mul(edge, at));
    }
};

/// Calls add(number, mean) for slabs first ... past - 1: differences of the integral between their ends, or to where
/// the ray leaves the kernel. Neighbouring slabs share one.
template <bool slopes, class D, class T, class Integral, class Add, class V = hn::Vec<D>>
HWY_INLINE void thick_slabs(D d, const PartProfile<T>& profile, const SlabRays<D>& rays, int first, int past,
                            const Integral& integral, const Add& add) {
    const V back = hn::Neg(rays.half_chord), minus_k = hn::Set(d, -profile.falloff_log2);
    const V edge = hn::Mul(rays.per_way, hn::Set(d, profile.edge));
    const V bell = hn::Mul(exp2_nonpositive(d, hn::Mul(minus_k, rays.p2)), rays.per_way);
    struct End {
        V at, integral, bell;
    };
    const auto end_at = [&](int number) {
        End end;
        const V at = hn::MulAdd(hn::Set(d, static_cast<T>(number) - T(0.5)), rays.way, rays.here);
        end.at = hn::Min(hn::Max(at, back), rays.half_chord);
        end.integral = integral(d, end.at, bell, edge);
        if constexpr (slopes) {
            end.bell = exp2_nonpositive(d, hn::Mul(minus_k, hn::MulAdd(end.at, end.at, rays.p2)));
        }
        return end;
    };
    const V per_steep = hn::Mul(rays.per_way, hn::Set(d, T(0.5) / (profile.root_falloff * profile.root_falloff)));
    End before = end_at(first);
    for (int number = first; number < past; ++number) {
        const End after = end_at(number + 1);
        SlabMean<D> mean;
        mean.lowered = hn::Sub(after.integral, before.integral);
        mean.reached = hn::Gt(after.at, before.at);
        if constexpr (slopes) {
            mean.plain = hn::MulAdd(edge, hn::Sub(after.at, before.at), mean.lowered);
            mean.moment = hn::Mul(hn::Sub(before.bell, after.bell), per_steep);
        }
        add(number, mean);
        before = after;
    }
}

/// As thick_slabs, where the integrals' difference would cancel. Of a ray's part in a slab, from m - h to m + h,
///     mean of exp(-k (m + h z)^2) over |z| < 1 = exp(-k m^2) mean of exp(-s z^2) cosh(y z),  s = k h^2, y = 2 k m h,
/// a power series in s and y^2.
template <bool slopes, class D, class T, class Add, class V = hn::Vec<D>>
HWY_INLINE void thin_slabs(D d, const PartProfile<T>& profile, const SlabRays<D>& rays, int first, int past,
                           const Add& add) {
    const T k_t = profile.root_falloff * profile.root_falloff;
    const V zero = hn::Zero(d), half = hn::Set(d, T(0.5)), minus_k = hn::Set(d, -profile.falloff_log2);
    const V to_s = hn::Set(d, T(0.25) * k_t), k = hn::Set(d, k_t), edge = hn::Set(d, profile.edge);
    const V back = hn::Neg(rays.half_chord), half_way = hn::Mul(half, rays.way);
    // (Beyond it the Gaussian has nothing left.)
    const V largest = hn::Set(d, T(4));
    const auto all = [&](double number) { return hn::Set(d, static_cast<T>(number)); };
    for (int number = first; number < past; ++number) {
        const V middle = hn::MulAdd(all(number), rays.way, rays.here);
        // From the middle of the slab: lengths of slabs are right to the last digit.
        const V low = hn::Max(hn::Sub(back, middle), hn::Neg(half_way));
        const V high = hn::Min(hn::Sub(rays.half_chord, middle), half_way);
        const V length = hn::Max(hn::Sub(high, low), zero);
        const V m = hn::MulAdd(half, hn::Add(low, high), middle);
        const V share = hn::Mul(length, rays.per_way), s = hn::Mul(to_s, hn::Mul(length, length));
        const V m2 = hn::Mul(m, m);
        const V y2 = hn::Min(hn::Mul(hn::Mul(all(4), s), hn::Mul(k, m2)), largest);
        const V bell = exp2_nonpositive(d, hn::Mul(minus_k, hn::Add(rays.p2, m2)));
        const V c0 = hn::MulAdd(s, hn::MulAdd(s, hn::MulAdd(s, all(-1.0 / 42), all(0.1)), all(-1.0 / 3)), all(1));
        const V c1 = hn::MulAdd(s, hn::MulAdd(s, all(1.0 / 28), all(-0.1)), all(1.0 / 6));
        const V c2 = hn::MulAdd(s, hn::MulAdd(s, all(1.0 / 432), all(-1.0 / 168)), all(1.0 / 120));
        const V c3 = hn::MulAdd(s, all(-1.0 / 6480), all(1.0 / 5040));
        const V series =
            hn::MulAdd(y2, hn::MulAdd(y2, hn::MulAdd(y2, hn::MulAdd(y2, all(1.0 / 362880), c3), c2), c1), c0);
        SlabMean<D> mean;
        mean.reached = hn::Gt(length, zero);
        mean.lowered = hn::Mul(share, hn::MulSub(bell, series, edge));
        if constexpr (slopes) {
            mean.plain = hn::Mul(share, hn::Mul(bell, series));
            // The Gaussian's differences between the ends, over 2 k.
            const V fall = hn::MulAdd(s, hn::MulAdd(s, hn::MulAdd(s, all(-1.0 / 6), half), all(-1)), all(1));
            const V rise = hn::MulAdd(
                y2,
                hn::MulAdd(y2, hn::MulAdd(y2, hn::MulAdd(y2, all(1.0 / 362880), all(1.0 / 5040)), all(1.0 / 120)),
                           all(1.0 / 6)),
                all(1));
            mean.moment = hn::Mul(hn::Mul(share, hn::Mul(bell, m)), hn::Mul(fall, rise));
        }
        add(number, mean);
    }
}

/// Means over the slabs of a kernel along the rays of any view. What depends on the ray alone is found once for all
/// slabs.
template <Sums sums, class D, class T, bool slopes>
class RaySlabs {
  public:
    /// every: all slabs are gone through on every ray.
    RaySlabs(Splat<T, slopes>& splat, const SlabKernel<T>& kernel, const Amounts<T>& amounts, int count,
             const Rect& box, bool every)
        : splat_(splat), kernel_(kernel), bounds_(kernel, box), box_(box), amounts_(amounts),
          steepness_(splat.steep(), amounts), count_(count), every_(every) {
        std::fill(std::begin(any_), std::end(any_), every);
    }

    /// Returns how many slabs were drawn.
    int draw() {
        for (int y = box_.y0; y < box_.y1; ++y) {
            draw_row(y);
        }
        int drawn = 0;
        for (int number = 0; number < count_; ++number) {
            if (any_[number]) {
                splat_.single[number].add(bounds_.of_slab(number));
                ++drawn;
            }
        }
        return drawn;
    }

  private:
    using V = hn::Vec<D>;
    using M = hn::Mask<D>;
    struct Range {
        int first, past;
    };

    HWY_INLINE void draw_row(int y) {
        const D d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const int x0 = bounds_.first[y - box_.y0], x1 = bounds_.past[y - box_.y0];
        const bool perspective = kernel_.perspective();
        const T row = static_cast<T>(y);
        const T q2_t = kernel_.Y2 * row + kernel_.a2, w2_t = kernel_.second_way(row);
        const T w1_t = kernel_.first_way(T(0), row), c1_t = q2_t * kernel_.ds - kernel_.s * w2_t;
        const T others2_t = w2_t * w2_t + kernel_.ds * kernel_.ds;
        const V one = hn::Set(d, T(1)), w3 = hn::Set(d, kernel_.ds), q3 = hn::Set(d, kernel_.s);
        const V X = hn::Set(d, kernel_.X), turn = hn::Set(d, kernel_.spread * kernel_.X);
        const V q2 = hn::Set(d, q2_t), w2 = hn::Set(d, w2_t), b = hn::Set(d, kernel_.Y1 * row + kernel_.a1);
        const V others = hn::Set(d, q2_t * w2_t + kernel_.s * kernel_.ds);
        const V c1 = hn::Set(d, c1_t), c1_squared = hn::Set(d, c1_t * c1_t), others2 = hn::Set(d, others2_t);
        V w1 = hn::Set(d, w1_t);
        // In orthographic views rays are alike.
        const T way = perspective ? T(1) : std::sqrt(w1_t * w1_t + others2_t);
        SlabRays<D> rays;
        rays.way = hn::Set(d, way);
        rays.per_way = hn::Set(d, T(1) / way);
        const std::ptrdiff_t in_sheet = static_cast<std::ptrdiff_t>(y) * splat_.targets[0].stride;
        for (int x = x1 - x0 <= lanes ? x0 : x0 & ~(lanes - 1); x < x1; x += lanes) {
            const V column = hn::Iota(d, static_cast<T>(x));
            const V q1 = hn::MulAdd(X, column, b);
            if (perspective) {
                w1 = hn::MulAdd(turn, column, hn::Set(d, w1_t));
                rays.way = hn::Sqrt(hn::MulAdd(w1, w1, others2));
                rays.per_way = hn::Div(one, rays.way);
            }
            // The nearest approach, by the cross product: nothing cancels there.
            const V c2 = hn::MulSub(q3, w1, hn::Mul(q1, w3)), c3 = hn::MulSub(q1, w2, hn::Mul(q2, w1));
            const V per_way2 = hn::Mul(rays.per_way, rays.per_way);
            rays.p2 = hn::Mul(hn::MulAdd(c2, c2, hn::MulAdd(c3, c3, c1_squared)), per_way2);
            const V inside = hn::Sub(one, rays.p2);
            const M met = hn::Gt(inside, hn::Zero(d));
            if (hn::AllFalse(d, met)) {
                continue;
            }
            rays.half_chord = hn::Sqrt(hn::Max(inside, hn::Zero(d)));
            rays.here = hn::Mul(hn::MulAdd(q1, w1, others), rays.per_way);
            if constexpr (slopes) {
                rays.near1 = hn::Mul(per_way2, hn::MulSub(w2, c3, hn::Mul(w3, c2)));
                rays.near2 = hn::Mul(per_way2, hn::MulSub(w3, c1, hn::Mul(w1, c3)));
                rays.along1 = hn::Mul(w1, rays.per_way);
                rays.along2 = hn::Mul(w2, rays.per_way);
            }
            add_slabs(rays, met, in_sheet + x);
        }
    }

    /// met: rays that meet the support. at: element of the sheets.
    HWY_INLINE void add_slabs(SlabRays<D>& rays, M met, std::ptrdiff_t at) {
        const D d;
        const M are_thin = hn::And(met, hn::Lt(rays.way, hn::Set(d, shortest_slab<T> / splat_.profile.root_falloff)));
        if (HWY_LIKELY(hn::AllFalse(d, are_thin))) {
            add_thick(rays, met, at);
            return;
        }
        const M are_thick = hn::AndNot(are_thin, met);
        const V chord = rays.half_chord;
        rays.half_chord = hn::IfThenElseZero(are_thin, chord);
        add_thin(rays, met_by(rays, are_thin), at);
        if (HWY_UNLIKELY(!hn::AllFalse(d, are_thick))) {
            rays.half_chord = hn::IfThenElseZero(are_thick, chord);
            add_thick(rays, are_thick, at);
        }
    }

    /// The slabs that some of the rays meet inside the support.
    HWY_INLINE Range met_by(const SlabRays<D>& rays, M some) {
        if (every_) {
            return {0, count_};
        }
        const D d;
        const V far = hn::Set(d, T(1e6));
        const V entered = hn::Mul(hn::Sub(hn::Neg(rays.half_chord), rays.here), rays.per_way);
        const V left = hn::Mul(hn::Sub(rays.half_chord, rays.here), rays.per_way);
        const T least = hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(some, entered, far)));
        const T most = hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElse(some, left, hn::Neg(far))));
        const Range range{whole(std::floor(least + T(0.5)), 0, count_),
                          whole(std::ceil(most - T(0.5)) + T(1), 0, count_)};
        for (int number = range.first; number < range.past; ++number) {
            any_[number] = true;
        }
        return range;
    }

    HWY_INLINE void add_thick(const SlabRays<D>& rays, M some, std::ptrdiff_t at) {
        const Range range = met_by(rays, some);
        if (splat_.profile.integrates) {
            add_thick_by(rays, range, PolynomialIntegral<D>{splat_.profile}, at);
        } else {
            add_thick_by(rays, range, ClosedIntegral<D>{splat_.profile}, at);
        }
    }
    template <class Integral>
    HWY_NOINLINE void add_thick_by(const SlabRays<D>& rays, const Range& range, const Integral& integral,
                                   std::ptrdiff_t at) const {
        thick_slabs<slopes>(D(), splat_.profile, rays, range.first, range.past, integral,
                            [&](int number, const SlabMean<D>& mean) { add(rays, number, mean, at); });
    }
    HWY_NOINLINE void add_thin(const SlabRays<D>& rays, const Range& range, std::ptrdiff_t at) const {
        thin_slabs<slopes>(D(), splat_.profile, rays, range.first, range.past,
                           [&](int number, const SlabMean<D>& mean) { add(rays, number, mean, at); });
    }

    HWY_INLINE void add(const SlabRays<D>& rays, int number, const SlabMean<D>& mean, std::ptrdiff_t at) const {
        const D d;
        const Target<T>& to = splat_.targets[number];
        add_reached<sums>(d, mean.lowered, mean.reached, Shares<D>(d, amounts_), to, at);
        if constexpr (slopes) {
            // The mean of q times the Gaussian.
            const V m1 = hn::MulAdd(rays.near1, mean.plain, hn::Mul(rays.along1, mean.moment));
            const V m2 = hn::MulAdd(rays.near2, mean.plain, hn::Mul(rays.along2, mean.moment));
            const T scale = steepness_.scale * (T(1) + static_cast<T>(number) * kernel_.spread);
            const Slope<D> slope{
                hn::Mul(m1, hn::Set(d, kernel_.X * scale)),
                hn::MulAdd(m1, hn::Set(d, kernel_.Y1 * scale), hn::Mul(m2, hn::Set(d, kernel_.Y2 * scale))),
                hn::Mul(hn::Mul(mean.moment, rays.way), hn::Set(d, steepness_.scale))};
            add_slope<sums>(d, hn::Set(d, T(1)), slope, steepness_.ratio, to, at);
        }
    }

    Splat<T, slopes>& splat_;
    const SlabKernel<T>& kernel_;
    const SlabBounds<T> bounds_;
    const Rect& box_;
    const Amounts<T> amounts_;
    const Steepness<sums, T> steepness_;
    const int count_;
    const bool every_;
    bool any_[covered_slices]; ///< slabs that were drawn
};

template <Sums sums, class T, bool slopes>
HWY_NOINLINE int add_ray_slabs(Splat<T, slopes>& splat, const Section<T>& section, const Amounts<T>& amounts,
                               const RowShape<T>& shape, int count, const Rect& box) {
    if (!splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    const SlabKernel<T> kernel(splat, section, shape);
    const T y = T(0.5) * static_cast<T>(box.y0 + box.y1);
    const T w1 = kernel.first_way(T(0.5) * static_cast<T>(box.x0 + box.x1), y), w2 = kernel.second_way(y);
    const T depth2 = kernel.ds * kernel.ds, across2 = w1 * w1 + w2 * w2;
    // Looking for the first and the last slab of a vector takes longer than a few slabs, or those that the rays through
    // a kernel that hardly leans have in common.
    const bool every = count <= few_slabs || across2 * T(8) < depth2;
    // Wide vectors hold rays that cross other slabs.
    const bool alike = std::abs(kernel.X * w1) * T(8) < across2 + depth2;
    if (alike && box.x1 - box.x0 > 8) {
        return RaySlabs<sums, hn::CappedTag<T, 16>, T, slopes>(splat, kernel, amounts, count, box, every).draw();
    }
    return RaySlabs<sums, hn::CappedTag<T, 8>, T, slopes>(splat, kernel, amounts, count, box, every).draw();
}

/// The slabs of a kernel along rays that are one of its axes: where they end along it, from back to front as q3 falls,
/// and the Gaussian there and its integral from 0 to there, over a slab's thickness.
template <class T>
struct SlabEnds {
    static constexpr int room = covered_slices + 16;
    HWY_ALIGN T place[room];
    HWY_ALIGN T integral[room];
    HWY_ALIGN T lowered[room]; ///< what the profile is lowered by, integrated likewise
    HWY_ALIGN T bell[room];
    T per_thickness;

    template <class D>
    HWY_INLINE SlabEnds(D d, const PartProfile<T>& profile, T first_end, T step, int ends)
        : per_thickness(T(-1) / step) {
        using V = hn::Vec<D>;
        const V one = hn::Set(d, T(1)), thin = hn::Set(d, per_thickness), zero = hn::Zero(d);
        const V edge = hn::Set(d, profile.edge * per_thickness), minus_k = hn::Set(d, -profile.falloff_log2);
        const PolynomialIntegral<D> of{profile};
        for (int end = 0; end < ends; end += static_cast<int>(hn::Lanes(d))) {
            const V at = hn::MulAdd(hn::Set(d, step), hn::Iota(d, static_cast<T>(end)), hn::Set(d, first_end));
            // (Outside of the support it is not asked for.)
            const V inside = hn::Min(hn::Max(at, hn::Neg(one)), one);
            hn::Store(at, d, place + end);
            hn::Store(of(d, inside, thin, zero), d, integral + end);
            hn::Store(hn::Mul(edge, at), d, lowered + end);
            hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(inside, inside))), d, bell + end);
        }
    }
};

/// What upright kernels have by row.
template <class T>
struct UprightRows {
    HWY_ALIGN T bell[most_edge];
    HWY_ALIGN T place[most_edge]; ///< q2
};

/// As add_rows, of means over slabs: a difference of the profile's integral between the ends of each slab or, on
/// rays that leave the kernel inside it, to where they do.
template <Sums sums, class D, class T, bool slopes>
HWY_INLINE void upright_slabs(D d, const Splat<T, slopes>& splat, const SlabKernel<T>& kernel, const SlabEnds<T>& ends,
                              const UprightRows<T>& rows, const Amounts<T>& amounts, int count, int x0,
                              const Rect& box) {
    using V = hn::Vec<D>;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const PartProfile<T>& profile = splat.profile;
    const Target<T>* to = splat.targets;
    const V zero = hn::Zero(d), one = hn::Set(d, T(1)), X = hn::Set(d, kernel.X);
    const Shares<D> shares(d, amounts);
    const V thin = hn::Set(d, ends.per_thickness), edge = hn::Set(d, profile.edge * ends.per_thickness);
    const PolynomialIntegral<D> integral{profile};
    const Steepness<sums, T> steepness(splat.steep(), amounts);
    const V minus_k = hn::Set(d, -profile.falloff_log2), at_edge = hn::Set(d, profile.edge);
    const T k = profile.root_falloff * profile.root_falloff;
    const V along = hn::Set(d, kernel.ds * steepness.scale * ends.per_thickness * T(0.5) / k);
    struct End {
        V integral, at, bell;
    };
    for (int x = x0; x < box.x1; x += lanes) {
        const V q1 = hn::MulAdd(X, hn::Iota(d, static_cast<T>(x)), hn::Set(d, kernel.a1));
        const V q1_squared = hn::Mul(q1, q1);
        const V bell_x = exp2_nonpositive(d, hn::Mul(minus_k, q1_squared));
        const V across = hn::Mul(q1, hn::Set(d, kernel.X * steepness.scale));
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(box.y0) * to[0].stride + x;
        for (int y = 0; y < box.y1 - box.y0; ++y, at += to[0].stride) {
            const T q2 = rows.place[y];
            const V squared = hn::Sub(hn::Sub(one, hn::Set(d, q2 * q2)), q1_squared);
            const auto met = hn::Gt(squared, zero);
            if (hn::AllFalse(d, met)) {
                continue;
            }
            const V half_chord = hn::Sqrt(hn::Max(squared, zero)), back = hn::Neg(half_chord);
            const V bell = hn::Mul(bell_x, hn::Set(d, rows.bell[y]));
            const V last = integral(d, half_chord, hn::Mul(bell, thin), edge), first = hn::Neg(last);
            const auto end_at = [&](int number) {
                const V place = hn::Set(d, ends.place[number]);
                const auto behind = hn::Ge(place, half_chord), ahead = hn::Le(place, back);
                const V inside = hn::MulSub(bell, hn::Set(d, ends.integral[number]), hn::Set(d, ends.lowered[number]));
                End end;
                end.integral = hn::IfThenElse(behind, last, hn::IfThenElse(ahead, first, inside));
                end.at = hn::Min(hn::Max(place, back), half_chord);
                if constexpr (slopes) {
                    end.bell =
                        hn::IfThenElse(hn::Or(behind, ahead), at_edge, hn::Mul(bell, hn::Set(d, ends.bell[number])));
                }
                return end;
            };
            const V down = hn::Set(d, q2 * kernel.Y2 * steepness.scale);
            End before = end_at(0);
            for (int slice = 0; slice < count; ++slice) {
                const End after = end_at(slice + 1);
                const V lowered = hn::Sub(before.integral, after.integral);
                const auto reached = hn::Gt(before.at, after.at);
                add_reached<sums>(d, lowered, reached, shares, to[slice], at);
                if constexpr (slopes) {
                    const V plain = hn::MulAdd(edge, hn::Sub(before.at, after.at), lowered);
                    const Slope<D> slope{hn::Mul(plain, across), hn::Mul(plain, down),
                                         hn::Mul(hn::Sub(after.bell, before.bell), along)};
                    add_slope<sums>(d, one, slope, steepness.ratio, to[slice], at);
                }
                before = after;
            }
        }
    }
}

/// Kernels whose sections are upright ellipses in one place, in orthographic views: the profile is a product, and what
/// depends on depth is the same for all pixels whose rays stay inside the kernel.
template <Sums sums, class T, bool slopes>
HWY_NOINLINE int add_upright_slabs(Splat<T, slopes>& splat, const Section<T>& section, const Amounts<T>& amounts,
                                   const RowShape<T>& shape, int count, const Rect& box) {
    if (!splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    const SlabKernel<T> kernel(splat, section, shape);
    UprightRows<T> rows;
    const T at_y = kernel.a2 + shape.Y2 * static_cast<T>(box.y0);
    bells(hn::CappedTag<T, 8>(), splat.profile.falloff_log2, at_y, shape.Y2, box.y1 - box.y0, rows.bell);
    for (int y = 0; y < box.y1 - box.y0; ++y) {
        rows.place[y] = at_y + shape.Y2 * static_cast<T>(y);
    }
    const SlabEnds<T> ends(hn::CappedTag<T, 16>(), splat.profile, kernel.s - T(0.5) * shape.ds, shape.ds, count + 1);
    in_narrowest<T>(box.x1 - box.x0, [&](auto d) {
        const int start = start_of<T>(box.x0, box.x1, static_cast<int>(hn::Lanes(d)));
        upright_slabs<sums>(d, splat, kernel, ends, rows, amounts, count, start, box);
    });
    splat.through[count - 1].add(box);
    return count;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_SLABS_INL

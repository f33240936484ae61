// The splat loop of ellipses that lean, and of all kernels in perspective: each section by itself.
// Source: [NM06] section 4.1, with the factors of backend_cpu/sections.hpp.

#if defined(SHEETSPLAT_CPU_SPLAT_ELLIPSES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_ELLIPSES_INL
#undef SHEETSPLAT_CPU_SPLAT_ELLIPSES_INL
#else
#define SHEETSPLAT_CPU_SPLAT_ELLIPSES_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// The sections of a kernel, one a slice: all of them are measured at once.
template <class T>
struct Ellipses {
    static constexpr int room = covered_slices + 16;
    HWY_ALIGN T scale[room]; ///< depth in perspective, else 1
    HWY_ALIGN T a1[room];
    HWY_ALIGN T a2[room];
    HWY_ALIGN T s[room];
    HWY_ALIGN T s2[room];
    HWY_ALIGN T rest[room]; ///< 1 - s^2
    HWY_ALIGN T middle_x[room];
    HWY_ALIGN T middle_y[room];
    HWY_ALIGN T tip[room];                              ///< where along x, from the middle, first and last rows are
    HWY_ALIGN T x0[room], y0[room], x1[room], y1[room]; ///< pixels
};

template <class T, bool slopes>
HWY_INLINE void measure(const Splat<T, slopes>& splat, const Section<T>& section, const RowShape<T>& shape, int count,
                        Ellipses<T>& e) {
    const hn::CappedTag<T, 8> d;
    using V = hn::Vec<decltype(d)>;
    const V one = hn::Set(d, T(1)), zero = hn::Zero(d);
    // Lengths in the unit sphere scale with the depth in perspective, and those on the screen against it.
    const T steep = std::sqrt(shape.Y1 * shape.Y1 + shape.Y2 * shape.Y2);
    const T per_X = T(1) / shape.X, per_Y2 = T(1) / shape.Y2;
    const T slant = shape.Y1 * per_X, reach = steep * std::abs(per_Y2) * per_X;
    const T tip = std::abs(shape.Y1 * per_Y2) * per_X;
    const auto edge = [&](int pixel) { return hn::Set(d, static_cast<T>(pixel)); };
    const V left = edge(splat.live.rect.x0), right = edge(splat.live.rect.x1);
    const V top = edge(splat.live.rect.y0), bottom = edge(splat.live.rect.y1);
    for (int slice = 0; slice < count; slice += static_cast<int>(hn::Lanes(d))) {
        const V along = hn::Iota(d, static_cast<T>(splat.n - section.first + slice));
        V scale = one;
        if (splat.setup.perspective) {
            scale =
                hn::MulAdd(hn::Iota(d, static_cast<T>(slice)), hn::Set(d, static_cast<T>(splat.setup.slice_spacing)),
                           hn::Set(d, splat.depth_of(splat.n)));
        }
        const V per_scale = hn::Div(one, scale);
        const V a1 = hn::MulAdd(along, hn::Set(d, shape.d1), hn::Set(d, section.a1));
        const V a2 = hn::MulAdd(along, hn::Set(d, shape.d2), hn::Set(d, section.a2));
        const V s = hn::MulAdd(along, hn::Set(d, shape.ds), hn::Set(d, section.s));
        const V s2 = hn::Mul(s, s);
        const V rest = hn::Sub(one, s2);
        const V root = hn::Mul(hn::Sqrt(hn::Max(rest, zero)), per_scale);
        const V middle_y = hn::Neg(hn::Mul(hn::Mul(a2, hn::Set(d, per_Y2)), per_scale));
        const V reach_y = hn::Mul(root, hn::Set(d, std::abs(per_Y2)));
        const V middle_x =
            hn::Neg(hn::MulAdd(hn::Set(d, slant), middle_y, hn::Mul(hn::Mul(a1, hn::Set(d, per_X)), per_scale)));
        const V reach_x = hn::Mul(root, hn::Set(d, reach));
        const auto first = [&](V middle, V half, V low, V high) {
            return hn::Min(hn::Max(hn::Ceil(hn::Sub(middle, half)), low), high);
        };
        const auto past = [&](V middle, V half, V low, V high) {
            return hn::Min(hn::Max(hn::Add(hn::Floor(hn::Add(middle, half)), one), low), high);
        };
        hn::Store(scale, d, e.scale + slice);
        hn::Store(a1, d, e.a1 + slice);
        hn::Store(a2, d, e.a2 + slice);
        hn::Store(s, d, e.s + slice);
        hn::Store(s2, d, e.s2 + slice);
        hn::Store(rest, d, e.rest + slice);
        hn::Store(middle_x, d, e.middle_x + slice);
        hn::Store(middle_y, d, e.middle_y + slice);
        hn::Store(hn::Mul(root, hn::Set(d, tip)), d, e.tip + slice);
        hn::Store(first(middle_x, reach_x, left, right), d, e.x0 + slice);
        hn::Store(past(middle_x, reach_x, left, right), d, e.x1 + slice);
        hn::Store(first(middle_y, reach_y, top, bottom), d, e.y0 + slice);
        hn::Store(past(middle_y, reach_y, top, bottom), d, e.y1 + slice);
    }
}

/// Columns of a vector's width, and of each the rows that the ellipse reaches there.
template <class T>
struct EllipseColumns {
    static constexpr int room = most_edge + 16; // a vector may be a single number
    HWY_ALIGN T first[room];
    HWY_ALIGN T past[room];
    HWY_ALIGN T ridge[room]; ///< the brightest row
};

template <class T>
HWY_INLINE void measure_columns(const RowShape<T>& shape, const Ellipses<T>& e, int slice, int start, int lanes, int x0,
                                int x1, int y0, int y1, EllipseColumns<T>& columns) {
    const hn::CappedTag<T, 8> d;
    using V = hn::Vec<decltype(d)>;
    const T scale = e.scale[slice];
    const T steep2 = shape.Y1 * shape.Y1 + shape.Y2 * shape.Y2;
    const T per_steep2 = T(1) / steep2;
    const T ridge = -shape.X * shape.Y1 * per_steep2;
    const T width = shape.X * shape.Y2 * scale;
    const V per_steep = hn::Set(d, T(1) / (std::sqrt(steep2) * scale));
    const V per_width2 = hn::Set(d, -width * width * per_steep2);
    const V rest = hn::Set(d, e.rest[slice]), zero = hn::Zero(d), one = hn::Set(d, T(1));
    const V middle_x = hn::Set(d, e.middle_x[slice]), middle_y = hn::Set(d, e.middle_y[slice]);
    const V top_tip = hn::Set(d, ridge > T(0) ? -e.tip[slice] : e.tip[slice]);
    const V upper = hn::Set(d, static_cast<T>(y0)), lower = hn::Set(d, static_cast<T>(y1));
    const int count = (x1 - start + lanes - 1) / lanes;
    for (int column = 0; column < count; column += static_cast<int>(hn::Lanes(d))) {
        const V x = hn::MulAdd(hn::Iota(d, static_cast<T>(column)), hn::Set(d, static_cast<T>(lanes)),
                               hn::Set(d, static_cast<T>(start)));
        // (Lanes beyond the last column look at it again.)
        const V low =
            hn::Sub(hn::Max(hn::Min(x, hn::Set(d, static_cast<T>(x1 - 1))), hn::Set(d, static_cast<T>(x0))), middle_x);
        const V high = hn::Sub(
            hn::Min(hn::Add(x, hn::Set(d, static_cast<T>(lanes - 1))), hn::Set(d, static_cast<T>(x1 - 1))), middle_x);
        const auto half = [&](V from_middle) {
            return hn::Mul(hn::Sqrt(hn::Max(hn::MulAdd(hn::Mul(from_middle, from_middle), per_width2, rest), zero)),
                           per_steep);
        };
        const V half_low = half(low), half_high = half(high);
        const V at_low = hn::MulAdd(hn::Set(d, ridge), low, middle_y),
                at_high = hn::MulAdd(hn::Set(d, ridge), high, middle_y);
        V top = hn::Min(hn::Sub(at_low, half_low), hn::Sub(at_high, half_high));
        V bottom = hn::Max(hn::Add(at_low, half_low), hn::Add(at_high, half_high));
        top = hn::IfThenElse(hn::And(hn::Le(low, top_tip), hn::Le(top_tip, high)), upper, top);
        bottom = hn::IfThenElse(hn::And(hn::Le(low, hn::Neg(top_tip)), hn::Le(hn::Neg(top_tip), high)), lower, bottom);
        // (A row more on each side: what is computed in T ends on either side of a pixel.)
        const V first = hn::Min(hn::Max(hn::Floor(top), upper), lower);
        const V past = hn::Min(hn::Max(hn::Add(hn::Ceil(bottom), one), upper), lower);
        const V brightest = hn::Floor(hn::Mul(hn::Set(d, T(0.5)), hn::Add(at_low, at_high)));
        hn::Store(first, d, columns.first + column);
        hn::Store(past, d, columns.past + column);
        hn::Store(hn::Max(hn::Min(brightest, hn::Sub(past, one)), first), d, columns.ridge + column);
    }
}

/// How q changes from slice to slice along a pixel's ray; in perspective rays part.
template <class T>
struct AlongRay {
    T X, Y1, Y2, d1, d2, d3;
    template <class D, class V = hn::Vec<D>>
    [[nodiscard]] HWY_INLINE V first(D d, V column, T row) const {
        return hn::MulAdd(hn::Set(d, X), column, hn::Set(d, Y1 * row + d1));
    }
    [[nodiscard]] HWY_INLINE T second(T row) const { return Y2 * row + d2; }
};
/// scale: what all of it is multiplied by.
template <class T, bool slopes>
HWY_INLINE AlongRay<T> along_ray(const Splat<T, slopes>& splat, const RowShape<T>& shape, T scale) {
    const T spread = splat.setup.perspective ? static_cast<T>(splat.setup.slice_spacing) * scale : T(0);
    return {spread * shape.X, spread * shape.Y1, spread * shape.Y2,
            shape.d1 * scale, shape.d2 * scale,  shape.ds * scale};
}
/// r dr over columns, rows and slices at q = (q1, q2, s), as X, Y1, Y2 and `along` are scaled.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE Slope<D> slope_at(D d, const AlongRay<T>& along, T X, T Y1, T Y2, V q1, T q2, T s, V column, T row) {
    return {hn::Mul(q1, hn::Set(d, X)), hn::MulAdd(q1, hn::Set(d, Y1), hn::Set(d, q2 * Y2)),
            hn::MulAdd(q1, along.first(d, column, row), hn::Set(d, q2 * along.second(row) + s * along.d3))};
}

/// 2^x, for exponents that the format has; above them what is not needed, since it meets a 0.
template <class D, class V>
HWY_INLINE V exp2_any(D d, V x) {
    return exp2_nonpositive(d, hn::Min(x, hn::Set(d, deepest_span<hn::TFromD<D>>)));
}

template <Sums sums, class D, class T, bool slopes>
HWY_NOINLINE void walk(D d, const Splat<T, slopes>& splat, const Target<T>& to, const RowShape<T>& shape,
                       const Ellipses<T>& e, int slice, const Amounts<T>& amounts, int x0, int x1, int y0, int y1) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const int start = start_of<T>(x0, x1, lanes);
    EllipseColumns<T> columns;
    measure_columns(shape, e, slice, start, lanes, x0, x1, y0, y1, columns);
    const T k = splat.profile.falloff_log2;
    const T X = shape.X * e.scale[slice], Y1 = shape.Y1 * e.scale[slice], Y2 = shape.Y2 * e.scale[slice];
    const T a1 = e.a1[slice], a2 = e.a2[slice], s2 = e.s2[slice];
    const auto q = exp2_nonpositive(d, hn::Set(d, -T(2) * k * (Y1 * Y1 + Y2 * Y2)));
    const Shares<D> shares(d, amounts);
    const auto edge = hn::Set(d, splat.profile.edge);
    const auto minus_k = hn::Set(d, -k);
    const Steepness<sums, T> steepness(splat.steep(), amounts);
    const T steep = steepness.scale;
    const AlongRay<T> along = along_ray(splat, shape, steep);
    // What slopes change by from row to row in orthographic views.
    const Slope<D> by_row{hn::Set(d, X * Y1 * steep), hn::Set(d, (Y1 * Y1 + Y2 * Y2) * steep),
                          hn::Set(d, Y1 * along.d1 + Y2 * along.d2)};
    const bool straight = !splat.setup.perspective;
    for (int x = start, column = 0; x < x1; x += lanes, ++column) {
        const int first = static_cast<int>(columns.first[column]), past = static_cast<int>(columns.past[column]);
        if (first >= past) {
            continue;
        }
        const int ridge = static_cast<int>(columns.ridge[column]);
        const auto columns_of = hn::Iota(d, static_cast<T>(x));
        const auto at_row_0 = hn::MulAdd(hn::Set(d, X), columns_of, hn::Set(d, a1));
        const auto slope_in = [&](T row) {
            return slope_at(d, along, X * steep, Y1 * steep, Y2 * steep,
                            hn::MulAdd(hn::Set(d, Y1), hn::Set(d, row), at_row_0), Y2 * row + a2, e.s[slice],
                            columns_of, row);
        };
        Slope<D> on_ridge{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
        if constexpr (slopes) {
            on_ridge = slope_in(static_cast<T>(ridge));
        }
        const auto add_rows = [&](int y, int end, int step, auto g, auto h) {
            Pixels<sums, T> pixels(to, static_cast<std::ptrdiff_t>(y) * to.stride + x);
            const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(to.stride) * step;
            auto off_ridge = hn::Set(d, static_cast<T>(y - ridge));
            for (; y != end; y += step) {
                add_bell<sums>(d, hn::Sub(g, edge), shares, pixels);
                if constexpr (slopes) {
                    const Slope<D> slope = straight ? Slope<D>{hn::MulAdd(off_ridge, by_row.column, on_ridge.column),
                                                               hn::MulAdd(off_ridge, by_row.row, on_ridge.row),
                                                               hn::MulAdd(off_ridge, by_row.slice, on_ridge.slice)}
                                                    : slope_in(static_cast<T>(y));
                    add_slope<sums>(d, inside_support(d, g, edge), slope, steepness.ratio, to,
                                    static_cast<std::ptrdiff_t>(y) * to.stride + x);
                    off_ridge = hn::Add(off_ridge, hn::Set(d, static_cast<T>(step)));
                }
                g = hn::Mul(g, h);
                h = hn::Mul(h, q);
                pixels = pixels.further(stride);
            }
        };
        const auto q1_at = [&](int y) { return hn::Add(at_row_0, hn::Set(d, Y1 * static_cast<T>(y))); };
        const auto q2_at = [&](int y) { return Y2 * static_cast<T>(y) + a2; };
        const auto bell = [&](auto q1, T q2) {
            return exp2_nonpositive(d, hn::Mul(minus_k, hn::MulAdd(q1, q1, hn::Set(d, q2 * q2 + s2))));
        };
        // What the Gaussian is multiplied by on the way to the next row: r^2 there less r^2 here.
        const auto growth = [&](auto q1, T q2, T step) {
            const T y1_step = Y1 * step, y2_step = Y2 * step;
            const auto change = hn::MulAdd(hn::Set(d, T(2) * y1_step), q1,
                                           hn::Set(d, y1_step * y1_step + y2_step * (T(2) * q2 + y2_step)));
            return exp2_any(d, hn::Mul(minus_k, change));
        };
        {
            // Upwards and downwards from the ridge.
            const auto q1 = q1_at(ridge);
            const T q2 = q2_at(ridge);
            const auto g = bell(q1, q2), down = growth(q1, q2, T(1));
            add_rows(ridge, std::min(ridge + walked_rows<T>, past), 1, g, down);
            if (ridge > first) {
                const auto up = growth(q1, q2, T(-1));
                add_rows(ridge - 1, std::max(ridge - 1 - walked_rows<T>, first - 1), -1, hn::Mul(g, up),
                         hn::Mul(up, q));
            }
        }
        for (int y = ridge + walked_rows<T>; y < past; y += walked_rows<T>) {
            const auto q1 = q1_at(y);
            const T q2 = q2_at(y);
            add_rows(y, std::min(y + walked_rows<T>, past), 1, bell(q1, q2), growth(q1, q2, T(1)));
        }
        for (int y = ridge - 1 - walked_rows<T>; y >= first; y -= walked_rows<T>) {
            const auto q1 = q1_at(y);
            const T q2 = q2_at(y);
            add_rows(y, std::max(y - walked_rows<T>, first - 1), -1, bell(q1, q2), growth(q1, q2, T(-1)));
        }
    }
}

template <Sums sums, class D, class T, bool slopes>
HWY_NOINLINE void evaluate_rows(D d, const Splat<T, slopes>& splat, const Target<T>& to, const RowShape<T>& shape,
                                const Ellipses<T>& e, int slice, const Amounts<T>& amounts, int x0, int x1, int y0,
                                int y1) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const T X = shape.X * e.scale[slice], Y1 = shape.Y1 * e.scale[slice], Y2 = shape.Y2 * e.scale[slice];
    const T per_X = T(1) / X;
    const auto scale = hn::Set(d, -splat.profile.falloff_log2);
    const auto edge = hn::Set(d, splat.profile.edge);
    const Shares<D> shares(d, amounts);
    const Steepness<sums, T> steepness(splat.steep(), amounts);
    const T steep = steepness.scale;
    const AlongRay<T> along = along_ray(splat, shape, steep);
    for (int y = y0; y < y1; ++y) {
        const T q2 = Y2 * static_cast<T>(y) + e.a2[slice];
        const T inside = e.rest[slice] - q2 * q2;
        if (!(inside > T(0))) {
            continue;
        }
        const T b = Y1 * static_cast<T>(y) + e.a1[slice];
        const T half = std::sqrt(inside) * per_X, centre = -b * per_X;
        const int left = whole(std::ceil(centre - half), x0, x1);
        const int right = whole(std::floor(centre + half) + T(1), x0, x1);
        const auto height = hn::Set(d, q2 * q2 + e.s2[slice]);
        const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * to.stride;
        for (int x = left; x < right; x += lanes) {
            const auto column = hn::Iota(d, static_cast<T>(x));
            const auto q1 = hn::MulAdd(hn::Set(d, X), column, hn::Set(d, b));
            const auto bell = exp2_nonpositive(d, hn::Mul(scale, hn::MulAdd(q1, q1, height)));
            add_bell<sums>(d, hn::Sub(bell, edge), shares, Pixels<sums, T>(to, at + x));
            if constexpr (slopes) {
                const auto slope = slope_at(d, along, X * steep, Y1 * steep, Y2 * steep, q1, q2, e.s[slice], column,
                                            static_cast<T>(y));
                add_slope<sums>(d, inside_support(d, bell, edge), slope, steepness.ratio, to, at + x);
            }
        }
    }
}

/// Each section by itself: an ellipse that leans. Columns of pixels, a vector wide, are walked along y, where one
/// Gaussian follows from the one before by two multiplications, g(y + 1) = g(y) h(y), h(y + 1) = h(y) q; walks
/// start where the column is brightest, and anew every few rows, so that errors do not grow. Where the ellipse is
/// so thin that a vector spans powers of two beyond the format, rows are evaluated one by one.
template <Sums sums, class T, bool slopes>
HWY_NOINLINE int add_ellipses(Splat<T, slopes>& splat, const Section<T>& section, const Amounts<T>& amounts,
                              const RowShape<T>& shape, int count) {
    Ellipses<T> e;
    measure(splat, section, shape, count, e);
    const hn::CappedTag<T, 8> d;
    const hn::CappedTag<T, 16> wide;
    const T steep_1 = std::sqrt(shape.Y1 * shape.Y1 + shape.Y2 * shape.Y2);
    int drawn = 0;
    for (int slice = 0; slice < count; ++slice) {
        if (!(e.rest[slice] > T(0))) {
            continue;
        }
        const int x0 = static_cast<int>(e.x0[slice]), x1 = static_cast<int>(e.x1[slice]);
        const int y0 = static_cast<int>(e.y0[slice]), y1 = static_cast<int>(e.y1[slice]);
        if (x0 >= x1 || y0 >= y1 || !splat.live.sees(x0, y0, x1, y1)) {
            continue;
        }
        const Target<T>& to = splat.targets[slice];
        const T X = shape.X * e.scale[slice], steep = steep_1 * e.scale[slice];
        const auto walks = [&](auto tag) {
            // A walk starts up to a row from where a column is brightest.
            const T across = std::max(T(1), steep) + static_cast<T>(hn::Lanes(tag) - 1) * X;
            return splat.profile.falloff_log2 * (across * across + T(1)) < deepest_span<T>;
        };
        if (!walks(d)) {
            evaluate_rows<sums>(d, splat, to, shape, e, slice, amounts, x0, x1, y0, y1);
        } else if (x1 - x0 > static_cast<int>(hn::Lanes(d)) && walks(wide)) {
            walk<sums>(wide, splat, to, shape, e, slice, amounts, x0, x1, y0, y1);
        } else {
            walk<sums>(d, splat, to, shape, e, slice, amounts, x0, x1, y0, y1);
        }
        splat.single[slice].add(Rect{x0, y0, x1, y1});
        ++drawn;
    }
    return drawn;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_ELLIPSES_INL

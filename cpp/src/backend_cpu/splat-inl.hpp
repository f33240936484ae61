// Adds kernels to sheets: vectors of pixels of one row. Source: IMAGE FORMATION sections 2 and 3; [NM05] section 4.2,
// [NM06] section 4.1, with the factors of backend_cpu/sections.hpp.

#if defined(SHEETSPLAT_SIMD_SPLAT_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_SIMD_SPLAT_INL
#undef SHEETSPLAT_SIMD_SPLAT_INL
#else
#define SHEETSPLAT_SIMD_SPLAT_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// What of a tile's sheets can still be seen, in blocks of 8 by 8 pixels.
struct Live {
    static constexpr int blocks = 8;
    static constexpr int block_edge = 8;

    Rect rect;
    std::uint64_t alive = ~std::uint64_t{0}; ///< bit 8 row + column

    explicit Live(const TileShape& shape) : rect{0, 0, shape.width + 2, shape.height + 2} {}

    /// bits: a row of pixels each.
    void set(const std::vector<std::uint64_t>& bits) {
        alive = 0;
        for (std::size_t y = 0; y < bits.size(); ++y) {
            std::uint64_t row = bits[y];
            // A byte that holds any bit becomes 1.
            row |= row >> 4;
            row |= row >> 2;
            row |= row >> 1;
            row &= 0x0101010101010101ULL;
            alive |= ((row * 0x0102040810204080ULL) >> 56) << (8 * std::min<std::size_t>(y / block_edge, 7));
        }
    }

    /// Whether some block that a box touches is alive. Pixels beyond column 63 and row 63 belong to the last blocks.
    [[nodiscard]] HWY_INLINE bool sees(int x0, int y0, int x1, int y1) const {
        if (alive == ~std::uint64_t{0}) {
            return true;
        }
        const int left = std::min(x0 / block_edge, 7), right = std::min((x1 - 1) / block_edge, 7);
        const int top = std::min(y0 / block_edge, 7), bottom = std::min((y1 - 1) / block_edge, 7);
        const std::uint64_t columns =
            ((std::uint64_t{2} << right) - (std::uint64_t{1} << left)) * 0x0101010101010101ULL;
        const std::uint64_t rows = (~std::uint64_t{0} << (8 * top)) & (~std::uint64_t{0} >> (8 * (7 - bottom)));
        return (alive & columns & rows) != 0;
    }
};

/// Most pixels along an edge of a tile's sheets, rounded up to whole vectors.
constexpr int most_edge = 160;

/// Gauss-Legendre nodes on [-1, 1], one of each pair.
template <class T>
struct Nodes6 {
    static constexpr int pairs = 3;
    static constexpr T node[3] = {T(0.23861918608319691), T(0.66120938646626451), T(0.93246951420315203)};
    static constexpr T share[3] = {T(0.46791393457269104), T(0.36076157304813861), T(0.17132449237917036)};
};

/// The sheets of one slice that a part adds to.
template <class T>
struct Target {
    T* value;
    T* weight; ///< null: not summed
    int stride;
    /// Of derivatives of both over columns, rows and slices: three sheets each, one after the other. Null: not summed.
    T* slope;
    T* weight_slope;
    std::size_t sheet; ///< elements from one sheet to the next
};

/// A pixel's place as a number that fits an int whatever it was.
template <class T>
HWY_INLINE int whole(T at, int low, int high) {
    return static_cast<int>(std::min(std::max(at, static_cast<T>(low)), static_cast<T>(high)));
}

/// Adds t = max(0, bell - edge) times value (and weight) to a vector of pixels.
template <bool with_weight, class D, class V = hn::Vec<D>>
HWY_INLINE void add_bell(D d, V bell_less_edge, V value, V weight, hn::TFromD<D>* values, hn::TFromD<D>* weights) {
    const V t = hn::Max(bell_less_edge, hn::Zero(d));
    hn::StoreU(hn::MulAdd(value, t, hn::LoadU(d, values)), d, values);
    if constexpr (with_weight) {
        hn::StoreU(hn::MulAdd(weight, t, hn::LoadU(d, weights)), d, weights);
    }
}

/// Half the derivative of -r^2 over columns, rows and slices, and what they are multiplied by.
template <class D>
struct Slope {
    hn::Vec<D> column, row, slice;
};

/// Adds bell times slope times `value` (and `weight`) to sheets of derivatives, at element `at`. Those of 2^(-falloff
/// r^2) are this with 2 falloff in value and weight.
template <bool with_weight, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_slope(D d, V bell, const Slope<D>& slope, V value, V weight, const Target<T>& to,
                          std::ptrdiff_t at) {
    const V slopes[3] = {slope.column, slope.row, slope.slice};
    const auto add = [&](V much, T* sheets) {
        for (const V& one : slopes) {
            hn::StoreU(hn::MulAdd(much, one, hn::LoadU(d, sheets + at)), d, sheets + at);
            sheets += to.sheet;
        }
    };
    add(hn::Mul(bell, value), to.slope);
    if constexpr (with_weight) {
        add(hn::Mul(bell, weight), to.weight_slope);
    }
}
/// The Gaussian where it is above its end, else 0.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V inside_support(D d, V bell, V edge) {
    (void)d;
    return hn::IfThenElseZero(hn::Gt(bell, edge), bell);
}

/// exp2(-falloff (at + i step)^2) for i = 0 ... count - 1, whole vectors.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void bells(D d, T falloff_log2, T at, T step, int count, T* out) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto scale = hn::Set(d, -falloff_log2);
    const auto steps = hn::Set(d, step);
    for (int i = 0; i < count; i += lanes) {
        const auto place = hn::MulAdd(steps, hn::Iota(d, static_cast<T>(i)), hn::Set(d, at));
        hn::Store(exp2_nonpositive(d, hn::Mul(scale, hn::Mul(place, place))), d, out + i);
    }
}

/// Where vectors start so that none straddles a line of the cache, which costs several times as much: at x0 or a little
/// before it. Rows of sheets start at whole lines.
template <class T>
HWY_INLINE int start_of(int x0, int x1, int lanes) {
    constexpr int line = 64 / static_cast<int>(sizeof(T));
    const int in_line = x0 & (line - 1);
    if (x1 - x0 <= lanes && in_line + (x1 - x0) <= line) {
        return std::min(x0, x0 - in_line + line - lanes);
    }
    return x0 & ~(lanes - 1);
}

/// Rows of `slices` sections whose Gaussian is a product of one along x, which starts at pixel x0, one along y and one
/// along depth. The sections' sheets are written side by side, so that one loop serves all of them.
template <bool with_weight, int slices, class D, class T = hn::TFromD<D>>
HWY_INLINE void separable_rows(D d, const Target<T>* to, const T* bell_x, const T* bell_y, const T* bell_z, T edge_t,
                               T value_t, T weight_t, int x0, int x1, int y0, int y1) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto edge = hn::Set(d, edge_t);
    const auto value = hn::Set(d, value_t);
    const auto weight = hn::Set(d, weight_t);
    const int stride = to[0].stride;
    // Copies, since the compiler must think that sheets might hold these.
    T* values[slices];
    T* weights[slices];
    T z[slices];
    for (int slice = 0; slice < slices; ++slice) {
        values[slice] = to[slice].value;
        weights[slice] = to[slice].weight;
        z[slice] = bell_z[slice];
    }
    // Column by column of vectors, whose Gaussian along x stays in a register.
    for (int x = x0; x < x1; x += lanes) {
        const auto bell = hn::LoadU(d, bell_x + (x - x0));
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0) * stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += stride) {
            const auto here = hn::Mul(bell, hn::Set(d, bell_y[y]));
            for (int slice = 0; slice < slices; ++slice) {
                add_bell<with_weight>(d, hn::MulSub(here, hn::Set(d, z[slice]), edge), value, weight,
                                      values[slice] + at, with_weight ? weights[slice] + at : nullptr);
            }
        }
    }
}

/// (at + i step) step for i = 0 ... count - 1, whole vectors.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void lines(D d, T at, T step, int count, T* out) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto steps = hn::Set(d, step);
    for (int i = 0; i < count; i += lanes) {
        const auto place = hn::MulAdd(steps, hn::Iota(d, static_cast<T>(i)), hn::Set(d, at));
        hn::Store(hn::Mul(place, steps), d, out + i);
    }
}

/// As separable_rows of one slice, with the derivatives.
template <bool with_weight, class D, class T = hn::TFromD<D>>
HWY_INLINE void separable_slopes(D d, const Target<T>& to, const T* bell_x, const T* bell_y, T bell_z, const T* slope_x,
                                 const T* slope_y, T slope_z, T edge_t, T value_t, T weight_t, T steep, int x0, int x1,
                                 int y0, int y1) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto edge = hn::Set(d, edge_t), value = hn::Set(d, value_t), weight = hn::Set(d, weight_t);
    const auto steep_value = hn::Set(d, steep * value_t), steep_weight = hn::Set(d, steep * weight_t);
    const Target<T> sheets = to;
    for (int x = x0; x < x1; x += lanes) {
        const auto column = hn::Mul(hn::LoadU(d, bell_x + (x - x0)), hn::Set(d, bell_z));
        Slope<D> slope{hn::LoadU(d, slope_x + (x - x0)), hn::Zero(d), hn::Set(d, slope_z)};
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0) * sheets.stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += sheets.stride) {
            const auto bell = hn::Mul(column, hn::Set(d, bell_y[y]));
            slope.row = hn::Set(d, slope_y[y]);
            add_bell<with_weight>(d, hn::Sub(bell, edge), value, weight, sheets.value + at,
                                  with_weight ? sheets.weight + at : nullptr);
            add_slope<with_weight>(d, inside_support(d, bell, edge), slope, steep_value, steep_weight, sheets, at);
        }
    }
}

/// Adds kernels of one field to the sheets of slices n ... n + covered_slices - 1; slopes: their derivatives too.
template <class T, bool slopes>
class Splatter {
  public:
    /// targets: the sheets of these slices. live: where anything can still be seen.
    Splatter(const LoopSetup<T>& setup, const PartProfile<T>& profile, const Live& live, std::int32_t n,
             const Target<T>* targets)
        : setup_(setup), profile_(profile), live_(live), n_(n), targets_(targets) {}

    /// Adds the slices from n on, past of them, of a kernel. Returns how many sections were drawn.
    HWY_INLINE int draw(const Section<T>& section, const SectionExtra<T>& extra, const RowShape<T>& shape, int count) {
        if (setup_.slab) {
            const Rect box{std::max<int>(extra.x0, live_.rect.x0), std::max<int>(extra.y0, live_.rect.y0),
                           std::min<int>(extra.x1, live_.rect.x1), std::min<int>(extra.y1, live_.rect.y1)};
            if (box.empty()) {
                return 0;
            }
            return profile_.weight_channel >= 0 ? slabs<true>(section, extra.weight, shape, count, box)
                                                : slabs<false>(section, extra.weight, shape, count, box);
        }
        const bool upright = shape.Y1 == T(0) && shape.d1 == T(0) && shape.d2 == T(0) && !setup_.perspective;
        if (profile_.weight_channel >= 0) {
            return upright ? spheres<true>(section, extra.weight, shape, T(1) / shape.X, count)
                           : ellipses<true>(section, extra.weight, shape, count);
        }
        return upright ? spheres<false>(section, extra.weight, shape, T(1) / shape.X, count)
                       : ellipses<false>(section, extra.weight, shape, count);
    }

    /// The same for kernels that share one upright shape; per_X: 1 / shape.X.
    template <bool with_weight>
    HWY_INLINE int draw_upright(const Section<T>& section, T weight, const RowShape<T>& shape, T per_X, int count) {
        return spheres<with_weight>(section, weight, shape, per_X, count);
    }

    /// Calls touch(slice, rect) for what was added to, in pixels of the sheets.
    template <class Touch>
    void tell(const Touch& touch) const {
        Rect common;
        for (int slice = covered_slices - 1; slice >= 0; --slice) {
            common.add(through_[slice]);
            Rect rect = single_[slice];
            rect.add(common);
            if (!rect.empty()) {
                touch(n_ + slice, rect);
            }
        }
    }

  private:
    /// One Gaussian along each of x, y and depth serves all sections of a kernel.
    template <bool with_weight>
    HWY_INLINE int spheres(const Section<T>& section, T weight, const RowShape<T>& shape, T per_X, int count) {
        const T per_Y = T(1) / std::abs(shape.Y2);
        const T middle_x = -section.a1 * per_X, middle_y = shape.Y2 < T(0) ? section.a2 * per_Y : -section.a2 * per_Y;
        const Rect box{whole(std::ceil(middle_x - per_X), live_.rect.x0, live_.rect.x1),
                       whole(std::ceil(middle_y - per_Y), live_.rect.y0, live_.rect.y1),
                       whole(std::floor(middle_x + per_X) + T(1), live_.rect.x0, live_.rect.x1),
                       whole(std::floor(middle_y + per_Y) + T(1), live_.rect.y0, live_.rect.y1)};
        if (box.empty() || !live_.sees(box.x0, box.y0, box.x1, box.y1)) {
            return 0;
        }
        HWY_ALIGN T bell_x[most_edge];
        HWY_ALIGN T bell_y[most_edge];
        HWY_ALIGN T bell_z[covered_slices + 16];
        const T k = profile_.falloff_log2;
        // The narrowest vectors that hold a row: wider ones cost more where they are made of two halves.
        const hn::CappedTag<T, 4> narrow;
        const hn::CappedTag<T, 8> middling;
        const hn::CappedTag<T, 16> wide;
        const int width = box.x1 - box.x0, height = box.y1 - box.y0;
        const int size = width <= 4 ? 0 : width <= 24 ? 1 : 2;
        const int lanes = static_cast<int>(size == 0   ? hn::Lanes(narrow)
                                           : size == 1 ? hn::Lanes(middling)
                                                       : hn::Lanes(wide));
        const int start = start_of<T>(box.x0, box.x1, lanes);
        const T at_x = section.a1 + shape.X * static_cast<T>(start);
        const T at_y = section.a2 + shape.Y2 * static_cast<T>(box.y0);
        const T at_z = section.s + static_cast<T>(n_ - section.first) * shape.ds;
        if (box.x1 - start <= 8 && height <= 8) {
            bells(middling, k, at_x, shape.X, 8, bell_x);
            bells(middling, k, at_y, shape.Y2, 8, bell_y);
        } else {
            bells(wide, k, at_x, shape.X, box.x1 - start, bell_x);
            bells(wide, k, at_y, shape.Y2, height, bell_y);
        }
        bells(middling, k, at_z, shape.ds, covered_slices, bell_z);
        through_[count - 1].add(box);
        if constexpr (slopes) {
            HWY_ALIGN T slope_x[most_edge];
            HWY_ALIGN T slope_y[most_edge];
            HWY_ALIGN T slope_z[covered_slices + 16];
            lines(wide, at_x, shape.X, box.x1 - start, slope_x);
            lines(wide, at_y, shape.Y2, height, slope_y);
            lines(middling, at_z, shape.ds, covered_slices, slope_z);
            const auto slice_by_slice = [&](auto d) {
                for (int slice = 0; slice < count; ++slice) {
                    separable_slopes<with_weight>(d, targets_[slice], bell_x, bell_y, bell_z[slice], slope_x, slope_y,
                                                  slope_z[slice], profile_.edge, section.value, weight, steep(), start,
                                                  box.x1, box.y0, box.y1);
                }
            };
            if (size == 0) {
                slice_by_slice(narrow);
            } else if (size == 1) {
                slice_by_slice(middling);
            } else {
                slice_by_slice(wide);
            }
        } else {
            const auto rows = [&](auto d) {
                for (int slice = 0; slice < count;) {
                    const auto add = [&](auto together) {
                        separable_rows<with_weight, together.value>(d, targets_ + slice, bell_x, bell_y, bell_z + slice,
                                                                    profile_.edge, section.value, weight, start, box.x1,
                                                                    box.y0, box.y1);
                        slice += together.value;
                    };
                    switch (std::min(count - slice, 5)) {
                    case 1:
                        add(std::integral_constant<int, 1>());
                        break;
                    case 2:
                        add(std::integral_constant<int, 2>());
                        break;
                    case 3:
                        add(std::integral_constant<int, 3>());
                        break;
                    case 4:
                        add(std::integral_constant<int, 4>());
                        break;
                    default:
                        add(std::integral_constant<int, 5>());
                    }
                }
            };
            if (size == 0) {
                rows(narrow);
            } else if (size == 1) {
                rows(middling);
            } else {
                rows(wide);
            }
        }
        return count;
    }

    /// Each section by itself: an ellipse that leans. Columns of pixels, a vector wide, are walked along y, where one
    /// Gaussian follows from the one before by two multiplications, g(y + 1) = g(y) h(y), h(y + 1) = h(y) q; walks
    /// start where the column is brightest, and anew every few rows, so that errors do not grow. Where the ellipse is
    /// so thin that a vector spans powers of two beyond the format, rows are evaluated one by one.
    template <bool with_weight>
    HWY_INLINE int ellipses(const Section<T>& section, T weight, const RowShape<T>& shape, int count) {
        Ellipses e;
        measure(section, shape, count, e);
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
            if (x0 >= x1 || y0 >= y1 || !live_.sees(x0, y0, x1, y1)) {
                continue;
            }
            const Target<T>& to = targets_[slice];
            const T X = shape.X * e.scale[slice], steep = steep_1 * e.scale[slice];
            const auto walks = [&](auto tag) {
                // A walk starts up to a row from where a column is brightest.
                const T across = std::max(T(1), steep) + static_cast<T>(hn::Lanes(tag) - 1) * X;
                return profile_.falloff_log2 * (across * across + T(1)) < deepest();
            };
            if (!walks(d)) {
                rows<with_weight>(d, to, shape, e, slice, section.value, weight, x0, x1, y0, y1);
            } else if (x1 - x0 > static_cast<int>(hn::Lanes(d)) && walks(wide)) {
                walk<with_weight>(wide, to, shape, e, slice, section.value, weight, x0, x1, y0, y1);
            } else {
                walk<with_weight>(d, to, shape, e, slice, section.value, weight, x0, x1, y0, y1);
            }
            single_[slice].add(Rect{x0, y0, x1, y1});
            ++drawn;
        }
        return drawn;
    }

    /// The sections of a kernel, one a slice: all of them are measured at once.
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

    HWY_INLINE void measure(const Section<T>& section, const RowShape<T>& shape, int count, Ellipses& e) const {
        const hn::CappedTag<T, 8> d;
        using V = hn::Vec<decltype(d)>;
        const V one = hn::Set(d, T(1)), zero = hn::Zero(d);
        // Lengths in the unit sphere scale with the depth in perspective, and those on the screen against it.
        const T steep = std::sqrt(shape.Y1 * shape.Y1 + shape.Y2 * shape.Y2);
        const T per_X = T(1) / shape.X, per_Y2 = T(1) / shape.Y2;
        const T slant = shape.Y1 * per_X, reach = steep * std::abs(per_Y2) * per_X;
        const T tip = std::abs(shape.Y1 * per_Y2) * per_X;
        const auto edge = [&](int pixel) { return hn::Set(d, static_cast<T>(pixel)); };
        const V left = edge(live_.rect.x0), right = edge(live_.rect.x1);
        const V top = edge(live_.rect.y0), bottom = edge(live_.rect.y1);
        for (int slice = 0; slice < count; slice += static_cast<int>(hn::Lanes(d))) {
            const V along = hn::Iota(d, static_cast<T>(n_ - section.first + slice));
            V scale = one;
            if (setup_.perspective) {
                scale = hn::MulAdd(hn::Iota(d, static_cast<T>(slice)), hn::Set(d, static_cast<T>(setup_.slice_spacing)),
                                   hn::Set(d, depth_of(n_)));
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

    /// Powers of two that a vector may span before its least lanes vanish: less than the format has, by what a walk
    /// adds.
    static constexpr T deepest() { return sizeof(T) == 4 ? T(118) : T(1000); }
    /// Rows of a walk: errors grow with the square, to some 50 roundings.
    static constexpr int walked_rows = sizeof(T) == 4 ? 20 : 48;

    /// Columns of a vector's width, and of each the rows that the ellipse reaches there.
    struct Columns {
        static constexpr int room = most_edge + 16; // a vector may be a single number
        HWY_ALIGN T first[room];
        HWY_ALIGN T past[room];
        HWY_ALIGN T ridge[room]; ///< the brightest row
    };

    HWY_INLINE void measure_columns(const RowShape<T>& shape, const Ellipses& e, int slice, int start, int lanes,
                                    int x0, int x1, int y0, int y1, Columns& columns) const {
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
            const V low = hn::Sub(
                hn::Max(hn::Min(x, hn::Set(d, static_cast<T>(x1 - 1))), hn::Set(d, static_cast<T>(x0))), middle_x);
            const V high =
                hn::Sub(hn::Min(hn::Add(x, hn::Set(d, static_cast<T>(lanes - 1))), hn::Set(d, static_cast<T>(x1 - 1))),
                        middle_x);
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
            bottom =
                hn::IfThenElse(hn::And(hn::Le(low, hn::Neg(top_tip)), hn::Le(hn::Neg(top_tip), high)), lower, bottom);
            // (A row more on each side: what is computed in T ends on either side of a pixel.)
            const V first = hn::Min(hn::Max(hn::Floor(top), upper), lower);
            const V past = hn::Min(hn::Max(hn::Add(hn::Ceil(bottom), one), upper), lower);
            const V brightest = hn::Floor(hn::Mul(hn::Set(d, T(0.5)), hn::Add(at_low, at_high)));
            hn::Store(first, d, columns.first + column);
            hn::Store(past, d, columns.past + column);
            hn::Store(hn::Max(hn::Min(brightest, hn::Sub(past, one)), first), d, columns.ridge + column);
        }
    }

    /// What a derivative of 2^(-falloff r^2) is multiplied by beside half that of -r^2.
    [[nodiscard]] HWY_INLINE T steep() const { return T(-2) * profile_.root_falloff * profile_.root_falloff; }

    /// How q changes from slice to slice along a pixel's ray; in perspective rays part.
    struct AlongRay {
        T X, Y1, Y2, d1, d2, d3;
        template <class D, class V = hn::Vec<D>>
        [[nodiscard]] HWY_INLINE V first(D d, V column, T row) const {
            return hn::MulAdd(hn::Set(d, X), column, hn::Set(d, Y1 * row + d1));
        }
        [[nodiscard]] HWY_INLINE T second(T row) const { return Y2 * row + d2; }
    };
    [[nodiscard]] HWY_INLINE AlongRay along_ray(const RowShape<T>& shape) const {
        const T spread = setup_.perspective ? static_cast<T>(setup_.slice_spacing) : T(0);
        return {spread * shape.X, spread * shape.Y1, spread * shape.Y2, shape.d1, shape.d2, shape.ds};
    }
    /// r dr over columns, rows and slices at q = (q1, q2, s).
    template <class D, class V = hn::Vec<D>>
    HWY_INLINE Slope<D> slope_at(D d, const AlongRay& along, T X, T Y1, T Y2, V q1, T q2, T s, V column, T row) const {
        return {hn::Mul(q1, hn::Set(d, X)), hn::MulAdd(q1, hn::Set(d, Y1), hn::Set(d, q2 * Y2)),
                hn::MulAdd(q1, along.first(d, column, row), hn::Set(d, q2 * along.second(row) + s * along.d3))};
    }

    template <bool with_weight, class D>
    HWY_INLINE void walk(D d, const Target<T>& to, const RowShape<T>& shape, const Ellipses& e, int slice, T value_t,
                         T weight_t, int x0, int x1, int y0, int y1) const {
        const int lanes = static_cast<int>(hn::Lanes(d));
        const int start = start_of<T>(x0, x1, lanes);
        Columns columns;
        measure_columns(shape, e, slice, start, lanes, x0, x1, y0, y1, columns);
        const T k = profile_.falloff_log2;
        const T X = shape.X * e.scale[slice], Y1 = shape.Y1 * e.scale[slice], Y2 = shape.Y2 * e.scale[slice];
        const T a1 = e.a1[slice], a2 = e.a2[slice], s2 = e.s2[slice];
        const auto q = exp2_nonpositive(d, hn::Set(d, -T(2) * k * (Y1 * Y1 + Y2 * Y2)));
        const auto value = hn::Set(d, value_t), weight = hn::Set(d, weight_t);
        const auto edge = hn::Set(d, profile_.edge);
        const auto minus_k = hn::Set(d, -k);
        const auto steep_value = hn::Set(d, steep() * value_t), steep_weight = hn::Set(d, steep() * weight_t);
        const AlongRay along = along_ray(shape);
        for (int x = start, column = 0; x < x1; x += lanes, ++column) {
            const int first = static_cast<int>(columns.first[column]), past = static_cast<int>(columns.past[column]);
            if (first >= past) {
                continue;
            }
            const int ridge = static_cast<int>(columns.ridge[column]);
            const auto columns_of = hn::Iota(d, static_cast<T>(x));
            const auto at_row_0 = hn::MulAdd(hn::Set(d, X), columns_of, hn::Set(d, a1));
            const auto add_rows = [&](int y, int end, int step, auto g, auto h) {
                T* values = to.value + static_cast<std::ptrdiff_t>(y) * to.stride + x;
                T* weights = with_weight ? to.weight + static_cast<std::ptrdiff_t>(y) * to.stride + x : nullptr;
                const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(to.stride) * step;
                for (; y != end; y += step) {
                    add_bell<with_weight>(d, hn::Sub(g, edge), value, weight, values, weights);
                    if constexpr (slopes) {
                        const T row = static_cast<T>(y);
                        const auto slope =
                            slope_at(d, along, X, Y1, Y2, hn::MulAdd(hn::Set(d, Y1), hn::Set(d, row), at_row_0),
                                     Y2 * row + a2, e.s[slice], columns_of, row);
                        add_slope<with_weight>(d, inside_support(d, g, edge), slope, steep_value, steep_weight, to,
                                               static_cast<std::ptrdiff_t>(y) * to.stride + x);
                    }
                    g = hn::Mul(g, h);
                    h = hn::Mul(h, q);
                    values += stride;
                    if constexpr (with_weight) {
                        weights += stride;
                    }
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
                add_rows(ridge, std::min(ridge + walked_rows, past), 1, g, down);
                if (ridge > first) {
                    const auto up = growth(q1, q2, T(-1));
                    add_rows(ridge - 1, std::max(ridge - 1 - walked_rows, first - 1), -1, hn::Mul(g, up),
                             hn::Mul(up, q));
                }
            }
            for (int y = ridge + walked_rows; y < past; y += walked_rows) {
                const auto q1 = q1_at(y);
                const T q2 = q2_at(y);
                add_rows(y, std::min(y + walked_rows, past), 1, bell(q1, q2), growth(q1, q2, T(1)));
            }
            for (int y = ridge - 1 - walked_rows; y >= first; y -= walked_rows) {
                const auto q1 = q1_at(y);
                const T q2 = q2_at(y);
                add_rows(y, std::max(y - walked_rows, first - 1), -1, bell(q1, q2), growth(q1, q2, T(-1)));
            }
        }
    }

    /// 2^x, for exponents that the format has; above them what is not needed, since it meets a 0.
    template <class D, class V>
    HWY_INLINE V exp2_any(D d, V x) const {
        return exp2_nonpositive(d, hn::Min(x, hn::Set(d, deepest())));
    }

    template <bool with_weight, class D>
    HWY_INLINE void rows(D d, const Target<T>& to, const RowShape<T>& shape, const Ellipses& e, int slice, T value_t,
                         T weight_t, int x0, int x1, int y0, int y1) const {
        const int lanes = static_cast<int>(hn::Lanes(d));
        const T X = shape.X * e.scale[slice], Y1 = shape.Y1 * e.scale[slice], Y2 = shape.Y2 * e.scale[slice];
        const T per_X = T(1) / X;
        const auto scale = hn::Set(d, -profile_.falloff_log2);
        const auto edge = hn::Set(d, profile_.edge);
        const auto value = hn::Set(d, value_t), weight = hn::Set(d, weight_t);
        const auto steep_value = hn::Set(d, steep() * value_t), steep_weight = hn::Set(d, steep() * weight_t);
        const AlongRay along = along_ray(shape);
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
                add_bell<with_weight>(d, hn::Sub(bell, edge), value, weight, to.value + at + x,
                                      with_weight ? to.weight + at + x : nullptr);
                if constexpr (slopes) {
                    const auto slope = slope_at(d, along, X, Y1, Y2, q1, q2, e.s[slice], column, static_cast<T>(y));
                    add_slope<with_weight>(d, inside_support(d, bell, edge), slope, steep_value, steep_weight, to,
                                           at + x);
                }
            }
        }
    }

    /// Means over slabs along the rays of the pixels: closed form over the chord where it is long against the Gaussian,
    /// quadrature where the difference of two erf would cancel.
    template <bool with_weight>
    HWY_INLINE int slabs(const Section<T>& section, T weight_t, const RowShape<T>& shape, int count, const Rect& box) {
        if (!live_.sees(box.x0, box.y0, box.x1, box.y1)) {
            return 0;
        }
        const hn::CappedTag<T, 16> d;
        using V = hn::Vec<decltype(d)>;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const V zero = hn::Zero(d), one = hn::Set(d, T(1)), half_slab = hn::Set(d, T(0.5));
        const V k = hn::Set(d, -profile_.falloff_log2), edge = hn::Set(d, profile_.edge);
        const V root_k = hn::Set(d, profile_.root_falloff);
        const V value = hn::Set(d, section.value), weight = hn::Set(d, weight_t);
        const V steep_value = hn::Set(d, steep() * section.value), steep_weight = hn::Set(d, steep() * weight_t);
        const V w3 = hn::Set(d, shape.ds);
        int drawn = 0;
        for (int slice = 0; slice < count; ++slice) {
            const std::int32_t n = n_ + slice;
            const T along = static_cast<T>(n - section.first);
            const T t = setup_.perspective ? depth_of(n) : T(1);
            const T X = shape.X * t, Y1 = shape.Y1 * t, Y2 = shape.Y2 * t;
            // Along a pixel's ray q changes by w from slice to slice; in perspective rays part.
            const T spread = setup_.perspective ? static_cast<T>(setup_.slice_spacing) : T(0);
            const T a1 = section.a1 + along * shape.d1, a2 = section.a2 + along * shape.d2;
            const V q3 = hn::Set(d, section.s + along * shape.ds);
            const Target<T>& to = targets_[slice];
            bool any = false;
            for (int y = box.y0; y < box.y1; ++y) {
                const T row = static_cast<T>(y);
                const V q2 = hn::Set(d, Y2 * row + a2), b = hn::Set(d, Y1 * row + a1);
                const V w2 = hn::Set(d, spread * shape.Y2 * row + shape.d2);
                const V w1_row = hn::Set(d, spread * shape.Y1 * row + shape.d1);
                const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * to.stride;
                for (int x = box.x0; x < box.x1; x += lanes) {
                    const V column = hn::Iota(d, static_cast<T>(x));
                    const V q1 = hn::MulAdd(hn::Set(d, X), column, b);
                    const V w1 = hn::MulAdd(hn::Set(d, spread * shape.X), column, w1_row);
                    // The ray's nearest approach to the centre, by the cross product: nothing cancels there.
                    const V c1 = hn::MulSub(q2, w3, hn::Mul(q3, w2));
                    const V c2 = hn::MulSub(q3, w1, hn::Mul(q1, w3));
                    const V c3 = hn::MulSub(q1, w2, hn::Mul(q2, w1));
                    const V speed2 = hn::MulAdd(w1, w1, hn::MulAdd(w2, w2, hn::Mul(w3, w3)));
                    const V per_speed2 = hn::Div(one, speed2);
                    const V p2 = hn::Mul(hn::MulAdd(c1, c1, hn::MulAdd(c2, c2, hn::Mul(c3, c3))), per_speed2);
                    const V nearest =
                        hn::Neg(hn::Mul(hn::MulAdd(q1, w1, hn::MulAdd(q2, w2, hn::Mul(q3, w3))), per_speed2));
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
                    if (hn::AllTrue(d, hn::Lt(widest, hn::Set(d, thin())))) {
                        mean = quadrature<Nodes6<T>>(d, low, high, nearest, hn::Mul(k, speed2), beside, moment);
                    } else {
                        mean = closed_form(d, low, high, nearest, rate, beside);
                        if constexpr (slopes) {
                            moment = moment_over(d, low, high, nearest, hn::Mul(k, speed2), rate, beside);
                        }
                    }
                    if constexpr (slopes) {
                        // The mean of q times the Gaussian: at the ray's nearest approach q is w x (q x w) / w^2.
                        const V share = hn::Mul(mean, per_speed2);
                        const V m1 = hn::MulAdd(moment, w1, hn::Mul(share, hn::MulSub(w2, c3, hn::Mul(w3, c2))));
                        const V m2 = hn::MulAdd(moment, w2, hn::Mul(share, hn::MulSub(w3, c1, hn::Mul(w1, c3))));
                        const V m3 = hn::MulAdd(moment, w3, hn::Mul(share, hn::MulSub(w1, c2, hn::Mul(w2, c1))));
                        const Slope<hn::CappedTag<T, 16>> slope{
                            hn::Mul(m1, hn::Set(d, X)), hn::MulAdd(m1, hn::Set(d, Y1), hn::Mul(m2, hn::Set(d, Y2))),
                            hn::MulAdd(m1, w1, hn::MulAdd(m2, w2, hn::Mul(m3, w3)))};
                        const V there = hn::IfThenElseZero(hn::Gt(length, zero), one);
                        add_slope<with_weight>(d, there, slope, steep_value, steep_weight, to, at + x);
                    }
                    const V rest = hn::Sub(mean, hn::Mul(edge, length));
                    add_bell<false>(d, rest, value, weight, to.value + at + x, nullptr);
                    if constexpr (with_weight) {
                        // Where a steep profile has nothing left, or a difference of two erf cancels, the ray still
                        // meets the support: the point is not empty.
                        const V least =
                            hn::IfThenElseZero(hn::Gt(length, zero), hn::Set(d, std::numeric_limits<T>::min()));
                        T* weights = to.weight + at + x;
                        const V added = hn::Max(hn::Mul(weight, hn::Max(rest, zero)), least);
                        hn::StoreU(hn::Add(hn::LoadU(d, weights), added), d, weights);
                    }
                }
            }
            if (any) {
                single_[slice].add(box);
                ++drawn;
            }
        }
        return drawn;
    }

    /// Below this many of the Gaussian's own lengths a slab is integrated by quadrature: six nodes are exact there to
    /// the rounding of T (the remainder of 6-point Gauss-Legendre at a length of 1.4 is 1e-8, at 0.25 4e-17).
    static constexpr T thin() { return sizeof(T) == 4 ? T(1.4) : T(0.25); }

    template <class Nodes, class D, class V>
    HWY_INLINE V quadrature(D d, V low, V high, V nearest, V scale, V beside, V& moment) const {
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
    template <class D, class V>
    HWY_INLINE V moment_over(D d, V low, V high, V nearest, V scale, V rate, V beside) const {
        const V a = hn::Sub(low, nearest), b = hn::Sub(high, nearest);
        const V over = hn::Sub(exp2_nonpositive(d, hn::Mul(scale, hn::Mul(a, a))),
                               exp2_nonpositive(d, hn::Mul(scale, hn::Mul(b, b))));
        return hn::Div(hn::Mul(hn::Mul(over, beside), hn::Set(d, T(0.5))), hn::Mul(rate, rate));
    }

    template <class D, class V>
    HWY_INLINE V closed_form(D d, V low, V high, V nearest, V rate, V beside) const {
        const V a = erf(d, hn::Mul(rate, hn::Sub(low, nearest)));
        const V b = erf(d, hn::Mul(rate, hn::Sub(high, nearest)));
        const V half_root_pi = hn::Set(d, T(0.88622692545275801));
        return hn::Mul(hn::Mul(beside, half_root_pi), hn::Div(hn::Sub(b, a), rate));
    }

    HWY_INLINE T depth_of(std::int32_t n) const {
        return static_cast<T>(setup_.first_depth + static_cast<double>(n) * setup_.slice_spacing);
    }

    const LoopSetup<T>& setup_;
    const PartProfile<T>& profile_;
    const Live& live_;
    std::int32_t n_;
    const Target<T>* targets_;
    Rect through_[covered_slices]; ///< added to slices n ... n + i
    Rect single_[covered_slices];  ///< added to slice n + i alone
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif

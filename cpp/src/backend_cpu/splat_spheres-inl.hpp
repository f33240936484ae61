// The splat loop of kernels whose axes are those of the picture in orthographic views, spheres among them: one Gaussian
// along rows, one along columns and one along depth. Source: [NM05] section 4.2.

#if defined(SHEETSPLAT_CPU_SPLAT_SPHERES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_SPHERES_INL
#undef SHEETSPLAT_CPU_SPLAT_SPHERES_INL
#else
#define SHEETSPLAT_CPU_SPLAT_SPHERES_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <type_traits>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

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

/// Gaussians of `slices` sections that share one along x, which starts at the first column, and one along y; the latter
/// and those along depth are stride_of_bells elements apart.
template <class D, int slices, int stride_of_bells>
class SeparableBells {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;

  public:
    HWY_INLINE SeparableBells(const T* bell_x, const T* bell_y, const T* bell_z) : bell_x_(bell_x), bell_y_(bell_y) {
        for (int slice = 0; slice < slices; ++slice) {
            z_[slice] = bell_z[slice * stride_of_bells];
        }
    }
    HWY_INLINE void at_column(int x) { column_ = hn::LoadU(D(), bell_x_ + x); }
    HWY_INLINE void at_row(int y) { here_ = hn::Mul(column_, hn::Set(D(), bell_y_[y * stride_of_bells])); }
    [[nodiscard]] HWY_INLINE V less(V edge, int slice) const {
        return hn::MulSub(here_, hn::Set(D(), z_[slice]), edge);
    }

  private:
    const T* bell_x_;
    const T* bell_y_;
    T z_[slices];
    V column_, here_;
};

/// Adds rows of `slices` sections, whose sheets are written side by side, so that one loop serves all of them; column
/// by column of vectors, of which `bells` keeps what it can in registers.
template <Sums sums, int slices, class D, class Bells, class T = hn::TFromD<D>>
HWY_INLINE void add_rows(D d, const Target<T>* to, Bells bells, T edge_t, const Amounts<T>& amounts, int x0, int x1,
                         int y0, int y1) {
    const auto edge = hn::Set(d, edge_t);
    const Shares<D> shares(d, amounts);
    const std::ptrdiff_t stride = to[0].stride;
    // Copies, since the compiler must think that sheets might hold these.
    Pixels<sums, T> sheets[slices];
    for (int slice = 0; slice < slices; ++slice) {
        sheets[slice] = Pixels<sums, T>(to[slice], 0);
    }
    for (int x = x0; x < x1; x += static_cast<int>(hn::Lanes(d))) {
        bells.at_column(x - x0);
        std::ptrdiff_t at = y0 * stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += stride) {
            bells.at_row(y);
            for (int slice = 0; slice < slices; ++slice) {
                add_bell<sums>(d, bells.less(edge, slice), shares, sheets[slice].further(at));
            }
        }
    }
}

/// Sheets of several lattices, of the slices that a kernel meets, and what it adds to each.
template <class T, std::size_t most>
struct SeveralTargets {
    const Target<T>* to[most + 1]; ///< (and room for one that is not taken)
    T value[most + 1];
    std::size_t field[most + 1]; ///< which of the lattices
    int count = 0;

    /// Takes those of which a kernel has a value. (Without a branch for each, which would be foreseen by chance.)
    template <bool slopes>
    HWY_INLINE SeveralTargets(const Splat<T, slopes>* splats, const T* values, std::size_t fields) {
        for (std::size_t number = 0; number < fields; ++number) {
            to[count] = splats[number].targets;
            value[count] = values[number];
            field[count] = number;
            count += values[number] != T(0) ? 1 : 0;
        }
    }
    /// Calls use(count) with the number as a constant; not for 0.
    template <class Use, int number = static_cast<int>(most)>
    HWY_INLINE void with_count(const Use& use) const {
        if constexpr (number > 0) {
            if (count == number) {
                use(std::integral_constant<int, number>());
            } else {
                with_count<Use, number - 1>(use);
            }
        }
    }
};

/// Slices of a kernel whose rows are written side by side, in sheets of each of some lattices.
template <int fields>
constexpr int most_of_several = fields == 1 ? 5 : (fields == 2 ? 3 : 2);

/// As add_rows, to the sheets of `fields` lattices, from a slice on.
template <int fields, int slices, class D, class Bells, std::size_t most, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_rows_of_several(D d, const SeveralTargets<T, most>& all, int first, Bells bells, T edge_t, int x0,
                                    int x1, int y0, int y1) {
    const V edge = hn::Set(d, edge_t), zero = hn::Zero(d);
    const std::ptrdiff_t stride = all.to[0][0].stride;
    T* sheets[slices][fields];
    V amounts[fields];
    for (int field = 0; field < fields; ++field) {
        amounts[field] = hn::Set(d, all.value[field]);
        for (int slice = 0; slice < slices; ++slice) {
            sheets[slice][field] = all.to[field][first + slice].value;
        }
    }
    for (int x = x0; x < x1; x += static_cast<int>(hn::Lanes(d))) {
        bells.at_column(x - x0);
        std::ptrdiff_t at = y0 * stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += stride) {
            bells.at_row(y);
            for (int slice = 0; slice < slices; ++slice) {
                const V t = hn::Max(bells.less(edge, slice), zero);
                for (int field = 0; field < fields; ++field) {
                    T* to = sheets[slice][field] + at;
                    hn::StoreU(hn::MulAdd(amounts[field], t, hn::LoadU(d, to)), d, to);
                }
            }
        }
    }
}

/// (at + i step) step scale for i = 0 ... count - 1, whole vectors.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void lines(D d, T at, T step, T scale, int count, T* out) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    for (int i = 0; i < count; i += lanes) {
        const auto place = hn::MulAdd(hn::Set(d, step), hn::Iota(d, static_cast<T>(i)), hn::Set(d, at));
        hn::Store(hn::Mul(place, hn::Set(d, step * scale)), d, out + i);
    }
}

/// The rows of a box that sections of an upright kernel reach, by columns.
template <class T>
struct ReachedRows {
    T at_x, X;      ///< q1 at the first column, and its change
    T middle, half; ///< row of the centre, counted from the box's first one; radius
    T rest;         ///< 1 - s^2 of the largest section
    int rows;

    /// Calls use(first, past) with the rows of `count` columns from the given one on. What rounding might leave in the
    /// support is among them.
    template <class Use>
    HWY_INLINE void of_columns(int column, int count, const Use& use) const {
        const T low = at_x + X * static_cast<T>(column), high = low + X * static_cast<T>(count - 1);
        const T nearest = low > T(0) ? low : std::min(high, T(0));
        const T inside = rest - nearest * nearest + T(1e-5);
        if (inside > T(0)) {
            const T reach = half * std::sqrt(inside);
            use(whole(std::ceil(middle - reach), 0, rows), whole(std::floor(middle + reach) + T(1), 0, rows));
        }
    }
};
/// All rows, of kernels so small that choosing takes longer.
struct AllRows {
    int rows;
    template <class Use>
    HWY_INLINE void of_columns(int /*column*/, int /*count*/, const Use& use) const {
        use(0, rows);
    }
};

/// As add_rows of SeparableBells, with the derivatives.
template <Sums sums, int slices, int stride_of_bells = 1, class D, class Rows, class T = hn::TFromD<D>>
HWY_INLINE void separable_slopes(D d, const Target<T>* to, const T* bell_x, const T* bell_y, const T* bell_z,
                                 const T* slope_x, const T* slope_y, const T* slope_z, T edge_t,
                                 const Amounts<T>& amounts, const Steepness<sums, T>& steepness, const Rows& rows,
                                 int x0, int x1, int y0) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto edge = hn::Set(d, edge_t);
    const Shares<D> shares(d, amounts);
    const std::ptrdiff_t stride = to[0].stride;
    Target<T> sheets[slices];
    T z[slices], steep_z[slices];
    for (int slice = 0; slice < slices; ++slice) {
        sheets[slice] = to[slice];
        z[slice] = bell_z[slice * stride_of_bells];
        steep_z[slice] = slope_z[slice * stride_of_bells];
    }
    for (int x = x0; x < x1; x += lanes) {
        const auto column = hn::LoadU(d, bell_x + (x - x0));
        const auto slope_x_here = hn::LoadU(d, slope_x + (x - x0));
        rows.of_columns(x - x0, lanes, [&](int first, int past) {
            std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0 + first) * stride + x;
            for (int y = first; y < past; ++y, at += stride) {
                const auto here = hn::Mul(column, hn::Set(d, bell_y[y * stride_of_bells]));
                const auto slope_y_here = hn::Set(d, slope_y[y * stride_of_bells]);
                for (int slice = 0; slice < slices; ++slice) {
                    const Target<T>& sheet = sheets[slice];
                    const auto bell = hn::Mul(here, hn::Set(d, z[slice]));
                    add_bell<sums>(d, hn::Sub(bell, edge), shares, Pixels<sums, T>(sheet, at));
                    add_slope<sums>(d, inside_support(d, bell, edge),
                                    Slope<D>{slope_x_here, slope_y_here, hn::Set(d, steep_z[slice])}, steepness.ratio,
                                    sheet, at);
                }
            }
        });
    }
}

/// One Gaussian along each of x, y and depth serves all sections of a kernel.
template <Sums sums, class T, bool slopes>
HWY_NOINLINE int add_spheres(Splat<T, slopes>& splat, const Section<T>& section, const Amounts<T>& amounts,
                             const RowShape<T>& shape, T per_X, int count) {
    const T per_Y = T(1) / std::abs(shape.Y2);
    const T middle_x = -section.a1 * per_X, middle_y = shape.Y2 < T(0) ? section.a2 * per_Y : -section.a2 * per_Y;
    const Rect box{whole(std::ceil(middle_x - per_X), splat.live.rect.x0, splat.live.rect.x1),
                   whole(std::ceil(middle_y - per_Y), splat.live.rect.y0, splat.live.rect.y1),
                   whole(std::floor(middle_x + per_X) + T(1), splat.live.rect.x0, splat.live.rect.x1),
                   whole(std::floor(middle_y + per_Y) + T(1), splat.live.rect.y0, splat.live.rect.y1)};
    if (box.empty() || !splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    HWY_ALIGN T bell_x[most_edge];
    HWY_ALIGN T bell_y[most_edge];
    HWY_ALIGN T bell_z[covered_slices + 16];
    const T k = splat.profile.falloff_log2;
    const hn::CappedTag<T, 8> middling;
    const hn::CappedTag<T, 16> wide;
    const int width = box.x1 - box.x0, height = box.y1 - box.y0;
    const int start = start_of<T>(box.x0, box.x1, narrowest_lanes<T>(width));
    const T at_x = section.a1 + shape.X * static_cast<T>(start);
    const T at_y = section.a2 + shape.Y2 * static_cast<T>(box.y0);
    const T at_z = section.s + static_cast<T>(splat.n - section.first) * shape.ds;
    if (box.x1 - start <= 8 && height <= 8) {
        bells(middling, k, at_x, shape.X, 8, bell_x);
        bells(middling, k, at_y, shape.Y2, 8, bell_y);
    } else {
        bells(wide, k, at_x, shape.X, box.x1 - start, bell_x);
        bells(wide, k, at_y, shape.Y2, height, bell_y);
    }
    bells(middling, k, at_z, shape.ds, covered_slices, bell_z);
    splat.through[count - 1].add(box);
    HWY_ALIGN T slope_x[slopes ? most_edge : 1];
    HWY_ALIGN T slope_y[slopes ? most_edge : 1];
    HWY_ALIGN T slope_z[slopes ? covered_slices + 16 : 1];
    const Steepness<sums, T> steepness(splat.steep(), amounts);
    if constexpr (slopes) {
        lines(wide, at_x, shape.X, steepness.scale, box.x1 - start, slope_x);
        lines(wide, at_y, shape.Y2, steepness.scale, height, slope_y);
        lines(middling, at_z, shape.ds, steepness.scale, covered_slices, slope_z);
    }
    in_narrowest<T>(width, [&](auto d) {
        in_batches<most_together<sums, slopes>>(0, count, [&](int slice, auto number) {
            constexpr int together = number.value;
            if constexpr (slopes) {
                // The section nearest to the centre is the largest.
                const T one_end = at_z + shape.ds * static_cast<T>(slice);
                const T other = one_end + shape.ds * static_cast<T>(together - 1);
                const T least = one_end * other > T(0) ? std::min(std::abs(one_end), std::abs(other)) : T(0);
                const ReachedRows<T> rows{
                    at_x, shape.X, middle_y - static_cast<T>(box.y0), per_Y, T(1) - least * least, height};
                separable_slopes<sums, together>(d, splat.targets + slice, bell_x, bell_y, bell_z + slice, slope_x,
                                                 slope_y, slope_z + slice, splat.profile.edge, amounts, steepness, rows,
                                                 start, box.x1, box.y0);
            } else {
                add_rows<sums, together>(d, splat.targets + slice,
                                         SeparableBells<decltype(d), together, 1>(bell_x, bell_y, bell_z + slice),
                                         splat.profile.edge, amounts, start, box.x1, box.y0, box.y1);
            }
        });
    });
    return count;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_SPHERES_INL

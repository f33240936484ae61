// The splat loop of kernels of one shape whose sections differ in place alone (and, in perspective, in scale): those of
// lattices with unequal spacing, and all of lattices in perspective. Around a pixel (x_c, y_c) near the kernel's centre
//     r^2 = (X u + A)^2  +  (m (m + 2 A) + (Y2 v + a2')^2 + s^2)  +  2 X Y1 u v,      m = Y1 v,
// with u = x - x_c, v = y - y_c, A and a2' being q1 and q2 at that pixel: a Gaussian along rows, times one along
// columns, times a factor that is the same for all kernels and comes from a table; 1 where a kernel's axes are those of
// the picture. Source: [NM05] section 4.2, with the factors of backend_cpu/sections.hpp.

#if defined(SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL
#undef SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL
#else
#define SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Tables of exp2(-2 falloff X Y1 u v), one for all slices, or in perspective one each, for up to largest_lean_px
/// pixels from a kernel's centre.
template <class T>
class LeanTables {
  public:
    /// Those of slices n ... n + covered_slices - 1. False where kernels there are too large for them, or lean so much
    /// that the factors would leave the format.
    bool make(const LoopSetup<T>& setup, const PartProfile<T>& profile, const TileKernels<T>& kernels,
              const TileShape& tile, std::int64_t n) {
        if (setup.perspective ? n == made_ : made_ >= 0) {
            return fits_;
        }
        made_ = n;
        const RowShape<T>& shape = kernels.shapes.front();
        const double half_depth = setup.slice_spacing / -static_cast<double>(shape.ds);
        const int count = setup.perspective
                              ? static_cast<int>(std::min<std::int64_t>(covered_slices, kernels.last_slice + 1 - n))
                              : 1;
        const auto depth = [&](std::int64_t slice) {
            return setup.perspective ? setup.first_depth + static_cast<double>(slice) * setup.slice_spacing : 1.0;
        };
        // A centre that meets slice n, and is not too near for its reach to hold, is no nearer than this.
        const double nearest = setup.perspective ? std::max(depth(n) - half_depth, 2.0 * half_depth) : 1.0;
        half_x_ = half_of(kernels.reach_x, nearest);
        half_y_ = half_of(kernels.reach_y, nearest);
        fits_ = half_x_ <= largest_lean_px && half_y_ <= largest_lean_px &&
                fits(setup, profile, kernels, tile, depth(n + count - 1), nearest, half_depth);
        if (!fits_) {
            return false;
        }
        stride_ = (2 * (half_x_ + room) + room) / room * room;
        const std::size_t elements = static_cast<std::size_t>(stride_) * static_cast<std::size_t>(2 * half_y_ + 1);
        apart_ = setup.perspective ? elements : 0;
        values_.resize(elements * static_cast<std::size_t>(count) + room);
        for (int table = 0; table < count; ++table) {
            const T scale = static_cast<T>(depth(n + table));
            fill(T(-2) * profile.falloff_log2 * shape.X * scale * shape.Y1 * scale,
                 values_.data() + elements * static_cast<std::size_t>(table));
        }
        return true;
    }

    /// The factors of slice n at pixel (u, v) from the centre and those on its right; stride() further on those of the
    /// row below, apart() further on those of the next slice.
    [[nodiscard]] HWY_INLINE const T* at(int u, int v) const {
        return values_.data() + static_cast<std::ptrdiff_t>(v + half_y_) * stride_ + (u + half_x_ + room);
    }
    [[nodiscard]] HWY_INLINE std::ptrdiff_t stride() const { return stride_; }
    [[nodiscard]] HWY_INLINE std::ptrdiff_t apart() const { return static_cast<std::ptrdiff_t>(apart_); }

  private:
    /// Vectors begin up to so many pixels before a section and end as far behind it.
    static constexpr int room = 16;

    [[nodiscard]] static int half_of(T reach, double nearest) {
        // (A pixel for where the centre lies in its own, one for rounding.)
        return static_cast<int>(std::min(static_cast<double>(reach) / nearest + 2.0, 1.0 + largest_lean_px));
    }

    /// depth: of the last of the slices. nearest: of a centre.
    [[nodiscard]] bool fits(const LoopSetup<T>& setup, const PartProfile<T>& profile, const TileKernels<T>& kernels,
                            const TileShape& tile, double depth, double nearest, double half_depth) const {
        const RowShape<T>& shape = kernels.shapes.front();
        const auto size = [](T number) { return std::abs(static_cast<double>(number)); };
        const double X = size(shape.X), Y1 = size(shape.Y1), Y2 = size(shape.Y2);
        // q1 and q2 at the centre's pixel change by this up to where the kernel ends.
        const double rays = setup.perspective ? setup.slice_spacing : 0.0, deep = half_depth / setup.slice_spacing;
        double far1 = 0.0, far2 = 0.0;
        for (const double x : {-1.0 * half_x_, tile.width + 2.0 + half_x_}) {
            for (const double y : {-1.0 * half_y_, tile.height + 2.0 + half_y_}) {
                const double d1 = static_cast<double>(shape.d1) +
                                  rays * (static_cast<double>(shape.X) * x + static_cast<double>(shape.Y1) * y);
                const double d2 = static_cast<double>(shape.d2) + rays * static_cast<double>(shape.Y2) * y;
                far1 = std::max(far1, deep * std::abs(d1));
                far2 = std::max(far2, deep * std::abs(d2));
            }
        }
        far1 += 0.5 * depth * (X + Y1);
        far2 += 0.5 * depth * Y2;
        const double closer = setup.perspective ? 1.0 + half_depth / nearest : 1.0;
        const double wide = X * (closer * size(kernels.reach_x) + 0.5 * depth);
        const double high = closer * size(kernels.reach_y) + 0.5 * depth;
        const double along_x = (wide + far1) * (wide + far1), of_both = 2.0 * wide * Y1 * high;
        const double along_y = Y1 * high * (Y1 * high + 2.0 * far1) + (Y2 * high + far2) * (Y2 * high + far2) + 1.0;
        return static_cast<double>(profile.falloff_log2) * std::max({along_x, of_both, along_y}) <
               static_cast<double>(deepest_lean<T>);
    }

    void fill(T per_pixels, T* out) const {
        const hn::CappedTag<T, 16> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        // Beyond sections, where a vector ends, factors only have to be finite.
        const auto most = hn::Set(d, deepest_lean<T>);
        for (int v = -half_y_; v <= half_y_; ++v) {
            const auto per_u = hn::Set(d, per_pixels * static_cast<T>(v));
            for (int i = 0; i < stride_; i += lanes) {
                const auto u = hn::Iota(d, static_cast<T>(i - half_x_ - room));
                hn::StoreU(exp2_nonpositive(d, hn::Min(hn::Mul(per_u, u), most)), d, out + i);
            }
            out += stride_;
        }
    }

    std::int64_t made_ = -1; ///< first slice
    bool fits_ = false;
    int half_x_ = 0, half_y_ = 0, stride_ = 0;
    std::size_t apart_ = 0; ///< elements from slice to slice
    std::vector<T> values_;
};

/// What kernels of one shape share on their way to the sheets of slices n ... n + covered_slices - 1.
template <class T>
struct ProductView {
    const RowShape<T>& shape;
    T reach_x, reach_y; ///< as TileKernels has them
    T depth;            ///< of slice n in perspective, else 1
    T spread;           ///< slice distance in perspective, else 0
    T per_X, per_Y;
    T deep;                    ///< half a kernel's depth, slices
    const LeanTables<T>* lean; ///< null: not needed
};

/// Whether derivatives aside, kernels of one shape can be drawn as products.
template <class T>
HWY_INLINE bool are_products(const LoopSetup<T>& setup, const PartProfile<T>& profile, const TileKernels<T>& kernels,
                             const TileShape& tile, std::int64_t n, LeanTables<T>& lean) {
    return kernels.shapes.size() == 1 && kernels.reach_x > T(0) &&
           (kernels.shapes.front().Y1 == T(0) || lean.make(setup, profile, kernels, tile, n));
}

template <class T, bool slopes>
HWY_INLINE ProductView<T> product_view(const Splat<T, slopes>& splat, const RowShape<T>& shape, T reach_x, T reach_y,
                                       const LeanTables<T>* lean) {
    const bool perspective = splat.setup.perspective;
    return {shape,
            reach_x,
            reach_y,
            perspective ? splat.depth_of(splat.n) : T(1),
            perspective ? static_cast<T>(splat.setup.slice_spacing) : T(0),
            T(1) / shape.X,
            T(1) / shape.Y2,
            T(-1) / shape.ds,
            shape.Y1 == T(0) ? nullptr : lean};
}

/// The factors of up to covered_slices sections: those along x from a pixel on, and those along y from a row on.
template <class T>
struct Bells {
    const T* x;
    const T* y;
    int stride; ///< from section to section
};

template <class T>
struct BellRoom {
    HWY_ALIGN T x[covered_slices * most_edge];
    HWY_ALIGN T y[covered_slices * most_edge];
};

/// On slice n, and what a slice further adds: q1 (with v = 0) at the first column and its change from column to column;
/// q2 at the first row, s, m and its change, and A.
template <class T>
struct ProductPlaces {
    T at_x, at_y, s, m, A, step_x, step_y, step_m;
};

/// exp2(-falloff (X u + A)^2) at `count` columns of each section.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void bells_of_columns(D d, T falloff_log2, const ProductPlaces<T>& first, const ProductPlaces<T>& more,
                                 int count, int sections, T* out) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto minus_k = hn::Set(d, -falloff_log2);
    for (int i = 0; i < count; i += lanes) {
        const auto pixel = hn::Iota(d, static_cast<T>(i));
        const auto here = hn::MulAdd(hn::Set(d, first.step_x), pixel, hn::Set(d, first.at_x));
        const auto further = hn::MulAdd(hn::Set(d, more.step_x), pixel, hn::Set(d, more.at_x));
        for (int section = 0; section < sections; ++section) {
            const auto q = hn::MulAdd(hn::Set(d, static_cast<T>(section)), further, here);
            hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q, q))), d, out + section * most_edge + i);
        }
    }
}

/// The factors along y at `count` rows of each section.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void bells_of_rows(D d, T falloff_log2, const ProductPlaces<T>& first, const ProductPlaces<T>& more,
                              int count, int sections, T* out) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto minus_k = hn::Set(d, -falloff_log2);
    for (int i = 0; i < count; i += lanes) {
        const auto pixel = hn::Iota(d, static_cast<T>(i));
        const auto along = [&](T step, T at) { return hn::MulAdd(hn::Set(d, step), pixel, hn::Set(d, at)); };
        const auto here = along(first.step_y, first.at_y), further = along(more.step_y, more.at_y);
        const auto m_here = along(first.step_m, first.m), m_further = along(more.step_m, more.m);
        for (int section = 0; section < sections; ++section) {
            const T number = static_cast<T>(section);
            const T height = first.s + number * more.s, A = first.A + number * more.A;
            const auto q = hn::MulAdd(hn::Set(d, number), further, here);
            const auto m = hn::MulAdd(hn::Set(d, number), m_further, m_here);
            const auto r2 =
                hn::MulAdd(m, hn::Add(m, hn::Set(d, T(2) * A)), hn::MulAdd(q, q, hn::Set(d, height * height)));
            hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, r2)), d, out + section * most_edge + i);
        }
    }
}

/// The same of at most eight columns and eight rows, in one vector of sixteen.
template <bool leans, class D, class T = hn::TFromD<D>>
HWY_INLINE void bells_of_both(D d, T falloff_log2, const ProductPlaces<T>& first, const ProductPlaces<T>& more,
                              int sections, T* out) {
    const auto along_x = hn::FirstN(d, 8);
    const auto lane = hn::Iota(d, T(0));
    const auto pixel = hn::IfThenElse(along_x, lane, hn::Sub(lane, hn::Set(d, T(8))));
    const auto both = [&](T x, T y) { return hn::IfThenElse(along_x, hn::Set(d, x), hn::Set(d, y)); };
    const auto rows = [&](T y) { return hn::IfThenZeroElse(along_x, hn::Set(d, y)); };
    const auto here = hn::MulAdd(both(first.step_x, first.step_y), pixel, both(first.at_x, first.at_y));
    const auto further = hn::MulAdd(both(more.step_x, more.step_y), pixel, both(more.at_x, more.at_y));
    const auto s = rows(first.s), s_further = rows(more.s);
    const auto m_here = hn::MulAdd(rows(first.step_m), pixel, rows(first.m));
    const auto m_further = hn::MulAdd(rows(more.step_m), pixel, rows(more.m));
    const auto twice_A = hn::Set(d, T(2) * first.A), twice_A_further = hn::Set(d, T(2) * more.A);
    const auto minus_k = hn::Set(d, -falloff_log2);
    for (int section = 0; section < sections; ++section) {
        const auto number = hn::Set(d, static_cast<T>(section));
        const auto q = hn::MulAdd(number, further, here), height = hn::MulAdd(number, s_further, s);
        auto r2 = hn::MulAdd(q, q, hn::Mul(height, height));
        if constexpr (leans) {
            const auto m = hn::MulAdd(number, m_further, m_here);
            r2 = hn::MulAdd(m, hn::Add(m, hn::MulAdd(number, twice_A_further, twice_A)), r2);
        }
        hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, r2)), d, out + 16 * section);
    }
}

/// Factors that lean, of `slices` sections from the first column and row on.
template <class T>
struct NoLean {
    static constexpr bool any = false, each = false;
};
template <class T>
struct SharedLean {
    static constexpr bool any = true, each = false;
    const T* table;
    std::ptrdiff_t stride, apart;
};
template <class T>
struct EachLean {
    static constexpr bool any = true, each = true;
    const T* table;
    std::ptrdiff_t stride, apart;
};

/// Rows of `slices` sections, side by side.
template <Sums sums, int slices, class D, class Lean, class T = hn::TFromD<D>>
HWY_INLINE void product_rows(D d, const Target<T>* to, const Bells<T>& bells, const Lean& lean, T edge_t, T value_t,
                             T weight_t, int x0, int x1, int y0, int y1) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto edge = hn::Set(d, edge_t), value = hn::Set(d, value_t), weight = hn::Set(d, weight_t);
    const int stride = to[0].stride;
    // Copies, since the compiler must think that sheets might hold these.
    T* values[slices];
    T* weights[slices];
    const T* along_x[slices];
    const T* along_y[slices];
    for (int slice = 0; slice < slices; ++slice) {
        values[slice] = to[slice].value;
        weights[slice] = to[slice].weight;
        along_x[slice] = bells.x + slice * bells.stride;
        along_y[slice] = bells.y + slice * bells.stride;
    }
    for (int x = x0; x < x1; x += lanes) {
        hn::Vec<D> column[slices];
        for (int slice = 0; slice < slices; ++slice) {
            column[slice] = hn::LoadU(d, along_x[slice] + (x - x0));
        }
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0) * stride + x;
        for (int y = 0; y < y1 - y0; ++y, at += stride) {
            for (int slice = 0; slice < slices; ++slice) {
                auto bell = column[slice];
                if constexpr (Lean::any) {
                    const T* factors = lean.table + y * lean.stride + (x - x0) + (Lean::each ? slice * lean.apart : 0);
                    bell = hn::Mul(bell, hn::LoadU(d, factors));
                }
                add_bell<sums>(d, hn::MulSub(bell, hn::Set(d, along_y[slice][y]), edge), value, weight,
                               values[slice] + at, sums != Sums::values ? weights[slice] + at : nullptr);
            }
        }
    }
}

template <Sums sums, class D, class Lean, class T = hn::TFromD<D>, bool slopes>
HWY_INLINE void add_product_rows(D d, const Splat<T, slopes>& splat, const Bells<T>& bells, const Lean& lean, T value,
                                 T weight, int x0, int x1, int y0, int y1, int count) {
    in_batches<5>(0, count, [&](int slice, auto together) {
        const Bells<T> here{bells.x + slice * bells.stride, bells.y + slice * bells.stride, bells.stride};
        Lean leaning = lean;
        if constexpr (Lean::each) {
            leaning.table += slice * lean.apart;
        }
        product_rows<sums, together.value>(d, splat.targets + slice, here, leaning, splat.profile.edge, value, weight,
                                           x0, x1, y0, y1);
    });
}

/// Adds the slices from n on, `count` of them, of a kernel that lies in `box`. x_c, y_c: whole numbers, of the pixel
/// that the kernel's centre is in; where it does not lean, any.
template <Sums sums, class T, bool slopes>
HWY_INLINE int add_products_in(const Rect& box, T x_c, T y_c, Splat<T, slopes>& splat, const Section<T>& section,
                               T weight, const ProductView<T>& view, int count) {
    static_assert(!slopes, "derivatives are not products");
    const RowShape<T>& shape = view.shape;
    if (box.empty() || !splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
        return 0;
    }
    const hn::CappedTag<T, 16> wide;
    const int width = box.x1 - box.x0, height = box.y1 - box.y0;
    const int start = start_of<T>(box.x0, box.x1, narrowest_lanes<T>(width));
    const T from_first = static_cast<T>(splat.n - section.first);
    ProductPlaces<T> first, more;
    first.step_x = shape.X * view.depth;
    first.step_y = shape.Y2 * view.depth;
    first.step_m = shape.Y1 * view.depth;
    more.step_x = shape.X * view.spread;
    more.step_y = shape.Y2 * view.spread;
    more.step_m = shape.Y1 * view.spread;
    first.at_x = section.a1 + from_first * shape.d1 + first.step_m * y_c;
    more.at_x = shape.d1 + more.step_m * y_c;
    first.A = first.at_x + first.step_x * x_c;
    more.A = more.at_x + more.step_x * x_c;
    first.at_x += first.step_x * static_cast<T>(start);
    more.at_x += more.step_x * static_cast<T>(start);
    first.at_y = section.a2 + from_first * shape.d2 + first.step_y * static_cast<T>(box.y0);
    more.at_y = shape.d2 + more.step_y * static_cast<T>(box.y0);
    first.m = first.step_m * (static_cast<T>(box.y0) - y_c);
    more.m = more.step_m * (static_cast<T>(box.y0) - y_c);
    first.s = section.s + from_first * shape.ds;
    more.s = shape.ds;
    BellRoom<T> room;
    const T k = splat.profile.falloff_log2;
    Bells<T> bells{room.x, room.y, most_edge};
    if (hn::Lanes(wide) == 16 && box.x1 - start <= 8 && height <= 8) {
        if (view.lean == nullptr) {
            bells_of_both<false>(wide, k, first, more, count, room.x);
        } else {
            bells_of_both<true>(wide, k, first, more, count, room.x);
        }
        bells = {room.x, room.x + 8, 16};
    } else {
        bells_of_columns(wide, k, first, more, box.x1 - start, count, room.x);
        bells_of_rows(wide, k, first, more, height, count, room.y);
    }
    splat.through[count - 1].add(box);
    in_narrowest<T>(width, [&](auto d) {
        const auto add = [&](const auto& lean) {
            add_product_rows<sums>(d, splat, bells, lean, section.value, weight, start, box.x1, box.y0, box.y1, count);
        };
        if (view.lean == nullptr) {
            add(NoLean<T>());
            return;
        }
        const int u = start - static_cast<int>(x_c), v = box.y0 - static_cast<int>(y_c);
        const T* table = view.lean->at(u, v);
        if (view.spread == T(0)) {
            add(SharedLean<T>{table, view.lean->stride(), 0});
        } else {
            add(EachLean<T>{table, view.lean->stride(), view.lean->apart()});
        }
    });
    return count;
}

/// Adds the slices from n on, `count` of them, of a kernel; -1 where it is so near that its reach does not hold.
template <Sums sums, class T, bool slopes>
HWY_INLINE int add_products(Splat<T, slopes>& splat, const Section<T>& section, T weight, const ProductView<T>& view,
                            int count) {
    const RowShape<T>& shape = view.shape;
    // Slices from the first one to n and from there to the kernel's centre, and its depth.
    const T from_first = static_cast<T>(splat.n - section.first), to_centre = section.s * view.deep - from_first;
    const T centre = view.depth + to_centre * view.spread;
    if (!(centre > T(2) * view.deep * view.spread)) {
        return -1;
    }
    const T per_depth = T(1) / centre;
    const T middle_y = -(section.a2 + (from_first + to_centre) * shape.d2) * view.per_Y * per_depth;
    const T middle_x =
        -(section.a1 + (from_first + to_centre) * shape.d1) * view.per_X * per_depth - shape.Y1 * view.per_X * middle_y;
    const T half_x = view.reach_x * per_depth, half_y = view.reach_y * per_depth;
    const Rect& seen = splat.live.rect;
    const Rect box{whole(std::ceil(middle_x - half_x), seen.x0, seen.x1),
                   whole(std::ceil(middle_y - half_y), seen.y0, seen.y1),
                   whole(std::floor(middle_x + half_x) + T(1), seen.x0, seen.x1),
                   whole(std::floor(middle_y + half_y) + T(1), seen.y0, seen.y1)};
    // The centre is not far outside the box, which it lies in the middle of unless that is cut.
    return add_products_in<sums>(box, std::floor(middle_x + T(0.5)), std::floor(middle_y + T(0.5)), splat, section,
                                 weight, view, count);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL

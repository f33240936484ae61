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
#include <type_traits>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "kernel_batch-inl.hpp"
#include "math-inl.hpp"
#include "splat_ellipses-inl.hpp"
#include "splat_spheres-inl.hpp"
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
                                 int count, int sections, T* out, int stride) {
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto minus_k = hn::Set(d, -falloff_log2);
    for (int i = 0; i < count; i += lanes) {
        const auto pixel = hn::Iota(d, static_cast<T>(i));
        const auto here = hn::MulAdd(hn::Set(d, first.step_x), pixel, hn::Set(d, first.at_x));
        const auto further = hn::MulAdd(hn::Set(d, more.step_x), pixel, hn::Set(d, more.at_x));
        for (int section = 0; section < sections; ++section) {
            const auto q = hn::MulAdd(hn::Set(d, static_cast<T>(section)), further, here);
            hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q, q))), d, out + section * stride + i);
        }
    }
}

/// The factors along y at `count` rows of each section.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void bells_of_rows(D d, T falloff_log2, const ProductPlaces<T>& first, const ProductPlaces<T>& more,
                              int count, int sections, T* out, int stride) {
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
            hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, r2)), d, out + section * stride + i);
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

/// Factors that lean, from the first column and row on; `stride` further on those of the row below, `apart` further on
/// those of the next slice; 0: they are the same.
template <class T>
struct Lean {
    const T* table = nullptr; ///< null: none
    std::ptrdiff_t stride = 0, apart = 0;
};

/// Whether there is a factor that leans: none, one for all slices, one each.
enum class Leans { no, alike, each };

/// Gaussians of `slices` sections that are products of one along x, one along y and a factor that leans.
template <class D, int slices, Leans leans>
class ProductBells {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;

  public:
    HWY_INLINE ProductBells(const Bells<T>& bells, const Lean<T>& lean, int first) : lean_(lean) {
        for (int slice = 0; slice < slices; ++slice) {
            x_[slice] = bells.x + (first + slice) * bells.stride;
            y_[slice] = bells.y + (first + slice) * bells.stride;
        }
        lean_.table += first * lean.apart;
    }
    HWY_INLINE void at_column(int x) {
        for (int slice = 0; slice < slices; ++slice) {
            column_[slice] = hn::LoadU(D(), x_[slice] + x);
        }
        factors_ = lean_.table + x;
    }
    HWY_INLINE void at_row(int y) {
        at_y_ = y;
        if constexpr (leans == Leans::alike) {
            factor_ = hn::LoadU(D(), factors_ + y * lean_.stride);
        }
    }
    [[nodiscard]] HWY_INLINE V less(V edge, int slice) const {
        V bell = column_[slice];
        if constexpr (leans == Leans::alike) {
            bell = hn::Mul(bell, factor_);
        } else if constexpr (leans == Leans::each) {
            bell = hn::Mul(bell, hn::LoadU(D(), factors_ + at_y_ * lean_.stride + slice * lean_.apart));
        }
        return hn::MulSub(bell, hn::Set(D(), y_[slice][at_y_]), edge);
    }

  private:
    const T* x_[slices];
    const T* y_[slices];
    Lean<T> lean_;
    V column_[slices], factor_;
    const T* factors_ = nullptr; ///< of the column
    std::ptrdiff_t at_y_ = 0;
};

/// Columns and rows of a small kernel, at most: those of a section are the two halves of sixteen numbers.
constexpr int small_px = 8;

/// The factors of a small kernel.
template <class T>
HWY_INLINE void bells_of_small(T falloff_log2, const ProductPlaces<T>& first, const ProductPlaces<T>& more, bool leans,
                               int sections, T* out) {
    const hn::CappedTag<T, 2 * small_px> both;
    if (hn::Lanes(both) < 2 * small_px) {
        const hn::CappedTag<T, small_px> half;
        bells_of_columns(half, falloff_log2, first, more, small_px, sections, out, 2 * small_px);
        bells_of_rows(half, falloff_log2, first, more, small_px, sections, out + small_px, 2 * small_px);
    } else if (leans) {
        bells_of_both<true>(both, falloff_log2, first, more, sections, out);
    } else {
        bells_of_both<false>(both, falloff_log2, first, more, sections, out);
    }
}

/// Where a kernel is drawn: the pixels that it can touch, and the column that vectors start at. x_c, y_c: whole
/// numbers, of the pixel that the kernel's centre is in; where it does not lean, any.
template <class T>
struct ProductBox {
    Rect box;
    int start = 0;
    T x_c = 0, y_c = 0;

    ProductBox() = default;
    ProductBox(const Rect& touched, T column, T row)
        : box(touched), start(start_of<T>(touched.x0, touched.x1, narrowest_lanes<T>(touched.x1 - touched.x0))),
          x_c(column), y_c(row) {}
    [[nodiscard]] HWY_INLINE bool small() const { return box.x1 - start <= small_px && box.y1 - box.y0 <= small_px; }
};

template <class T>
HWY_INLINE void find_places(const ProductBox<T>& at, const Section<T>& section, const ProductView<T>& view,
                            T from_first, ProductPlaces<T>& first, ProductPlaces<T>& more) {
    const RowShape<T>& shape = view.shape;
    first.step_x = shape.X * view.depth;
    first.step_y = shape.Y2 * view.depth;
    first.step_m = shape.Y1 * view.depth;
    more.step_x = shape.X * view.spread;
    more.step_y = shape.Y2 * view.spread;
    more.step_m = shape.Y1 * view.spread;
    const T y0 = static_cast<T>(at.box.y0);
    first.at_x = section.a1 + from_first * shape.d1 + first.step_m * at.y_c;
    more.at_x = shape.d1 + more.step_m * at.y_c;
    first.A = first.at_x + first.step_x * at.x_c;
    more.A = more.at_x + more.step_x * at.x_c;
    first.at_x += first.step_x * static_cast<T>(at.start);
    more.at_x += more.step_x * static_cast<T>(at.start);
    first.at_y = section.a2 + from_first * shape.d2 + first.step_y * y0;
    more.at_y = shape.d2 + more.step_y * y0;
    first.m = first.step_m * (y0 - at.y_c);
    more.m = more.step_m * (y0 - at.y_c);
    first.s = section.s + from_first * shape.ds;
    more.s = shape.ds;
}

/// Adds the slices from n on, `count` of them, of a kernel whose factors are known.
template <Sums sums, class T, bool slopes>
HWY_NOINLINE void add_product(const ProductBox<T>& at, const Bells<T>& bells, Splat<T, slopes>& splat,
                              const Amounts<T>& amounts, const ProductView<T>& view, int count) {
    const Rect& box = at.box;
    splat.through[count - 1].add(box);
    Lean<T> lean;
    if (view.lean != nullptr) {
        const T* table = view.lean->at(at.start - static_cast<int>(at.x_c), box.y0 - static_cast<int>(at.y_c));
        lean = {table, view.lean->stride(), view.lean->apart()};
    }
    in_narrowest<T>(box.x1 - box.x0, [&](auto d) {
        in_batches<most_together<sums, slopes>>(0, count, [&](int slice, auto together) {
            const auto add = [&](auto leans) {
                add_rows<sums, together.value>(
                    d, splat.targets + slice,
                    ProductBells<decltype(d), together.value, leans.value>(bells, lean, slice), splat.profile.edge,
                    amounts, at.start, box.x1, box.y0, box.y1);
            };
            if (lean.table == nullptr) {
                add(std::integral_constant<Leans, Leans::no>());
            } else if (lean.apart == 0) {
                add(std::integral_constant<Leans, Leans::alike>());
            } else {
                add(std::integral_constant<Leans, Leans::each>());
            }
        });
    });
}

/// Adds the slices from n on, `count` of them, of a kernel.
template <Sums sums, class T, bool slopes>
HWY_NOINLINE int add_one_product(const ProductBox<T>& at, Splat<T, slopes>& splat, const Section<T>& section,
                                 const Amounts<T>& amounts, const ProductView<T>& view, int count) {
    static_assert(!slopes, "derivatives are not products");
    ProductPlaces<T> first, more;
    find_places(at, section, view, static_cast<T>(splat.n - section.first), first, more);
    BellRoom<T> room;
    const T k = splat.profile.falloff_log2;
    Bells<T> bells{room.x, room.y, most_edge};
    if (at.small()) {
        bells_of_small(k, first, more, view.lean != nullptr, count, room.x);
        bells = {room.x, room.x + small_px, 2 * small_px};
    } else {
        const hn::CappedTag<T, 16> wide;
        bells_of_columns(wide, k, first, more, at.box.x1 - at.start, count, room.x, most_edge);
        bells_of_rows(wide, k, first, more, at.box.y1 - at.box.y0, count, room.y, most_edge);
    }
    add_product<sums>(at, bells, splat, amounts, view, count);
    return count;
}

/// Kernels of one shape that are products. several: for several lattices.
template <Sums sums, class T, bool several = false>
class ProductBatch {
  public:
    /// view: kept by the caller.
    ProductBatch(Splat<T, false>& splat, const TileKernels<T>& kernels, const ProductView<T>& view)
        : splat_(splat), kernels_(kernels), view_(view) {}

    /// Draws the kernel of each number, 1 to batch_room of them. Returns how many sections were drawn.
    HWY_NOINLINE int draw(const std::uint32_t* numbers, int number) {
        measure(numbers, number);
        // The factors of all small kernels first: their rows do not wait for them.
        Small small[room];
        int smalls = 0, most = 0, drawn = 0;
        for (int kernel = 0; kernel < number; ++kernel) {
            const Section<T>& section = kernels_.sections[numbers[kernel]];
            const int count = splat_.slices_of(at_.last(kernel), numbers[kernel]);
            if (count <= 0) {
                continue;
            }
            const auto amounts = [&](T value) { return Amounts<T>{value, kernels_.weight, T(0)}; };
            if (!(holds_[kernel] > T(0))) {
                for_each_value<several>(splat_, kernels_, numbers[kernel], [&](Splat<T, false>& to, T value) {
                    drawn += add_ellipses<sums>(to, section, amounts(value), view_.shape, count);
                });
                continue;
            }
            const Rect box = at_.box(kernel);
            if (!splat_.sees(box)) {
                continue;
            }
            const ProductBox<T> place(box, x_c_[kernel], y_c_[kernel]);
            if (place.small()) {
                small[smalls++] = {place, numbers[kernel], count};
                most = std::max(most, count);
            } else {
                for_each_value<several>(splat_, kernels_, numbers[kernel], [&](Splat<T, false>& to, T value) {
                    drawn += add_one_product<sums>(place, to, section, amounts(value), view_, count);
                });
            }
        }
        return drawn + add_small(small, smalls, most);
    }

  private:
    static constexpr int room = batch_room;
    using D = typename KernelBatch<T>::D;
    using V = typename KernelBatch<T>::V;
    struct Small {
        ProductBox<T> place;
        std::uint32_t number; ///< of the kernel
        int count;            ///< slices
    };

    HWY_INLINE void measure(const std::uint32_t* numbers, int number) {
        at_.gather(kernels_.sections.data(), numbers, number);
        const D d;
        const RowShape<T>& shape = view_.shape;
        const auto all = [&](T value) { return hn::Set(d, value); };
        const V one = all(T(1)), near = all(T(2) * view_.deep * view_.spread);
        for (int kernel = 0; kernel < room; kernel += KernelBatch<T>::lanes) {
            at_.set_last(kernel, view_.deep, kernels_.last_slice);
            // Slices from the first one to the kernel's centre, and its depth.
            const V to_centre = hn::Mul(hn::Load(d, at_.s + kernel), all(view_.deep));
            const V from_here =
                hn::Sub(hn::Add(to_centre, hn::Load(d, at_.first + kernel)), all(static_cast<T>(splat_.n)));
            const V centre = hn::MulAdd(from_here, all(view_.spread), all(view_.depth));
            const auto far = hn::Gt(centre, near);
            const V per_depth = hn::Div(one, hn::IfThenElse(far, centre, one));
            const V q1 = hn::MulAdd(to_centre, all(shape.d1), hn::Load(d, at_.a1 + kernel));
            const V q2 = hn::MulAdd(to_centre, all(shape.d2), hn::Load(d, at_.a2 + kernel));
            const V y = hn::Neg(hn::Mul(hn::Mul(q2, all(view_.per_Y)), per_depth));
            const V x = hn::Sub(hn::Neg(hn::Mul(hn::Mul(q1, all(view_.per_X)), per_depth)),
                                hn::Mul(all(shape.Y1 * view_.per_X), y));
            at_.set_box(kernel, x, y, hn::Mul(all(view_.reach_x), per_depth), hn::Mul(all(view_.reach_y), per_depth),
                        splat_.live.rect);
            // The centre is not far outside the box, which it lies in the middle of unless that is cut.
            hn::Store(hn::Floor(hn::Add(x, all(T(0.5)))), d, x_c_ + kernel);
            hn::Store(hn::Floor(hn::Add(y, all(T(0.5)))), d, y_c_ + kernel);
            hn::Store(hn::IfThenElseZero(far, one), d, holds_ + kernel);
        }
    }

    /// most: slices of any. Returns how many sections were drawn.
    int add_small(const Small* small, int number, int most) {
        HWY_ALIGN T bells[room * covered_slices * 2 * small_px];
        constexpr int apart = covered_slices * 2 * small_px;
        for (int i = 0; i < number; ++i) {
            ProductPlaces<T> first, more;
            const Section<T>& section = kernels_.sections[small[i].number];
            find_places(small[i].place, section, view_, static_cast<T>(splat_.n - section.first), first, more);
            bells_of_small(splat_.profile.falloff_log2, first, more, view_.lean != nullptr, most, bells + i * apart);
        }
        int drawn = 0;
        for (int i = 0; i < number; ++i) {
            const T* own = bells + i * apart;
            for_each_value<several>(splat_, kernels_, small[i].number, [&](Splat<T, false>& to, T value) {
                add_product<sums>(small[i].place, Bells<T>{own, own + small_px, 2 * small_px}, to,
                                  {value, kernels_.weight, T(0)}, view_, small[i].count);
                drawn += small[i].count;
            });
        }
        return drawn;
    }

    Splat<T, false>& splat_;
    const TileKernels<T>& kernels_;
    const ProductView<T>& view_;
    KernelBatch<T> at_;
    HWY_ALIGN T x_c_[room], y_c_[room]; ///< the pixel that its centre is in
    HWY_ALIGN T holds_[room];           ///< 1: it is not so near that its reach is another one
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_PRODUCTS_INL

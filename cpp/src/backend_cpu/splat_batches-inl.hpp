// The splat loop of spheres for small kernels of one shape, measured together.

#if defined(SHEETSPLAT_CPU_SPLAT_BATCHES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_BATCHES_INL
#undef SHEETSPLAT_CPU_SPLAT_BATCHES_INL
#else
#define SHEETSPLAT_CPU_SPLAT_BATCHES_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "kernel_batch-inl.hpp"
#include "math-inl.hpp"
#include "splat_spheres-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Kernels of one upright shape in an orthographic view. several: for several lattices.
template <Sums sums, class T, bool slopes, bool several = false>
class SphereBatch {
  public:
    SphereBatch(Splat<T, slopes>& splat, const TileKernels<T>& kernels)
        : splat_(splat), kernels_(kernels), shape_(kernels.shapes.front()), minus_k_(-splat.profile.falloff_log2) {}

    /// Whether kernels of this shape are small enough.
    [[nodiscard]] static bool holds(const RowShape<T>& shape) {
        const T least = T(2) / static_cast<T>(most_px - 1);
        return shape.X >= least && std::abs(shape.Y2) >= least;
    }

    /// Draws the kernel of each number, 1 to batch_room of them. Returns how many sections were drawn.
    HWY_NOINLINE int draw(const std::uint32_t* numbers, int number) {
        measure(numbers, number);
        int drawn = 0;
        for (int kernel = 0; kernel < number; ++kernel) {
            const int count = splat_.slices_of(at_.last(kernel), numbers[kernel]);
            const Rect box = at_.box(kernel);
            if (count <= 0 || !splat_.sees(box)) {
                continue;
            }
            HWY_ALIGN T bell_x[2 * most_px];
            const int start = begin(kernel, box, bell_x);
            if constexpr (several) {
                drawn += count * add_all(numbers[kernel], kernel, box, start, bell_x, count);
            } else {
                add(kernel, box, start, bell_x, count, kernels_.sections[numbers[kernel]].value);
                splat_.through[count - 1].add(box);
                drawn += count;
            }
        }
        return drawn;
    }

  private:
    static constexpr int room = batch_room;
    /// Rows and columns of a kernel, at most.
    static constexpr int most_px = 8;
    static_assert(covered_slices <= most_px, "bells along depth have as much room as those along columns");
    using D = typename KernelBatch<T>::D;
    using V = typename KernelBatch<T>::V;

    HWY_INLINE void measure(const std::uint32_t* numbers, int number) {
        at_.gather(kernels_.sections.data(), numbers, number);
        if constexpr (slopes) {
            for (int kernel = 0; kernel < room; ++kernel) {
                const T value = kernels_.sections[numbers[std::min(kernel, number - 1)]].value;
                scale_[kernel] = Steepness<sums, T>(splat_.steep(), {value, kernels_.weight, T(0)}).scale;
            }
        }
        const D d;
        const V half_x = hn::Set(d, T(1) / shape_.X), half_y = hn::Set(d, std::abs(T(1) / shape_.Y2));
        const V now = hn::Set(d, static_cast<T>(splat_.n));
        for (int kernel = 0; kernel < room; kernel += KernelBatch<T>::lanes) {
            const V a1 = hn::Load(d, at_.a1 + kernel), a2 = hn::Load(d, at_.a2 + kernel);
            const V x = hn::Mul(hn::Neg(a1), half_x), y = hn::Mul(a2, hn::Set(d, T(-1) / shape_.Y2));
            at_.set_box(kernel, x, y, half_x, half_y, splat_.live.rect);
            at_.set_last(kernel, T(-1) / shape_.ds, kernels_.last_slice);
            const V passed = hn::Sub(now, hn::Load(d, at_.first + kernel));
            bells_of(kernel, hn::MulAdd(hn::Set(d, shape_.Y2), hn::Load(d, at_.y0 + kernel), a2), shape_.Y2, bell_y_,
                     slope_y_);
            bells_of(kernel, hn::MulAdd(passed, hn::Set(d, shape_.ds), hn::Load(d, at_.s + kernel)), shape_.ds, bell_z_,
                     slope_z_);
        }
    }

    /// At `at`, at + step, ... of lanes from `kernel` on.
    HWY_INLINE void bells_of(int kernel, V at, T step, T* out, T* slope) const {
        const D d;
        for (int i = 0; i < most_px; ++i) {
            const V place = hn::MulAdd(hn::Set(d, step), hn::Set(d, static_cast<T>(i)), at);
            const V bell = exp2_nonpositive(d, hn::Mul(hn::Set(d, minus_k_), hn::Mul(place, place)));
            hn::Store(bell, d, out + i * room + kernel);
            if constexpr (slopes) {
                hn::Store(hn::Mul(place, hn::Mul(hn::Set(d, step), hn::Load(d, scale_ + kernel))), d,
                          slope + i * room + kernel);
            }
        }
    }

    /// Finds a kernel's factors of columns; returns the first one.
    HWY_INLINE int begin(int kernel, const Rect& box, T* bell_x) const {
        const hn::CappedTag<T, most_px> d;
        const int start = start_of<T>(box.x0, box.x1, static_cast<int>(hn::Lanes(d)));
        const T at_x = at_.a1[kernel] + shape_.X * static_cast<T>(start);
        bells(d, -minus_k_, at_x, shape_.X, box.x1 - start, bell_x);
        return start;
    }

    /// Adds `count` slices of a kernel to the sheets.
    HWY_INLINE void add(int kernel, const Rect& box, int start, const T* bell_x, int count, T value) const {
        const hn::CappedTag<T, most_px> d;
        const T edge = splat_.profile.edge;
        const Amounts<T> amounts{value, kernels_.weight, T(0)};
        [[maybe_unused]] const T at_x = at_.a1[kernel] + shape_.X * static_cast<T>(start);
        HWY_ALIGN T slope_x[slopes ? 2 * most_px : 1];
        const Steepness<sums, T> steepness(splat_.steep(), amounts);
        if constexpr (slopes) {
            lines(d, at_x, shape_.X, steepness.scale, box.x1 - start, slope_x);
        }
        in_batches<most_together<sums, slopes>>(0, count, [&](int slice, auto number) {
            const T* bell_y = bell_y_ + kernel;
            const T* bell_z = bell_z_ + slice * room + kernel;
            if constexpr (slopes) {
                separable_slopes<sums, number.value, room>(d, splat_.targets + slice, bell_x, bell_y, bell_z, slope_x,
                                                           slope_y_ + kernel, slope_z_ + slice * room + kernel, edge,
                                                           amounts, steepness, AllRows{box.y1 - box.y0}, start, box.x1,
                                                           box.y0);
            } else {
                add_rows<sums, number.value>(d, splat_.targets + slice,
                                             SeparableBells<decltype(d), number.value, room>(bell_x, bell_y, bell_z),
                                             edge, amounts, start, box.x1, box.y0, box.y1);
            }
        });
    }

    /// The same to the sheets of all lattices that a kernel is drawn for; returns how many these are.
    HWY_INLINE int add_all(std::uint32_t number, int kernel, const Rect& box, int start, const T* bell_x, int count) {
        const SeveralTargets<T, 1 + most_beside> all(&splat_, kernels_.values.data() + number * kernels_.fields,
                                                     kernels_.fields);
        for (int one = 0; one < all.count; ++one) {
            (&splat_)[all.field[one]].through[count - 1].add(box);
        }
        all.with_count([&](auto fields) { add_to<fields.value>(all, kernel, box, start, bell_x, count); });
        return all.count;
    }
    template <int fields>
    HWY_NOINLINE void add_to(const SeveralTargets<T, 1 + most_beside>& all, int kernel, const Rect& box, int start,
                             const T* bell_x, int count) const {
        const hn::CappedTag<T, most_px> d;
        in_batches<most_of_several<fields>>(0, count, [&](int slice, auto together) {
            add_rows_of_several<fields, together.value>(d, all, slice,
                                                        SeparableBells<decltype(d), together.value, room>(
                                                            bell_x, bell_y_ + kernel, bell_z_ + slice * room + kernel),
                                                        splat_.profile.edge, start, box.x1, box.y0, box.y1);
        });
    }

    Splat<T, slopes>& splat_;
    const TileKernels<T>& kernels_;
    const RowShape<T> shape_;
    const T minus_k_;
    KernelBatch<T> at_;
    HWY_ALIGN T bell_y_[most_px * room], bell_z_[most_px * room]; ///< [row or slice][kernel]
    static constexpr int slope_room = slopes ? most_px * room : 1;
    HWY_ALIGN T slope_y_[slope_room], slope_z_[slope_room]; ///< the same
    HWY_ALIGN T scale_[slopes ? room : 1];                  ///< Steepness::scale
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_BATCHES_INL

// The splat loop of spheres for kernels of one shape, sixteen at a time: what they need is measured in vectors that
// hold a kernel a lane. The arithmetic is that of add_spheres.

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
#include "math-inl.hpp"
#include "splat_spheres-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Some kernels of one upright shape in an orthographic view, where they are on slice n; slopes: their derivatives are
/// summed too.
template <class T, bool slopes>
class SphereBatch {
  public:
    static constexpr int room = 16;
    /// Rows and columns of a kernel, at most: others are drawn one by one.
    static constexpr int most_px = 8;

    /// Whether kernels of this shape are small enough.
    [[nodiscard]] static bool holds(const RowShape<T>& shape) {
        const T least = T(2) / static_cast<T>(most_px - 1);
        return shape.X >= least && std::abs(shape.Y2) >= least;
    }

    SphereBatch(const RowShape<T>& shape, T falloff_log2, std::int32_t last_slice)
        : shape_(shape), per_X_(T(1) / shape.X), per_Y_(T(1) / shape.Y2), per_slice_(T(-1) / shape.ds),
          minus_k_(-falloff_log2), last_slice_(last_slice) {}

    /// 1 to `room` kernels, from slice splat.n on.
    template <Sums sums>
    HWY_INLINE void measure(const Section<T>* sections, int number, const Splat<T, slopes>& splat, T weight) {
        const std::int32_t n = splat.n;
        const Rect& seen = splat.live.rect;
        at_.gather(number, [&](int kernel) -> const Section<T>& { return sections[kernel]; });
        if constexpr (slopes) {
            for (int kernel = 0; kernel < room; ++kernel) {
                const T value = sections[std::min(kernel, number - 1)].value;
                scale_[kernel] = Steepness<sums, T>(splat.steep(), value, weight).scale;
            }
        }
        const hn::CappedTag<T, room> d;
        using V = hn::Vec<decltype(d)>;
        const V one = hn::Set(d, T(1)), per_X = hn::Set(d, per_X_), per_Y = hn::Set(d, std::abs(per_Y_));
        const V minus_k = hn::Set(d, minus_k_), now = hn::Set(d, static_cast<T>(n));
        const auto clamped = [&](V at, int low, int high) SHEETSPLAT_CPU_INLINE {
            return hn::Min(hn::Max(at, hn::Set(d, static_cast<T>(low))), hn::Set(d, static_cast<T>(high)));
        };
        for (int kernel = 0; kernel < room; kernel += static_cast<int>(hn::Lanes(d))) {
            const V a1 = hn::Load(d, at_.a1 + kernel), a2 = hn::Load(d, at_.a2 + kernel),
                    s = hn::Load(d, at_.s + kernel);
            const V middle_x = hn::Mul(hn::Neg(a1), per_X);
            const V middle_y = hn::Mul(a2, hn::Set(d, -per_Y_));
            const V y0 = clamped(hn::Ceil(hn::Sub(middle_y, per_Y)), seen.y0, seen.y1);
            hn::Store(clamped(hn::Ceil(hn::Sub(middle_x, per_X)), seen.x0, seen.x1), d, x0_ + kernel);
            hn::Store(clamped(hn::Add(hn::Floor(hn::Add(middle_x, per_X)), one), seen.x0, seen.x1), d, x1_ + kernel);
            hn::Store(y0, d, y0_ + kernel);
            hn::Store(clamped(hn::Add(hn::Floor(hn::Add(middle_y, per_Y)), one), seen.y0, seen.y1), d, y1_ + kernel);
            const V further = hn::Floor(hn::Mul(hn::Add(one, s), hn::Set(d, per_slice_)));
            const V first = hn::Load(d, at_.first + kernel);
            hn::Store(hn::Min(hn::Add(first, hn::Max(further, hn::Neg(one))), hn::Set(d, static_cast<T>(last_slice_))),
                      d, last_ + kernel);
            const auto bells = [&](V at, T step, T* out, T* slope) SHEETSPLAT_CPU_INLINE {
                for (int i = 0; i < most_px; ++i) {
                    const V place = hn::MulAdd(hn::Set(d, step), hn::Set(d, static_cast<T>(i)), at);
                    hn::Store(exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(place, place))), d, out + i * room + kernel);
                    if constexpr (slopes) {
                        hn::Store(hn::Mul(place, hn::Mul(hn::Set(d, step), hn::Load(d, scale_ + kernel))), d,
                                  slope + i * room + kernel);
                    }
                }
            };
            bells(hn::MulAdd(hn::Set(d, shape_.Y2), y0, a2), shape_.Y2, bell_y_, slope_y_);
            bells(hn::MulAdd(hn::Sub(now, first), hn::Set(d, shape_.ds), s), shape_.ds, bell_z_, slope_z_);
        }
    }

    [[nodiscard]] HWY_INLINE Rect box(int kernel) const {
        return {static_cast<int>(x0_[kernel]), static_cast<int>(y0_[kernel]), static_cast<int>(x1_[kernel]),
                static_cast<int>(y1_[kernel])};
    }
    /// The last slice that a kernel meets.
    [[nodiscard]] HWY_INLINE std::int32_t last(int kernel) const { return static_cast<std::int32_t>(last_[kernel]); }

    /// Adds `count` slices of a kernel to the sheets.
    template <Sums sums>
    HWY_INLINE void add(int kernel, const Splat<T, slopes>& splat, int count, T value, T weight) const {
        const hn::CappedTag<T, most_px> d;
        const Rect box = this->box(kernel);
        const T edge = splat.profile.edge;
        const int start = start_of<T>(box.x0, box.x1, static_cast<int>(hn::Lanes(d)));
        const T at_x = at_.a1[kernel] + shape_.X * static_cast<T>(start);
        HWY_ALIGN T bell_x[2 * most_px];
        bells(d, -minus_k_, at_x, shape_.X, box.x1 - start, bell_x);
        HWY_ALIGN T slope_x[slopes ? 2 * most_px : 1];
        const Steepness<sums, T> steepness(splat.steep(), value, weight);
        if constexpr (slopes) {
            lines(d, at_x, shape_.X, steepness.scale, box.x1 - start, slope_x);
        }
        in_batches<slopes ? 2 : 5>(0, count, [&](int slice, auto number) SHEETSPLAT_CPU_INLINE {
            const T* bell_y = bell_y_ + kernel;
            const T* bell_z = bell_z_ + slice * room + kernel;
            if constexpr (slopes) {
                separable_slopes<sums, number.value, room>(d, splat.targets + slice, bell_x, bell_y, bell_z, slope_x,
                                                           slope_y_ + kernel, slope_z_ + slice * room + kernel, edge,
                                                           value, weight, steepness, AllRows{box.y1 - box.y0}, start,
                                                           box.x1, box.y0);
            } else {
                separable_rows<sums, number.value, room>(d, splat.targets + slice, bell_x, bell_y, bell_z, edge, value,
                                                         weight, start, box.x1, box.y0, box.y1);
            }
        });
    }

  private:
    static_assert(covered_slices <= most_px, "bells along depth have as much room as those along columns");

    const RowShape<T> shape_;
    const T per_X_, per_Y_, per_slice_, minus_k_;
    const std::int32_t last_slice_;
    BatchPlaces<T, room> at_;
    HWY_ALIGN T x0_[room], x1_[room], y0_[room], y1_[room], last_[room];
    HWY_ALIGN T bell_y_[most_px * room], bell_z_[most_px * room]; ///< [row or slice][kernel]
    static constexpr int slope_room = slopes ? most_px * room : 1;
    HWY_ALIGN T slope_y_[slope_room], slope_z_[slope_room]; ///< the same
    HWY_ALIGN T scale_[slopes ? room : 1];                  ///< Steepness::scale
};

/// As add_spheres, of kernels one after the other. Calls draw_again(last slice, number) for each that is drawn or only
/// met later. Returns how many sections were drawn.
template <Sums sums, class T, bool slopes, class DrawAgain>
HWY_NOINLINE int add_sphere_batch(Splat<T, slopes>& splat, SphereBatch<T, slopes>& batch, const Section<T>* sections,
                                int number, T weight, const DrawAgain& draw_again) {
    batch.template measure<sums>(sections, number, splat, weight);
    int drawn = 0;
    for (int kernel = 0; kernel < number; ++kernel) {
        const std::int32_t last = batch.last(kernel);
        const int count = std::min(last + 1 - splat.n, covered_slices);
        if (count <= 0) {
            continue;
        }
        draw_again(last, kernel);
        const Rect box = batch.box(kernel);
        if (box.empty() || !splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
            continue;
        }
        batch.template add<sums>(kernel, splat, count, sections[kernel].value, weight);
        splat.through[count - 1].add(box);
        drawn += count;
    }
    return drawn;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_BATCHES_INL

// Sums over all slices of a lattice's kernels, without sheets: where the picture is a sum over slices, its order does
// not matter. For kernels whose axes are those of an orthographic picture. With h = exp(-k (q1^2 + q2^2)) at a pixel,
// z_1
// >= z_2 >= ... the Gaussian along depth on the slices nearest to a kernel's centre, and e = exp(-k), what its sections
// add there is
//     sum_n max(0, h z_n - e) = max_m (h (z_1 + ... + z_m) - m e),      m = 0, 1, ...,
// since terms fall with n. Source: conventions, sections 2, 3 and 7.

#if defined(SHEETSPLAT_CPU_SUM_ROWS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SUM_ROWS_INL
#undef SHEETSPLAT_CPU_SUM_ROWS_INL
#else
#define SHEETSPLAT_CPU_SUM_ROWS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_task.hpp"
#include "feed_rows-inl.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Whether sections of kernels of this shape are few and small enough for RowSums.
template <class T>
bool sums_fit(const RowShape<T>& shape) {
    const double rows = 2.0 / std::abs(static_cast<double>(shape.Y2)) + 1.0;
    const double slices = 2.0 / std::abs(static_cast<double>(shape.ds)) + 1.0;
    return is_upright(shape) && rows * slices <= most_factors;
}

/// The slices first <= n <= last of each pixel of a tile that half spaces keep, in rows with a margin on both sides.
/// Source: conventions, section 10 (clipping).
template <class T>
class KeptOfPixels {
  public:
    /// Columns on both sides of a tile that vectors may run over.
    static constexpr int margin = TileShape::padding;

    /// Of an orthographic picture. Takes room from `scratch`.
    KeptOfPixels(const Shading<T>& shading, const TileShape& tile, std::int64_t slices, TileScratch<T>& scratch)
        : stride_(margin + tile.stride + margin) {
        const std::size_t elements = static_cast<std::size_t>(stride_) * static_cast<std::size_t>(tile.height);
        scratch.first_kept.resize(elements);
        scratch.last_kept.resize(elements);
        first_ = scratch.first_kept.data() + margin;
        last_ = scratch.last_kept.data() + margin;
        for (int y = 0; y < tile.height; ++y) {
            const double up = (shading.axis_y - (tile.y + y)) * shading.pixel;
            for (int x = -margin; x < tile.stride + margin; ++x) {
                const double over = (tile.x + x - shading.axis_x) * shading.pixel;
                double first = 0.0, last = static_cast<double>(slices - 1);
                for (const KeptHalfSpace& half : shading.kept) {
                    const double at_0 =
                        half.normal.x * over + half.normal.y * up - half.normal.z * shading.first_depth + half.distance;
                    const double step = -half.normal.z * shading.slice_spacing;
                    if (std::abs(step) * (last + 1.0) * 1e6 < std::abs(at_0) || step == 0.0) {
                        // No slice lies where this changes.
                        last = at_0 >= 0.0 ? last : -1.0;
                    } else if (step > 0.0) {
                        first = std::max(first, std::ceil(-at_0 / step));
                    } else {
                        last = std::min(last, std::floor(at_0 / -step));
                    }
                }
                const auto at = static_cast<std::ptrdiff_t>(y) * stride_ + x;
                first_[at] = static_cast<T>(first);
                last_[at] = static_cast<T>(std::max(last, first - 1.0));
            }
        }
    }

    [[nodiscard]] const T* first(int y) const { return first_ + static_cast<std::ptrdiff_t>(y) * stride_; }
    [[nodiscard]] const T* last(int y) const { return last_ + static_cast<std::ptrdiff_t>(y) * stride_; }

    /// How many slices of each pixel are kept, to a plane of the tile's picture.
    void count(const TileShape& tile, T* counted) const {
        for (int y = 0; y < tile.height; ++y) {
            for (int x = 0; x < tile.width; ++x) {
                counted[static_cast<std::ptrdiff_t>(y) * tile.stride + x] = last(y)[x] - first(y)[x] + T(1);
            }
        }
    }

  private:
    int stride_;
    T *first_, *last_;
};

template <class T>
class RowSums {
  public:
    /// Adds to a plane of the tile's picture: `step` times what sheets would add up to. Takes room from `scratch`.
    RowSums(const PartProfile<T>& profile, const RowShape<T>& shape, const TileShape& tile, T step,
            TileScratch<T>& scratch, T* plane)
        : profile_(profile), X_(shape.X), Y_(std::abs(shape.Y2)), per_slice_(std::abs(shape.ds)),
          half_x_(1.0 / static_cast<double>(X_)), half_y_(1.0 / static_cast<double>(Y_)), tile_(tile), step_(step),
          plane_(plane), stride_(margin + tile.stride + margin), rows_(static_cast<int>(2.0 * half_y_) + 1),
          terms_(static_cast<int>(std::ceil(T(2) / per_slice_))) {
        scratch.sums.assign(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(tile.height), T(0));
        sums_ = scratch.sums.data() + margin;
    }

    /// Adds the kernels of samples from `sample` on at place, place + step, ...: in pixels of the tile's sheets and
    /// slices. kept: where clipping leaves only some slices of the kernels' pixels, else null.
    void add(const SampleReader<T>& reader, const KeptOfPixels<T>* kept, std::size_t sample, const Vec3& place,
             const Vec3& step, std::uint32_t count) {
        in_terms([&](auto terms) {
            if (kept == nullptr) {
                add_run<false>(terms, reader, nullptr, sample, place, step, count);
            } else {
                add_run<true>(terms, reader, kept, sample, place, step, count);
            }
        });
    }

    /// Moves what has been added to the picture. (Sums of sums: a single one of very many terms would drift.)
    void flush() {
        const hn::CappedTag<T, TileShape::padding> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const auto step = hn::Set(d, step_);
        for (int y = 0; y < tile_.height; ++y) {
            T* from = sums_ + static_cast<std::ptrdiff_t>(y) * stride_;
            T* to = plane_ + static_cast<std::ptrdiff_t>(y) * tile_.stride;
            for (int x = 0; x < tile_.width; x += lanes) {
                hn::StoreU(hn::MulAdd(hn::LoadU(d, from + x), step, hn::LoadU(d, to + x)), d, to + x);
            }
            std::fill(from - margin, from - margin + stride_, T(0));
        }
        added_ = 0;
    }

    /// Kernel times slice.
    [[nodiscard]] std::uint64_t sections() const { return sections_; }

  private:
    static constexpr std::uint32_t together = 16;
    /// Columns on both sides of the tile that vectors may run over.
    static constexpr int margin = TileShape::padding;
    /// Pixels: what is farther away stays outside.
    static constexpr double outside = 1e6;

    /// Calls use with the number of terms, known to the compiler where it is small.
    template <class Use>
    HWY_INLINE void in_terms(const Use& use) const {
        switch (terms_) {
        case 2:
            return use(std::integral_constant<int, 2>());
        case 3:
            return use(std::integral_constant<int, 3>());
        case 4:
            return use(std::integral_constant<int, 4>());
        case 5:
            return use(std::integral_constant<int, 5>());
        default:
            return use(terms_);
        }
    }

    /// So many kernels, in whole vectors.
    [[nodiscard]] static HWY_INLINE int in_vectors(int kernels) {
        const int lanes = static_cast<int>(hn::Lanes(hn::CappedTag<T, together>()));
        return (kernels + lanes - 1) / lanes * lanes;
    }

    /// Where kernels i ... i + kernels - 1 are; those beyond the end too.
    HWY_INLINE void look_at(const Vec3& place, const Vec3& step, std::uint32_t i, int kernels) {
        const hn::CappedTag<double, 8> d;
        const hn::Rebind<std::int32_t, decltype(d)> d_whole;
        using V = hn::Vec<decltype(d)>;
        const auto all = [&](double number) { return hn::Set(d, number); };
        const V half_x = all(half_x_), half_y = all(half_y_), slices = all(1.0 / static_cast<double>(per_slice_));
        const V one = all(1.0);
        for (int kernel = 0; kernel < kernels; kernel += static_cast<int>(hn::Lanes(d))) {
            const V along = hn::Iota(d, static_cast<double>(i) + kernel);
            const auto at = [&](double first, double more) { return hn::MulAdd(along, all(more), all(first)); };
            const auto on_screen = [&](V pixel) { return hn::Min(hn::Max(pixel, all(-outside)), all(outside)); };
            const auto store = [&](V number, T* to) {
                if constexpr (sizeof(T) == sizeof(double)) {
                    hn::Store(number, d, to + kernel);
                } else {
                    hn::Store(hn::DemoteTo(hn::Rebind<T, decltype(d)>(), number), hn::Rebind<T, decltype(d)>(),
                              to + kernel);
                }
            };
            const auto store_whole = [&](V number, std::int32_t* to) {
                hn::Store(hn::DemoteTo(d_whole, number), d_whole, to + kernel);
            };
            const V x = on_screen(at(place.x, step.x)), y = on_screen(at(place.y, step.y)), z = at(place.z, step.z);
            const V column = hn::Ceil(hn::Sub(x, half_x)), row = hn::Ceil(hn::Sub(y, half_y));
            store(hn::Sub(column, x), off_x_);
            store(hn::Sub(row, y), off_y_);
            store(hn::Abs(hn::Sub(z, hn::Round(z))), off_z_);
            // Pixel (0, 0) of the tile is that at (1, 1) of its sheets.
            store_whole(hn::Sub(column, one), column_);
            store_whole(hn::Sub(row, one), row_);
            store_whole(hn::Floor(hn::Add(x, half_x)), past_);
            const V met = hn::Sub(hn::Floor(hn::Add(z, slices)), hn::Ceil(hn::Sub(z, slices)));
            store_whole(hn::Add(met, one), sections_of_);
        }
    }

    /// The Gaussian along columns times sums of those along depth.
    template <class Terms>
    HWY_INLINE void factors(Terms terms, int kernels) {
        const hn::CappedTag<T, together> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const auto minus_k = hn::Set(d, -profile_.falloff_log2);
        for (int kernel = 0; kernel < kernels; kernel += lanes) {
            const auto off_z = hn::Load(d, off_z_ + kernel);
            auto sum = hn::Zero(d);
            for (int term = 0; term < terms; ++term) {
                // Slices on the near side and on the far side of the centre's nearest one in turn.
                const auto whole = hn::Set(d, static_cast<T>((term + 1) / 2));
                const auto slices = term % 2 == 0 ? hn::Add(whole, off_z) : hn::Sub(whole, off_z);
                const auto height = hn::Mul(slices, hn::Set(d, per_slice_));
                sum = hn::Add(sum, exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(height, height))));
                hn::Store(sum, d, depth_ + term * static_cast<int>(together) + kernel);
            }
            const auto off_y = hn::Load(d, off_y_ + kernel);
            T* to = factors_ + kernel;
            for (int row = 0; row < rows_; ++row) {
                const auto q2 = hn::Mul(hn::Add(off_y, hn::Set(d, static_cast<T>(row))), hn::Set(d, Y_));
                const auto bell = exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q2, q2)));
                for (int term = 0; term < terms; ++term, to += together) {
                    hn::Store(hn::Mul(bell, hn::Load(d, depth_ + term * static_cast<int>(together) + kernel)), d, to);
                }
            }
        }
    }

    template <bool cut, class Terms>
    HWY_NOINLINE void add_run(Terms terms, const SampleReader<T>& reader, const KeptOfPixels<T>* kept,
                              std::size_t sample, const Vec3& place, const Vec3& step, std::uint32_t count) {
        T values[together];
        for (std::uint32_t i = 0; i < count; i += together) {
            const int number = static_cast<int>(std::min(together, count - i));
            reader.read(sample + i, static_cast<std::uint32_t>(number), values);
            look_at(place, step, i, in_vectors(number));
            if constexpr (cut) {
                cut_factors(terms, in_vectors(number), place.z, step.z, i);
            } else {
                factors(terms, in_vectors(number));
            }
            for (int kernel = 0; kernel < number; ++kernel) {
                if constexpr (cut) {
                    add_one_cut(terms, *kept, kernel, values[kernel]);
                } else {
                    add_one(terms, kernel, values[kernel]);
                }
                sections_ += static_cast<std::uint64_t>(sections_of_[kernel]);
            }
            added_ += together;
            if (added_ >= summed_together) {
                flush();
            }
        }
    }

    template <class Terms>
    HWY_INLINE void add_one(Terms terms, int kernel, T value_t) {
        const hn::CappedTag<T, TileShape::padding> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const int row = row_[kernel], column = column_[kernel];
        const int first = std::max(0, -row), past = std::min(rows_, tile_.height - row);
        // Whole vectors from multiples of their length on, so that kernels one after the other read what was written.
        const int start = std::max(column & ~(lanes - 1), -margin), end = std::min(past_[kernel], tile_.width);
        const auto zero = hn::Zero(d), value = hn::Set(d, value_t), minus_k = hn::Set(d, -profile_.falloff_log2);
        const T edge = profile_.edge;
        for (int x = start; x < end; x += lanes) {
            const auto q1 =
                hn::Mul(hn::Add(hn::Iota(d, static_cast<T>(x - column)), hn::Set(d, off_x_[kernel])), hn::Set(d, X_));
            const auto bell = exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q1, q1)));
            T* to = sums_ + static_cast<std::ptrdiff_t>(row + first) * stride_ + x;
            const T* factor = factors_ + first * terms * static_cast<int>(together) + kernel;
            for (int y = first; y < past; ++y, to += stride_) {
                auto most = zero;
                for (int term = 0; term < terms; ++term, factor += together) {
                    const auto lowered = hn::Set(d, static_cast<T>(term + 1) * edge);
                    most = hn::Max(most, hn::MulSub(bell, hn::Set(d, *factor), lowered));
                }
                hn::Store(hn::MulAdd(value, most, hn::Load(d, to)), d, to);
            }
        }
    }

    /// The first slice in each kernel's support, and the Gaussians along depth on the slices from there on and down its
    /// rows. z: of kernel 0's centre, in slices; step_z: from kernel to kernel.
    template <class Terms>
    HWY_INLINE void cut_factors(Terms terms, int kernels, double z, double step_z, std::uint32_t i) {
        const double reach = 1.0 / static_cast<double>(per_slice_);
        for (int kernel = 0; kernel < kernels; ++kernel) {
            const double centre = z + static_cast<double>(i + static_cast<std::uint32_t>(kernel)) * step_z;
            const double front = std::floor(centre - reach) + 1.0;
            front_[kernel] = static_cast<T>(front);
            for (int term = 0; term < terms; ++term) {
                depth_[term * static_cast<int>(together) + kernel] = static_cast<T>(front + term - centre);
            }
        }
        const hn::CappedTag<T, together> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const auto minus_k = hn::Set(d, -profile_.falloff_log2);
        const auto bell = [&](auto q) { return exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q, q))); };
        for (int kernel = 0; kernel < kernels; kernel += lanes) {
            for (int term = 0; term < terms; ++term) {
                T* along = depth_ + term * static_cast<int>(together) + kernel;
                hn::Store(bell(hn::Mul(hn::Load(d, along), hn::Set(d, per_slice_))), d, along);
            }
            const auto off_y = hn::Load(d, off_y_ + kernel);
            for (int row = 0; row < rows_; ++row) {
                const auto q2 = hn::Mul(hn::Add(off_y, hn::Set(d, static_cast<T>(row))), hn::Set(d, Y_));
                hn::Store(bell(q2), d, factors_ + row * static_cast<int>(together) + kernel);
            }
        }
    }

    template <class Terms>
    HWY_INLINE void add_one_cut(Terms terms, const KeptOfPixels<T>& kept, int kernel, T value_t) {
        const hn::CappedTag<T, TileShape::padding> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const int row = row_[kernel], column = column_[kernel];
        const int top = std::max(0, -row), bottom = std::min(rows_, tile_.height - row);
        const int start = std::max(column & ~(lanes - 1), -margin), end = std::min(past_[kernel], tile_.width);
        const auto zero = hn::Zero(d), value = hn::Set(d, value_t), minus_k = hn::Set(d, -profile_.falloff_log2);
        const auto edge = hn::Set(d, profile_.edge), front = hn::Set(d, front_[kernel]);
        for (int x = start; x < end; x += lanes) {
            const auto q1 =
                hn::Mul(hn::Add(hn::Iota(d, static_cast<T>(x - column)), hn::Set(d, off_x_[kernel])), hn::Set(d, X_));
            const auto bell = exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(q1, q1)));
            T* to = sums_ + static_cast<std::ptrdiff_t>(row + top) * stride_ + x;
            const T* down = factors_ + top * static_cast<int>(together) + kernel;
            for (int y = top; y < bottom; ++y, to += stride_, down += together) {
                const auto across = hn::Mul(bell, hn::Set(d, *down));
                const auto first = hn::Sub(hn::Load(d, kept.first(row + y) + x), front);
                const auto last = hn::Sub(hn::Load(d, kept.last(row + y) + x), front);
                auto sum = zero;
                for (int term = 0; term < terms; ++term) {
                    const auto along = hn::Set(d, depth_[term * static_cast<int>(together) + kernel]);
                    const auto number = hn::Set(d, static_cast<T>(term));
                    const auto inside = hn::And(hn::Le(first, number), hn::Ge(last, number));
                    const auto own = hn::Max(hn::MulSub(across, along, edge), zero);
                    sum = hn::Add(sum, hn::IfThenElseZero(inside, own));
                }
                hn::Store(hn::MulAdd(value, sum, hn::Load(d, to)), d, to);
            }
        }
    }

    const PartProfile<T>& profile_;
    const T X_, Y_, per_slice_; ///< of the unit sphere, per pixel and slice
    const double half_x_, half_y_;
    const TileShape& tile_;
    const T step_;
    T* const plane_;
    const int stride_;
    const int rows_, terms_;
    T* sums_ = nullptr; ///< of the tile's first pixel
    std::size_t added_ = 0;
    std::uint64_t sections_ = 0;
    // Of some kernels at once: pixels from the centre to the first row and column, and slices to the nearest one.
    HWY_ALIGN T off_x_[together], off_y_[together], off_z_[together];
    HWY_ALIGN std::int32_t column_[together], past_[together], row_[together], sections_of_[together];
    HWY_ALIGN T front_[together];                  ///< of kernels that clipping cuts: the first slice in their supports
    HWY_ALIGN T depth_[most_factors * together];   ///< [term][kernel]
    HWY_ALIGN T factors_[most_factors * together]; ///< [row][term][kernel]
};

/// Adds the kernels of a lattice to a plane of the tile's picture; kept: where clipping takes slices away. Returns how
/// many sections that were.
template <class T>
std::uint64_t sum_lattice(const LoopSetup<T>& setup, const PartProfile<T>& profile, const RowShape<T>& shape,
                          RowFeed<T>& feed, const KeptOfPixels<T>* kept, const TileShape& tile, TileScratch<T>& scratch,
                          T* plane) {
    RowSums<T> sums(profile, shape, tile, setup.shading->scalar_step, scratch, plane);
    const Vec3 step = feed.step_of_places();
    const auto cuts = feed.row_cuts(setup.shading->kept);
    feed.for_each_stretch([&](std::size_t sample, const Vec3& eye, std::uint32_t count) {
        const Vec3 place = feed.place_of(eye);
        const auto from = [&](std::uint32_t i) { return place + static_cast<double>(i) * step; };
        const auto [begin, end] = kept == nullptr ? std::pair(0U, count) : feed.wholly_kept(cuts, eye, count);
        sums.add(feed.reader(), kept, sample, place, step, begin);
        sums.add(feed.reader(), nullptr, sample + begin, from(begin), step, end - begin);
        sums.add(feed.reader(), kept, sample + end, from(end), step, count - end);
    });
    sums.flush();
    return sums.sections();
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SUM_ROWS_INL

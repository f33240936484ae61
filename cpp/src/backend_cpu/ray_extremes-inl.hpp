// Modes mip and minimum of a lattice: each pixel's ray looks up the slice points where rho (in mode mip, -rho) can be
// smaller than what it has found, by the bounds of LatticeExtremes. The first points that it looks at are those where
// its neighbours found theirs. What is found does not depend on the order. Source: conventions, sections 2, 3 and 7.

#if defined(SHEETSPLAT_CPU_RAY_EXTREMES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_RAY_EXTREMES_INL
#undef SHEETSPLAT_CPU_RAY_EXTREMES_INL
#else
#define SHEETSPLAT_CPU_RAY_EXTREMES_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <type_traits>
#include <variant>
#include <vector>

#include "backend_cpu/lattice_extremes.hpp"
#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// rho at points of a lattice.
template <class T>
class Points {
  public:
    Points() = default;
    Points(const Points&) = delete;
    Points& operator=(const Points&) = delete;
    virtual ~Points() = default;
    /// At start + n step, index coordinates, times value_scale.
    [[nodiscard]] virtual T rho(const Vec3& start, const Vec3& step, std::int64_t n) const = 0;
};

/// Of kernels that reach fewer than `half` samples on either side.
template <class T, int half>
class LatticePoints final : public Points<T> {
  public:
    LatticePoints(const RegularField& field, double value_scale)
        : field_(field),
          load_(std::visit([](const auto& data) { return &load_as<std::decay_t<decltype(data)>>; }, field.samples())),
          counted_from_(field.counted_from()), rounded_from_(static_cast<T>(counted_from_)),
          rest_(static_cast<T>(counted_from_ - static_cast<double>(rounded_from_))), ni_(as_signed(field.shape()[2])),
          nj_(as_signed(field.shape()[1])), nk_(as_signed(field.shape()[0])), value_scale_(value_scale),
          falloff_(
              static_cast<T>(-field.kernel().falloff * log2_e / (field.options().radius * field.options().radius))),
          edge_(static_cast<T>(field.kernel().edge())) {
        for (int i = 0; i < layer; ++i) {
            columns_[i] = static_cast<T>(half - 1 - i % row);
            rows_[i] = static_cast<T>(half - 1 - i / row);
        }
    }

    [[nodiscard]] T rho(const Vec3& start, const Vec3& step, std::int64_t n) const override {
        const Vec3 place = start + static_cast<double>(n) * step;
        const hn::CappedTag<T, 16> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const double floors[3] = {std::floor(place.x), std::floor(place.y), std::floor(place.z)};
        const auto offset = [&](int axis) { return hn::Set(d, static_cast<T>(place[axis] - floors[axis])); };
        // Rows of a layer lie `row` elements apart; what lies between counts as 0.
        HWY_ALIGN T values[width * layer];
        load_(*this, static_cast<std::int64_t>(floors[0]) - (half - 1),
              static_cast<std::int64_t>(floors[1]) - (half - 1), static_cast<std::int64_t>(floors[2]) - (half - 1),
              values);
        const auto falloff = hn::Set(d, falloff_), edge = hn::Set(d, edge_), zero = hn::Zero(d);
        HWY_ALIGN T along[16];
        for (int z = 0; z < width; z += lanes) {
            const auto off =
                hn::Sub(hn::Add(offset(2), hn::Set(d, static_cast<T>(half - 1))), hn::Iota(d, static_cast<T>(z)));
            hn::Store(exp2_nonpositive(d, hn::Mul(falloff, hn::Mul(off, off))), d, along + z);
        }
        const auto offset_x = offset(0), offset_y = offset(1);
        auto sum = zero;
        for (int i = 0; i < layer; i += lanes) {
            const auto x = hn::Add(offset_x, hn::Load(d, columns_ + i)), y = hn::Add(offset_y, hn::Load(d, rows_ + i));
            const auto across = exp2_nonpositive(d, hn::Mul(falloff, hn::MulAdd(x, x, hn::Mul(y, y))));
            for (int z = 0; z < width; ++z) {
                const auto weight = hn::Max(hn::MulSub(across, hn::Set(d, along[z]), edge), zero);
                sum = hn::MulAdd(hn::Load(d, values + z * layer + i), weight, sum);
            }
        }
        return static_cast<T>(static_cast<double>(hn::GetLane(hn::SumOfLanes(d, sum))) * value_scale_);
    }

  private:
    static constexpr double log2_e = 1.4426950408889634;
    static constexpr int width = 2 * half;
    static constexpr int row = width <= 4 ? 4 : 8;
    static constexpr int layer = row * width;
    static_assert(layer % 16 == 0 && width <= 16, "layers are whole vectors");

    static std::int64_t as_signed(std::size_t n) { return static_cast<std::int64_t>(n); }

    /// What a kernel adds: its value, counted from the base. NaN: no kernel.
    template <class Value>
    [[nodiscard]] HWY_INLINE T factor(Value value) const {
        if constexpr (sizeof(Value) > sizeof(T)) {
            return value == value ? static_cast<T>(static_cast<double>(value) - counted_from_) : T(0);
        } else if constexpr (std::is_floating_point_v<Value>) {
            return value == value ? (static_cast<T>(value) - rounded_from_) - rest_ : T(0);
        } else {
            return (static_cast<T>(value) - rounded_from_) - rest_;
        }
    }

    /// The samples of a window from (i, j, k) on; beyond the lattice there are none.
    template <class Data>
    static void load_as(const LatticePoints& points, std::int64_t i, std::int64_t j, std::int64_t k, T* to) {
        points.load(*std::get_if<Data>(&points.field_.samples()), i, j, k, to);
    }
    template <class Value>
    HWY_INLINE void load(const std::vector<Value>& samples, std::int64_t i, std::int64_t j, std::int64_t k,
                         T* to) const {
        const auto row_of = [&](std::int64_t y, std::int64_t z) {
            return samples.data() + field_.row(static_cast<std::size_t>(y), static_cast<std::size_t>(z));
        };
        if (HWY_LIKELY(i >= 0 && j >= 0 && k >= 0 && i + width <= ni_ && j + width <= nj_ && k + width <= nk_)) {
            Value window[width * layer];
            if constexpr (row != width) {
                std::memset(window, 0, sizeof window);
            }
            for (int z = 0; z < width; ++z) {
                for (int y = 0; y < width; ++y) {
                    std::memcpy(window + z * layer + y * row, row_of(j + y, k + z) + i, width * sizeof(Value));
                }
            }
            for (int at = 0; at < width * layer; ++at) {
                to[at] = factor(window[at]);
            }
            return;
        }
        std::fill(to, to + width * layer, T(0));
        for (std::int64_t z = std::max<std::int64_t>(0, -k); z < std::min<std::int64_t>(width, nk_ - k); ++z) {
            for (std::int64_t y = std::max<std::int64_t>(0, -j); y < std::min<std::int64_t>(width, nj_ - j); ++y) {
                for (std::int64_t x = std::max<std::int64_t>(0, -i); x < std::min<std::int64_t>(width, ni_ - i); ++x) {
                    to[z * layer + y * row + x] = factor(row_of(j + y, k + z)[i + x]);
                }
            }
        }
    }

    const RegularField& field_;
    void (*load_)(const LatticePoints& points, std::int64_t i, std::int64_t j, std::int64_t k, T* to);
    const double counted_from_;
    const T rounded_from_, rest_; ///< of counted_from_
    const std::int64_t ni_, nj_, nk_;
    const double value_scale_;
    const T falloff_; ///< -k log2(e) over the squared radius
    const T edge_;
    HWY_ALIGN T columns_[layer], rows_[layer]; ///< what is added to a place's distance from the sample before it
};

template <class T>
class RayExtremes {
  public:
    RayExtremes(const ExtremesView& view, const TileShape& tile, const TilePicture<T>& picture, const Points<T>& points)
        : view_(view), tile_(tile), picture_(picture), points_(points), first_(view.places->places(TileShape{}, 0)),
          last_(view.places->places(TileShape{}, view.frame->slices - 1)),
          per_slice_(1.0 / std::max<double>(1.0, most())), radius_(view.places->radius()),
          past_(view.places->last() + view.places->radius()),
          per_value_(1.0 / (view.value_scale * view.bounds->scale())), least_(view.bounds->least()) {}

    /// Writes a tile's numbers. Returns how many points were looked up.
    std::uint64_t run(const std::function<bool()>& between) {
        std::int64_t above[largest_tile];
        std::fill(above, above + tile_.width, none);
        for (int y = 0; y < tile_.height; ++y) {
            std::int64_t left = none;
            for (int x = 0; x < tile_.width; ++x) {
                const T rho = ray(x, y, left, above[x], between);
                if (given_up_) {
                    return looked_up_;
                }
                picture_.scalar[in_plane(x, y)] = rho * static_cast<T>(view_.sign * view_.scalar_step);
            }
        }
        return looked_up_;
    }

  private:
    static constexpr std::int64_t none = -1;
    /// Points and blocks between two questions whether to go on.
    static constexpr std::uint64_t steps_between_polls = 8192;
    /// What bounds differ from sums in float32 by, relatively. Smaller floats are not relative to their roundings.
    static constexpr double slack = 1e-5, least_share = 1e-30;

    /// The last slice.
    [[nodiscard]] double most() const { return static_cast<double>(view_.frame->slices - 1); }
    [[nodiscard]] std::ptrdiff_t in_plane(int x, int y) const {
        return static_cast<std::ptrdiff_t>(y) * tile_.stride + x;
    }

    /// What a block's bound must be less than, where rho has been found.
    [[nodiscard]] float limit(T rho) const {
        const double share = static_cast<double>(rho) * per_value_;
        const double size = std::abs(share);
        if (!(size < 2.0)) {
            return nothing_found;
        }
        if (size <= least_share) {
            return rho > T(0) ? static_cast<float>(least_share) : 0.0F;
        }
        return static_cast<float>(share + slack * size);
    }
    /// Every bound is less.
    static constexpr float nothing_found = 3.0F;

    /// left, above: slices where neighbouring rays found their extremes; both become that of this ray. NaN where no
    /// point counts.
    T ray(int x, int y, std::int64_t& left, std::int64_t& above, const std::function<bool()>& between) {
        const auto at = [&](const LatticeReach::Places& places) {
            return places.first + static_cast<double>(tile_.x + x) * places.by_column +
                   static_cast<double>(tile_.y + y) * places.by_row;
        };
        const Vec3 start = at(first_), step = (at(last_) - start) * per_slice_;
        double low = 0.0, high = most();
        for (int axis = 0; axis < 3; ++axis) {
            keep(start[axis], step[axis], axis, low, high);
        }
        clip(x, y, low, high);
        // (A pixel that leaves the lattice aside forgets where its neighbours found theirs.)
        std::int64_t found = none;
        T least = std::numeric_limits<T>::quiet_NaN();
        float beyond = nothing_found;
        const auto look_at = [&](std::int64_t n) {
            if (!reaches(start + static_cast<double>(n) * step)) {
                return;
            }
            const T rho = points_.rho(start, step, n);
            ++looked_up_;
            if (found == none || rho < least) {
                least = rho;
                found = n;
                beyond = limit(rho);
            }
        };
        if (low <= high) {
            const auto begin = static_cast<std::int64_t>(std::ceil(low)), end = static_cast<std::int64_t>(high) + 1;
            for (const std::int64_t n : {left, above}) {
                if (n >= begin && n < end && n != found && least_ < beyond) {
                    look_at(n);
                }
            }
            march(start, step, begin, end, beyond, look_at, between);
        }
        left = above = found;
        return least;
    }

    /// Keeps the slices whose points lie where kernels reach along one axis.
    void keep(double start, double step, int axis, double& low, double& high) const {
        const double before = -radius_, past = past_[axis];
        if (std::abs(step) * most() < 1e-9) {
            high = start > before && start < past ? high : -1.0;
            return;
        }
        const double a = (before - start) / step, b = (past - start) / step;
        low = std::max(low, std::min(a, b));
        high = std::min(high, std::max(a, b));
    }

    /// Keeps the slices whose points the clip and the depth limit keep.
    void clip(int x, int y, double& low, double& high) const {
        const Frame& frame = *view_.frame;
        const auto at = [&](const KeptHalfSpace& half, double depth) {
            const double pixel = frame.pixel * (frame.projection == Projection::perspective ? depth : 1.0);
            return half.normal.x * ((tile_.x + x + 0.5 - frame.axis_x) * pixel) +
                   half.normal.y * ((frame.axis_y - tile_.y - y - 0.5) * pixel) - half.normal.z * depth + half.distance;
        };
        for (const KeptHalfSpace& half : *view_.kept) {
            const double front = at(half, frame.depth_of(0)), back = at(half, frame.depth_of(frame.slices - 1));
            if (front >= 0.0 && back >= 0.0) {
                continue;
            }
            if (front < 0.0 && back < 0.0) {
                high = -1.0;
                return;
            }
            // Linear in between.
            const double crossed = front / (front - back) * most();
            (front < 0.0 ? low : high) = front < 0.0 ? std::max(low, crossed) : std::min(high, crossed);
        }
        if (picture_.last_kept != nullptr) {
            high = std::min(high, static_cast<double>(picture_.last_kept[in_plane(x, y)]));
        }
    }

    /// Whether any kernel reaches a point: the one of the nearest sample does.
    [[nodiscard]] bool reaches(const Vec3& place) const {
        double distance2 = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double sample = std::min(std::max(std::nearbyint(place[axis]), 0.0), view_.places->last()[axis]);
            distance2 += (place[axis] - sample) * (place[axis] - sample);
        }
        return distance2 < radius_ * radius_;
    }

    /// Looks at slices begin ... end - 1 where bounds of blocks are beyond what look_at moves.
    template <class LookAt>
    HWY_INLINE void march(const Vec3& start, const Vec3& step, std::int64_t begin, std::int64_t end,
                          const float& beyond, const LookAt& look_at, const std::function<bool()>& between) {
        const hn::CappedTag<double, 8> d;
        const hn::Rebind<std::int32_t, decltype(d)> d_whole;
        const hn::Rebind<float, decltype(d)> d_share;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const auto& blocks = view_.bounds->blocks();
        const float* all_bounds = view_.bounds->bounds();
        HWY_ALIGN float bounds[8];
        for (std::int64_t n = begin; n < end && least_ < beyond; n += lanes) {
            const auto slice = hn::Iota(d, static_cast<double>(n));
            auto block = hn::Zero(d);
            for (int axis = 2; axis >= 0; --axis) {
                const auto place = hn::MulAdd(slice, hn::Set(d, step[axis]), hn::Set(d, start[axis]));
                const auto along = hn::Floor(hn::MulAdd(place, hn::Set(d, 1.0 / ExtremeBlocks::edge), hn::Set(d, 1.0)));
                const auto last = hn::Set(d, static_cast<double>(blocks[static_cast<std::size_t>(axis)] - 1));
                block = hn::MulAdd(block, hn::Add(last, hn::Set(d, 1.0)), hn::Min(hn::Max(along, hn::Zero(d)), last));
            }
            const auto bound = hn::GatherIndex(d_share, all_bounds, hn::DemoteTo(d_whole, block));
            asked_ += static_cast<std::uint64_t>(lanes);
            const auto limit = hn::Set(d_share, beyond);
            if (!hn::AllFalse(d_share, hn::Lt(bound, limit))) {
                hn::Store(bound, d_share, bounds);
                const int count = static_cast<int>(std::min<std::int64_t>(lanes, end - n));
                for (int lane = 0; lane < count; ++lane) {
                    if (bounds[lane] < beyond) {
                        look_at(n + lane);
                        asked_ += 16;
                    }
                }
            }
            if (HWY_UNLIKELY(asked_ >= steps_between_polls)) {
                asked_ = 0;
                if (!between()) {
                    given_up_ = true;
                    return;
                }
            }
        }
    }

    const ExtremesView& view_;
    const TileShape& tile_;
    const TilePicture<T>& picture_;
    const Points<T>& points_;
    const LatticeReach::Places first_, last_; ///< from the picture's first pixel on, so that tiles do not matter
    const double per_slice_;
    const double radius_;
    const Vec3 past_;
    const double per_value_; ///< from the sheets' unit to that of bounds
    const float least_;      ///< bound of any block
    std::uint64_t looked_up_ = 0, asked_ = 0;
    bool given_up_ = false;
};

/// Writes a tile's largest or smallest rho to the scalar's plane; between: as TileFunctions::run takes it. Returns how
/// many points were looked up.
template <class T>
std::uint64_t find_extremes(const ExtremesView& view, const TileShape& tile, const TilePicture<T>& picture,
                            const std::function<bool()>& between) {
    const auto within = [&](auto half) {
        const LatticePoints<T, half.value> points(*view.field, view.sign * view.value_scale);
        return RayExtremes<T>(view, tile, picture, points).run(between);
    };
    const double radius = view.places->radius();
    return radius <= 2.0   ? within(std::integral_constant<int, 2>())
           : radius <= 3.0 ? within(std::integral_constant<int, 3>())
                           : within(std::integral_constant<int, 4>());
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RAY_EXTREMES_INL

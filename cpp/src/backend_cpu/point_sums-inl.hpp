// Sums of a lattice at single points: of fields whose colours other fields take, few points are asked for, so that the
// kernels around each are summed in place of sheets. Source: conventions, section 2.

#if defined(SHEETSPLAT_CPU_POINT_SUMS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_POINT_SUMS_INL
#undef SHEETSPLAT_CPU_POINT_SUMS_INL
#else
#define SHEETSPLAT_CPU_POINT_SUMS_INL
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "slab-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// The sums of f - b times kernels at pixels of one row of a slice.
template <class T>
class PointSums {
  public:
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;

    /// ahead: 0 for slice n, 1 for slice n + 1.
    PointSums(const Slab<T>& slab, int y, int ahead)
        : lattice_(*slab.group.summed_at_points), field_(*lattice_.field), shape_(field_.shape()) {
        const double depth =
            slab.shading.first_depth + static_cast<double>(slab.window.n + ahead) * slab.shading.slice_spacing;
        const double wide = slab.shading.pixel * (slab.shading.perspective ? depth : 1.0);
        const Vec3 eye((slab.shape.x - slab.shading.axis_x) * wide, (slab.shading.axis_y - (slab.shape.y + y)) * wide,
                       -depth);
        first_ = lattice_.to_index * (eye - lattice_.first_eye);
        step_ = lattice_.to_index[0] * wide;
    }

    /// From column x on, in some lanes; 0 in the others.
    HWY_INLINE V at(int x, M lanes) const {
        const D d;
        HWY_ALIGN T wanted[Slab<T>::lanes];
        HWY_ALIGN T sums[Slab<T>::lanes];
        hn::Store(hn::IfThenElseZero(lanes, hn::Set(d, T(1))), d, wanted);
        std::visit(
            [&](const auto& samples) {
                for (int lane = 0; lane < Slab<T>::lanes; ++lane) {
                    sums[lane] = wanted[lane] == T(0) ? T(0)
                                                      : sum(samples.data(), samples.size(),
                                                            first_ + static_cast<double>(x + lane) * step_);
                }
            },
            field_.samples());
        return hn::Load(d, sums);
    }

  private:
    static constexpr int room = PointLattice::most_samples;
    using Narrow = hn::CappedTag<T, room>;
    static constexpr int narrow = static_cast<int>(hn::MaxLanes(Narrow()));

    /// Samples of an axis whose kernels may reach a place, and the factors of their Gaussians.
    struct Axis {
        std::int64_t first = 0, past = 0;
        HWY_ALIGN T bells[room];

        HWY_INLINE Axis(double place, double radius, T falloff, std::size_t size) {
            const Narrow d;
            first = std::max<std::int64_t>(static_cast<std::int64_t>(std::ceil(std::max(place - radius, -1.0))), 0);
            past = std::min<std::int64_t>(
                static_cast<std::int64_t>(std::floor(std::min(place + radius, static_cast<double>(size)))) + 1,
                static_cast<std::int64_t>(size));
            past = std::min(past, first + room);
            const auto from = static_cast<T>(static_cast<double>(first) - place);
            for (int at = 0; at < room; at += narrow) {
                const auto far = hn::Add(hn::Iota(d, static_cast<T>(at)), hn::Set(d, from));
                const auto bell = exp2_nonpositive(d, hn::Mul(hn::Set(d, -falloff), hn::Mul(far, far)));
                const auto count = static_cast<int>(std::max<std::int64_t>(past - first - at, 0));
                const auto own = hn::FirstN(d, static_cast<std::size_t>(std::min(count, narrow)));
                hn::Store(hn::IfThenElseZero(own, bell), d, bells + at);
            }
        }
    };

    /// Numbers that vectors of T hold with all their digits.
    template <class Value>
    static constexpr bool fits = std::is_same_v<T, float> && (std::is_same_v<Value, float> || sizeof(Value) <= 2);

    template <class Value>
    HWY_INLINE static hn::Vec<Narrow> load(const Value* from) {
        const Narrow d;
        if constexpr (std::is_same_v<Value, T>) {
            return hn::LoadU(d, from);
        } else {
            const hn::Rebind<std::int32_t, Narrow> whole;
            return hn::ConvertTo(d, hn::PromoteTo(whole, hn::LoadU(hn::Rebind<Value, Narrow>(), from)));
        }
    }

    template <class Value>
    HWY_NOINLINE T sum(const Value* samples, std::size_t size, const Vec3& place) const {
        const Narrow d;
        const Axis i(place.x, lattice_.radius, static_cast<T>(lattice_.falloff_log2), shape_[2]);
        const Axis j(place.y, lattice_.radius, static_cast<T>(lattice_.falloff_log2), shape_[1]);
        const Axis k(place.z, lattice_.radius, static_cast<T>(lattice_.falloff_log2), shape_[0]);
        if (i.first >= i.past || j.first >= j.past || k.first >= k.past) {
            return T(0);
        }
        const auto edge = hn::Set(d, static_cast<T>(lattice_.edge)), zero = hn::Zero(d);
        // What is counted from in two parts: a difference of neighbouring numbers has no rounding error.
        const auto high = hn::Set(d, static_cast<T>(lattice_.counted_from));
        const auto low = hn::Set(
            d, static_cast<T>(lattice_.counted_from - static_cast<double>(static_cast<T>(lattice_.counted_from))));
        // Rows lie alike in all layers.
        std::ptrdiff_t rows[room];
        const auto row_begin = [&](std::int64_t row, std::int64_t layer) {
            return static_cast<std::ptrdiff_t>(
                field_.row(static_cast<std::size_t>(row), static_cast<std::size_t>(layer)) +
                static_cast<std::size_t>(i.first));
        };
        for (std::int64_t row = j.first; row < j.past; ++row) {
            rows[row - j.first] = row_begin(row, k.first);
        }
        const auto last_whole = static_cast<std::ptrdiff_t>(size) - room;
        // (Two sums, so that no addition waits for the one before. Rows beyond the support add 0.)
        auto all = zero, other = zero;
        for (std::int64_t layer = k.first; layer < k.past; ++layer) {
            const T of_layer = k.bells[layer - k.first];
            const std::ptrdiff_t farther = row_begin(j.first, layer) - rows[0];
            for (std::int64_t row = j.first; row < j.past; ++row) {
                const auto of_row = hn::Set(d, of_layer * j.bells[row - j.first]);
                const Value* from = samples + rows[row - j.first] + farther;
                const SampleRange kernels =
                    field_.kernels_of_row(static_cast<std::size_t>(row), static_cast<std::size_t>(layer));
                const bool whole = from - samples <= last_whole && kernels.begin <= i.first && i.past <= kernels.end;
                HWY_ALIGN T copy[room];
                if (!fits<Value> || HWY_UNLIKELY(!whole)) {
                    copy_row(from, i, kernels, copy);
                }
                for (int at = 0; at < room; at += narrow) {
                    const auto bell = hn::Mul(of_row, hn::Load(d, i.bells + at));
                    const auto t = hn::Max(hn::Sub(bell, edge), zero);
                    auto value = zero;
                    if constexpr (fits<Value>) {
                        value =
                            HWY_LIKELY(whole) ? hn::Sub(hn::Sub(load(from + at), high), low) : hn::Load(d, copy + at);
                    } else {
                        value = hn::Load(d, copy + at);
                    }
                    all = hn::MulAdd(t, value, all);
                }
                std::swap(all, other);
            }
        }
        return hn::GetLane(hn::SumOfLanes(d, hn::Add(all, other))) * static_cast<T>(lattice_.value_scale);
    }

    /// f - b of an axis' samples in a row; 0 where none is.
    template <class Value>
    HWY_NOINLINE void copy_row(const Value* from, const Axis& i, const SampleRange& kernels, T* copy) const {
        for (int at = 0; at < room; ++at) {
            const std::int64_t sample = i.first + at;
            const bool is_kernel = sample < i.past && sample >= kernels.begin && sample < kernels.end;
            copy[at] = is_kernel ? static_cast<T>(static_cast<double>(from[at]) - lattice_.counted_from) : T(0);
        }
    }

    const PointLattice& lattice_;
    const RegularField& field_;
    const std::array<std::size_t, 3>& shape_;
    Vec3 first_, step_; ///< in samples: column 0, and from column to column
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_POINT_SUMS_INL

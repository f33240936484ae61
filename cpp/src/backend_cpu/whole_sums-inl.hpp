// The sum of the kernels of all samples of a lattice at the pixels of a slice: it follows from the place in a cell, and
// from how far the ends are. Source: conventions, section 2.

#if defined(SHEETSPLAT_CPU_WHOLE_SUMS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_WHOLE_SUMS_INL
#undef SHEETSPLAT_CPU_WHOLE_SUMS_INL
#else
#define SHEETSPLAT_CPU_WHOLE_SUMS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "backend_cpu/lattice_reach.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// In the sheets' unit, at neighbouring pixels of a row: a vector of D.
template <class D>
class WholeSums {
  public:
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;

    /// lattice: kept by the caller.
    WholeSums(const WholeLattice& lattice, const TileShape& tile, std::int64_t n)
        : lattice_(lattice), terms_(static_cast<int>(std::ceil(2.0 * lattice.parts.front().radius()))) {
        for (const LatticeReach& part : lattice.parts) {
            places_.push_back(part.places(tile, n));
        }
    }

    /// Whether the label without a sheet may have a sum other than 0 at one of `count` pixels from (x, y) on.
    [[nodiscard]] HWY_INLINE bool are_near(int x, int y, int count) const {
        if (lattice_.reached == nullptr) {
            return true;
        }
        const LatticeReach::Places& places = places_.front();
        const double half = 0.5 * static_cast<double>(count - 1);
        const Vec3 away = half * glm::abs(places.by_column);
        return std::max({away.x, away.y, away.z}) > WholeLattice::more_reach ||
               lattice_.reached->reached(places.first + (static_cast<double>(x - 1) + half) * places.by_column +
                                         static_cast<double>(y - 1) * places.by_row);
    }

    /// From pixel (x, y) of a sheet on.
    [[nodiscard]] HWY_INLINE V at(int x, int y) const {
        const D d;
        V sum = hn::Zero(d);
        for (std::size_t part = 0; part < places_.size(); ++part) {
            const LatticeReach::Places& places = places_[part];
            const Vec3 first = places.first + static_cast<double>(x - 1) * places.by_column +
                               static_cast<double>(y - 1) * places.by_row;
            if (HWY_UNLIKELY(near_edges(lattice_.parts[part], first, places.by_column))) {
                sum = hn::Add(sum, one_by_one(lattice_.parts[part], first, places.by_column));
                continue;
            }
            // Of the usual kernels the number of terms is known when this is compiled.
            sum = hn::Add(sum, terms_ == 4 ? of_part(lattice_.parts[part], first, places.by_column,
                                                     std::integral_constant<int, 4>())
                                           : of_part(lattice_.parts[part], first, places.by_column, terms_));
        }
        return hn::Mul(sum, hn::Set(d, static_cast<T>(lattice_.scale)));
    }

  private:
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));
    static constexpr int room = WholeLattice::most_samples;

    /// The factors of the Gaussians of neighbouring samples along one axis, those that reach a place among them.
    struct Axis {
        V bells[room];

        template <class Terms>
        HWY_INLINE Axis(const WholeLattice& lattice, double at, double step, double radius, double last, Terms terms) {
            const D d;
            // Places are rounded once they are relative to a sample nearby.
            const double near = std::floor(at), span = static_cast<double>(lanes - 1) * step;
            const V place =
                hn::MulAdd(hn::Iota(d, T(0)), hn::Set(d, static_cast<T>(step)), hn::Set(d, static_cast<T>(at - near)));
            const V first = hn::Ceil(hn::Sub(place, hn::Set(d, static_cast<T>(radius))));
            const V far = hn::Sub(first, place), minus_k = hn::Set(d, static_cast<T>(-lattice.falloff_log2));
            for (int term = 0; term < terms; ++term) {
                const V off = hn::Add(far, hn::Set(d, static_cast<T>(term)));
                bells[term] = exp2_nonpositive(d, hn::Mul(minus_k, hn::Mul(off, off)));
            }
            if (HWY_LIKELY(at + std::min(span, 0.0) - radius >= 0.0 && at + std::max(span, 0.0) + radius <= last)) {
                return;
            }
            const V begin = hn::Set(d, static_cast<T>(-near)), end = hn::Set(d, static_cast<T>(last - near));
            for (int term = 0; term < terms; ++term) {
                const V sample = hn::Add(first, hn::Set(d, static_cast<T>(term)));
                const auto is_there = hn::And(hn::Ge(sample, begin), hn::Le(sample, end));
                bells[term] = hn::IfThenElseZero(is_there, bells[term]);
            }
        }
    };

    /// Whether samples may be missing that reach the pixels.
    [[nodiscard]] bool near_edges(const LatticeReach& part, const Vec3& at, const Vec3& step) const {
        int near = 0;
        for (int axis = 0; axis < 3 && lattice_.layers > 0.0; ++axis) {
            const double span = static_cast<double>(lanes - 1) * step[axis];
            const double least = at[axis] + std::min(span, 0.0) - part.radius();
            const double most = at[axis] + std::max(span, 0.0) + part.radius();
            near += least < lattice_.layers || most > part.last()[axis] - lattice_.layers ? 1 : 0;
        }
        return near > 1;
    }
    /// Sums that ask for each sample whether it is there. (Of Cartesian lattices: others lack none.)
    HWY_NOINLINE V one_by_one(const LatticeReach& part, const Vec3& first, const Vec3& step) const {
        HWY_ALIGN T sums[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            const Vec3 at = first + static_cast<double>(lane) * step;
            const Vec3 low = glm::max(glm::ceil(at - part.radius()), Vec3(0.0));
            const Vec3 high = glm::min(glm::floor(at + part.radius()), part.last());
            double sum = 0.0;
            for (double k = low.z; k <= high.z; k += 1.0) {
                for (double j = low.y; j <= high.y; j += 1.0) {
                    const SampleRange kernels =
                        lattice_.field->kernels_of_row(static_cast<std::size_t>(j), static_cast<std::size_t>(k));
                    const double end = std::min(high.x, static_cast<double>(kernels.end) - 1.0);
                    for (double i = std::max(low.x, static_cast<double>(kernels.begin)); i <= end; i += 1.0) {
                        const Vec3 off = Vec3(i, j, k) - at;
                        sum += std::max(std::exp2(-lattice_.falloff_log2 * glm::dot(off, off)) - lattice_.edge, 0.0);
                    }
                }
            }
            sums[lane] = static_cast<T>(sum);
        }
        return hn::Load(D(), sums);
    }

    template <class Terms>
    HWY_NOINLINE V of_part(const LatticeReach& part, const Vec3& at, const Vec3& step, Terms terms) const {
        const D d;
        const double radius = part.radius();
        const Axis i(lattice_, at.x, step.x, radius, part.last().x, terms);
        const Axis j(lattice_, at.y, step.y, radius, part.last().y, terms);
        const Axis k(lattice_, at.z, step.z, radius, part.last().z, terms);
        const V edge = hn::Set(d, static_cast<T>(lattice_.edge)), zero = hn::Zero(d);
        // (Two sums, so that no addition waits for the one before.)
        V all = zero, other = zero;
        for (int layer = 0; layer < terms; ++layer) {
            for (int row = 0; row < terms; ++row) {
                const V of_row = hn::Mul(k.bells[layer], j.bells[row]);
                for (int sample = 0; sample < terms; ++sample) {
                    V& sum = sample % 2 == 0 ? all : other;
                    sum = hn::Add(sum, hn::Max(hn::MulSub(of_row, i.bells[sample], edge), zero));
                }
            }
        }
        return hn::Add(all, other);
    }

    const WholeLattice& lattice_;
    const int terms_;
    std::vector<LatticeReach::Places> places_;
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_WHOLE_SUMS_INL

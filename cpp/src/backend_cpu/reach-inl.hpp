// The sheet of the points of a slice that count, where the places of samples alone say which do.

#if defined(SHEETSPLAT_CPU_REACH_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_REACH_INL
#undef SHEETSPLAT_CPU_REACH_INL
#else
#define SHEETSPLAT_CPU_REACH_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "backend_cpu/lattice_reach.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// 1 where the lattice reaches pixels of a row, else 0. at: index coordinates of the row's first pixel.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V reached_in_row(D d, const LatticeReach& lattice, const Vec3& at, const Vec3& by_column, V columns) {
    V distance2 = hn::Zero(d);
    for (int axis = 0; axis < 3; ++axis) {
        const V place = hn::MulAdd(columns, hn::Set(d, by_column[axis]), hn::Set(d, at[axis]));
        const V sample = hn::Min(hn::Max(hn::Round(place), hn::Zero(d)), hn::Set(d, lattice.last()[axis]));
        const V off = hn::Sub(place, sample);
        distance2 = hn::MulAdd(off, off, distance2);
    }
    const V radius2 = hn::Set(d, lattice.radius() * lattice.radius());
    return hn::IfThenElseZero(hn::Lt(distance2, radius2), hn::Set(d, 1.0));
}

/// Float64 numbers in the sheets' format.
template <class T, class D>
HWY_INLINE auto in_sheets([[maybe_unused]] D d, hn::Vec<D> numbers) {
    if constexpr (std::is_same_v<T, double>) {
        return numbers;
    } else {
        return hn::DemoteTo(hn::Rebind<T, D>(), numbers);
    }
}

/// Writes reached_in_row of `count` pixels from column x on to `marks`; `beside`: leaves those that are 1.
template <class T>
HWY_INLINE void mark_pixels(const LatticeReach& lattice, const Vec3& at, const Vec3& by_column, int x, int count,
                            bool beside, T* marks) {
    const hn::CappedTag<double, 8> d;
    const hn::Rebind<T, decltype(d)> d_marks;
    const int lanes = static_cast<int>(hn::Lanes(d));
    for (int number = 0; number < count; number += lanes) {
        auto mark =
            in_sheets<T>(d, reached_in_row(d, lattice, at, by_column, hn::Iota(d, static_cast<double>(x + number))));
        if (beside) {
            mark = hn::Max(mark, hn::LoadU(d_marks, marks + number));
        }
        hn::StoreU(mark, d_marks, marks + number);
    }
}

/// The same for the pixels of a sheet.
template <class T>
HWY_NOINLINE void mark_reached(const LatticeReach& lattice, const LatticeReach::Places& places, const TileShape& tile,
                               bool beside, T* sheet) {
    for (int y = 0; y < tile.height; ++y) {
        const Vec3 at = places.first + static_cast<double>(y) * places.by_row;
        mark_pixels(lattice, at, places.by_column, 0, tile.width, beside,
                    sheet + static_cast<std::ptrdiff_t>(y + 1) * tile.stride + 1);
    }
}

/// The same for pixels (x, y), (x + 1, y) ... of slice n, by any of the lattices. Where there is no slice nothing is
/// reached.
template <class T>
HWY_NOINLINE void mark_row(const std::vector<LatticeReach>& lattices, const TileShape& tile, std::int64_t n, int y,
                           int x, int count, T* marks) {
    std::fill(marks, marks + count, T(0));
    for (const LatticeReach& lattice : lattices) {
        if (!lattice.has_slice(n)) {
            return;
        }
        const LatticeReach::Places places = lattice.places(tile, n);
        mark_pixels(lattice, places.first + static_cast<double>(y) * places.by_row, places.by_column, x, count, true,
                    marks);
    }
}

/// Slices from `begin` up to `past`.
struct SliceRange {
    double begin, past;

    /// Leaves those where low <= at + n step <= high.
    void keep(double at, double step, double low, double high) {
        if (step == 0.0 || !(low <= high)) {
            past = low <= at && at <= high ? past : begin;
            return;
        }
        const double one = (low - at) / step, other = (high - at) / step;
        begin = std::max(begin, std::min(one, other));
        past = std::min(past, std::max(one, other));
    }
    /// In whole slices, `more` farther to both sides, of `slices`.
    void round(double more, std::int64_t slices) {
        begin = std::clamp(std::floor(begin) - more, 0.0, static_cast<double>(slices));
        past = std::clamp(std::ceil(past) + more, begin, static_cast<double>(slices));
    }
};

/// Writes, for each pixel of a tile of an orthographic picture, how many slices have a point there that a lattice
/// reaches. Most are between samples; only the others are looked at.
template <class T>
HWY_NOINLINE void count_reached(const std::vector<LatticeReach>& lattices, const TileShape& tile, std::int64_t slices,
                                T* counted) {
    const hn::CappedTag<double, 8> d;
    using V = hn::Vec<decltype(d)>;
    const int lanes = static_cast<int>(hn::Lanes(d));
    std::vector<LatticeReach::Places> places;
    places.reserve(static_cast<std::size_t>(slices) * lattices.size());
    for (std::int64_t n = 0; n < slices; ++n) {
        for (const LatticeReach& lattice : lattices) {
            places.push_back(lattice.places(tile, n));
        }
    }
    for (int y = 0; y < tile.height; ++y) {
        for (int x = 0; x < tile.width; x += lanes) {
            SliceRange some{static_cast<double>(slices), 0.0}, all{0.0, 0.0};
            for (std::size_t number = 0; number < lattices.size(); ++number) {
                const LatticeReach& lattice = lattices[number];
                const LatticeReach::Places& here = places[number];
                const Vec3 by_slice = lattice.places(tile, 1).first - here.first;
                const Vec3 at =
                    here.first + static_cast<double>(y) * here.by_row + static_cast<double>(x) * here.by_column;
                SliceRange near{0.0, static_cast<double>(slices)}, between = near;
                for (int axis = 0; axis < 3; ++axis) {
                    const double span = static_cast<double>(lanes - 1) * here.by_column[axis];
                    const double down = std::min(span, 0.0), up = std::max(span, 0.0), last = lattice.last()[axis];
                    near.keep(at[axis], by_slice[axis], -lattice.radius() - up, last + lattice.radius() - down);
                    between.keep(at[axis], by_slice[axis], -down, last - up);
                }
                near.round(1.0, slices);
                between.round(-1.0, slices);
                some = {std::min(some.begin, near.begin), std::max(some.past, near.past)};
                if (!lattice.has_gaps() && between.past - between.begin > all.past - all.begin) {
                    all = between;
                }
            }
            if (!(all.begin < all.past)) {
                all = {some.past, some.past};
            }
            V count = hn::Set(d, all.past - all.begin);
            const auto look = [&](double begin, double past) {
                for (auto n = static_cast<std::size_t>(begin); n < static_cast<std::size_t>(past); ++n) {
                    V any = hn::Zero(d);
                    for (std::size_t number = 0; number < lattices.size(); ++number) {
                        const LatticeReach::Places& there = places[n * lattices.size() + number];
                        const Vec3 at = there.first + static_cast<double>(y) * there.by_row;
                        any = hn::Max(any, reached_in_row(d, lattices[number], at, there.by_column,
                                                          hn::Iota(d, static_cast<double>(x))));
                    }
                    count = hn::Add(count, any);
                }
            };
            look(some.begin, all.begin);
            look(all.past, some.past);
            hn::StoreU(in_sheets<T>(d, count), hn::Rebind<T, decltype(d)>(),
                       counted + static_cast<std::ptrdiff_t>(y) * tile.stride + x);
        }
    }
}

/// Sheets of ones and zeros.
template <class T>
class ReachSheets {
  public:
    /// Room for two sheets is taken from the scratch memory as soon as a slice is asked for.
    ReachSheets(const std::vector<LatticeReach>& lattices, const TileShape& tile, TileScratch<T>& scratch)
        : lattices_(lattices), tile_(tile), scratch_(scratch) {}

    /// Which points of slice n are reached, until it is asked for another one; null: none.
    [[nodiscard]] const T* of(std::int64_t n) {
        using Pixels = LatticeReach::Pixels;
        const std::size_t elements = tile_.sheet_elements();
        if (scratch_.ones.size() < elements) {
            scratch_.ones.assign(elements, T(1));
        }
        if (scratch_.reached.size() < elements) {
            scratch_.reached.assign(elements, T(0));
        }
        bool any = false;
        for (const LatticeReach& lattice : lattices_) {
            const LatticeReach::Places places = lattice.places(tile_, n);
            const Pixels pixels = lattice.pixels(tile_, places);
            if (pixels == Pixels::all) {
                return scratch_.ones.data();
            }
            if (pixels == Pixels::some) {
                mark_reached(lattice, places, tile_, any, scratch_.reached.data());
                any = true;
            }
        }
        return any ? scratch_.reached.data() : nullptr;
    }

  private:
    const std::vector<LatticeReach>& lattices_;
    const TileShape& tile_;
    TileScratch<T>& scratch_;
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_REACH_INL

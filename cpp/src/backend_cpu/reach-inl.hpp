// The sheet of the points of a slice that count, where the places of samples alone say which do.

#if defined(SHEETSPLAT_CPU_REACH_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_REACH_INL
#undef SHEETSPLAT_CPU_REACH_INL
#else
#define SHEETSPLAT_CPU_REACH_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "backend_cpu/lattice_reach.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Sets the pixels of a sheet to 1 where the lattice reaches them, else to 0; `beside`: leaves those that are 1.
template <class T>
HWY_NOINLINE void mark_reached(const LatticeReach& lattice, const LatticeReach::Places& places, const TileShape& tile,
                               bool beside, T* sheet) {
    const hn::CappedTag<double, 8> d;
    using V = hn::Vec<decltype(d)>;
    const hn::Rebind<T, decltype(d)> d_sheet;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const V zero = hn::Zero(d), one = hn::Set(d, 1.0);
    const V radius2 = hn::Set(d, lattice.radius() * lattice.radius());
    for (int y = 0; y < tile.height; ++y) {
        const Vec3 at = places.first + static_cast<double>(y) * places.by_row;
        T* row = sheet + static_cast<std::ptrdiff_t>(y + 1) * tile.stride + 1;
        for (int x = 0; x < tile.width; x += lanes) {
            const V column = hn::Iota(d, static_cast<double>(x));
            V distance2 = zero;
            for (int axis = 0; axis < 3; ++axis) {
                const V place = hn::MulAdd(column, hn::Set(d, places.by_column[axis]), hn::Set(d, at[axis]));
                const V sample = hn::Min(hn::Max(hn::Round(place), zero), hn::Set(d, lattice.last()[axis]));
                const V off = hn::Sub(place, sample);
                distance2 = hn::MulAdd(off, off, distance2);
            }
            const V reached = hn::IfThenElseZero(hn::Lt(distance2, radius2), one);
            auto mark = [&] {
                if constexpr (std::is_same_v<T, double>) {
                    return reached;
                } else {
                    return hn::DemoteTo(d_sheet, reached);
                }
            }();
            if (beside) {
                mark = hn::Max(mark, hn::LoadU(d_sheet, row + x));
            }
            hn::StoreU(mark, d_sheet, row + x);
        }
    }
}

/// Sheets of ones and zeros.
template <class T>
class ReachSheets {
  public:
    /// Room for two sheets is taken from the scratch memory where there are lattices.
    ReachSheets(const std::vector<LatticeReach>& lattices, const TileShape& tile, TileScratch<T>& scratch)
        : lattices_(lattices), tile_(tile) {
        if (lattices.empty()) {
            return;
        }
        const std::size_t elements = tile.sheet_elements();
        if (scratch.ones.size() < elements) {
            scratch.ones.assign(elements, T(1));
        }
        if (scratch.reached.size() < elements) {
            scratch.reached.assign(elements, T(0));
        }
        ones_ = scratch.ones.data();
        reached_ = scratch.reached.data();
    }

    /// Which points of slice n are reached, until it is asked for another one; null: none.
    [[nodiscard]] const T* of(std::int64_t n) {
        using Pixels = LatticeReach::Pixels;
        bool any = false;
        for (const LatticeReach& lattice : lattices_) {
            const LatticeReach::Places places = lattice.places(tile_, n);
            const Pixels pixels = lattice.pixels(tile_, places);
            if (pixels == Pixels::all) {
                return ones_;
            }
            if (pixels == Pixels::some) {
                mark_reached(lattice, places, tile_, any, reached_);
                any = true;
            }
        }
        return any ? reached_ : nullptr;
    }

  private:
    const std::vector<LatticeReach>& lattices_;
    const TileShape& tile_;
    const T* ones_ = nullptr;
    T* reached_ = nullptr;
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_REACH_INL

// The transfer function of a vector of values, and the correction of its opacities for the slice distance.
// Source: conventions, section 4.

#if defined(SHEETSPLAT_CPU_TRANSFER_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_TRANSFER_INL
#undef SHEETSPLAT_CPU_TRANSFER_INL
#else
#define SHEETSPLAT_CPU_TRANSFER_INL
#endif

#include <cstddef>
#include <cstdint>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class D>
struct Color {
    hn::Vec<D> red, green, blue;
};

/// Colour and opacity of one vector of values from a table in registers, one stretch a lane.
template <class D>
class TableInLanes {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;
    using DI = hn::RebindToSigned<D>;
    using TI = hn::TFromD<DI>;

  public:
    explicit TableInLanes(const TransferTable<T>& table) : table_(table) {}

    struct Place {
        decltype(hn::IndicesFromVec(D(), hn::Zero(DI()))) stretch;
        V beyond; ///< how far beyond the stretch's start
    };

    /// Opacity per reference length.
    HWY_INLINE V opacity(D d, V rho, Place& place) const {
        const DI di;
        auto stretch = hn::Zero(di);
        for (int n = 1; n < table_.stretches; ++n) {
            const auto there = hn::Ge(rho, hn::Set(d, table_.lanes[0][n]));
            stretch = hn::IfThenElse(hn::RebindMask(di, there), hn::Set(di, static_cast<TI>(n)), stretch);
        }
        place.stretch = hn::IndicesFromVec(d, stretch);
        place.beyond = hn::Max(hn::Sub(rho, look_up(d, 0, place)), hn::Zero(d));
        return hn::Min(hn::Max(linear(d, 2, place), hn::Zero(d)), hn::Set(d, T(1)));
    }
    HWY_INLINE Color<D> color(D d, const Place& place) const {
        return {linear(d, 4, place), linear(d, 6, place), linear(d, 8, place)};
    }

  private:
    HWY_INLINE V look_up(D d, int number, const Place& place) const {
        return hn::TableLookupLanes(hn::LoadU(d, table_.lanes[number]), place.stretch);
    }
    HWY_INLINE V linear(D d, int number, const Place& place) const {
        return hn::MulAdd(place.beyond, look_up(d, number + 1, place), look_up(d, number, place));
    }

    const TransferTable<T>& table_;
};

/// A register whose blocks of 16 bytes come from where `offsets` of the first lane of each block says.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE hn::Vec<D> load_blocks(D d, const T* table, const std::int32_t* offsets) {
#if HWY_TARGET == HWY_SCALAR
    return hn::Load(d, table + offsets[0]);
#else
    if constexpr (hn::MaxLanes(D()) * sizeof(T) <= 16) {
        return hn::LoadU(d, table + offsets[0]);
    } else {
        const hn::Half<D> half;
        return hn::Combine(d, load_blocks(half, table, offsets + hn::MaxLanes(D()) / 2),
                           load_blocks(half, table, offsets));
    }
#endif
}

/// Four consecutive numbers of each lane's record.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void load_four(D d, const T* table, const std::int32_t* offsets, V& a, V& b, V& c, V& e) {
#if HWY_TARGET == HWY_SCALAR
    a = load_blocks(d, table, offsets);
    b = load_blocks(d, table + 1, offsets);
    c = load_blocks(d, table + 2, offsets);
    e = load_blocks(d, table + 3, offsets);
#else
    const V first = load_blocks(d, table, offsets), second = load_blocks(d, table, offsets + 1);
    if constexpr (sizeof(T) == 8) {
        a = hn::InterleaveLower(d, first, second);
        b = hn::InterleaveUpper(d, first, second);
        const V first_on = load_blocks(d, table + 2, offsets), second_on = load_blocks(d, table + 2, offsets + 1);
        c = hn::InterleaveLower(d, first_on, second_on);
        e = hn::InterleaveUpper(d, first_on, second_on);
    } else {
        const hn::RepartitionToWide<hn::RebindToUnsigned<D>> wide;
        const V third = load_blocks(d, table, offsets + 2), fourth = load_blocks(d, table, offsets + 3);
        const auto low = hn::BitCast(wide, hn::InterleaveLower(d, first, second));
        const auto low_on = hn::BitCast(wide, hn::InterleaveLower(d, third, fourth));
        const auto high = hn::BitCast(wide, hn::InterleaveUpper(d, first, second));
        const auto high_on = hn::BitCast(wide, hn::InterleaveUpper(d, third, fourth));
        a = hn::BitCast(d, hn::InterleaveLower(wide, low, low_on));
        b = hn::BitCast(d, hn::InterleaveUpper(wide, low, low_on));
        c = hn::BitCast(d, hn::InterleaveLower(wide, high, high_on));
        e = hn::BitCast(d, hn::InterleaveUpper(wide, high, high_on));
    }
#endif
}

/// Records of one vector of values, one a lane.
template <class D>
struct LaneRecords {
    HWY_ALIGN std::int32_t at[hn::MaxLanes(D())];
};

/// A record at or before the stretch that each value is in, from which the search starts.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void look_in_cells(D d, const Cells<T>& cells, V rho, LaneRecords<D>& records) {
    const hn::Rebind<std::int32_t, D> di;
    constexpr std::size_t lanes = hn::MaxLanes(D());
    const V inside = hn::Min(hn::Max(rho, hn::Set(d, cells.first)), hn::Set(d, cells.last));
    const V among = hn::Min(hn::Mul(hn::Sub(inside, hn::Set(d, cells.first)), hn::Set(d, cells.per_unit)),
                            hn::Set(d, cells.last_cell));
    // (Values beyond the last start are many where a picture is saturated.)
    const V beyond = hn::Set(d, cells.last_cell + T(1));
    const V cell = hn::IfThenElse(hn::Ge(rho, hn::Set(d, cells.last)), beyond, among);
    HWY_ALIGN std::int32_t numbers[lanes];
    if constexpr (sizeof(T) == 4) {
        hn::StoreU(hn::ConvertTo(di, cell), di, numbers);
    } else {
        hn::StoreU(hn::DemoteTo(di, cell), di, numbers);
    }
    for (std::size_t lane = 0; lane < lanes; ++lane) {
        records.at[lane] = cells.records[static_cast<std::size_t>(numbers[lane])];
    }
}

/// Continues the search to the stretch that each value is in, since stretches may end inside a cell. The second number
/// of a record, of `size` numbers, is where its stretch ends; last: the record of the last stretch, which has no end.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_NOINLINE void find_onwards(D d, const T* table, std::int32_t size, std::int32_t last, V rho,
                               LaneRecords<D>& records) {
    constexpr std::size_t lanes = hn::MaxLanes(D());
    HWY_ALIGN T values[lanes];
    hn::StoreU(rho, d, values);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
        // In growing steps, then back in falling ones: a cell may hold many stretches.
        std::int32_t at = records.at[lane], step = size;
        const auto past_end = [&](std::int32_t record) { return values[lane] >= table[record + 1]; };
        if (!past_end(at)) {
            continue;
        }
        while (at + step <= last && past_end(at + step)) {
            at += step;
            step *= 2;
        }
        for (; step >= size; step /= 2) {
            if (at + step <= last && past_end(at + step)) {
                at += step;
            }
        }
        records.at[lane] = at + size;
    }
}

/// Colour and opacity of one vector of values from records in memory, found through cells.
template <class D>
class TableInMemory {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;

  public:
    explicit TableInMemory(const TransferTable<T>& table) : table_(table) {}

    struct Place {
        LaneRecords<D> records;
        V beyond;
    };

    HWY_INLINE V opacity(D d, V rho, Place& place) const {
        const T* records = table_.records.data();
        look_in_cells(d, table_.cells, rho, place.records);
        V from, to, opacity, slope;
        load_four(d, records, place.records.at, from, to, opacity, slope);
        if (HWY_UNLIKELY(!hn::AllFalse(d, hn::Ge(rho, to)))) {
            find_onwards(d, records, TransferTable<T>::record, table_.cells.records.back(), rho, place.records);
            load_four(d, records, place.records.at, from, to, opacity, slope);
        }
        place.beyond = hn::Max(hn::Sub(rho, from), hn::Zero(d));
        return hn::Min(hn::Max(hn::MulAdd(place.beyond, slope, opacity), hn::Zero(d)), hn::Set(d, T(1)));
    }
    HWY_INLINE Color<D> color(D d, const Place& place) const {
        V red, red_slope, green, green_slope, blue, blue_slope, none, none_slope;
        load_four(d, table_.records.data() + 4, place.records.at, red, red_slope, green, green_slope);
        load_four(d, table_.records.data() + 8, place.records.at, blue, blue_slope, none, none_slope);
        return {hn::MulAdd(place.beyond, red_slope, red), hn::MulAdd(place.beyond, green_slope, green),
                hn::MulAdd(place.beyond, blue_slope, blue)};
    }

  private:
    const TransferTable<T>& table_;
};

/// The opacity correction for the slice distance: 1 - (1 - a)^exponent of an opacity a per reference length, 0 to 1;
/// exponent: reference lengths between two slices along the pixel's ray.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V corrected_opacity(D d, V a, V exponent) {
    const V one = hn::Set(d, hn::TFromD<D>(1));
    const auto below_one = hn::Lt(a, one);
    const V alpha = opacity_of_absorption(d, hn::Mul(exponent, absorption(d, hn::IfThenElseZero(below_one, a))));
    return hn::IfThenElse(below_one, alpha, one);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_TRANSFER_INL

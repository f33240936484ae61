// The resolve pass: rho of a finished slice from its sums, by the weights of each field. Source: conventions
// section 2.

#if defined(SHEETSPLAT_CPU_RESOLVE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_RESOLVE_INL
#undef SHEETSPLAT_CPU_RESOLVE_INL
#else
#define SHEETSPLAT_CPU_RESOLVE_INL
#endif

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "sheet_ring-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// A row of the derivatives of rho, in the place of those of the sums of the fields that share sheets; while the
/// sums themselves are still there.
template <class T>
void divide_slopes(const GroupSheets<T>& group, const SheetRing<T>& ring, std::int64_t n, std::ptrdiff_t row,
                   const Rect& rect) {
    const hn::CappedTag<T, 16> d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    for (int x = rect.x0; x < rect.x1; x += lanes) {
        const std::ptrdiff_t at = row + x;
        const auto load = [&](int channel) { return hn::LoadU(d, ring.plane(n, channel) + at); };
        // With values counted from p: (D' W - D W') / W^2 where W > w0, else (D' + p W') / w0.
        const auto quotient = [&](int value, int weight, int slope, int weight_slope, T w0, T pivot) {
            const auto least = hn::Set(d, w0), w = load(weight);
            const auto per_divisor = hn::Div(hn::Set(d, T(1)), hn::Max(least, w));
            const auto rho =
                hn::IfThenElse(hn::Gt(w, least), hn::Mul(load(value), per_divisor), hn::Neg(hn::Set(d, pivot)));
            return hn::Mul(hn::NegMulAdd(rho, load(weight_slope), load(slope)), per_divisor);
        };
        for (int axis = 0; axis < 3; ++axis) {
            auto sum = group.threshold ? quotient(group.rho_channel, group.weight_channel, group.slope_channel + axis,
                                                  group.weight_slope_channel + axis, group.w0, group.pivot)
                                       : load(group.slope_channel + axis);
            for (const OwnSheets<T>& own : group.own) {
                sum = hn::Add(sum, quotient(own.value_channel, own.weight_channel, own.slope_channel + axis,
                                            own.weight_slope_channel + axis, own.w0, own.pivot));
            }
            hn::StoreU(sum, d, ring.plane(n, group.slope_channel + axis) + at);
        }
    }
}

/// rho of a group in a slice, in the place of the sums of the fields that share sheets; W of all in its own channel.
template <class T>
void divide_group(const GroupSheets<T>& group, bool keep_weight, const SheetRing<T>& ring, const TileShape& shape,
                  std::int64_t n, const Rect& rect) {
    const hn::CappedTag<T, 16> d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    if (!group.threshold && group.own.empty()) {
        return;
    }
    // D / max(w0, W); of values counted from p, p more for each W up to w0.
    const auto quotient = [&](auto value, auto weight, T w0, T pivot) {
        const auto least = hn::Set(d, w0);
        const auto ratio = hn::Div(value, hn::Max(least, weight));
        if (pivot == T(0)) {
            return ratio;
        }
        return hn::MulAdd(hn::Set(d, pivot), hn::Div(hn::Min(weight, least), least), ratio);
    };
    for (int y = rect.y0; y < rect.y1; ++y) {
        const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape.stride;
        T* rho = ring.plane(n, group.rho_channel) + at;
        T* weight = group.weight_channel >= 0 ? ring.plane(n, group.weight_channel) + at : nullptr;
        if (group.slope_channel >= 0) {
            divide_slopes(group, ring, n, at, rect);
        }
        for (int x = rect.x0; x < rect.x1; x += lanes) {
            auto sum = hn::LoadU(d, rho + x);
            const auto plain_weight = keep_weight ? hn::LoadU(d, weight + x) : hn::Zero(d);
            auto all_weight = plain_weight;
            auto reached = hn::Gt(plain_weight, hn::Zero(d));
            if (group.threshold) {
                sum = quotient(sum, hn::LoadU(d, weight + x), group.w0, group.pivot);
            }
            for (const OwnSheets<T>& own : group.own) {
                const auto own_weight = hn::LoadU(d, ring.plane(n, own.weight_channel) + at + x);
                const auto value = hn::LoadU(d, ring.plane(n, own.value_channel) + at + x);
                sum = hn::Add(sum, quotient(value, own_weight, own.w0, own.pivot));
                all_weight = hn::Add(all_weight, own_weight);
                const auto counts = hn::Ge(own_weight, hn::Set(d, own.least_weight));
                reached = hn::Or(reached, hn::And(counts, hn::Gt(own_weight, hn::Zero(d))));
            }
            // Below 0 where each field is empty, though some have weights: coverage counts those.
            if (keep_weight && !group.own.empty()) {
                hn::StoreU(hn::IfThenElse(reached, all_weight, hn::Neg(all_weight)), d, weight + x);
            }
            hn::StoreU(sum, d, rho + x);
        }
    }
}

/// The two largest weights of labels in a vector of pixels.
template <class D>
struct LargestLabels {
    hn::Vec<D> largest, second;
    hn::Vec<D> first, next; ///< whose they are, where slopes are summed; -1: of none

    HWY_INLINE explicit LargestLabels(D d)
        : largest(hn::Zero(d)), second(largest), first(hn::Set(d, hn::TFromD<D>(-1))), next(first) {}
    template <bool slopes>
    HWY_INLINE void look_at(D d, hn::Vec<D> own, hn::TFromD<D> label) {
        if constexpr (slopes) {
            const auto number = hn::Set(d, label);
            const auto leads = hn::Gt(own, largest), follows = hn::Gt(own, second);
            next = hn::IfThenElse(leads, first, hn::IfThenElse(follows, number, next));
            first = hn::IfThenElse(leads, number, first);
        }
        second = hn::Max(second, hn::Min(own, largest));
        largest = hn::Max(largest, own);
    }
};

/// The derivatives of what labels are above the largest other one, in place of those of their weights.
template <class D, class T>
HWY_NOINLINE void compare_slopes(D d, const LoopSetup<T>& setup, const GroupRange& groups, const SheetRing<T>& ring,
                                 std::int64_t n, std::ptrdiff_t at, const LargestLabels<D>& found) {
    const auto count = static_cast<T>(groups.last - groups.first);
    for (int axis = 0; axis < 3; ++axis) {
        const auto slope = [&](T label) {
            const GroupSheets<T>& group = setup.groups[groups.first + static_cast<std::size_t>(label)];
            return ring.plane(n, group.slope_channel + axis) + at;
        };
        auto of_first = hn::Zero(d), of_next = hn::Zero(d);
        for (T label = 0; label < count; label += T(1)) {
            const auto own = hn::LoadU(d, slope(label));
            of_first = hn::IfThenElse(hn::Eq(found.first, hn::Set(d, label)), own, of_first);
            of_next = hn::IfThenElse(hn::Eq(found.next, hn::Set(d, label)), own, of_next);
        }
        for (T label = 0; label < count; label += T(1)) {
            const auto other = hn::IfThenElse(hn::Eq(found.first, hn::Set(d, label)), of_next, of_first);
            hn::StoreU(hn::Sub(hn::LoadU(d, slope(label)), other), d, slope(label));
        }
    }
}

/// Writes what labels are above the largest other one, in place of their weights, to a vector of pixels of their
/// sheets; and what labels without a sheet are.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE void put_above(D d, const LargestLabels<D>& found, const std::vector<T*>& sheets, std::ptrdiff_t at,
                          T* of_absent) {
    const auto zero = hn::Zero(d), absent = hn::Set(d, T(-1e-12));
    for (T* const sheet : sheets) {
        const auto own = hn::LoadU(d, sheet + at);
        // (Of two that are alike each is 0 above the other.)
        const auto other = hn::IfThenElse(hn::Ge(own, found.largest), found.second, found.largest);
        const auto above = hn::Sub(own, other);
        hn::StoreU(hn::IfThenElse(hn::Gt(own, zero), above, hn::Min(above, absent)), d, sheet + at);
    }
    hn::StoreU(hn::Min(hn::Neg(found.largest), absent), d, of_absent + at);
}

/// Of groups that hold the weights of labels, what each is above the largest other one. Where a label has no weight it
/// is below 0, so that no point shows what is not there. Unless slopes are summed, those of a set that were not drawn
/// to on the slice share one sheet. sheets: room for those that were.
template <bool slopes, class T>
HWY_NOINLINE void compare_labels(const LoopSetup<T>& setup, std::size_t number, SheetRing<T>& ring,
                                 const TileShape& shape, std::int64_t n, std::vector<T*>& sheets) {
    using D = hn::CappedTag<T, 16>;
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const LabelSet& set = setup.label_sets[number];
    Rect rect;
    for (std::size_t group = set.groups.first; group < set.groups.last; ++group) {
        rect.add(ring.touched(n, group));
    }
    if (rect.empty()) {
        return;
    }
    sheets.clear();
    for (std::size_t group = set.groups.first; group < set.groups.last; ++group) {
        if (slopes || !ring.touched(n, group).empty()) {
            sheets.push_back(ring.plane(n, setup.groups[group].rho_channel));
            ring.write(n, rect, group);
        }
    }
    ring.write_set(n, rect, number);
    T* const of_absent = ring.plane(n, set.absent_channel);
    T* const* const own_sheets = sheets.data();
    const std::size_t count = sheets.size();
    for (int y = rect.y0; y < rect.y1; ++y) {
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * shape.stride;
        for (int x = rect.x0; x < rect.x1; x += lanes) {
            const std::ptrdiff_t at = row + x;
            LargestLabels<D> found(d);
            for (std::size_t label = 0; label < count; ++label) {
                found.template look_at<slopes>(d, hn::LoadU(d, own_sheets[label] + at), static_cast<T>(label));
            }
            if constexpr (slopes) {
                compare_slopes(D(), setup, set.groups, ring, n, at, found);
            }
            put_above(d, found, sheets, at, of_absent);
        }
    }
}

/// sheets: room.
template <class T>
void divide(const LoopSetup<T>& setup, SheetRing<T>& ring, const TileShape& shape, std::int64_t n,
            std::vector<T*>& sheets) {
    for (std::size_t group = 0; group < setup.groups.size(); ++group) {
        divide_group(setup.groups[group], setup.keep_weight, ring, shape, n, ring.touched(n, group));
    }
    for (std::size_t set = 0; set < setup.label_sets.size(); ++set) {
        if (setup.label_sets[set].whole) {
            continue; // LabelRests
        }
        setup.slopes ? compare_labels<true>(setup, set, ring, shape, n, sheets)
                     : compare_labels<false>(setup, set, ring, shape, n, sheets);
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RESOLVE_INL

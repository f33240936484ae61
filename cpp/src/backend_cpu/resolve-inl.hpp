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

/// Of groups that hold the weights of labels, what each is above the largest other one, and its derivatives. Where a
/// label has no weight it is below 0, so that no point shows what is not there.
template <class T>
HWY_NOINLINE void compare_labels(const LoopSetup<T>& setup, const GroupRange& set, const SheetRing<T>& ring,
                                 const TileShape& shape, std::int64_t n, const Rect& rect) {
    const hn::CappedTag<T, 16> d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto zero = hn::Zero(d), absent = hn::Set(d, T(-1e-12));
    const auto count = static_cast<T>(set.last - set.first);
    const auto sheet = [&](std::size_t group, std::ptrdiff_t at) {
        return ring.plane(n, setup.groups[group].rho_channel) + at;
    };
    for (int y = rect.y0; y < rect.y1; ++y) {
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * shape.stride;
        for (int x = rect.x0; x < rect.x1; x += lanes) {
            const std::ptrdiff_t at = row + x;
            auto largest = zero, second = zero, first = hn::Set(d, T(-1)), next = first;
            for (T label = 0; label < count; label += T(1)) {
                const auto number = hn::Set(d, label);
                const auto own = hn::LoadU(d, sheet(set.first + static_cast<std::size_t>(label), at));
                const auto leads = hn::Gt(own, largest), follows = hn::Gt(own, second);
                next = hn::IfThenElse(leads, first, hn::IfThenElse(follows, number, next));
                second = hn::IfThenElse(leads, largest, hn::IfThenElse(follows, own, second));
                first = hn::IfThenElse(leads, number, first);
                largest = hn::IfThenElse(leads, own, largest);
            }
            for (int axis = 0; axis < 3 && setup.slopes; ++axis) {
                const auto slope = [&](std::size_t group) {
                    return ring.plane(n, setup.groups[group].slope_channel + axis) + at;
                };
                auto of_first = zero, of_next = zero;
                for (T label = 0; label < count; label += T(1)) {
                    const auto own = hn::LoadU(d, slope(set.first + static_cast<std::size_t>(label)));
                    of_first = hn::IfThenElse(hn::Eq(first, hn::Set(d, label)), own, of_first);
                    of_next = hn::IfThenElse(hn::Eq(next, hn::Set(d, label)), own, of_next);
                }
                for (T label = 0; label < count; label += T(1)) {
                    T* own = slope(set.first + static_cast<std::size_t>(label));
                    const auto other = hn::IfThenElse(hn::Eq(first, hn::Set(d, label)), of_next, of_first);
                    hn::StoreU(hn::Sub(hn::LoadU(d, own), other), d, own);
                }
            }
            for (T label = 0; label < count; label += T(1)) {
                T* place = sheet(set.first + static_cast<std::size_t>(label), at);
                const auto own = hn::LoadU(d, place);
                const auto other = hn::IfThenElse(hn::Eq(first, hn::Set(d, label)), second, largest);
                const auto above = hn::Sub(own, other);
                hn::StoreU(hn::IfThenElse(hn::Gt(own, zero), above, hn::Min(above, absent)), d, place);
            }
        }
    }
}

template <class T>
void divide(const LoopSetup<T>& setup, const SheetRing<T>& ring, const TileShape& shape, std::int64_t n,
            const Rect& rect) {
    for (const GroupSheets<T>& group : setup.groups) {
        divide_group(group, setup.keep_weight, ring, shape, n, rect);
    }
    for (const GroupRange& set : setup.label_sets) {
        compare_labels(setup, set, ring, shape, n, rect);
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_RESOLVE_INL

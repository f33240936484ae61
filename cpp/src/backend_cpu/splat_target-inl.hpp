// What kernels are added to, the sheets of a few slices of a tile, and how a vector of pixels is added.

#if defined(SHEETSPLAT_CPU_SPLAT_TARGET_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_TARGET_INL
#undef SHEETSPLAT_CPU_SPLAT_TARGET_INL
#else
#define SHEETSPLAT_CPU_SPLAT_TARGET_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "live-inl.hpp"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// What kernels add to sheets.
enum class Sums {
    values,  ///< the sum of m f g
    weights, ///< beside it that of m g
    pairs,   ///< and beside both that of m f g of another field's values, without derivatives
};

/// What a kernel adds to sheets, times its profile.
template <class T>
struct Amounts {
    T value, weight;
    T other; ///< of the other field's values
};

/// The sheets of one slice that a part adds to.
template <class T>
struct Target {
    T* value;
    T* weight; ///< null: not summed
    T* other;  ///< null: not summed
    int stride;
    /// Of derivatives of both over columns, rows and slices: three sheets each, one after the other. Null: not summed.
    T* slope;
    T* weight_slope;
    std::size_t sheet; ///< elements from one sheet to the next
};

/// A pixel coordinate, clamped to low ... high before it is converted.
template <class T>
HWY_INLINE int whole(T at, int low, int high) {
    return static_cast<int>(std::min(std::max(at, static_cast<T>(low)), static_cast<T>(high)));
}

/// Amounts in vectors.
template <class D>
struct Shares {
    hn::Vec<D> value, weight, other;
    HWY_INLINE Shares(D d, const Amounts<hn::TFromD<D>>& amounts)
        : value(hn::Set(d, amounts.value)), weight(hn::Set(d, amounts.weight)), other(hn::Set(d, amounts.other)) {}
};

/// Where a vector of pixels is in the sheets that are summed.
template <Sums sums, class T>
struct Pixels {
    T* values;
    T* weights = nullptr;
    T* others = nullptr;

    Pixels() = default;
    HWY_INLINE Pixels(const Target<T>& to, std::ptrdiff_t at) : values(to.value + at) {
        if constexpr (sums != Sums::values) {
            weights = to.weight + at;
        }
        if constexpr (sums == Sums::pairs) {
            others = to.other + at;
        }
    }
    [[nodiscard]] HWY_INLINE Pixels further(std::ptrdiff_t by) const {
        Pixels moved = *this;
        moved.values += by;
        if constexpr (sums != Sums::values) {
            moved.weights += by;
        }
        if constexpr (sums == Sums::pairs) {
            moved.others += by;
        }
        return moved;
    }
};

/// Adds t = max(0, bell - edge) times a kernel's shares to a vector of pixels.
template <Sums sums, class D, class V = hn::Vec<D>>
HWY_INLINE void add_bell(D d, V bell_less_edge, const Shares<D>& shares, const Pixels<sums, hn::TFromD<D>>& to) {
    const V t = hn::Max(bell_less_edge, hn::Zero(d));
    hn::StoreU(hn::MulAdd(shares.value, t, hn::LoadU(d, to.values)), d, to.values);
    if constexpr (sums != Sums::values) {
        hn::StoreU(hn::MulAdd(shares.weight, t, hn::LoadU(d, to.weights)), d, to.weights);
    }
    if constexpr (sums == Sums::pairs) {
        hn::StoreU(hn::MulAdd(shares.other, t, hn::LoadU(d, to.others)), d, to.others);
    }
}

/// Half the derivative of r^2 over columns, rows and slices, times a kernel's steepness (Steepness::scale).
template <class D>
struct Slope {
    hn::Vec<D> column, row, slice;
};

/// What the derivatives of a kernel's Gaussian are multiplied by.
template <Sums sums, class T>
struct Steepness {
    T scale; ///< where weights are summed, by weight, else by value
    T ratio; ///< of value to weight; of Sums::weights

    HWY_INLINE Steepness(T steep, const Amounts<T>& of)
        : scale(steep * (sums == Sums::values ? of.value : of.weight)),
          ratio(sums == Sums::weights ? of.value / of.weight : T(0)) {}
};

/// Adds bell times slope to sheets of derivatives, at element `at`: to those of values times `per_weight` where there
/// are those of weights too (Steepness::ratio).
template <Sums sums, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE void add_slope(D d, V bell, const Slope<D>& slope, T per_weight, const Target<T>& to, std::ptrdiff_t at) {
    const V slopes[3] = {slope.column, slope.row, slope.slice};
    const auto add = [&](V much, T* sheets) {
        for (const V& one : slopes) {
            hn::StoreU(hn::MulAdd(much, one, hn::LoadU(d, sheets + at)), d, sheets + at);
            sheets += to.sheet;
        }
    };
    if constexpr (sums == Sums::values) {
        add(bell, to.slope);
    } else {
        add(hn::Mul(bell, hn::Set(d, per_weight)), to.slope);
        add(bell, to.weight_slope);
    }
}

/// The Gaussian inside its support, else 0.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V inside_support(D d, V bell, V edge) {
    (void)d;
    return hn::IfThenElseZero(hn::Gt(bell, edge), bell);
}

/// Where vectors start so that none straddles a line of the cache, which costs several times as much: at x0 or a little
/// before it. Rows of sheets start at whole lines.
template <class T>
HWY_INLINE int start_of(int x0, int x1, int lanes) {
    constexpr int line = 64 / static_cast<int>(sizeof(T));
    const int in_line = x0 & (line - 1);
    if (x1 - x0 <= lanes && in_line + (x1 - x0) <= line) {
        return std::min(x0, x0 - in_line + line - lanes);
    }
    return x0 & ~(lanes - 1);
}

/// The narrowest vectors that hold a row of `width` pixels: wider ones cost more where they are made of two halves.
/// Calls use(d) with them.
template <class T, class Use>
HWY_INLINE void in_narrowest(int width, const Use& use) {
    if (width <= 4) {
        use(hn::CappedTag<T, 4>());
    } else if (width <= 24) {
        use(hn::CappedTag<T, 8>());
    } else {
        use(hn::CappedTag<T, 16>());
    }
}
template <class T>
HWY_INLINE int narrowest_lanes(int width) {
    int lanes = 1;
    in_narrowest<T>(width, [&](auto d) { lanes = static_cast<int>(hn::Lanes(d)); });
    return lanes;
}

/// Slices of a kernel whose rows are written side by side: as many as there are registers for their sheets.
template <Sums sums, bool slopes>
constexpr int most_together = slopes ? 2 : (sums == Sums::pairs ? 4 : 5);

/// Calls add(slice, number) for slices `first` ... count - 1: as many at once as number.value says, `most` while so
/// many are left.
template <int most, class Add>
HWY_INLINE void in_batches(int first, int count, const Add& add) {
    for (; count - first >= most; first += most) {
        add(first, std::integral_constant<int, most>());
    }
    if constexpr (most > 1) {
        in_batches<most - 1>(first, count, add);
    }
}

/// Calls use(sums) with what kernels of a field add to sheets: sums.value is one of Sums.
template <class T, class Use>
HWY_INLINE auto with_sums(const PartProfile<T>& profile, const Use& use) {
    return profile.weight_channel >= 0 ? use(std::integral_constant<Sums, Sums::weights>())
                                       : use(std::integral_constant<Sums, Sums::values>());
}

/// Kernels of one field on their way to the sheets of slices n ... n + covered_slices - 1; with_slopes: their
/// derivatives are summed too.
template <class T, bool with_slopes>
struct Splat {
    static constexpr bool slopes = with_slopes;
    const LoopSetup<T>& setup;
    const PartProfile<T>& profile;
    const Live& live; ///< where anything can still be seen
    std::int32_t n;
    const Target<T>* targets;          ///< the sheets of these slices
    std::vector<std::uint32_t>& again; ///< numbers of kernels that reach slice n + covered_slices
    Rect through[covered_slices] = {}; ///< added to slices n ... n + i
    Rect single[covered_slices] = {};  ///< added to slice n + i alone

    /// What a derivative of 2^(-falloff r^2) is multiplied by beside half that of -r^2.
    [[nodiscard]] HWY_INLINE T steep() const { return T(-2) * profile.root_falloff * profile.root_falloff; }
    [[nodiscard]] HWY_INLINE T depth_of(std::int32_t slice) const {
        return static_cast<T>(setup.first_depth + static_cast<double>(slice) * setup.slice_spacing);
    }

    /// How many of the slices a kernel meets whose last one is given; it is noted where it reaches beyond them.
    [[nodiscard]] HWY_INLINE int slices_of(std::int32_t last, std::uint32_t number) {
        if (last >= n + covered_slices) {
            again.push_back(number);
        }
        return std::min(last + 1 - n, covered_slices);
    }
    /// Whether anything of a box can still be seen.
    [[nodiscard]] HWY_INLINE bool sees(const Rect& box) const {
        return !box.empty() && live.sees(box.x0, box.y0, box.x1, box.y1);
    }

    /// Calls touch(slice, rect) for what was added to, in pixels of the sheets.
    template <class Touch>
    void tell(const Touch& touch) const {
        Rect common;
        for (int slice = covered_slices - 1; slice >= 0; --slice) {
            common.add(through[slice]);
            Rect rect = single[slice];
            rect.add(common);
            if (!rect.empty()) {
                touch(n + slice, rect);
            }
        }
    }
};

/// Calls add(splat, value) for each lattice that a kernel is drawn for. splat: the first of as many as there are
/// lattices, each to its own sheets.
template <bool several, class T, bool slopes, class Add>
HWY_INLINE void for_each_value(Splat<T, slopes>& splat, const TileKernels<T>& kernels, std::uint32_t number,
                               const Add& add) {
    if constexpr (several) {
        const T* values = kernels.values.data() + number * kernels.fields;
        for (std::size_t field = 0; field < kernels.fields; ++field) {
            if (values[field] != T(0)) {
                add((&splat)[field], values[field]);
            }
        }
    } else {
        add(splat, kernels.sections[number].value);
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_TARGET_INL

#include "prefilter_passes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "mirrored.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "prefilter_passes.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::prefiltering::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Columns of a stencil that are summed at once, as many as registers hold.
constexpr std::size_t most_columns = 4;

/// Numbers in rows of scratch are preceded and followed by zeros or by their images, at least as many as a filter
/// reaches and vectors side by side hold.
constexpr std::size_t round_up(std::size_t count) { return (count + 63) / 64 * 64; }
struct Padded {
    std::size_t before, length;
    Padded(std::size_t count, std::size_t reach)
        : before(round_up(reach)), length(before + round_up(count + reach) + 64) {}
};

template <class D, class In>
HWY_INLINE hn::Vec<D> load(D d, const In* from) {
    if constexpr (std::is_same_v<hn::TFromD<D>, In>) {
        return hn::LoadU(d, from);
    } else {
        return hn::PromoteTo(d, hn::LoadU(hn::Rebind<In, D>(), from));
    }
}

/// The first `count` numbers, fewer than there are lanes, 0 behind them: what lies behind them is not touched.
template <class D, class In>
HWY_INLINE hn::Vec<D> load_some(D d, const In* from, std::size_t count) {
    const hn::Rebind<In, D> same;
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX2
    const auto some = hn::MaskedLoad(hn::FirstN(same, count), same, from);
#else
    HWY_ALIGN In numbers[hn::MaxLanes(hn::Rebind<In, D>())] = {};
    std::copy_n(from, count, numbers);
    const auto some = hn::Load(same, numbers);
#endif
    if constexpr (std::is_same_v<hn::TFromD<D>, In>) {
        return some;
    } else {
        return hn::PromoteTo(d, some);
    }
}

template <class D>
HWY_INLINE void store_some(hn::Vec<D> vector, D d, float* to, std::size_t count) {
    HWY_ALIGN float numbers[hn::MaxLanes(D())];
    hn::Store(vector, d, numbers);
    std::copy_n(numbers, count, to);
}

/// Vectors that are summed side by side, so that additions need not wait for each other, as registers allow.
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_NEON
constexpr std::size_t side_by_side = 4;
#else
constexpr std::size_t side_by_side = 2;
#endif

/// Sums of rows at some vectors of places, weighted for `columns` distances. left: places that there are, if not
/// `whole`.
template <std::size_t columns, bool whole, class T, class In>
HWY_INLINE void sum_here(const Scratch& scratch, const T* taps, std::size_t stride, std::size_t at, std::size_t left,
                         T* sums, std::size_t length) {
    const hn::ScalableTag<T> d;
    using V = hn::Vec<decltype(d)>;
    const std::size_t lanes = hn::Lanes(d);
    V weighted[side_by_side][columns];
    for (auto& vectors : weighted) {
        for (V& vector : vectors) {
            vector = hn::Zero(d);
        }
    }
    std::size_t row = 0;
    for (std::size_t n = 0; n < scratch.kinds.size(); ++n) {
        V plain[side_by_side];
        for (V& vector : plain) {
            vector = hn::Zero(d);
        }
        for (; row < scratch.ends[n]; ++row) {
            const In* const from = static_cast<const In*>(scratch.rows[row]) + at;
            for (std::size_t v = 0; v < side_by_side; ++v) {
                if constexpr (whole) {
                    plain[v] = hn::Add(plain[v], load(d, from + v * lanes));
                } else if ((v + 1) * lanes <= left) {
                    plain[v] = hn::Add(plain[v], load(d, from + v * lanes));
                } else if (v * lanes < left) {
                    plain[v] = hn::Add(plain[v], load_some(d, from + v * lanes, left - v * lanes));
                }
            }
        }
        const T* const weights = taps + scratch.kinds[n] * stride;
        for (std::size_t column = 0; column < columns; ++column) {
            const V weight = hn::Set(d, weights[column]);
            for (std::size_t v = 0; v < side_by_side; ++v) {
                weighted[v][column] = hn::MulAdd(weight, plain[v], weighted[v][column]);
            }
        }
    }
    for (std::size_t column = 0; column < columns; ++column) {
        for (std::size_t v = 0; v < side_by_side; ++v) {
            hn::StoreU(weighted[v][column], d, sums + column * length + at + v * lanes);
        }
    }
}

template <std::size_t columns, class T, class In>
void sum_columns(const Scratch& scratch, const T* taps, std::size_t stride, std::size_t count, T* sums,
                 std::size_t length) {
    const std::size_t step = side_by_side * hn::Lanes(hn::ScalableTag<T>());
    std::size_t at = 0;
    for (; at + step <= count; at += step) {
        sum_here<columns, true, T, In>(scratch, taps, stride, at, step, sums, length);
    }
    if (at < count) {
        sum_here<columns, false, T, In>(scratch, taps, stride, at, count - at, sums, length);
    }
}

/// Writes, before and behind the sums of rows of layer k, as many of their images as `across` reads.
template <class T>
void mirror_ends(const Stencil<T>& stencil, std::size_t ni, std::size_t k, T* sums, std::size_t length) {
    for (std::size_t column = 1; column < stencil.columns; ++column) {
        // Rows whose distance along i is odd lie in layers of the other kind.
        const std::size_t odd = (k + column) % 2;
        const auto source = [&](std::ptrdiff_t i) {
            return stencil.bcc ? mirrored_index_bcc(i, ni, odd) : mirrored_index(i, ni);
        };
        const auto reach = static_cast<std::ptrdiff_t>(stencil.bcc ? (column + 1) / 2 : column);
        const auto end = static_cast<std::ptrdiff_t>(ni);
        T* const row = sums + column * length;
        for (std::ptrdiff_t n = 0; n < reach; ++n) {
            row[-1 - n] = row[source(-1 - n)];
            row[end + n] = row[source(end + n)];
        }
    }
}

/// The sums at row j of layer k, a row for each distance along i: sums + column * length. Mirrored samples beyond the
/// ends follow and precede them; beyond other ends nothing is changed, or made 0.
template <class T, class In>
void sum_rows(const Equations& equations, const Stencil<T>& stencil, const In* volume, std::size_t k, std::size_t j,
              Scratch& scratch, T* sums, std::size_t length) {
    const auto [nk, nj, ni] = equations.shape;
    scratch.rows.resize(stencil.rows.size());
    scratch.ends.resize(stencil.kinds);
    scratch.kinds.resize(stencil.kinds);
    const void** const rows = scratch.rows.data();
    const std::size_t odd_layer = k % 2;
    std::size_t count = 0, kinds = 0, kind = stencil.kinds;
    for (const auto& row : stencil.rows) {
        std::size_t at_k = k + static_cast<std::size_t>(row.k);
        std::size_t at_j = j + static_cast<std::size_t>(row.j[odd_layer]);
        if (equations.mirrored) {
            // Images of layers are layers of the same kind, odd or even.
            const auto beyond_k = static_cast<std::ptrdiff_t>(at_k), beyond_j = static_cast<std::ptrdiff_t>(at_j);
            at_j = stencil.bcc ? mirrored_index_bcc(beyond_j, nj, at_k % 2) : mirrored_index(beyond_j, nj);
            at_k = mirrored_index(beyond_k, nk);
        }
        // Negative indices are large ones.
        if (at_k < nk && at_j < nj) {
            if (row.kind != kind) {
                kind = row.kind;
                scratch.kinds[kinds++] = kind;
            }
            rows[count++] = volume + (at_k * nj + at_j) * ni;
            scratch.ends[kinds - 1] = count;
        }
    }
    scratch.kinds.resize(kinds);
    for (std::size_t first = 0; first < stencil.columns; first += most_columns) {
        const T* const taps = stencil.taps.data() + first;
        T* const to = sums + first * length;
        switch (std::min(most_columns, stencil.columns - first)) {
        case 1:
            sum_columns<1, T, In>(scratch, taps, stencil.columns, ni, to, length);
            break;
        case 2:
            sum_columns<2, T, In>(scratch, taps, stencil.columns, ni, to, length);
            break;
        case 3:
            sum_columns<3, T, In>(scratch, taps, stencil.columns, ni, to, length);
            break;
        default:
            sum_columns<4, T, In>(scratch, taps, stencil.columns, ni, to, length);
        }
    }
    if (equations.mirrored) {
        mirror_ends(stencil, ni, k, sums, length);
    }
}

/// The whole sum at a vector of places of a row of layer k.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE hn::Vec<D> across(D d, const Stencil<T>& stencil, int odd_layer, const T* sums, std::size_t length) {
    hn::Vec<D> whole = hn::LoadU(d, sums);
    for (std::size_t column = 1; column < stencil.columns; ++column) {
        const int away = static_cast<int>(column);
        const int right = !stencil.bcc ? away : away % 2 == 0 ? away / 2 : (away + 2 * odd_layer - 1) / 2;
        const int left = !stencil.bcc ? away : away % 2 == 0 ? away / 2 : (away - 2 * odd_layer + 1) / 2;
        const T* const at = sums + column * length;
        whole = hn::Add(whole, hn::Add(hn::LoadU(d, at + right), hn::LoadU(d, at - left)));
    }
    return whole;
}

/// Copies samples, counted from the base, as numbers of another type.
template <class T, class Sample>
void read_row(const void* samples, std::size_t first, std::size_t count, double base, T* row) {
    const Sample* const from = static_cast<const Sample*>(samples) + first;
    if (base == 0.0) {
        for (std::size_t n = 0; n < count; ++n) {
            row[n] = static_cast<T>(from[n]);
        }
        return;
    }
    // (In float32 a difference of large samples would have few digits.)
    for (std::size_t n = 0; n < count; ++n) {
        row[n] = static_cast<T>(static_cast<double>(from[n]) - base);
    }
}
template <class T>
using ReadRow = void (*)(const void* samples, std::size_t first, std::size_t count, double base, T* row);
/// In the order of SampleArray.
template <class T>
constexpr ReadRow<T> read_rows[] = {&read_row<T, std::uint8_t>, &read_row<T, std::int16_t>, &read_row<T, std::uint16_t>,
                                    &read_row<T, float>, &read_row<T, double>};

/// One row of remainders, before all filters, by sums in T. Returns the largest.
template <class T, class C>
double subtract_row(const Equations& equations, const Stencil<T>& kernel, const C* coefficients, std::size_t k,
                    std::size_t j, Scratch& scratch, const Padded& padded, T* wide, float* row) {
    const std::size_t count = equations.shape[2];
    T* const wanted = wide;
    T* const sums = wide + padded.length + padded.before;
    read_rows<T>[equations.kind](equations.samples, (k * equations.shape[1] + j) * count, count, equations.base,
                                 wanted);
    if (coefficients != nullptr) {
        sum_rows<T, C>(equations, kernel, coefficients, k, j, scratch, sums, padded.length);
    }
    const hn::ScalableTag<T> d;
    const std::size_t lanes = hn::Lanes(d);
    const auto scale = hn::Set(d, static_cast<T>(1.0 / equations.unit));
    auto largest = hn::Zero(d);
    const int odd_layer = static_cast<int>(k % 2);
    for (std::size_t i = 0; i < count; i += lanes) {
        auto left = hn::LoadU(d, wanted + i);
        if (coefficients != nullptr) {
            left = hn::Sub(left, across(d, kernel, odd_layer, sums + i, padded.length));
        }
        left = hn::Mul(left, scale);
        if (i + lanes > count) {
            left = hn::IfThenElseZero(hn::FirstN(d, count - i), left);
        }
        largest = hn::Max(largest, hn::Abs(left));
        if constexpr (std::is_same_v<T, float>) {
            hn::StoreU(left, d, row + i);
        } else {
            const hn::Rebind<float, decltype(d)> narrow;
            hn::StoreU(hn::DemoteTo(narrow, left), narrow, row + i);
        }
    }
    return static_cast<double>(hn::GetLane(hn::MaxOfLanes(d, largest)));
}

/// Filters a padded row along i. Beyond the border, whose filters differ, all samples have the same.
inline void filter_row(const AxisFilters& filters, std::size_t count, const float* from, float* to) {
    const hn::ScalableTag<float> d;
    const std::size_t lanes = hn::Lanes(d);
    std::size_t i = 0;
    const auto by_itself = [&](std::size_t end) __attribute__((always_inline)) {
        for (; i < end; i += lanes) {
            auto sum = hn::Zero(d);
            for (int offset = -filters.band; offset <= filters.band; ++offset) {
                sum = hn::MulAdd(hn::LoadU(d, filters.at(2, offset, count) + i),
                                 hn::LoadU(d, from + static_cast<std::ptrdiff_t>(i) + offset), sum);
            }
            hn::StoreU(sum, d, to + i);
        }
    };
    if (count > 2 * filter_border) {
        by_itself(filter_border);
        const std::size_t middle = count / 2;
        for (; i + 4 * lanes + filter_border <= count; i += 4 * lanes) {
            auto a = hn::Zero(d), b = a, c = a, e = a;
            for (int offset = -filters.band; offset <= filters.band; ++offset) {
                const auto tap = hn::Set(d, filters.at(2, offset, count)[middle]);
                const float* const at = from + static_cast<std::ptrdiff_t>(i) + offset;
                a = hn::MulAdd(tap, hn::LoadU(d, at), a);
                b = hn::MulAdd(tap, hn::LoadU(d, at + lanes), b);
                c = hn::MulAdd(tap, hn::LoadU(d, at + 2 * lanes), c);
                e = hn::MulAdd(tap, hn::LoadU(d, at + 3 * lanes), e);
            }
            hn::StoreU(a, d, to + i);
            hn::StoreU(b, d, to + i + lanes);
            hn::StoreU(c, d, to + i + 2 * lanes);
            hn::StoreU(e, d, to + i + 3 * lanes);
        }
    }
    by_itself(count);
}

/// The weighted sum of the rows around one, along axis k (0) or j (1): row(offset) has that with an offset.
/// use(i, count of lanes or fewer, sum) takes it.
template <class RowAt, class Use>
HWY_INLINE void filter_across(const AxisFilters& filters, std::size_t axis, std::size_t index, std::size_t length,
                              std::size_t count, Scratch& scratch, RowAt&& row, Use&& use) {
    scratch.rows.resize(static_cast<std::size_t>(2 * filters.band + 1));
    scratch.weights.resize(scratch.rows.size());
    std::size_t terms = 0;
    for (int offset = -filters.band; offset <= filters.band; ++offset) {
        if (index + static_cast<std::size_t>(offset) < length) {
            scratch.weights[terms] = filters.at(axis, offset, length)[index];
            scratch.rows[terms++] = row(offset);
        }
    }
    const auto at_row = [&](std::size_t n) __attribute__((always_inline)) {
        return static_cast<const float*>(scratch.rows[n]);
    };
    const float* const weights = scratch.weights.data();
    const hn::ScalableTag<float> d;
    const std::size_t lanes = hn::Lanes(d);
    std::size_t i = 0;
    for (; i + 4 * lanes <= count; i += 4 * lanes) {
        auto a = hn::Zero(d), b = a, c = a, e = a;
        for (std::size_t n = 0; n < terms; ++n) {
            const auto weight = hn::Set(d, weights[n]);
            const float* const at = at_row(n) + i;
            a = hn::MulAdd(weight, hn::LoadU(d, at), a);
            b = hn::MulAdd(weight, hn::LoadU(d, at + lanes), b);
            c = hn::MulAdd(weight, hn::LoadU(d, at + 2 * lanes), c);
            e = hn::MulAdd(weight, hn::LoadU(d, at + 3 * lanes), e);
        }
        use(i, lanes, a);
        use(i + lanes, lanes, b);
        use(i + 2 * lanes, lanes, c);
        use(i + 3 * lanes, lanes, e);
    }
    for (; i < count; i += lanes) {
        const std::size_t some = std::min(lanes, count - i);
        auto sum = hn::Zero(d);
        for (std::size_t n = 0; n < terms; ++n) {
            const auto row_here = some == lanes ? hn::LoadU(d, at_row(n) + i) : load_some(d, at_row(n) + i, some);
            sum = hn::MulAdd(hn::Set(d, weights[n]), row_here, sum);
        }
        use(i, some, sum);
    }
}

template <class T, class C>
double subtract(const Equations& equations, const Stencil<T>& kernel, Room<T>& room, const C* coefficients,
                const Tile& tile, Scratch& scratch, float* remainder) {
    const auto [nk, nj, ni] = equations.shape;
    const bool separable = equations.preconditioner.separable();
    const AxisFilters& filters = equations.preconditioner.axes;
    const std::size_t band = separable ? static_cast<std::size_t>(filters.band) : 0;
    // A power of two, so that a row's place in the ring costs no division.
    std::size_t ring = 1;
    while (ring < 2 * band + 1) {
        ring *= 2;
    }
    const Padded padded(ni, std::max(band, kernel.columns));
    T* const wide = room.of((1 + kernel.columns) * padded.length);
    std::fill_n(wide, (1 + kernel.columns) * padded.length, T(0));
    // The row of remainders, then the ring of those that are filtered along i.
    float* const narrow = scratch.narrow.of((1 + ring) * padded.length);
    std::fill_n(narrow, padded.length, 0.0F);
    float* const row = narrow + padded.before;
    const auto in_ring = [&](std::size_t j) { return narrow + (1 + (j & (ring - 1))) * padded.length; };
    double largest = 0.0;
    for (std::size_t k = tile.k0; k < tile.k1; ++k) {
        const std::size_t begin = tile.j0 - std::min(tile.j0, band);
        const std::size_t end = std::min(nj, tile.j1 + band);
        std::size_t next = tile.j0;
        for (std::size_t j = begin; j < end; ++j) {
            largest = std::max(largest,
                               subtract_row<T, C>(equations, kernel, coefficients, k, j, scratch, padded, wide, row));
            float* const to = remainder + (k * nj + j) * ni;
            if (!separable) {
                std::copy_n(row, ni, to);
                continue;
            }
            filter_row(filters, ni, row, in_ring(j));
            // A row can be filtered along j once all that it needs are there.
            for (; next < tile.j1 && (next + band <= j || j + 1 == end); ++next) {
                const hn::ScalableTag<float> d;
                float* const out = remainder + (k * nj + next) * ni;
                filter_across(
                    filters, 1, next, nj, ni, scratch,
                    [&](int offset) {
                        return in_ring(static_cast<std::size_t>(static_cast<std::ptrdiff_t>(next) + offset));
                    },
                    [&](std::size_t i, std::size_t count, auto sum) __attribute__((always_inline)) {
                        if (count == hn::Lanes(d)) {
                            hn::StoreU(sum, d, out + i);
                        } else {
                            store_some(sum, d, out + i, count);
                        }
                    });
            }
        }
    }
    return largest;
}

template <class C>
double subtract_in(Accuracy accuracy, const Equations& equations, const C* coefficients, const Tile& tile,
                   Scratch& scratch, float* remainder) {
    if constexpr (std::is_same_v<C, float>) {
        if (accuracy == Accuracy::coarse) {
            return subtract<float, C>(equations, equations.coarse_kernel, scratch.coarse, coefficients, tile, scratch,
                                      remainder);
        }
    }
    return subtract<double, C>(equations, equations.kernel, scratch.wide, coefficients, tile, scratch, remainder);
}

template <class C>
double add(const Equations& equations, const float* remainder, double share, const Tile& tile, Scratch& scratch,
           C* coefficients) {
    const auto [nk, nj, ni] = equations.shape;
    const Preconditioner& preconditioner = equations.preconditioner;
    const std::size_t plane = nj * ni;
    const hn::ScalableTag<float> d;
    using V = hn::Vec<decltype(d)>;
    const std::size_t lanes = hn::Lanes(d);
    auto largest = hn::Zero(d);
    // A power of two apart, so that float64 keeps its range.
    const double factor = share * equations.unit;
    const auto change = [&](C * to, std::size_t count, V step) __attribute__((always_inline)) {
        if constexpr (std::is_same_v<C, float>) {
            const V weight = hn::Set(d, static_cast<float>(factor));
            if (count == lanes) {
                const V made = hn::MulAdd(weight, step, hn::LoadU(d, to));
                largest = hn::Max(largest, hn::Abs(made));
                hn::StoreU(made, d, to);
            } else {
                // The lanes behind are 0 in the coefficients, and must not count in what is added.
                const V made =
                    hn::IfThenElseZero(hn::FirstN(d, count), hn::MulAdd(weight, step, load_some(d, to, count)));
                largest = hn::Max(largest, hn::Abs(made));
                store_some(made, d, to, count);
            }
        } else {
            float steps[HWY_MAX_BYTES / sizeof(float)];
            hn::StoreU(step, d, steps);
            for (std::size_t n = 0; n < count; ++n) {
                to[n] += factor * static_cast<double>(steps[n]);
            }
        }
    };
    if (preconditioner.separable()) {
        for (std::size_t k = tile.k0; k < tile.k1; ++k) {
            for (std::size_t j = tile.j0; j < tile.j1; ++j) {
                const float* const here = remainder + k * plane + j * ni;
                C* const to = coefficients + k * plane + j * ni;
                filter_across(
                    preconditioner.axes, 0, k, nk, ni, scratch,
                    [&](int offset) { return here + offset * static_cast<std::ptrdiff_t>(plane); },
                    [&](std::size_t i, std::size_t count, V sum)
                        __attribute__((always_inline)) { change(to + i, count, sum); });
            }
        }
        return hn::GetLane(hn::MaxOfLanes(d, largest));
    }
    const Stencil<float>& stencil = preconditioner.stencil;
    const Padded padded(ni, stencil.columns);
    float* const narrow = scratch.narrow.of(stencil.columns * padded.length);
    std::fill_n(narrow, stencil.columns * padded.length, 0.0F);
    float* const sums = narrow + padded.before;
    for (std::size_t k = tile.k0; k < tile.k1; ++k) {
        const int odd_layer = static_cast<int>(k % 2);
        for (std::size_t j = tile.j0; j < tile.j1; ++j) {
            sum_rows<float, float>(equations, stencil, remainder, k, j, scratch, sums, padded.length);
            C* const to = coefficients + k * plane + j * ni;
            for (std::size_t i = 0; i < ni; i += lanes) {
                change(to + i, std::min(lanes, ni - i), across(d, stencil, odd_layer, sums + i, padded.length));
            }
        }
    }
    return hn::GetLane(hn::MaxOfLanes(d, largest));
}

template <class C>
const Passes<C>& of_this_set() {
    static constexpr Passes<C> all{&subtract_in<C>, &add<C>};
    return all;
}

} // namespace sheetsplat::prefiltering::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace sheetsplat::prefiltering {

template <class C>
const Passes<C>& passes(InstructionSet set) {
    switch (set) {
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return N_SSE4::of_this_set<C>();
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return N_AVX2::of_this_set<C>();
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return N_AVX3::of_this_set<C>();
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return N_NEON::of_this_set<C>();
#endif
    default:
        return HWY_STATIC_DISPATCH(of_this_set<C>)();
    }
}

template const Passes<float>& passes<float>(InstructionSet set);
template const Passes<double>& passes<double>(InstructionSet set);

} // namespace sheetsplat::prefiltering

#endif

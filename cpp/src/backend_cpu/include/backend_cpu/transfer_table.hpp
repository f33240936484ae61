// The transfer function in the number format of the sheets: looks of one value, and means over ramps between two.
// Source: conventions, section 4; [EKE01].
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/transfer_function.hpp"

namespace sheetsplat::backend_cpu {

/// Where to look for the stretch that a value is in: the cell of a value, put between first and last, is
/// (value - first) * per_unit, rounded down and not above last_cell; from `last` on last_cell + 1.
template <class T>
struct Cells {
    /// Of each cell the place, in records, of the stretch that its smallest values are in; last that of the last one.
    std::vector<std::int32_t> records;
    T first = T(0), last = T(0), per_unit = T(0), last_cell = T(0);
};

/// The transfer function over rho in the sheets' unit, as stretches over which colour and opacity are linear, stretches
/// of no width left out: exact, steps not smeared, of two points at one value the later one holds from there on. The
/// first stretch holds with its first looks for all smaller values too, the last one for all larger ones.
template <class T>
struct TransferTable {
    /// Stretches that fit registers, one a lane.
    static constexpr int most_in_lanes = 16;
    /// Numbers of one stretch: from, to, opacity, its slope | red, slope, green, slope | blue, slope, 0, 0.
    static constexpr int record = 12;
    static constexpr int numbers = 10;

    int stretches = 0;
    std::vector<T> records;
    /// By number of `record`, then by stretch: the same for up to most_in_lanes stretches.
    alignas(64) T lanes[numbers][most_in_lanes] = {};
    Cells<T> cells;
    /// Opacity is 0 where rho <= below and where rho >= above.
    T below = T(0), above = T(0);
};

/// A stretch of the transfer function for means over ramps: opacity is at most 1 - 2^-24 and linear.
template <class T>
struct RampStretch {
    T from = T(0), to = T(0);
    T per_width = T(0); ///< 1 / (to - from); 0 where everything is constant
    T opacity = T(0), opacity_step = T(0);
    T clearness = T(0), clearness_step = T(0); ///< 1 - opacity, with its own digits
    T color[3] = {}, color_step[3] = {};
};

/// All stretches of RampStretch, from the smallest number to the largest. Where there are many they are looked up, and
/// cut where 1 - opacity changes by more than most_change: over each, absorption -ln(1 - opacity) is a polynomial of
/// the share of its width, within the rounding of T.
template <class T>
struct RampTable {
    std::vector<RampStretch<T>> stretches;
    static constexpr int degree = sizeof(T) == 4 ? 2 : 7;
    /// Numbers of one stretch: from, to, per_width, blue | red, step, green, step | blue's step, then the polynomial's
    /// terms, that of x^n divided by n + 1 | from a multiple of four on the integrals over rho up to `from` of
    /// absorption and of absorption times red, green and blue, each as a number and what it has lost. One record more
    /// than stretches; only where there are many.
    static constexpr int first_term = 9, first_integral = (first_term + degree + 4) / 4 * 4,
                         record = first_integral + 8;
    std::vector<T> records;
    Cells<T> cells;
};

/// value_unit: the amount of rho that sheets call 1.
template <class T>
TransferTable<T> make_transfer_table(const TransferFunction& function, double value_unit);

extern template TransferTable<float> make_transfer_table<float>(const TransferFunction&, double);
extern template TransferTable<double> make_transfer_table<double>(const TransferFunction&, double);

template <class T>
RampTable<T> make_ramp_table(const TransferFunction& function, double value_unit);

extern template RampTable<float> make_ramp_table<float>(const TransferFunction&, double);
extern template RampTable<double> make_ramp_table<double>(const TransferFunction&, double);

} // namespace sheetsplat::backend_cpu

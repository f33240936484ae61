// The pivot of a field: a constant that is subtracted from values before sums are divided, so that large values keep
// their digits: by backend gl in sheets of a field's own and where differences of both sums are splatted, by backend
// cpu where derivatives are divided.
#pragma once

#include <array>
#include <cmath>

#include "plan/make_plan.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// What is subtracted from a field's values: the middle of the range of values where its absolute
/// value is greater than the width of the range, else 0.
inline double pivot_of(const Field& field) {
    const std::array<double, 2> range = field.value_range();
    const double middle = 0.5 * range[0] + 0.5 * range[1];
    return std::abs(middle) > range[1] - range[0] ? middle : 0.0;
}

/// Whether backend gl counts values of fields that are divided from their pivots. Modes that show rho itself have no
/// use for that, and [NM06] does not do it.
inline bool counts_from_pivots(const DrawPlan& plan) {
    const bool classified = plan.mode == Mode::composite || plan.mode == Mode::isosurface;
    return classified && !plan.paper_slicing && (!plan.own_sheets.empty() || (plan.fine_gradient && plan.threshold));
}

} // namespace sheetsplat

// The pivot of a field: a constant that is subtracted from values before sums are divided, so that large values keep
// their digits: by backend gl in sheets of a field's own and where differences of both sums are splatted, by backend
// cpu where derivatives are divided.
#pragma once

#include <array>

#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// What is subtracted from a field's values: the middle of their range, from which the largest is least.
inline double pivot_of(const Field& field) {
    const std::array<double, 2> range = field.value_range();
    return 0.5 * range[0] + 0.5 * range[1];
}

/// Whether backend gl counts values of fields that are divided from their pivots. Modes that show rho itself have no
/// use for that, and [NM06] does not do it.
inline bool counts_from_pivots(const DrawPlan& plan) {
    return !is_scalar(plan.mode) && !plan.paper_slicing &&
           (!plan.own_sheets.empty() || (plan.fine_gradient && plan.threshold));
}

} // namespace sheetsplat

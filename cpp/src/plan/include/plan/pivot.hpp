// The pivot of a field: a constant that is subtracted from values before sums are divided, so that large values keep
// their digits: by backend gl, and by backend cpu where derivatives are divided.
#pragma once

#include <array>
#include <cmath>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// What is subtracted from a field's values in sheets of its own: the middle of the range of values where its absolute
/// value is greater than the width of the range, else 0.
inline double pivot_of(const Field& field) {
    const std::array<double, 2> range = field.value_range();
    const double middle = 0.5 * range[0] + 0.5 * range[1];
    return std::abs(middle) > range[1] - range[0] ? middle : 0.0;
}

} // namespace sheetsplat

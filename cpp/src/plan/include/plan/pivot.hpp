// Values that lie far from 0 are counted from their middle where they are divided by their weight sum.
#pragma once

#include <array>
#include <cmath>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// What a field's values are less by in sheets of its own: the middle of those that lie farther from 0 than from one
/// another, else 0.
inline double pivot_of(const Field& field) {
    const std::array<double, 2> range = field.value_range();
    const double middle = 0.5 * range[0] + 0.5 * range[1];
    return std::abs(middle) > range[1] - range[0] ? middle : 0.0;
}

} // namespace sheetsplat

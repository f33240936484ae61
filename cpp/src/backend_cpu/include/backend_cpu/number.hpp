// Numbers of the plan in the number format of the sheets.
#pragma once

#include <algorithm>
#include <limits>

namespace sheetsplat::backend_cpu {

/// The nearest number of the format, never infinite.
template <class T>
T number(double value) {
    constexpr auto largest = static_cast<double>(std::numeric_limits<T>::max());
    return static_cast<T>(std::clamp(value, -largest, largest));
}

} // namespace sheetsplat::backend_cpu

// Pixels that fill a picture evenly, however many are taken.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Column and row of pixel `number` of a sequence: the additive recurrence with the powers of the plastic number.
inline std::array<int, 2> spread(std::size_t number, Size size) {
    constexpr double first = 0.7548776662466927, second = 0.5698402909980532;
    const auto place = [number](double step, int count) {
        const double at = 0.5 + static_cast<double>(number) * step;
        return std::min(static_cast<int>((at - std::floor(at)) * count), count - 1);
    };
    return {place(first, size.width), place(second, size.height)};
}

} // namespace sheetsplat

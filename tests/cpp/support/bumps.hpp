// A volume with detail inside: a ball that falls off linearly, with waves.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "sheetsplat/field.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {

/// n samples along each axis, 0 to 1.
inline std::shared_ptr<const RegularField> bumps(std::size_t n = 14) {
    std::vector<float> samples(n * n * n);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const Vec3 at = 2.0 * Vec3(double(i % n), double(i / n % n), double(i / n / n)) / double(n - 1) - 1.0;
        const double r = std::sqrt(at.x * at.x + at.y * at.y + at.z * at.z);
        const double wave = 0.25 * std::sin(8.0 * at.x) * std::cos(7.0 * at.y + 1.0) * std::sin(6.0 * at.z);
        samples[i] = static_cast<float>(std::clamp(1.1 - r + wave, 0.0, 1.0));
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n},
                                          test::zero_boundary());
}

} // namespace sheetsplat::test

// Small checks on numbers, and numbers as text for messages.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

inline bool is_finite(double value) { return std::isfinite(value); }
inline bool is_finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// The shortest decimal text that reads back as the same number; "NaN", "infinity", "-infinity".
std::string text_of(double value);
/// "(x, y, z)", each number as above.
std::string text_of(const Vec3& v);
/// At most so many significant digits.
std::string text_of(double value, int digits);
/// Whole numbers in digits.
std::string text_of_count(std::uint64_t count);
/// "1 kernel", "2 kernels".
std::string text_of_count(std::uint64_t count, const char* noun);
/// Bytes in the largest binary unit that leaves a number of at least 1, with two decimals: "1.50 GiB".
std::string text_of_bytes(std::uint64_t bytes);

} // namespace sheetsplat

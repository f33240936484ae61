#include "base/checks.hpp"

#include <array>
#include <charconv>
#include <sstream>

namespace sheetsplat {

std::string text_of(double value) {
    if (std::isnan(value)) {
        return "NaN";
    }
    if (std::isinf(value)) {
        return value > 0.0 ? "infinity" : "-infinity";
    }
    std::array<char, 40> buffer{};
    const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
    return {buffer.data(), end.ptr};
}

std::string text_of(const Vec3& v) { return "(" + text_of(v.x) + ", " + text_of(v.y) + ", " + text_of(v.z) + ")"; }

std::string text_of(double value, int digits) {
    std::ostringstream text;
    text.precision(digits);
    text << value;
    return text.str();
}

std::string text_of_count(std::uint64_t count) { return std::to_string(count); }

std::string text_of_count(std::uint64_t count, const char* noun) {
    return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

std::string text_of_bytes(std::uint64_t bytes) {
    if (bytes < 1024) {
        return std::to_string(bytes) + " bytes";
    }
    static constexpr std::array<const char*, 6> units{"KiB", "MiB", "GiB", "TiB", "PiB", "EiB"};
    double amount = static_cast<double>(bytes) / 1024.0;
    std::size_t unit = 0;
    // 1023.995 and more would be printed as 1024.00 of the smaller unit.
    while (amount >= 1023.995 && unit + 1 < units.size()) {
        amount /= 1024.0;
        ++unit;
    }
    std::array<char, 32> number{};
    const auto end = std::to_chars(number.data(), number.data() + number.size(), amount, std::chars_format::fixed, 2);
    return std::string(number.data(), end.ptr) + " " + units[unit];
}

} // namespace sheetsplat

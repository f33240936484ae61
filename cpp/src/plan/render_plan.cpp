#include "sheetsplat/render_plan.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sheetsplat {

bool RenderPlan::has(const std::string& effect) const {
    return std::any_of(effects.begin(), effects.end(), [&](const Effect& e) { return e.on && e.name == effect; });
}

double RenderPlan::expected_error() const {
    double squares = 0.0;
    for (const ErrorShare& share : error_budget) {
        squares += share.rmse * share.rmse;
    }
    return std::sqrt(squares);
}

const char* to_string(Backend value) { return value == Backend::automatic ? "auto" : traits_of(value).name; }

const char* to_string(Precision value) {
    constexpr std::array names{"auto", "uint8", "float16", "float32", "float64"};
    return names.at(static_cast<std::size_t>(value));
}

const char* to_string(Packing value) {
    constexpr std::array names{"auto", "paper", "wide"};
    return names.at(static_cast<std::size_t>(value));
}

const char* to_string(Path value) {
    constexpr std::array names{"auto", "raster", "compute"};
    return names.at(static_cast<std::size_t>(value));
}

const char* to_string(Tagging value) {
    constexpr std::array names{"auto", "depth_bounds", "depth_equal", "tiles", "off"};
    return names.at(static_cast<std::size_t>(value));
}

} // namespace sheetsplat

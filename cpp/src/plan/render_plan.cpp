#include "sheetsplat/render_plan.hpp"

#include <algorithm>
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

const char* to_string(Backend value) {
    switch (value) {
    case Backend::automatic:
        return "auto";
    case Backend::gl:
        return "gl";
    case Backend::cpu:
        return "cpu";
    case Backend::reference:
        return "reference";
    }
    return "?";
}

const char* to_string(Precision value) {
    switch (value) {
    case Precision::automatic:
        return "auto";
    case Precision::uint8:
        return "uint8";
    case Precision::float16:
        return "float16";
    case Precision::float32:
        return "float32";
    case Precision::float64:
        return "float64";
    }
    return "?";
}

const char* to_string(Packing value) {
    switch (value) {
    case Packing::automatic:
        return "auto";
    case Packing::paper:
        return "paper";
    case Packing::wide:
        return "wide";
    }
    return "?";
}

const char* to_string(Tagging value) {
    switch (value) {
    case Tagging::automatic:
        return "auto";
    case Tagging::depth_bounds:
        return "depth_bounds";
    case Tagging::depth_equal:
        return "depth_equal";
    case Tagging::tiles:
        return "tiles";
    case Tagging::off:
        return "off";
    }
    return "?";
}

} // namespace sheetsplat

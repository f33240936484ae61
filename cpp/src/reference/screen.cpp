#include "reference/screen.hpp"

#include <algorithm>
#include <cmath>

namespace sheetsplat::reference {

namespace {

// Pixels that a footprint is widened by, so that rounding cannot lose one: the kernel's own end decides.
constexpr double margin_px = 1e-3;

// Pixels -1 ... count whose number lies between two real ones.
Screen::Span pixels_between(double a, double b, int count) {
    if (std::isnan(a) || std::isnan(b)) {
        return {-1, count};
    }
    const double lower = std::clamp(std::ceil(std::min(a, b) - margin_px), -1.0, count + 1.0);
    const double upper = std::clamp(std::floor(std::max(a, b) + margin_px), -2.0, static_cast<double>(count));
    return {static_cast<int>(lower), static_cast<int>(upper)};
}

} // namespace

Screen::Screen(const Camera& camera, Size size)
    : size_(size), perspective_(camera.projection() == Projection::perspective), half_height_(camera.half_height()),
      aspect_(static_cast<double>(size.width) / size.height),
      shift_(2.0 * camera.shift().x / aspect_, 2.0 * camera.shift().y) {
    for (int i = -1; i <= size.width; ++i) {
        ndc_x_.push_back(2.0 * (i + 0.5) / size.width - 1.0 + shift_.x);
    }
    for (int j = -1; j <= size.height; ++j) {
        ndc_y_.push_back(1.0 - 2.0 * (j + 0.5) / size.height + shift_.y);
    }
}

double Screen::secant(int column, int row) const {
    const double x = slope_x(column), y = slope_y(row);
    return std::sqrt(1.0 + x * x + y * y);
}

Vec3 Screen::to_viewer(int column, int row) const {
    return Vec3(-slope_x(column), -slope_y(row), 1.0) / secant(column, row);
}

Screen::Span Screen::columns(double lower, double upper, double front, double back) const {
    // A slab may begin behind the eye: rays turned inside out there can come from any pixel.
    if (perspective_ && front <= 0.0) {
        return {-1, size_.width};
    }
    // lower / depth is monotonic in depth, so that the ends of the interval bound it.
    const double half_front = half_width(front), half_back = half_width(back);
    const double ndc_lower = std::min(lower / half_front, lower / half_back);
    const double ndc_upper = std::max(upper / half_front, upper / half_back);
    const auto column = [this](double ndc) { return (1.0 + ndc - shift_.x) * 0.5 * size_.width - 0.5; };
    return pixels_between(column(ndc_lower), column(ndc_upper), size_.width);
}

Screen::Span Screen::rows(double lower, double upper, double front, double back) const {
    if (perspective_ && front <= 0.0) {
        return {-1, size_.height};
    }
    const double half_front = half_height(front), half_back = half_height(back);
    const double ndc_lower = std::min(lower / half_front, lower / half_back);
    const double ndc_upper = std::max(upper / half_front, upper / half_back);
    const auto row = [this](double ndc) { return (1.0 - ndc + shift_.y) * 0.5 * size_.height - 0.5; };
    return pixels_between(row(ndc_upper), row(ndc_lower), size_.height);
}

} // namespace sheetsplat::reference

#include "coarse_view.hpp"

#include <cmath>

namespace sheetsplat {

namespace {

constexpr double pi = 3.14159265358979323846;

} // namespace

Size coarse_size(Size full, int larger) {
    const auto cover = [&](int pixels) { return larger == 1 ? pixels : (pixels - 1) / larger + 2; };
    return {cover(full.width), cover(full.height)};
}

Camera coarse_camera(const Camera& full, Size full_size, int larger) {
    const Size size = coarse_size(full_size, larger);
    const double taller = static_cast<double>(size.height) * larger / full_size.height;
    if (full.projection() == Projection::orthographic) {
        return Camera::orthographic(full.eye(), full.target(), full.up(), full.height() * taller);
    }
    const double angle = 2.0 * std::atan(full.half_height() * taller) * 180.0 / pi;
    return Camera::perspective(full.eye(), full.target(), full.up(), angle, full.near());
}

} // namespace sheetsplat

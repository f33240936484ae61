#include "coarse_view.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

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
    return Camera::perspective(full.eye(), full.target(), full.up(), angle, full.near(), full.shift() / taller);
}

Scene coarse_scene(const Scene& full, Size full_size, int larger) {
    Scene scene = full;
    if (!full.depth_limit || larger == 1) {
        return scene;
    }
    const Size size = coarse_size(full_size, larger);
    const auto nearest = [larger](int pixel, int pixels, int full_pixels) {
        const double middle = (pixel + 0.5 - 0.5 * pixels) * larger + 0.5 * full_pixels;
        return std::clamp(static_cast<int>(std::floor(middle)), 0, full_pixels - 1);
    };
    std::vector<double> depths;
    depths.reserve(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height));
    for (int row = 0; row < size.height; ++row) {
        const int from = nearest(row, size.height, full_size.height);
        for (int column = 0; column < size.width; ++column) {
            depths.push_back(full.depth_limit->at(nearest(column, size.width, full_size.width), from));
        }
    }
    scene.depth_limit = DepthLimit(size, std::move(depths));
    return scene;
}

} // namespace sheetsplat

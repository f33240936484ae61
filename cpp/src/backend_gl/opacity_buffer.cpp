#include "opacity_buffer.hpp"

#include <algorithm>

namespace sheetsplat::backend_gl {

OpacityBuffer::OpacityBuffer(int width, int height, double opacity_stop, bool average)
    : width_(width), height_(height), stop_(opacity_stop), average_(average),
      sums_(static_cast<std::size_t>(width + 1) * static_cast<std::size_t>(height + 1), 0.0) {}

void OpacityBuffer::update(const float* rgba) {
    const auto row = static_cast<std::size_t>(width_ + 1);
    for (int y = 0; y < height_; ++y) {
        double sum = 0.0;
        for (int x = 0; x < width_; ++x) {
            const bool border =
                x < Tile::border || y < Tile::border || x >= width_ - Tile::border || y >= height_ - Tile::border;
            const float alpha = border ? 1.0F
                                       : rgba[4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                                   static_cast<std::size_t>(x)) +
                                              3];
            // The comparison is the shader's own: in float32.
            sum += average_ ? static_cast<double>(alpha) : alpha >= static_cast<float>(stop_) ? 0.0 : 1.0;
            const std::size_t at = static_cast<std::size_t>(y + 1) * row + static_cast<std::size_t>(x + 1);
            sums_[at] = sums_[at - row] + sum;
        }
    }
    any_ = true;
}

bool OpacityBuffer::hides(const PixelBox& box) const {
    if (!any_) {
        return false;
    }
    const int wider = average_ ? 0 : 1;
    const int x0 = std::max(box.x0 - wider, 0);
    const int y0 = std::max(box.y0 - wider, 0);
    const int x1 = std::min(box.x1 + wider, width_);
    const int y1 = std::min(box.y1 + wider, height_);
    const auto at = [&](int x, int y) {
        return sums_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_ + 1) + static_cast<std::size_t>(x)];
    };
    const double sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
    if (average_) {
        return sum >= stop_ * static_cast<double>(x1 - x0) * static_cast<double>(y1 - y0);
    }
    return sum < 0.5;
}

} // namespace sheetsplat::backend_gl

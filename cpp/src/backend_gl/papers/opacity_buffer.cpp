#include "papers/opacity_buffer.hpp"

#include <algorithm>

#include "tile_scope.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// [NM05] section 4.4: the opacity buffer is brought up to date every ten slices.
constexpr std::int64_t period = 10;

} // namespace

OpacityBuffer::OpacityBuffer(int width, int height, double opacity_stop, int wider)
    : width_(width), height_(height), wider_(wider), stop_(opacity_stop),
      sums_(static_cast<std::size_t>(width + 1) * static_cast<std::size_t>(height + 1), 0.0) {}

// The comparison is the shader's own: in float32.
double OpacityBuffer::measure(float alpha) const { return alpha >= static_cast<float>(stop_) ? 0.0 : 1.0; }

bool OpacityBuffer::is_opaque(double sum, double /*pixels*/) const { return sum < 0.5; }

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
            sum += measure(alpha);
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
    const int x0 = std::max(box.x0 - wider_, 0);
    const int y0 = std::max(box.y0 - wider_, 0);
    const int x1 = std::min(box.x1 + wider_, width_);
    const int y1 = std::min(box.y1 + wider_, height_);
    const auto at = [&](int x, int y) {
        return sums_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_ + 1) + static_cast<std::size_t>(x)];
    };
    const double sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
    return is_opaque(sum, static_cast<double>(x1 - x0) * static_cast<double>(y1 - y0));
}

OpacityCulling::OpacityCulling(const TileScope& scope) : scope_(scope) {
    if (!scope.plan.opacity_buffer) {
        return;
    }
    const int width = scope.tile.target_width();
    const int height = scope.tile.target_height();
    const double stop = scope.job.scene->opacity_stop;
    buffer_ = scope.hooks.opacity_buffer(width, height, stop);
    if (buffer_ == nullptr) {
        buffer_ = std::make_unique<OpacityBuffer>(width, height, stop);
    }
    readback_ = gl::AsyncReadback(scope.gl, width, height);
}

void OpacityCulling::update(std::int64_t pass) {
    if (buffer_ == nullptr) {
        return;
    }
    if (readback_.pending() && readback_.ready()) {
        readback_.fetch(pixels_);
        buffer_->update(pixels_.data());
    }
    const std::int64_t slices = (pass + 1) * scope_.steps.stride;
    if (!readback_.pending() && slices - last_slices_ >= period) {
        last_slices_ = slices;
        scope_.targets.bind_image();
        readback_.start();
    }
}

} // namespace sheetsplat::backend_gl

// The rays of the pixels in eye space. Source: conventions, section 1.
#pragma once

#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat::reference {

/// Pixels are numbered from -1 to width (height): one pixel of border on every side, for the gradients of the pixels at
/// the edge.
class Screen {
  public:
    Screen(const Camera& camera, Size size);

    [[nodiscard]] int width() const { return size_.width; }
    [[nodiscard]] int height() const { return size_.height; }
    [[nodiscard]] bool perspective() const { return perspective_; }

    /// Where a pixel is: from the optical axis, right and up, in half heights (half widths) of the picture.
    [[nodiscard]] double ndc_x(int column) const { return ndc_x_[static_cast<std::size_t>(column + 1)]; }
    [[nodiscard]] double ndc_y(int row) const { return ndc_y_[static_cast<std::size_t>(row + 1)]; }
    /// Half the picture's height (width) in world units at a depth.
    [[nodiscard]] double half_height(double depth) const { return perspective_ ? half_height_ * depth : half_height_; }
    [[nodiscard]] double half_width(double depth) const { return half_height(depth) * aspect_; }
    /// World units from one pixel to the next at a depth, both ways.
    [[nodiscard]] double pixel_width(double depth) const { return 2.0 * half_height(depth) / size_.height; }

    /// X and Y: how far the pixel's ray moves sideways per unit of depth; 0 in orthographic.
    [[nodiscard]] double slope_x(int column) const {
        return perspective_ ? ndc_x(column) * half_height_ * aspect_ : 0.0;
    }
    [[nodiscard]] double slope_y(int row) const { return perspective_ ? ndc_y(row) * half_height_ : 0.0; }
    /// Where the pixel's ray is at a depth, eye space.
    [[nodiscard]] Vec3 point(int column, int row, double depth) const {
        return {ndc_x(column) * half_width(depth), ndc_y(row) * half_height(depth), -depth};
    }
    /// s: length of the pixel's ray per unit of depth, 1 / cos theta.
    [[nodiscard]] double secant(int column, int row) const;
    /// Unit vector from anything on the pixel's ray towards the camera.
    [[nodiscard]] Vec3 to_viewer(int column, int row) const;

    /// Pixels from first to last; none where first > last.
    struct Span {
        int first = 0, last = -1;
        [[nodiscard]] bool empty() const { return first > last; }
    };
    /// The columns (rows) whose rays pass between two values of x (y), eye space, somewhere at depths from `front` to
    /// `back`. Never too small, at times a little too large.
    [[nodiscard]] Span columns(double lower, double upper, double front, double back) const;
    [[nodiscard]] Span rows(double lower, double upper, double front, double back) const;

  private:
    Size size_;
    bool perspective_;
    double half_height_; ///< of the picture: in world units, or per unit of depth in perspective
    double aspect_;
    Vec2 shift_; ///< of the picture's middle, ndc
    std::vector<double> ndc_x_, ndc_y_;
};

} // namespace sheetsplat::reference

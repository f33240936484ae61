// The transfer function: scalar -> colour and opacity, linear between points. Source: conventions, section 4.
#pragma once

#include <array>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// One point: the colour is not multiplied by the opacity; opacity is per reference length, in [0, 1].
struct TransferPoint {
    double value = 0.0;
    Vec3 color{0.0};
    double opacity = 0.0;
};

/// Piecewise linear, clamped beyond its first and last point; of two points at one value the later holds from there on.
class TransferFunction {
  public:
    /// Throws InvalidInput for no points, values that fall, numbers that are not finite, opacity outside [0, 1].
    explicit TransferFunction(std::vector<TransferPoint> points);

    [[nodiscard]] const std::vector<TransferPoint>& points() const { return points_; }
    [[nodiscard]] double v_min() const { return points_.front().value; }
    [[nodiscard]] double v_max() const { return points_.back().value; }

    /// Colour and opacity at a value.
    [[nodiscard]] TransferPoint at(double value) const;
    /// True where opacity is 0 everywhere in [lower, upper] (limits from both sides of a step included).
    [[nodiscard]] bool transparent_over(double lower, double upper) const;
    /// Largest opacity anywhere.
    [[nodiscard]] double max_opacity() const;
    /// True where two points share a value but not their colour and opacity.
    [[nodiscard]] bool has_steps() const;
    /// Largest slope of opacity and of any colour channel between points, per unit of value.
    [[nodiscard]] double steepest() const;

  private:
    std::vector<TransferPoint> points_;
};

} // namespace sheetsplat

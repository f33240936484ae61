// rho -> colour and opacity of a slice or an interval. Source: conventions, section 4; [EKE01] for intervals.
#pragma once

#include <array>

#include "sheetsplat/transfer_function.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat::reference {

struct ColorOpacity {
    Vec3 color{0.0};
    double opacity = 0.0;
};

/// The transfer function at a value: opacity per reference length.
ColorOpacity look_up(const TransferFunction& function, double value);

/// alpha = 1 - (1 - a)^lengths for a path of so many reference lengths.
double opacity_over(double opacity, double lengths);

/// Colour and alpha of the interval in which rho goes linearly from `front` to `back`, over a path of so many reference
/// lengths.
ColorOpacity preintegrate(const TransferFunction& function, double front, double back, double lengths);

/// The same of second order: rho on the slices n - 1 to n + 2 says how it bends between n and n + 1, and a step of
/// Romberg's from the interval to its halves how far attenuation inside it matters. Source: project page of
/// conventions, section 10. Opacity 0 where nothing is left.
ColorOpacity preintegrate_second_order(const TransferFunction& function, const std::array<double, 4>& rho,
                                       double lengths);

} // namespace sheetsplat::reference

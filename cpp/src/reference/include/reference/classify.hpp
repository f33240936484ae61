// rho -> colour and opacity of a slice or an interval. Source: IMAGE FORMATION section 4; [EKE01] for intervals.
#pragma once

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

} // namespace sheetsplat::reference

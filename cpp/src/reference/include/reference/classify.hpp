// rho -> colour and opacity of a slice or an interval. Source: conventions, section 4; [EKE01] for intervals.
#pragma once

#include <array>
#include <vector>

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

/// -ln(1 - a), a held below 1: what weights the colours of groups.
double extinction_of(double opacity);

/// What groups of fields show together at one point or in one interval: 1 - alpha is the product of theirs, and the
/// colour the mean of theirs by extinction.
class Mixture {
  public:
    /// A group: its shaded colour, -ln(1 - alpha) over the path, and the weight of its colour.
    void add(const Vec3& color, double extinction, double weight);
    [[nodiscard]] double opacity() const;
    [[nodiscard]] Vec3 color() const;

  private:
    struct Part {
        Vec3 color;
        double weight;
    };
    std::vector<Part> parts_;
    double extinction_ = 0.0, weight_ = 0.0;
};

/// Means over an interval in which rho goes linearly from `front` to `back`.
struct ColorExtinction {
    Vec3 color{0.0};         ///< mean(tau c) / mean(tau); 0 without extinction
    double extinction = 0.0; ///< mean(tau) times the reference length
};
ColorExtinction mean_over_ramp(const TransferFunction& function, double front, double back);

/// Colour and alpha of such an interval over a path of so many reference lengths.
ColorOpacity preintegrate(const TransferFunction& function, double front, double back, double lengths);

/// The same of second order: rho on the slices n - 1 to n + 2 says how it bends between n and n + 1, and a step of
/// Romberg's from the interval to its halves how far attenuation inside it matters. Source: conventions,
/// section 10. Opacity 0 where nothing is left.
ColorOpacity preintegrate_second_order(const TransferFunction& function, const std::array<double, 4>& rho,
                                       double lengths);

} // namespace sheetsplat::reference

// The mass of a kernel in closed form. Source: conventions, section 2.
#include <cmath>

#include "sheetsplat/field.hpp"

namespace sheetsplat {
namespace {

constexpr double pi = 3.14159265358979323846;

// With k the falloff, integration by parts turns the mass into
//     M = 4 pi gain (I - exp(-k)/3),   I = integral of r^2 exp(-k r^2) over 0..1 = sqrt(pi) erf(sqrt k) / (4 k^1.5) -
//     exp(-k) / (2k)
//       = 4 pi gain (2k/3) J,          J = integral of r^4 exp(-k r^2) over 0..1 = exp(-k) sum_m (2k)^m / (5 7 9 ...
//       (2m+5))
// The first form loses digits as k -> 0, where I and exp(-k)/3 agree; in the series all terms are positive.

double mass_by_erf(double k, double gain) {
    const double edge = std::exp(-k);
    const double root = std::sqrt(k);
    return 4.0 * pi * gain * (std::sqrt(pi) * std::erf(root) / (4.0 * k * root) - edge / (2.0 * k) - edge / 3.0);
}

double mass_by_series(double k, double gain) {
    double term = 1.0 / 5.0;
    double sum = term;
    for (int m = 1; term > 1e-18 * sum; ++m) {
        term *= 2.0 * k / (2.0 * m + 5.0);
        sum += term;
    }
    // gain k tends to 1: taken together they neither overflow nor vanish.
    return 4.0 * pi * (gain * k) * (2.0 / 3.0) * std::exp(-k) * sum;
}

/// Above it the first form loses less than one digit.
constexpr double series_below = 2.0;

} // namespace

double Kernel::unit_mass() const {
    return falloff < series_below ? mass_by_series(falloff, gain()) : mass_by_erf(falloff, gain());
}

} // namespace sheetsplat

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "sheetsplat/field.hpp"

namespace sheetsplat {
namespace {

constexpr long double pi = 3.14159265358979323846264338327950288L;

/// 4 pi times the integral of r^2 g(r) over 0..1 by Gauss-Legendre with 5 points in each of 400 panels, in long double.
double mass_by_quadrature(double falloff) {
    static constexpr long double nodes[5] = {
        0.0L, 0.538469310105683091036314420700208805L, -0.538469310105683091036314420700208805L,
        0.906179845938663992797626878299392965L, -0.906179845938663992797626878299392965L};
    static constexpr long double weights[5] = {
        0.568888888888888888888888888888888889L, 0.478628670499366468041291514835638193L,
        0.478628670499366468041291514835638193L, 0.236926885056189087514264040719917363L,
        0.236926885056189087514264040719917363L};
    constexpr int panels = 400;
    const long double k = falloff;
    long double sum = 0.0L;
    for (int panel = 0; panel < panels; ++panel) {
        for (int n = 0; n < 5; ++n) {
            const long double r = (panel + 0.5L * (1.0L + nodes[n])) / panels;
            // exp(-k r^2) - exp(-k) = exp(-k) expm1(k (1 - r^2)) keeps its digits for small k.
            const long double profile = std::exp(-k) * std::expm1(k * (1.0L - r * r)) / -std::expm1(-k);
            sum += weights[n] * r * r * profile / (2.0L * panels);
        }
    }
    return static_cast<double>(4.0L * pi * sum);
}

TEST(Kernel, mass_is_the_integral_over_the_ball) {
    for (double k = 1e-6; k <= 50.0; k *= 1.1) {
        const double expected = mass_by_quadrature(k);
        EXPECT_NEAR(Kernel{k}.unit_mass() / expected, 1.0, 8e-15) << "falloff " << k;
    }
    // Negative control: the tolerance tells falloffs apart that differ by 1e-13.
    EXPECT_GT(std::abs(Kernel{5.0 * (1.0 + 1e-13)}.unit_mass() / mass_by_quadrature(5.0) - 1.0), 8e-15);
}

TEST(Kernel, mass_has_its_limits) {
    // k -> 0: g tends to 1 - r^2, whose mass is 8 pi / 15, by an amount of the order of k.
    EXPECT_NEAR(Kernel{1e-12}.unit_mass(), static_cast<double>(8.0L * pi / 15.0L), 1e-12);
    // k -> infinity: a whole Gaussian, (pi / k)^1.5.
    EXPECT_NEAR(Kernel{500.0}.unit_mass() / std::pow(static_cast<double>(pi) / 500.0, 1.5), 1.0, 1e-13);
}

TEST(Kernel, mass_is_continuous_where_its_forms_meet) {
    const double below = Kernel{std::nextafter(2.0, 0.0)}.unit_mass();
    const double above = Kernel{2.0}.unit_mass();
    EXPECT_NEAR(below / above, 1.0, 8e-15);
}

TEST(Kernel, gain_makes_the_centre_one) {
    for (const double k : {1e-9, 0.1, 5.0, 8.0, 30.0}) {
        const Kernel kernel{k};
        EXPECT_NEAR((-std::expm1(-k)) * kernel.gain(), 1.0, 4e-16) << k;
        EXPECT_EQ(kernel.edge(), std::exp(-k));
    }
}

} // namespace
} // namespace sheetsplat

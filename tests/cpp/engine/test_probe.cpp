// How pictures approach the converged one, by pictures whose errors are known.
#include "probe.hpp"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace sheetsplat {
namespace {

constexpr std::size_t pixels = 20000;

Image picture(const std::vector<double>& error) {
    Image image;
    image.size = {static_cast<int>(error.size()), 1};
    for (const double one : error) {
        image.scalar.push_back(static_cast<float>(0.5 + one));
    }
    return image;
}

/// Errors of three pictures that fall by a factor, neighbours alike to a degree.
std::vector<Image> series(double factor, double alike) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::vector<std::vector<double>> errors(3, std::vector<double>(pixels));
    for (std::size_t i = 0; i < pixels; ++i) {
        double one = normal(random);
        for (std::size_t n = 0; n < 3; ++n) {
            errors[n][i] = 0.01 * std::pow(factor, static_cast<double>(n)) * one;
            one = alike * one + std::sqrt(1.0 - alike * alike) * normal(random);
        }
    }
    return {picture(errors[0]), picture(errors[1]), picture(errors[2])};
}

TEST(Approach, FindsOrderAndLikenessOfErrors) {
    for (const double factor : {0.25, 0.5}) {
        for (const double alike : {1.0, 0.8, 0.5, 0.0}) {
            const std::vector<Image> drawn = series(factor, alike);
            const Approach found = approach(drawn[0], drawn[1], drawn[2]);
            EXPECT_NEAR(found.factor, factor, 0.02) << factor << ' ' << alike;
            EXPECT_NEAR(found.alike, alike, 0.1) << factor << ' ' << alike;
            // The step from the second picture to the third one tells the error of the second.
            const double error = distance(drawn[1], picture(std::vector<double>(pixels, 0.0)));
            EXPECT_NEAR(distance(drawn[1], drawn[2]) / found.share(), error, 0.05 * error) << factor << ' ' << alike;
        }
    }
}

TEST(Approach, EqualPicturesHaveNoError) {
    const Image same = picture(std::vector<double>(8, 0.1));
    EXPECT_EQ(approach(same, same, same).factor, 0.0);
}

} // namespace
} // namespace sheetsplat

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/transfer_function.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TransferPoint point(double value, double opacity) { return {value, Vec3(opacity, 2.0 * opacity, 0.25), opacity}; }

TransferFunction opacities(const std::vector<std::pair<double, double>>& points) {
    std::vector<TransferPoint> result;
    for (const auto& [value, opacity] : points) {
        result.push_back(point(value, opacity));
    }
    return TransferFunction(result);
}

TEST(TransferFunction, is_linear_between_and_clamped_beyond) {
    const TransferFunction f({{1.0, {0.0, 1.0, 0.5}, 0.2}, {3.0, {1.0, 0.0, 0.5}, 0.8}});
    EXPECT_DOUBLE_EQ(f.at(1.5).opacity, 0.35);
    EXPECT_DOUBLE_EQ(f.at(1.5).color.x, 0.25);
    EXPECT_DOUBLE_EQ(f.at(1.5).color.y, 0.75);
    EXPECT_EQ(f.at(1.5).color.z, 0.5);
    EXPECT_EQ(f.at(1.5).value, 1.5);
    EXPECT_EQ(f.at(-100.0).opacity, 0.2);
    EXPECT_EQ(f.at(-100.0).color, Vec3(0.0, 1.0, 0.5));
    EXPECT_EQ(f.at(100.0).opacity, 0.8);
    EXPECT_EQ(f.at(infinity).opacity, 0.8);
    EXPECT_EQ(f.at(-infinity).opacity, 0.2);
    EXPECT_EQ(f.v_min(), 1.0);
    EXPECT_EQ(f.v_max(), 3.0);
}

TEST(TransferFunction, points_are_met_exactly_and_nothing_leaves_their_range) {
    std::uint32_t state = 7;
    const auto random = [&state] {
        state = state * 1664525U + 1013904223U;
        return static_cast<double>(state >> 8) / 16777216.0;
    };
    std::vector<TransferPoint> points;
    double value = -3.0;
    for (int n = 0; n < 50; ++n) {
        value += 1e-3 + random();
        points.push_back({value, {random(), random(), random()}, n % 7 == 0 ? 1.0 : random()});
    }
    const TransferFunction f(points);
    for (std::size_t n = 0; n < points.size(); ++n) {
        EXPECT_EQ(f.at(points[n].value).opacity, points[n].opacity);
        EXPECT_EQ(f.at(points[n].value).color, points[n].color);
        if (n + 1 < points.size()) {
            const double just_before = std::nextafter(points[n + 1].value, -infinity);
            EXPECT_GE(f.at(just_before).opacity, std::min(points[n].opacity, points[n + 1].opacity));
            EXPECT_LE(f.at(just_before).opacity, std::max(points[n].opacity, points[n + 1].opacity));
            EXPECT_NEAR(f.at(just_before).opacity, points[n + 1].opacity, 1e-11);
        }
    }
}

TEST(TransferFunction, rounding_does_not_leave_the_range) {
    // The place between the two points rounds to 1, and 0.06 + (0.87 - 0.06) to more than 0.87.
    EXPECT_EQ(opacities({{-1.0, 0.06}, {1e-20, 0.87}}).at(0.0).opacity, 0.87);
}

TEST(TransferFunction, of_points_at_one_value_the_last_holds_from_there_on) {
    const TransferFunction f = opacities({{0.0, 0.1}, {1.0, 0.2}, {1.0, 0.9}, {1.0, 0.6}, {2.0, 0.8}});
    EXPECT_EQ(f.at(1.0).opacity, 0.6);
    EXPECT_NEAR(f.at(std::nextafter(1.0, 0.0)).opacity, 0.2, 1e-15);
    EXPECT_DOUBLE_EQ(f.at(1.5).opacity, 0.7);
    EXPECT_DOUBLE_EQ(f.at(0.5).opacity, 0.15);
    // Steps at the ends: below the first value the first point holds, from the last value on the last.
    const TransferFunction ends = opacities({{0.0, 0.1}, {0.0, 0.5}, {1.0, 0.5}, {1.0, 0.3}});
    EXPECT_EQ(ends.at(-1e-300).opacity, 0.1);
    EXPECT_EQ(ends.at(0.0).opacity, 0.5);
    EXPECT_EQ(ends.at(0.999).opacity, 0.5);
    EXPECT_EQ(ends.at(1.0).opacity, 0.3);
}

TEST(TransferFunction, one_point_holds_everywhere) {
    const TransferFunction f = opacities({{5.0, 0.5}});
    EXPECT_EQ(f.at(-9.0).opacity, 0.5);
    EXPECT_EQ(f.at(5.0).opacity, 0.5);
    EXPECT_EQ(f.at(9.0).opacity, 0.5);
    EXPECT_EQ(f.max_opacity(), 0.5);
    EXPECT_EQ(f.steepest(), 0.0);
    EXPECT_FALSE(f.has_steps());
    EXPECT_FALSE(f.transparent_over(0.0, 1.0));
    EXPECT_TRUE(opacities({{5.0, 0.0}}).transparent_over(0.0, 10.0));
}

TEST(TransferFunction, transparent_over_ramps) {
    const TransferFunction f = opacities({{1.0, 0.0}, {2.0, 0.0}, {3.0, 0.5}, {4.0, 0.0}, {5.0, 0.0}});
    EXPECT_TRUE(f.transparent_over(-infinity, 2.0));
    EXPECT_TRUE(f.transparent_over(1.5, 2.0));
    EXPECT_TRUE(f.transparent_over(2.0, 2.0));
    EXPECT_TRUE(f.transparent_over(4.0, 4.0));
    EXPECT_TRUE(f.transparent_over(4.0, infinity));
    EXPECT_FALSE(f.transparent_over(2.0, std::nextafter(2.0, 3.0)));
    EXPECT_FALSE(f.transparent_over(std::nextafter(4.0, 3.0), 4.0));
    EXPECT_FALSE(f.transparent_over(2.5, 2.5));
    EXPECT_FALSE(f.transparent_over(3.0, 3.0));
    EXPECT_FALSE(f.transparent_over(2.0, 4.0));
    EXPECT_FALSE(f.transparent_over(0.0, 9.0));
    EXPECT_FALSE(f.transparent_over(-infinity, infinity));
}

TEST(TransferFunction, transparent_over_counts_the_limits_of_both_sides_of_a_step) {
    const TransferFunction rise = opacities({{1.0, 0.0}, {2.0, 0.0}, {2.0, 0.5}, {3.0, 0.5}});
    EXPECT_TRUE(rise.transparent_over(0.0, std::nextafter(2.0, 0.0)));
    EXPECT_FALSE(rise.transparent_over(0.0, 2.0));
    const TransferFunction fall = opacities({{1.0, 0.5}, {2.0, 0.5}, {2.0, 0.0}, {3.0, 0.0}});
    EXPECT_FALSE(fall.transparent_over(2.0, 2.5)); // at(2) is 0, its limit from below is not
    EXPECT_EQ(fall.at(2.0).opacity, 0.0);
    EXPECT_TRUE(fall.transparent_over(std::nextafter(2.0, 3.0), 100.0));
    // A point between two others at one value shows nowhere.
    const TransferFunction hidden = opacities({{1.0, 0.0}, {2.0, 0.0}, {2.0, 0.9}, {2.0, 0.0}, {3.0, 0.0}});
    EXPECT_TRUE(hidden.transparent_over(0.0, 4.0));
    EXPECT_EQ(hidden.max_opacity(), 0.0);
    // Steps at the ends.
    const TransferFunction ends = opacities({{0.0, 0.0}, {0.0, 0.5}, {1.0, 0.5}, {1.0, 0.0}});
    EXPECT_TRUE(ends.transparent_over(-1.0, -1e-300));
    EXPECT_FALSE(ends.transparent_over(-1.0, 0.0));
    EXPECT_FALSE(ends.transparent_over(1.0, 2.0));
    EXPECT_TRUE(ends.transparent_over(1.0 + 1e-15, 2.0));
    const TransferFunction edge = opacities({{0.0, 0.5}, {0.0, 0.0}, {1.0, 0.0}, {1.0, 0.5}});
    EXPECT_FALSE(edge.transparent_over(-2.0, -1.0));
    EXPECT_FALSE(edge.transparent_over(0.0, 0.5));
    EXPECT_TRUE(edge.transparent_over(0.1, 0.9));
    EXPECT_FALSE(edge.transparent_over(0.1, 1.0));
    EXPECT_FALSE(edge.transparent_over(2.0, 3.0));
    // All points at one value.
    const TransferFunction jump = opacities({{1.0, 0.0}, {1.0, 0.5}});
    EXPECT_TRUE(jump.transparent_over(0.0, 0.9));
    EXPECT_FALSE(jump.transparent_over(0.0, 1.0));
    EXPECT_FALSE(jump.transparent_over(1.0, 2.0));
}

TEST(TransferFunction, transparent_over_sees_opacities_that_round_to_0) {
    const TransferFunction f = opacities({{0.0, 0.0}, {1.0, 5e-324}});
    EXPECT_EQ(f.at(0.25).opacity, 0.0);
    EXPECT_FALSE(f.transparent_over(0.0, 0.25));
}

TEST(TransferFunction, transparent_over_nonsense_drops_nothing) {
    const TransferFunction f = opacities({{0.0, 0.0}});
    EXPECT_FALSE(f.transparent_over(nan, 1.0));
    EXPECT_FALSE(f.transparent_over(0.0, nan));
    EXPECT_FALSE(f.transparent_over(1.0, 0.0));
}

TEST(TransferFunction, transparent_over_agrees_with_looking) {
    std::uint32_t state = 99;
    const auto random = [&state](std::uint32_t below) {
        state = state * 1664525U + 1013904223U;
        return (state >> 8) % below;
    };
    int transparent = 0;
    for (int trial = 0; trial < 2000; ++trial) {
        std::vector<std::pair<double, double>> points;
        double value = 0.0;
        for (std::uint32_t n = 0; n <= random(6); ++n) {
            points.emplace_back(value, random(3) == 0 ? 0.5 : 0.0);
            value += random(3);
        }
        const TransferFunction f = opacities(points);
        const double lower = 0.5 * random(20) - 1.0;
        const double upper = lower + 0.5 * random(8);
        // Looking a little beyond both ends sees the limits from both sides.
        bool seen = false;
        for (double v = lower; v <= upper; v += 0.25) {
            seen = seen || f.at(v).opacity > 0.0;
        }
        for (const auto& p : f.points()) {
            if (lower <= p.value && p.value <= upper) {
                // 1e-9 beside a point only a step is left of a slope: less than 1e-8 of the opacity.
                seen = seen || f.at(p.value).opacity > 0.0 || f.at(p.value - 1e-9).opacity > 1e-8 ||
                       f.at(p.value + 1e-9).opacity > 1e-8;
            }
        }
        EXPECT_EQ(f.transparent_over(lower, upper), !seen) << trial;
        transparent += seen ? 0 : 1;
    }
    EXPECT_GT(transparent, 200);
    EXPECT_LT(transparent, 1800);
}

TEST(TransferFunction, has_steps) {
    EXPECT_FALSE(opacities({{0.0, 0.0}, {1.0, 1.0}}).has_steps());
    EXPECT_FALSE(opacities({{0.0, 0.5}, {0.0, 0.5}, {1.0, 1.0}}).has_steps());
    EXPECT_TRUE(opacities({{0.0, 0.5}, {0.0, 0.6}, {1.0, 1.0}}).has_steps());
    EXPECT_TRUE(TransferFunction({{0.0, Vec3(0.0), 0.5}, {0.0, Vec3(0.0, 0.0, 0.1), 0.5}}).has_steps());
}

TEST(TransferFunction, steepest_looks_at_opacity_and_every_channel_but_not_at_steps) {
    EXPECT_DOUBLE_EQ(TransferFunction({{0.0, Vec3(0.5), 0.0}, {2.0, Vec3(0.5), 1.0}, {3.0, Vec3(0.5), 0.2}}).steepest(),
                     0.8);
    for (int channel = 0; channel < 3; ++channel) {
        Vec3 dark(0.0);
        dark[channel] = -0.5;
        EXPECT_DOUBLE_EQ(TransferFunction({{0.0, Vec3(0.0), 0.0}, {0.25, dark, 0.1}}).steepest(), 2.0) << channel;
    }
    EXPECT_DOUBLE_EQ(opacities({{0.0, 0.0}, {1.0, 0.0}, {1.0, 0.5}, {2.0, 0.5}}).steepest(), 0.0);
    EXPECT_EQ(opacities({{0.0, 0.0}, {1.0, 0.3}, {1.0, 0.7}}).max_opacity(), 0.7);
}

TEST(TransferFunction, refuses_what_has_no_meaning) {
    const auto refused = [](const std::vector<TransferPoint>& points) {
        return message_of<InvalidInput>([&] { const TransferFunction f(points); });
    };
    expect_parts(refused({}), {"no points", "at least one point"});
    expect_parts(refused({point(0.0, 0.0), point(2.0, 0.0), point(1.0, 0.0)}),
                 {"not sorted", "value 1 of point 2 after value 2", "sort the points"});
    expect_parts(refused({point(0.0, 0.0), point(1.0, 1.5)}), {"point 1 at value 1", "opacity 1.5", "from 0 to 1"});
    expect_parts(refused({point(0.0, -0.1)}), {"point 0", "opacity -0.1"});
    expect_parts(refused({point(nan, 0.0)}), {"value NaN", "finite"});
    expect_parts(refused({point(0.0, nan)}), {"opacity NaN"});
    expect_parts(refused({point(infinity, 0.0)}), {"value infinity"});
    expect_parts(refused({{0.0, {0.0, nan, 0.0}, 0.0}}), {"colour (0, NaN, 0)"});
    expect_parts(refused({point(-1.7e308, 0.0), point(1.7e308, 0.0)}), {"difference"});
}

} // namespace
} // namespace sheetsplat

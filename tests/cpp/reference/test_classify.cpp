// Opacity, intervals and compositing against closed forms.
#include "reference/classify.hpp"

#include <gtest/gtest.h>

#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr double limit = 1.0 - 0x1p-24;

/// One opacity and colour for every value.
TransferFunction constant_function(double opacity) {
    return TransferFunction({{0.0, Vec3(0.8, 0.4, 0.2), opacity}, {1.0, Vec3(0.8, 0.4, 0.2), opacity}});
}

/// A volume whose support is 8 deep at the middle of the picture: 5 samples of radius 2.
Scene homogeneous(double opacity, double spacing, double reference_length = 1.0) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = Vec3(-2.0);
    Scene scene = make_scene(make_field(sampled({5, 5, 5}, [](int, int, int) { return 1.0; }), {5, 5, 5}, options),
                             constant_function(opacity));
    scene.slice_spacing = spacing;
    scene.reference_length = reference_length;
    return scene;
}

constexpr double homogeneous_depth = 8.0;

std::array<double, 4> middle(const Picture& picture) {
    const std::size_t at =
        4 * static_cast<std::size_t>((picture.size.height / 2) * picture.size.width + picture.size.width / 2);
    return {picture.rgba[at], picture.rgba[at + 1], picture.rgba[at + 2], picture.rgba[at + 3]};
}

/// Means over the ramp by nothing but values of the function.
ColorOpacity interval_by_quadrature(const TransferFunction& function, double front, double back, double lengths,
                                    double tolerance) {
    const auto extinction = [&](double v) { return -std::log1p(-std::min(look_up(function, v).opacity, limit)); };
    // The ramp is cut where the function or the limit bends it.
    std::vector<double> ends{front, back};
    const auto& points = function.points();
    for (std::size_t n = 0; n < points.size(); ++n) {
        ends.push_back(points[n].value);
        if (n > 0 && points[n].opacity != points[n - 1].opacity) {
            const double x = (limit - points[n - 1].opacity) / (points[n].opacity - points[n - 1].opacity);
            ends.push_back(points[n - 1].value + x * (points[n].value - points[n - 1].value));
        }
    }
    const double lower = std::min(front, back), upper = std::max(front, back);
    for (double& end : ends) {
        end = std::clamp(end, lower, upper);
    }
    std::sort(ends.begin(), ends.end());
    double mean = 0.0;
    Vec3 color(0.0);
    for (std::size_t n = 0; n + 1 < ends.size(); ++n) {
        if (ends[n] < ends[n + 1]) {
            // Inside the part, so that a step at its end counts with its limit from this side.
            const double from = ends[n], to = ends[n + 1], share = (to - from) / (upper - lower);
            const auto inside = [&](double x) { return from + x * (to - from); };
            mean += share * integrate([&](double x) { return extinction(inside(x)); }, 0.0, 1.0, tolerance);
            for (int c = 0; c < 3; ++c) {
                color[c] +=
                    share *
                    integrate([&](double x) { return extinction(inside(x)) * look_up(function, inside(x)).color[c]; },
                              0.0, 1.0, tolerance);
            }
        }
    }
    return {color / mean, -std::expm1(-lengths * mean)};
}

double relative_difference(const ColorOpacity& a, const ColorOpacity& b) {
    double largest = std::abs(a.opacity / b.opacity - 1.0);
    for (int c = 0; c < 3; ++c) {
        largest = std::max(largest, std::abs(a.color[c] - b.color[c]));
    }
    return largest;
}

} // namespace

TEST(LookUp, ClampsInterpolatesAndSteps) {
    const TransferFunction function(
        {{1.0, Vec3(0.1), 0.1}, {2.0, Vec3(0.2), 0.2}, {2.0, Vec3(0.9), 0.8}, {4.0, Vec3(0.5), 0.4}});
    EXPECT_EQ(look_up(function, -5.0).opacity, 0.1);
    EXPECT_EQ(look_up(function, 1.0).opacity, 0.1);
    EXPECT_DOUBLE_EQ(look_up(function, 1.5).opacity, 0.15);
    EXPECT_NEAR(look_up(function, std::nextafter(2.0, 0.0)).opacity, 0.2, 1e-15);
    EXPECT_EQ(look_up(function, 2.0).opacity, 0.8);
    EXPECT_DOUBLE_EQ(look_up(function, 3.0).opacity, 0.6);
    EXPECT_DOUBLE_EQ(look_up(function, 3.0).color.x, 0.7);
    EXPECT_EQ(look_up(function, 9.0).opacity, 0.4);
    const TransferFunction step_first({{0.0, Vec3(0.0), 0.1}, {0.0, Vec3(1.0), 0.5}});
    EXPECT_EQ(look_up(step_first, -1e-300).opacity, 0.1);
    EXPECT_EQ(look_up(step_first, 0.0).opacity, 0.5);
}

TEST(Opacity, KeepsItsDigits) {
    EXPECT_EQ(opacity_over(0.0, 3.0), 0.0);
    EXPECT_EQ(opacity_over(1.0, 1e-9), 1.0);
    EXPECT_NEAR(opacity_over(1e-12, 0.5) / 5e-13, 1.0, 1e-11);
    EXPECT_NEAR(opacity_over(1e-300, 2.0) / 2e-300, 1.0, 1e-15);
    EXPECT_NEAR(opacity_over(0.36, 0.5), 0.2, 1e-16);
    EXPECT_NEAR(1.0 - opacity_over(limit, 1.0), 0x1p-24, 1e-22);
    // What a formula without expm1 and log1p would have made of it.
    EXPECT_GT(std::abs((1.0 - std::pow(1.0 - 1e-12, 0.5)) / 5e-13 - 1.0), 1e-6);
}

TEST(BeerLambert, HomogeneousSlabAtAnySpacing) {
    const Camera camera = front_camera(2.0);
    for (const double opacity : {1e-12, 1e-3, 0.3, 0.9, 0.999999}) {
        for (const double length : {1.0, 0.7}) {
            const double expected = -std::expm1(homogeneous_depth / length * std::log1p(-opacity));
            for (const double spacing : {0.125, 0.5, 1.0, 2.0, 4.0}) {
                for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                    for (const bool preintegration : {false, true}) {
                        Scene scene = homogeneous(opacity, spacing, length);
                        scene.sampling = sampling;
                        scene.preintegration = preintegration;
                        const auto rgba = middle(render(scene, camera, Size{3, 3}));
                        // Intervals reach half a slice beyond the first slice and the last.
                        const double depth = homogeneous_depth + (preintegration ? spacing : 0.0);
                        const double there =
                            preintegration ? -std::expm1(depth / length * std::log1p(-opacity)) : expected;
                        EXPECT_NEAR(rgba[3] / there, 1.0, 1e-12) << opacity << " " << spacing;
                        EXPECT_NEAR(rgba[0] / (0.8 * there), 1.0, 1e-12);
                    }
                }
            }
        }
    }
    // Without the correction for the distance of slices the opacity is far off.
    EXPECT_GT(std::abs(1.0 - std::pow(0.7, 16.0) - (1.0 - std::pow(0.7, 8.0))), 1e-3);
}

TEST(BeerLambert, OpaqueIsOpaque) {
    const auto rgba = middle(render(homogeneous(1.0, 0.25), front_camera(2.0), Size{3, 3}));
    EXPECT_EQ(rgba[3], 1.0);
    EXPECT_EQ(rgba[0], 0.8);
}

TEST(BeerLambert, ObliqueRaysGoFurther) {
    // A single slice, 18 in front of the eye: alpha of the path's length, s = 1 / cos theta.
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = Vec3(1.0, 1.0, 6.0);
    options.origin = Vec3(-12.0, -12.0, -6.0);
    Scene scene = make_scene(make_field(sampled({3, 25, 25}, [](int, int, int) { return 1.0; }), {3, 25, 25}, options),
                             constant_function(0.2));
    scene.slice_spacing = 10.0;
    scene.reference_length = 1.0;
    const Camera camera = Camera::perspective(Vec3(0.0, 0.0, 3.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 40.0, 10.0);
    const Picture picture = render(scene, camera, Size{5, 5});
    ASSERT_EQ(picture.slices, 1);
    const double h = std::tan(20.0 * pi / 180.0);
    for (int j = 0; j < 5; ++j) {
        for (int i = 0; i < 5; ++i) {
            const double x = h * (2.0 * (i + 0.5) / 5.0 - 1.0), y = h * (1.0 - 2.0 * (j + 0.5) / 5.0);
            const double s = std::sqrt(1.0 + x * x + y * y);
            const double alpha = picture.rgba[static_cast<std::size_t>(4 * (5 * j + i) + 3)];
            EXPECT_NEAR(alpha, 1.0 - std::pow(0.8, 10.0 * s), 1e-14);
            if (i != 2 || j != 2) {
                EXPECT_GT(std::abs(alpha - (1.0 - std::pow(0.8, 10.0))), 1e-6);
            }
        }
    }
}

TEST(Preintegration, ConstantValueIsThePlainFormula) {
    const TransferFunction function = smooth_function();
    for (const double value : {-1.0, 1e-13, 0.1, 0.4, 0.7, 1.0, 3.0}) {
        const ColorOpacity looks = look_up(function, value);
        const ColorOpacity interval = preintegrate(function, value, value, 0.3);
        EXPECT_DOUBLE_EQ(interval.opacity, opacity_over(looks.opacity, 0.3));
        if (looks.opacity > 0.0) {
            EXPECT_LE(glm::length(interval.color - looks.color), 1e-15);
        }
    }
    EXPECT_NEAR(preintegrate(constant_function(1.0), 0.2, 0.7, 1.0).opacity, limit, 1e-15);
}

TEST(Preintegration, TinyIntervalsAreThePlainFormula) {
    const TransferFunction function = smooth_function();
    for (const double value : {1e-9, 0.2, 0.6, 0.99}) {
        for (const double length : {1e-15, 1e-12, 1e-9}) {
            const double end = value + length * value;
            const ColorOpacity looks = look_up(function, 0.5 * (value + end));
            const ColorOpacity interval = preintegrate(function, value, end, 0.3);
            EXPECT_NEAR(interval.opacity / opacity_over(looks.opacity, 0.3), 1.0, 1e-14);
            EXPECT_LE(glm::length(interval.color - looks.color), 1e-14);
        }
    }
}

TEST(Preintegration, IsTheIntegral) {
    const std::vector<TransferFunction> functions{
        smooth_function(),
        TransferFunction(
            {{0.0, Vec3(0.0, 1.0, 0.5), 0.0}, {0.5, Vec3(1.0, 0.0, 0.5), 1.0}, {1.0, Vec3(0.2, 0.3, 0.4), 0.2}}),
        TransferFunction({{0.2, Vec3(0.3), 0.1},
                          {0.3, Vec3(0.9, 0.1, 0.2), 0.1},
                          {0.3, Vec3(0.1, 0.9, 0.2), 0.7},
                          {0.8, Vec3(0.0, 0.0, 1.0), 0.7},
                          {0.8, Vec3(1.0), 1.0},
                          {0.9, Vec3(0.4), 1.0}}),
        TransferFunction({{0.0, Vec3(0.1, 0.2, 0.3), 0.0}, {1.0, Vec3(0.9, 0.8, 0.7), 1e-12}}),
        TransferFunction({{0.0, Vec3(0.1, 0.2, 0.3), 0.4999}, {1.0, Vec3(0.9, 0.8, 0.7), 0.5001}}),
        TransferFunction({{0.0, Vec3(0.1, 0.2, 0.3), 1.0 - 1e-9}, {1.0, Vec3(0.9, 0.8, 0.7), 1.0 - 1e-5}}),
    };
    double worst = 0.0;
    for (const TransferFunction& function : functions) {
        // Where a is nearly 1 its last digit is 10^-9 of 1 - a already.
        const double tolerance = &function == &functions.back() ? 1e-10 : 1e-12;
        for (const double front : {-0.3, 0.0, 0.11, 0.3, 0.45, 0.7, 0.95, 1.4}) {
            for (const double back : {-0.2, 0.05, 0.12, 0.301, 0.5, 0.74, 1.0, 1.3}) {
                const ColorOpacity expected = interval_by_quadrature(function, front, back, 0.01, 1e-3 * tolerance);
                if (!(expected.opacity > 0.0)) {
                    continue;
                }
                const double difference = relative_difference(preintegrate(function, front, back, 0.01), expected);
                EXPECT_LE(difference, tolerance) << front << " " << back << " " << &function - functions.data();
                worst = std::max(worst, difference / tolerance);
                // A ramp that falls has the same means.
                EXPECT_LE(relative_difference(preintegrate(function, back, front, 0.01), expected), tolerance);
            }
        }
    }
    std::printf("intervals: largest relative difference %.2e of the tolerance\n", worst);
    const ColorOpacity right = preintegrate(smooth_function(), 0.1, 0.9, 0.01);
    EXPECT_GT(relative_difference(preintegrate(smooth_function(), 0.1, 0.9 + 1e-9, 0.01), right), 1e-12);
    // The mean of the ends is not the mean of the ramp.
    const ColorOpacity a = look_up(smooth_function(), 0.1), b = look_up(smooth_function(), 0.9);
    EXPECT_GT(std::abs(opacity_over(0.5 * (a.opacity + b.opacity), 0.01) / right.opacity - 1.0), 1e-3);
}

TEST(OpacityStop, PixelsStopOnceItIsReached) {
    // Every slice has alpha 0.3: A is 0.3, 0.51, 0.657, 0.7599 ...
    const auto opacity = [](double stop, double nudge = 0.0) {
        Scene scene = homogeneous(0.3, 1.0);
        scene.opacity_stop = stop;
        Request request;
        request.nudge_stop = nudge;
        return middle(render(scene, front_camera(2.0), Size{1, 1}, request))[3];
    };
    EXPECT_NEAR(opacity(0.2), 0.3, 1e-15);
    EXPECT_NEAR(opacity(0.5), 0.51, 1e-15);
    EXPECT_NEAR(opacity(0.52), 0.657, 1e-15);
    // Reached exactly is reached.
    EXPECT_NEAR(opacity(opacity_over(0.3, 1.0)), 0.3, 1e-15);
    EXPECT_NEAR(opacity(0.65), 0.657, 1e-15);
    EXPECT_NEAR(opacity(0.65, 0.01), 0.7599, 1e-15);
    EXPECT_NEAR(opacity(1.0), 1.0 - std::pow(0.7, 8.0), 1e-15);
    EXPECT_GT(std::abs(opacity(0.65) - opacity(0.66)), 0.1);
}

TEST(Depth, IsWhereOpacityReachesOneHalf) {
    Scene scene = homogeneous(0.3, 1.0);
    Request request;
    request.depth = true;
    // Slices at -3.5 ... 3.5 around the middle, which is 20 away; A reaches one half with the second.
    EXPECT_NEAR(render(scene, front_camera(2.0), Size{1, 1}, request).depth[0], 20.0 - 2.5, 1e-14);
    // Intervals begin one slice earlier and count with their middle.
    scene.preintegration = true;
    EXPECT_NEAR(render(scene, front_camera(2.0), Size{1, 1}, request).depth[0], 20.0 - 3.0, 1e-14);
    scene = homogeneous(0.01, 1.0);
    EXPECT_EQ(render(scene, front_camera(2.0), Size{1, 1}, request).depth[0], std::numeric_limits<double>::infinity());
}

TEST(Background, LiesBehindThePicture) {
    Scene scene = homogeneous(0.3, 1.0);
    const auto before = middle(render(scene, front_camera(2.0), Size{1, 1}));
    scene.background = Vec3(0.1, 0.5, 2.0);
    const auto after = middle(render(scene, front_camera(2.0), Size{1, 1}));
    for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(after[static_cast<std::size_t>(c)],
                    before[static_cast<std::size_t>(c)] + (1.0 - before[3]) * (*scene.background)[c], 1e-15);
    }
    EXPECT_EQ(after[3], 1.0);
    scene.mode = Mode::xray;
    const Picture with = render(scene, front_camera(2.0), Size{3, 3});
    scene.background.reset();
    EXPECT_EQ(with.scalar, render(scene, front_camera(2.0), Size{3, 3}).scalar);
}

TEST(EmptyPoints, AreTransparentWhateverTheFunctionSays) {
    // Opaque at every value; the kernel's support is a ball of radius 2.
    Scene scene = make_scene(make_field({0.0}, {1, 1, 1}, plain_options()), constant_function(1.0));
    scene.slice_spacing = 0.01;
    for (const bool preintegration : {false, true}) {
        scene.preintegration = preintegration;
        const Picture picture = render(scene, front_camera(6.0), Size{60, 60});
        int inside = 0;
        for (int j = 0; j < 60; ++j) {
            for (int i = 0; i < 60; ++i) {
                const double r = std::hypot(i - 29.5, j - 29.5) * 0.1;
                const double opacity = picture.rgba[static_cast<std::size_t>(4 * (60 * j + i) + 3)];
                // The slices next to the middle are 0.005 away from it.
                const bool reached = r * r + 0.005 * 0.005 < 4.0;
                EXPECT_NEAR(opacity, reached ? 1.0 : 0.0, 0.2 * (preintegration ? 1.0 : 0.0));
                inside += opacity > 0.0 ? 1 : 0;
            }
        }
        EXPECT_NEAR(inside, pi * 400.0, 30.0);
    }
}

} // namespace sheetsplat::reference::testing

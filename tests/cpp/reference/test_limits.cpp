// Slices that do not exist, pictures that cannot be, and pixels that jump.
#include <gtest/gtest.h>

#include "reference/slices.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

template <class E, class F>
std::string message_of(F&& function) {
    try {
        function();
    } catch (const E& error) {
        return error.what();
    }
    return "nothing was thrown";
}

Scene one_kernel_scene(double spacing) {
    Scene scene = make_scene(one_kernel(2.0, 5.0));
    scene.slice_spacing = spacing;
    return scene;
}

} // namespace

TEST(Slices, AreAnchoredAtTheMiddleOfTheCentres) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = Vec3(1.0, 2.0, 3.0);
    Scene scene = make_scene(blobs(options));
    scene.slice_spacing = 0.7;
    const Vec3 middle = options.origin + Vec3(4.0, 3.5, 3.0);
    for (const Vec3& eye : {Vec3(9.0, 9.0, 9.0), Vec3(-9.0, 3.0, 1.0)}) {
        const Camera camera = Camera::orthographic(eye, Vec3(0.0), Vec3(0.0, 1.0, 0.0), 5.0);
        const Slices slices = find_slices(scene, camera, Screen(camera, Size{4, 4}), 1.0);
        const double depth = glm::dot(middle - eye, glm::normalize(-eye));
        EXPECT_NEAR(slices.depth(0), depth + 0.35, 1e-13);
        EXPECT_NEAR(slices.depth(-1), depth - 0.35, 1e-13);
        // All slabs that meet a support, and no more: the farthest kernels are at the corners of the box.
        double reach = 0.0;
        for (int corner = 0; corner < 8; ++corner) {
            const Vec3 at(corner & 1 ? 4.0 : -4.0, corner & 2 ? 3.5 : -3.5, corner & 4 ? 3.0 : -3.0);
            reach = std::max(reach, glm::dot(at, glm::normalize(eye)) + 2.0);
        }
        EXPECT_EQ(slices.count, 2 * static_cast<std::int64_t>(std::ceil(reach / 0.7)));
        EXPECT_EQ(slices.first, -slices.count / 2);
    }
}

TEST(Slices, AnchorDoesNotMoveWithInvisibleKernelsOrOtherSettings) {
    // A field of zeros on one side: invisible, but its centres count.
    Scene scene = make_scene(one_kernel());
    scene.fields.push_back(make_field({0.0}, {1, 1, 1}, [] {
        RegularFieldOptions options = plain_options();
        options.origin = Vec3(0.0, 0.0, -4.0);
        return options;
    }()));
    const Slices slices = find_slices(scene, front_camera(4.0), Screen(front_camera(4.0), Size{4, 4}), 1.0);
    EXPECT_NEAR(slices.anchor, 22.0, 1e-14);
}

TEST(Slices, InFrontOfNearDoNotExist) {
    // An x-ray of slabs is the integral from the front of the first slab on; slabs are 0.5 thick, the eye at a distance
    // of 1.
    Scene scene = one_kernel_scene(0.5);
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    const auto value = [&](double near) {
        return render(scene, Camera::perspective(Vec3(0.0, 0.0, 1.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 30.0, near),
                      Size{1, 1})
            .scalar[0];
    };
    const auto from_depth = [](double depth) {
        return integrate([](double t) { return kernel_value(std::abs(t - 1.0) / 2.0, 5.0); }, depth, 1.0, 1e-15) +
               integrate([](double t) { return kernel_value(std::abs(t - 1.0) / 2.0, 5.0); }, 1.0, 3.0, 1e-15);
    };
    // Slices at 0.25, 0.75, 1.25 ...; one on near itself does not exist, one behind it counts with its whole slab.
    EXPECT_NEAR(value(0.2), from_depth(0.0), 1e-14);
    EXPECT_NEAR(value(0.25), from_depth(0.5), 1e-14);
    EXPECT_NEAR(value(0.7499), from_depth(0.5), 1e-14);
    EXPECT_NEAR(value(0.7501), from_depth(1.0), 1e-14);
    EXPECT_GT(std::abs(from_depth(0.5) - from_depth(0.55)), 1e-3);
    // All of it in front of near.
    EXPECT_EQ(value(5.0), 0.0);
    // Orthographic cameras clip nothing, even behind the eye.
    const Camera inside = Camera::orthographic(Vec3(0.0, 0.0, 1.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 1e-6);
    EXPECT_NEAR(render(scene, inside, Size{1, 1}).scalar[0], from_depth(-1.0), 1e-12);
}

TEST(Slices, TooManyAreRefused) {
    const std::string message = message_of<InvalidInput>([] {
        (void)render(one_kernel_scene(1e-7), front_camera(4.0), Size{4, 4});
    });
    EXPECT_NE(message.find("4e+07"), std::string::npos) << message;
    EXPECT_NE(message.find("4e-07"), std::string::npos) << message;
    EXPECT_THROW((void)render(one_kernel_scene(1e-300), front_camera(4.0), Size{4, 4}), InvalidInput);
    // Ten million are let through.
    EXPECT_EQ(find_slices(one_kernel_scene(4e-7), front_camera(4.0), Screen(front_camera(4.0), Size{4, 4}), 1.0).count,
              10'000'000);
}

TEST(Pictures, ThatCannotBe) {
    const Scene scene = one_kernel_scene(0.5);
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{0, 5}), InvalidInput);
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{5, 0}), InvalidInput);
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{-3, -3}), InvalidInput);
    EXPECT_THROW((void)ambiguous_pixels(scene, front_camera(4.0), Size{0, 0}), InvalidInput);
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{2'000'000'000, 2'000'000'000}), OutOfMemory);
    EXPECT_THROW((void)ambiguous_pixels(scene, front_camera(4.0), Size{2'000'000'000, 2'000'000'000}), OutOfMemory);
    Scene wrong = scene;
    wrong.slice_spacing = -1.0;
    EXPECT_THROW((void)render(wrong, front_camera(4.0), Size{4, 4}), InvalidInput);
}

TEST(Pictures, WithoutKernelsAreTransparent) {
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    Scene scene = make_scene(make_field({nan, nan}, {1, 1, 2}, options), TransferFunction({{0.0, Vec3(1.0), 1.0}}));
    Request request;
    request.coverage = request.depth = true;
    const std::vector<double> zeros(4 * 6, 0.0);
    for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}) {
        scene.mode = mode;
        scene.iso_values = {0.0};
        const Picture picture = render(scene, front_camera(4.0), Size{3, 2}, request);
        EXPECT_EQ(picture.slices, 0);
        EXPECT_EQ(picture.kernels_drawn, 0U);
        if (mode == Mode::xray || mode == Mode::mip) {
            const std::vector<double> expected(6, mode == Mode::xray ? 0.0 : no_number);
            EXPECT_EQ(largest_difference(picture.scalar, expected), 0.0);
            EXPECT_TRUE(picture.rgba.empty());
        } else {
            EXPECT_EQ(picture.rgba, zeros);
        }
        EXPECT_EQ(picture.coverage, std::vector<double>(6, 0.0));
        EXPECT_EQ(picture.depth, std::vector<double>(6, std::numeric_limits<double>::infinity()));
    }
}

TEST(Pictures, SkippedSamplesAreNoKernels) {
    // A hole instead of a value: emptier than a value of 0, which has weight.
    RegularFieldOptions options = plain_options();
    options.nan = NanPolicy::skip;
    Scene hole = make_scene(make_field({1.0, std::numeric_limits<double>::quiet_NaN(), 1.0}, {1, 1, 3}, options));
    Scene zero = make_scene(make_field({1.0, 0.0, 1.0}, {1, 1, 3}, options));
    hole.slice_spacing = zero.slice_spacing = 0.5;
    Request request;
    request.coverage = true;
    const Picture a = render(hole, front_camera(6.0), Size{9, 9}, request),
                  b = render(zero, front_camera(6.0), Size{9, 9}, request);
    EXPECT_EQ(a.kernels_drawn, 2U);
    EXPECT_EQ(b.kernels_drawn, 3U);
    EXPECT_EQ(a.rgba, b.rgba);
    EXPECT_GT(largest_difference(a.coverage, b.coverage), 0.5);
}

TEST(Pictures, ProgressRunsToTheEndAndCanStop) {
    Scene scene = one_kernel_scene(0.1);
    std::vector<double> shares;
    Request request;
    request.progress = [&](double done) {
        shares.push_back(done);
        return true;
    };
    const Picture picture = render(scene, front_camera(4.0), Size{2, 2}, request);
    ASSERT_EQ(static_cast<std::int64_t>(shares.size()), picture.slices + 1);
    EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
    EXPECT_EQ(shares.back(), 1.0);
    shares.clear();
    request.progress = [&](double done) {
        shares.push_back(done);
        return done < 0.5;
    };
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{2, 2}, request), Cancelled);
    EXPECT_LT(shares.back(), 0.6);
    shares.clear();
    request.progress = [&](double done) {
        shares.push_back(done);
        return true;
    };
    (void)ambiguous_pixels(scene, front_camera(4.0), Size{2, 2}, request);
    EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
    EXPECT_EQ(shares.back(), 1.0);
}

TEST(Nudges, RadiusIsThatOfAWiderField) {
    const auto scene_of = [](double radius) {
        RegularFieldOptions options = test::zero_boundary();
        options.radius = radius;
        Scene scene = make_scene(blobs(options));
        scene.lights = two_lights();
        return scene;
    };
    Request request;
    request.nudge_radius = 1e-3;
    const auto nudged = render(scene_of(2.0), oblique_camera(), Size{12, 12}, request).rgba;
    EXPECT_LE(largest_difference(nudged, render(scene_of(2.002), oblique_camera(), Size{12, 12}).rgba), 1e-12);
    EXPECT_GT(largest_difference(nudged, render(scene_of(2.0), oblique_camera(), Size{12, 12}).rgba), 1e-6);
}

TEST(Nudges, RhoIsThatOfAMovedFunction) {
    for (const bool preintegration : {false, true}) {
        Scene scene = make_scene(blobs());
        scene.lights = two_lights();
        scene.preintegration = preintegration;
        Scene moved = scene;
        std::vector<TransferPoint> points = scene.transfer_function.points();
        for (TransferPoint& point : points) {
            point.value -= 0.01;
        }
        moved.transfer_function = TransferFunction(points);
        Request request;
        request.nudge_rho = 0.01;
        const auto nudged = render(scene, oblique_camera(), Size{12, 12}, request).rgba;
        EXPECT_LE(largest_difference(nudged, render(moved, oblique_camera(), Size{12, 12}).rgba), 1e-12);
        EXPECT_GT(largest_difference(nudged, render(scene, oblique_camera(), Size{12, 12}).rgba), 1e-6);
    }
    Scene surface = make_scene(blobs());
    surface.mode = Mode::isosurface;
    surface.iso_values = {0.4};
    Request request;
    request.nudge_rho = 0.01;
    request.depth = true;
    const Picture moved = render(surface, oblique_camera(), Size{12, 12}, request);
    const auto& nudged = moved.depth;
    // The surface moves; its colour stays that of the iso value.
    const std::size_t pixel = 6 * 12 + 6;
    ASSERT_EQ(moved.rgba[4 * pixel + 3], 1.0);
    EXPECT_NEAR(moved.rgba[4 * pixel], surface.transfer_function.at(0.4).color.x, 1e-15);
    EXPECT_GT(std::abs(moved.rgba[4 * pixel] - surface.transfer_function.at(0.41).color.x), 1e-3);
    surface.iso_values = {0.39};
    request.nudge_rho = 0.0;
    EXPECT_LE(largest_difference(nudged, render(surface, oblique_camera(), Size{12, 12}, request).depth), 1e-12);
}

TEST(AmbiguousPixels, AreThoseNextToAJump) {
    // A ball of opacity 1 from a step at 0.3: only rays that graze it are ambiguous, and only if they graze it by
    // chance.
    Scene scene = make_scene(
        one_kernel(2.0, 5.0),
        TransferFunction({{0.0, Vec3(1.0), 0.0}, {0.3, Vec3(1.0), 0.0}, {0.3, Vec3(1.0), 1.0}, {1.0, Vec3(1.0), 1.0}}));
    scene.slice_spacing = 0.5;
    // The slices next to the middle are 0.25 away from it; a pixel's distance at which they have just the value 0.3:
    const double edge = std::exp(-5.0);
    const double r = 2.0 * std::sqrt(-std::log(0.3 * (1.0 - edge) + edge) / 5.0), b = std::sqrt(r * r - 0.25 * 0.25);
    // Three pixels in a row, b apart: the outer two are at the jump.
    const auto marks = [&](double distance) { return ambiguous_pixels(scene, front_camera(distance), Size{3, 1}); };
    EXPECT_EQ(marks(b), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(b * (1.0 + 1e-6)), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(b * 1.001), (std::vector<unsigned char>{0, 0, 0}));
    EXPECT_EQ(marks(b * 0.999), (std::vector<unsigned char>{0, 0, 0}));
    // The support's end, where opacity at 0 is not 0.
    scene.transfer_function = TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}});
    const double end = std::sqrt(4.0 - 0.25 * 0.25);
    EXPECT_EQ(marks(end * (1.0 + 1e-6)), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(end * 1.001), (std::vector<unsigned char>{0, 0, 0}));
    // An isosurface's outline.
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.3};
    EXPECT_EQ(marks(b * (1.0 + 1e-6)), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(b * 1.001), (std::vector<unsigned char>{0, 0, 0}));
    // Scalar modes do not jump.
    scene.mode = Mode::xray;
    EXPECT_EQ(marks(b), (std::vector<unsigned char>{0, 0, 0}));
}

TEST(AmbiguousPixels, WhereOpacityStopsByChance) {
    Scene scene = make_scene(one_kernel(2.0, 5.0), TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
    scene.slice_spacing = 0.5;
    scene.reference_length = 0.5;
    const auto marks = [&](double stop) {
        scene.opacity_stop = stop;
        return ambiguous_pixels(scene, front_camera(0.5), Size{1, 1});
    };
    EXPECT_EQ(marks(0.75), std::vector<unsigned char>{1});
    EXPECT_EQ(marks(0.75 + 2e-5), std::vector<unsigned char>{0});
    EXPECT_EQ(marks(0.75 - 2e-5), std::vector<unsigned char>{0});
    EXPECT_EQ(marks(1.0), std::vector<unsigned char>{0});
}

TEST(AmbiguousPixels, DepthOnlyWhereItIsAskedFor) {
    // A is 1/2 exactly after the first slice that is reached: a little less, and the depth is the next slice's.
    Scene scene = make_scene(one_kernel(2.0, 5.0),
                             TransferFunction({{-1.0, Vec3(1.0), 0.5 - 1e-9}, {1.0, Vec3(1.0), 0.5 + 1e-9}}));
    scene.slice_spacing = 0.5;
    scene.reference_length = 0.5;
    Request request;
    EXPECT_EQ(ambiguous_pixels(scene, front_camera(0.5), Size{1, 1}, request), std::vector<unsigned char>{0});
    request.depth = true;
    const double rho = kernel_value(1.75 / 2.0, 5.0);
    scene.transfer_function = TransferFunction(
        {{-1.0, Vec3(1.0), 0.5 - 0.5 * (1.0 + rho) * 1e-3}, {1.0, Vec3(1.0), 0.5 + 0.5 * (1.0 - rho) * 1e-3}});
    EXPECT_EQ(ambiguous_pixels(scene, front_camera(0.5), Size{1, 1}, request), std::vector<unsigned char>{1});
    request.depth = false;
    EXPECT_EQ(ambiguous_pixels(scene, front_camera(0.5), Size{1, 1}, request), std::vector<unsigned char>{0});
}

} // namespace sheetsplat::reference::testing

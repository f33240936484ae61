// Fields with transfer functions of their own, several isosurfaces, and what near planes and intervals report, against
// closed forms. Source: conventions, sections 4 and 7.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "reference/classify.hpp"
#include "reference/reference.hpp"
#include "reference/support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// A block of one value, `samples` of them from `low` on along z, wide enough for any pixel; supports reach 2 further.
std::shared_ptr<const Field> block(double value, double low, std::size_t samples) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = Normalization::threshold;
    options.w0 = 1e-9;
    options.origin = Vec3(-4.0, -4.0, low);
    return make_field(std::vector<double>(9 * 9 * samples, value), {samples, 9, 9}, options);
}

TransferFunction flat(const Vec3& color, double opacity) {
    return TransferFunction({{0.0, color, opacity}, {1.0, color, opacity}});
}

// Two blocks that overlap, each with its own colour and opacity.
Scene two_blocks() {
    Scene scene = make_scene(block(0.6, -2.0, 3), flat(Vec3(1.0, 0.0, 0.0), 0.3));
    scene.fields.push_back(block(0.3, 0.0, 3));
    scene.later_groups = {{1, flat(Vec3(0.0, 1.0, 0.5), 0.6)}};
    scene.slice_spacing = 0.5;
    scene.reference_length = 1.0;
    return scene;
}

Picture one_pixel(const Scene& scene) {
    Request request;
    request.coverage = request.depth = true;
    return render(scene, front_camera(1.0), Size{1, 1}, request);
}

double sum_of(const std::vector<double>& numbers, std::size_t channel) { return numbers[channel]; }

} // namespace

TEST(Mixture, OfOneIsItself) {
    const Vec3 color(0.3, 0.7, 1.1);
    for (const double extinction : {1e-300, 1e-9, 0.3, 40.0, infinity}) {
        Mixture mixture;
        mixture.add(color, extinction, 0.37);
        EXPECT_EQ(mixture.color(), color);
        EXPECT_EQ(mixture.opacity(), -std::expm1(-extinction));
    }
    EXPECT_EQ(Mixture().opacity(), 0.0);
    EXPECT_EQ(Mixture().color(), Vec3(0.0));
}

TEST(Mixture, TransparenciesMultiplyAndColorsAreWeighted) {
    Mixture mixture;
    const double a = 0.3, b = 0.9, lengths = 0.25;
    for (const auto& [opacity, color] : {std::pair{a, Vec3(1.0, 0.0, 0.0)}, {b, Vec3(0.0, 1.0, 0.0)}}) {
        mixture.add(color, -lengths * std::log1p(-opacity), extinction_of(opacity));
    }
    EXPECT_NEAR(mixture.opacity(), 1.0 - std::pow(0.7 * 0.1, 0.25), 1e-15);
    EXPECT_NEAR(mixture.color().x, std::log(0.7) / (std::log(0.7) + std::log(0.1)), 1e-15);
    EXPECT_NEAR(mixture.color().x + mixture.color().y, 1.0, 1e-15);
    // Full opacity takes all but a share of 24 binary digits' logarithm.
    Mixture opaque;
    opaque.add(Vec3(1.0), infinity, extinction_of(1.0));
    opaque.add(Vec3(0.0), -std::log1p(-0.5), extinction_of(0.5));
    EXPECT_EQ(opaque.opacity(), 1.0);
    EXPECT_NEAR(opaque.color().x, 24.0 / 25.0, 1e-12);
}

TEST(Groups, MixLightInTheSameSlice) {
    // Supports reach from -4 to 2 and from -2 to 4: seen from +z, 4 deep green, 4 of both, 4 deep red, a slice every
    // half: 4 of green alone, 8 of both, 4 of red alone. Each at half its opacity's length.
    Scene scene = two_blocks();
    const double green = std::pow(1.0 - 0.6, 0.5), red = std::pow(1.0 - 0.3, 0.5), both = green * red;
    const double weight_green = std::log(0.4) / (std::log(0.4) + std::log(0.7));
    for (const bool preintegrated : {false, true}) {
        scene.preintegration = preintegrated;
        double left = 1.0, reds = 0.0, greens = 0.0;
        // With pre-integration an interval begins half a slice early, and one end is enough: one more of each.
        const int first = preintegrated ? 1 : 0;
        for (int n = 0; n < 16 + first; ++n) {
            const bool in_green = n < 12 + first, in_red = n >= 4;
            const double through = in_green && in_red ? both : in_green ? green : red;
            const double share = in_green && in_red ? weight_green : in_green ? 1.0 : 0.0;
            greens += left * (1.0 - through) * share;
            reds += left * (1.0 - through) * (1.0 - share);
            left *= through;
        }
        const Picture picture = one_pixel(scene);
        EXPECT_NEAR(picture.rgba[0], reds, 1e-14);
        EXPECT_NEAR(picture.rgba[1], greens, 1e-14);
        EXPECT_NEAR(picture.rgba[2], 0.5 * greens, 1e-14);
        EXPECT_NEAR(picture.rgba[3], 1.0 - left, 1e-14);
        EXPECT_GT(reds, 0.01);
        // One transfer function for their sum shows something else.
        Scene summed = scene;
        summed.later_groups.clear();
        EXPECT_GT(std::abs(one_pixel(summed).rgba[1] - greens), 0.1);
    }
}

TEST(Groups, CoverageIsOfAllFields) {
    Scene scene = two_blocks();
    const Picture apart = one_pixel(scene);
    scene.later_groups.clear();
    EXPECT_NEAR(apart.coverage[0], one_pixel(scene).coverage[0], 1e-12);
    scene.fields.pop_back();
    EXPECT_GT(apart.coverage[0], 1.5 * one_pixel(scene).coverage[0]);
}

TEST(Groups, HaveTheirOwnWeakestGradient) {
    // One field twice, the same colours over windows of 1 and of 1e9: to the second all gradients are weak.
    Scene scene = make_scene(blobs(), flat(Vec3(1.0), 0.3));
    scene.lights = two_lights();
    const Picture one = render(scene, oblique_camera(), Size{9, 9});
    scene.transfer_function = TransferFunction({{0.0, Vec3(1.0), 0.3}, {1e9, Vec3(1.0), 0.3}});
    const Picture faint = render(scene, oblique_camera(), Size{9, 9});
    scene.fields.push_back(blobs());
    scene.later_groups = {{1, flat(Vec3(1.0), 0.3)}};
    const Picture mixed = render(scene, oblique_camera(), Size{9, 9});
    EXPECT_GT(largest_difference(one.rgba, faint.rgba), 0.1);
    const double lit_one = sum_of(one.rgba, 4 * 40) / one.rgba[4 * 40 + 3];
    const double lit_faint = sum_of(faint.rgba, 4 * 40) / faint.rgba[4 * 40 + 3];
    const double lit_mixed = sum_of(mixed.rgba, 4 * 40) / mixed.rgba[4 * 40 + 3];
    EXPECT_GT(lit_mixed, std::min(lit_one, lit_faint));
    EXPECT_LT(lit_mixed, std::max(lit_one, lit_faint));
}

TEST(Surfaces, AreCompositedFromFrontToBack) {
    // From +z into a field that rises to 1 at once: all values are crossed in one interval, the lowest first; and out
    // of it again, the highest first.
    Scene scene =
        make_scene(block(1.0, 0.0, 3), TransferFunction({{0.0, Vec3(0.0), 0.0}, {1.0, Vec3(1.0, 2.0, 4.0), 0.0}}));
    scene.mode = Mode::isosurface;
    scene.slice_spacing = 0.5;
    scene.iso_values = {{0.8, 0.5}, {0.2, 0.25}};
    const Picture picture = one_pixel(scene);
    const double a = 0.25 * 0.2 + 0.75 * 0.5 * 0.8, left = 0.75 * 0.5;
    const double b = left * (0.5 * 0.8 + 0.5 * 0.25 * 0.2);
    EXPECT_NEAR(picture.rgba[0], a + b, 1e-14);
    EXPECT_NEAR(picture.rgba[2], 4.0 * (a + b), 1e-14);
    EXPECT_NEAR(picture.rgba[3], 1.0 - left * left, 1e-14);
    // A reaches one half at the second crossing: 4/5 of the way from the empty slice to the first one.
    const Picture opaque = [&] {
        Scene other = scene;
        other.iso_values = {0.5};
        return one_pixel(other);
    }();
    EXPECT_NEAR(picture.depth[0] - opaque.depth[0], 0.3 * 0.5, 1e-13);
    // A_stop holds between two crossings of one interval.
    scene.opacity_stop = 0.2;
    EXPECT_NEAR(one_pixel(scene).rgba[3], 0.25, 1e-15);
    // Two at one place: as the list has them.
    scene.opacity_stop = 1.0;
    scene.iso_values = {{0.2, 1.0}, {0.2, 0.5}};
    EXPECT_EQ(one_pixel(scene).rgba[3], 1.0);
    // And groups before the list.
    scene.fields.push_back(scene.fields.front());
    scene.later_groups = {{1, flat(Vec3(3.0), 0.0)}};
    scene.iso_values = {{0.2, 0.5}};
    const double first = 0.5 * 0.2, second = 0.25 * 3.0;
    const double third = 0.25 * (0.5 * 0.2 + 0.25 * 3.0);
    EXPECT_NEAR(one_pixel(scene).rgba[0], first + second + third, 1e-14);
}

TEST(Surfaces, AreOpenWhereTheNearPlaneCutsThem) {
    // A camera in the block looks out of it: the surface is where it leaves. Cut in front of the block, it is where it
    // enters, as it is where the slices begin only at the block.
    Scene scene = make_scene(block(1.0, 0.0, 9), flat(Vec3(1.0), 0.0));
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.5};
    scene.slice_spacing = 0.5;
    const auto depth = [&](double eye, double near) {
        Request request;
        request.depth = true;
        const Camera camera =
            Camera::perspective(Vec3(0.0, 0.0, eye), Vec3(0.0, 0.0, eye - 1.0), Vec3(0.0, 1.0, 0.0), 1.0, near);
        return render(scene, camera, Size{1, 1}, request).depth[0];
    };
    // The block's supports reach from z = -2 to 10; slices lie at 4 -+ 1/4, 3/4 ...
    EXPECT_NEAR(depth(20.0, 1.0), 10.0, 1e-9);
    EXPECT_NEAR(depth(20.0, 12.0), 22.0, 1e-9);
    EXPECT_NEAR(depth(6.0, 0.01), 8.0, 1e-9);
    EXPECT_NEAR(depth(10.0, 0.1), 0.0, 0.01) << "the near plane removes no slice";
}

TEST(Depth, OfAnIntervalIsItsMiddle) {
    Scene scene = make_scene(block(1.0, 0.0, 3), flat(Vec3(1.0), 0.2));
    scene.slice_spacing = 0.5;
    scene.reference_length = 0.5;
    // Supports reach from z = -2 to 4, t_c = 19: slices at depths 16.25, 16.75 ...; 0.8^4 < 1/2 < 0.8^3.
    EXPECT_NEAR(one_pixel(scene).depth[0], 16.25 + 3 * 0.5, 1e-12);
    scene.preintegration = true;
    // The interval before the first slice is one of the four.
    EXPECT_NEAR(one_pixel(scene).depth[0], 16.25 + 2 * 0.5 + 0.25, 1e-12);
    scene.second_order = true;
    EXPECT_NEAR(one_pixel(scene).depth[0], 16.25 + 2 * 0.5 + 0.25, 1e-12);
    // Never in front of the first slice.
    scene.transfer_function = flat(Vec3(1.0), 0.9);
    EXPECT_NEAR(one_pixel(scene).depth[0], 16.25, 1e-12);
    scene.second_order = scene.preintegration = false;
    EXPECT_NEAR(one_pixel(scene).depth[0], 16.25, 1e-12);
    // The cue uses the middle as it is.
    scene.preintegration = true;
    scene.transfer_function = flat(Vec3(1.0), 1.0);
    scene.depth_cue = DepthCue{15.75, 16.25, Vec3(0.0), 1.0};
    EXPECT_NEAR(one_pixel(scene).rgba[0], 0.5, 1e-6);
}

TEST(ScalarModes, CountSlicesThatWeighSomething) {
    // rho rises along z; the mean and the least of its slices, by the slices' own values.
    Scene scene = make_scene(blobs());
    scene.mode = Mode::xray;
    const Picture sum = render(scene, oblique_camera(), Size{12, 10});
    scene.mode = Mode::average;
    const Picture mean = render(scene, oblique_camera(), Size{12, 10});
    scene.mode = Mode::minimum;
    const Picture least = render(scene, oblique_camera(), Size{12, 10});
    int touched = 0;
    for (std::size_t n = 0; n < sum.scalar.size(); ++n) {
        if (sum.scalar[n] == 0.0) {
            EXPECT_TRUE(std::isnan(mean.scalar[n]));
            EXPECT_TRUE(std::isnan(least.scalar[n]));
            continue;
        }
        ++touched;
        // A whole number of slices counts.
        const double slices = sum.scalar[n] / scene.slice_distance() / mean.scalar[n];
        EXPECT_NEAR(slices, std::round(slices), 1e-9);
        EXPECT_LE(slices, static_cast<double>(sum.slices));
        EXPECT_LT(least.scalar[n], mean.scalar[n] * (1.0 + 1e-12));
    }
    EXPECT_GT(touched, 30);
    // A value of 0 counts where its weight is above 0, and does not where it is 0.
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(2.0), glm::dquat(1.0, 0.0, 0.0, 0.0));
    arrays.centers.emplace_back(0.0, 0.0, -6.0);
    arrays.scales.emplace_back(2.0);
    arrays.rotations.emplace_back(1.0, 0.0, 0.0, 0.0);
    arrays.values = {-0.5, 0.0};
    for (const double weight : {1.0, 0.0}) {
        arrays.weights = {1.0, weight};
        EllipsoidFieldOptions options;
        options.normalization = Normalization::threshold;
        options.w0 = 1e-9;
        Scene two = make_scene(make_ellipsoids(arrays, options));
        two.slice_spacing = 1.0;
        two.mode = Mode::average;
        // Either is cut by four slices.
        EXPECT_NEAR(one_pixel(two).scalar[0], weight > 0.0 ? -0.25 : -0.5, 1e-12);
        two.mode = Mode::minimum;
        EXPECT_NEAR(one_pixel(two).scalar[0], -0.5, 1e-12);
        // Clipped slices are passed over.
        two.clip.planes = {{Vec3(0.0, 0.0, -1.0), 3.0}};
        EXPECT_EQ(largest_difference(one_pixel(two).scalar, {weight > 0.0 ? 0.0 : no_number}), 0.0);
        two.mode = Mode::xray;
        EXPECT_EQ(one_pixel(two).scalar[0], 0.0);
    }
}

} // namespace sheetsplat::reference::testing

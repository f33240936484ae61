// Scattered ellipsoids against closed forms.
#include <gtest/gtest.h>

#include "reference/ellipsoid_scenes.hpp"
#include "reference/kernels.hpp"
#include "reference/support.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference::testing {

namespace {} // namespace

TEST(Ellipsoids, ValuesAtPoints) {
    // Semi-axes 3 along (0, 0.6, 0.8), 1 along x, 2 along (0, -0.8, 0.6).
    EllipsoidArrays arrays = one_ellipsoid(Vec3(1.0, 2.0, 3.0), Vec3(1.0, 2.0, 3.0),
                                           // About x, so that z becomes (0, 0.6, 0.8): by minus acos 0.8.
                                           glm::dquat(3.0 / std::sqrt(10.0), -1.0 / std::sqrt(10.0), 0.0, 0.0));
    arrays.values = {4.0};
    arrays.weights = {0.5};
    const auto field = make_ellipsoids(arrays);
    const auto expect_r = [&](const Vec3& from_centre, double r) {
        const Sums sums = sums_at(*field, Vec3(1.0, 2.0, 3.0) + from_centre);
        EXPECT_EQ(sums.empty, r >= 1.0);
        EXPECT_NEAR(sums.w, 0.5 * kernel_value(r, 8.0), 1e-15);
        EXPECT_NEAR(sums.d, 2.0 * kernel_value(r, 8.0), 4e-15);
    };
    expect_r(Vec3(0.0), 0.0);
    expect_r(3.0 * Vec3(0.0, 0.6, 0.8) * 0.3, 0.3);
    expect_r(Vec3(0.7, 0.0, 0.0), 0.7);
    expect_r(2.0 * Vec3(0.0, -0.8, 0.6) * 0.5, 0.5);
    expect_r(Vec3(0.3, 0.0, 0.0) + 2.0 * Vec3(0.0, -0.8, 0.6) * 0.4, 0.5);
    expect_r(Vec3(0.0, 0.6, 0.8) * 3.0001, 1.1);
    // Turned the other way it is another value.
    EXPECT_LT(sums_at(*field, Vec3(1.0, 2.0, 3.0) + 3.0 * Vec3(0.0, -0.6, 0.8) * 0.3).w, 0.4 * kernel_value(0.3, 8.0));
}

TEST(Ellipsoids, SumsOfBothKindsOfField) {
    // The lattice as scattered spheres: the same sums anywhere.
    RegularFieldOptions options = plain_options(2.0, 5.0);
    const auto lattice = blobs(options);
    EllipsoidArrays arrays;
    for (std::size_t k = 0; k < 7; ++k) {
        for (std::size_t j = 0; j < 8; ++j) {
            for (std::size_t i = 0; i < 9; ++i) {
                arrays.centers.push_back(lattice->position(i, j, k));
                arrays.radii.push_back(2.0);
                arrays.values.push_back(lattice->value(i, j, k));
            }
        }
    }
    const auto spheres = make_ellipsoids(arrays, plain_ellipsoids(5.0));
    for (int n = 0; n < 20; ++n) {
        const Vec3 point(0.4 * n, 7.0 - 0.31 * n, 0.17 * n);
        const Sums a = sums_at(*lattice, point), b = sums_at(*spheres, point);
        EXPECT_NEAR(a.d, b.d, 1e-14);
        EXPECT_NEAR(a.w, b.w, 1e-13);
        EXPECT_EQ(a.empty, b.empty);
        EXPECT_GT(a.w, 0.5);
    }
}

TEST(Ellipsoids, PointSamplingAtTheCentre) {
    // A slice through the kernel's centre, a pixel on it: exactly m f. Two kernels put the box's middle, the anchor,
    // half a slice in front of the first one.
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(0.2, 0.1, 0.15), glm::dquat(0.5, 0.5, -0.5, 0.5));
    arrays.centers.emplace_back(0.0, 30.0, 0.5);
    arrays.scales.emplace_back(0.1);
    arrays.rotations.emplace_back(1.0, 0.0, 0.0, 0.0);
    arrays.values = {3.0, 1.0};
    arrays.weights = {0.25, 1.0};
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    scene.mode = Mode::mip;
    scene.slice_spacing = 0.5;
    const Picture picture = render(scene, front_camera(1.0), Size{3, 3});
    const double no = no_number;
    EXPECT_LE(largest_difference(picture.scalar, {no, no, no, no, 0.75, no, no, no, no}), 2e-16);
    // The anchor a quarter elsewhere, and the slice misses the centre.
    arrays.centers[1].z += 0.1;
    scene.fields = {make_ellipsoids(arrays, plain_ellipsoids())};
    EXPECT_LT(render(scene, front_camera(1.0), Size{3, 3}).scalar[4], 0.7);
}

TEST(Ellipsoids, XrayOfSlabsIsTheLineIntegralAtAnySpacing) {
    const auto field = make_ellipsoids(scattered(20, 11), plain_ellipsoids(6.0));
    Scene scene = make_scene(field);
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    for (const bool perspective : {false, true}) {
        const Camera camera = camera_of(perspective);
        const std::vector<double> expected = line_integrals(*field, camera, 6.0);
        ASSERT_GT(largest_of(expected), 0.5);
        for (const double spacing : {0.004, 0.1, 0.37, 1.0, 3.3, 15.0}) {
            scene.slice_spacing = spacing;
            EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-12) << spacing;
        }
        EXPECT_GT(largest_difference(line_integrals(*field, camera, 6.0 + 1e-9), expected), 1e-11);
        scene.slice_spacing = 0.3;
        Scene points = scene;
        points.sampling = Sampling::point;
        EXPECT_GT(largest_difference(render(points, camera, size).scalar, expected), 1e-4);
    }
}

TEST(Ellipsoids, CoverageIsTheLineIntegralOfTheWeight) {
    // Values 0: there for their weight alone.
    EllipsoidArrays arrays = scattered(6, 12), ones = arrays;
    for (std::size_t n = 0; n < 6; ++n) {
        arrays.values[n] = 0.0;
        ones.values[n] = 1.0;
    }
    Scene scene = make_scene(make_ellipsoids(arrays, thresholded()));
    scene.sampling = Sampling::slab;
    Request request;
    request.coverage = true;
    for (const bool perspective : {false, true}) {
        const Picture picture = render(scene, camera_of(perspective), size, request);
        const std::vector<double> expected = line_integrals(*make_ellipsoids(ones), camera_of(perspective), 8.0);
        ASSERT_GT(largest_of(expected), 0.5);
        EXPECT_LE(largest_difference(picture.coverage, expected), 1e-12);
        EXPECT_EQ(largest_of(picture.rgba), 0.0);
        // The coverage of several fields is their sum.
        Scene twice = scene;
        twice.fields.push_back(scene.fields.front());
        const std::vector<double> more = render(twice, camera_of(perspective), size, request).coverage;
        for (std::size_t n = 0; n < more.size(); ++n) {
            EXPECT_NEAR(more[n], 2.0 * expected[n], 1e-12);
        }
    }
}

TEST(Ellipsoids, ThresholdIsAWeightedMeanWhereThereIsWeight) {
    // Two kernels on one spot: D / W between their values; alone and thin, D / w0.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(0.0)};
    arrays.radii = {2.0, 2.0};
    arrays.values = {1.0, 4.0};
    arrays.weights = {2.0, 1.0};
    const double k = 8.0;
    EllipsoidFieldOptions options = thresholded(0.3);
    Scene scene = make_scene(make_ellipsoids(arrays, options));
    scene.mode = Mode::mip;
    scene.slice_spacing = 0.2; // the nearest slice is 0.1 from the centres
    const Picture picture = render(scene, front_camera(4.0), Size{5, 1});
    for (std::size_t n = 0; n < 5; ++n) {
        // On rays 0.8 apart.
        const double x = 0.8 * (static_cast<double>(n) - 2.0) * 5.0;
        double expected = 0.0;
        for (int slice = 0; slice < 10; ++slice) {
            const double g = kernel_value(std::hypot(x, 0.1 + 0.2 * slice) / 2.0, k);
            expected = std::max(expected, 6.0 * g / std::max(0.3, 3.0 * g));
        }
        if (expected > 0.0) {
            EXPECT_NEAR(picture.scalar[n], expected, 1e-14);
        } else {
            EXPECT_TRUE(std::isnan(picture.scalar[n]));
        }
    }
    EXPECT_NEAR(picture.scalar[2], 2.0, 1e-14);
}

TEST(Ellipsoids, LatticeNormalisation) {
    // A constant lattice of spheres reconstructs its constant; with half the cell's volume, half of it.
    EllipsoidArrays arrays;
    for (int k = -4; k <= 4; ++k) {
        for (int j = -4; j <= 4; ++j) {
            for (int i = -4; i <= 4; ++i) {
                arrays.centers.emplace_back(i, j, k);
                arrays.radii.push_back(2.0);
                arrays.values.push_back(0.6);
            }
        }
    }
    const auto middle = [&](double volume, double nudge) {
        EllipsoidFieldOptions options;
        options.falloff = 5.0;
        options.normalization = Normalization::lattice;
        options.cell_volume = volume;
        Scene scene = make_scene(make_ellipsoids(arrays, options));
        scene.mode = Mode::mip;
        scene.slice_spacing = 0.5;
        Request request;
        request.nudge_radius = nudge;
        return render(scene, front_camera(1.0), Size{1, 1}, request).scalar[0];
    };
    EXPECT_NEAR(middle(1.0, 0.0), 0.6, 0.6 * 0.009);
    EXPECT_NEAR(middle(0.5, 0.0), 0.3, 0.3 * 0.009);
    // C follows the radius.
    EXPECT_NEAR(middle(1.0, 0.1), 0.6, 0.6 * 0.009);
}

TEST(Ellipsoids, OfWeightZeroReach) {
    // Opaque at 0: a kernel of weight 0 is seen though it adds nothing; opaque nowhere near 0, it is left out.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-1.0, 0.0, 0.0), Vec3(1.0, 0.0, 0.0)};
    arrays.radii = {0.5, 0.5};
    arrays.values = {0.0, 5.0};
    arrays.weights = {1.0, 0.0};
    for (const EllipsoidFieldOptions& options : {plain_ellipsoids(), thresholded()}) {
        Scene scene = make_scene(make_ellipsoids(arrays, options),
                                 TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
        scene.slice_spacing = 0.5;
        scene.reference_length = 0.5;
        const Picture picture = render(scene, front_camera(1.0, 5.0), Size{3, 1});
        EXPECT_EQ(picture.kernels_drawn, 2U);
        // One slice a quarter before the centre and one behind it.
        EXPECT_NEAR(picture.rgba[3], 0.75, 1e-15);
        EXPECT_EQ(picture.rgba[7], 0.0);
        EXPECT_NEAR(picture.rgba[11], 0.75, 1e-15);
    }
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    EXPECT_EQ(render(scene, front_camera(1.0, 5.0), Size{3, 1}).kernels_drawn, 0U);
}

TEST(Ellipsoids, WithoutKernelsAddNothing) {
    const auto none = make_ellipsoids({});
    Request request;
    request.coverage = request.depth = true;
    Scene empty = make_scene(none, TransferFunction({{0.0, Vec3(1.0), 1.0}}));
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        empty.filter = filter;
        for (const bool perspective : {false, true}) {
            const Picture picture = render(empty, camera_of(perspective), Size{3, 2}, request);
            EXPECT_EQ(picture.slices, 0);
            EXPECT_EQ(picture.kernels_drawn, 0U);
            EXPECT_EQ(picture.rgba, std::vector<double>(24, 0.0));
            EXPECT_EQ(picture.coverage, std::vector<double>(6, 0.0));
            EXPECT_EQ(picture.depth, std::vector<double>(6, std::numeric_limits<double>::infinity()));
        }
    }
    EXPECT_TRUE(sums_at(*none, Vec3(0.0)).empty);
    // Beside another field it changes nothing.
    const auto some = make_ellipsoids(scattered(9, 4));
    Scene alone = full_scene(some), beside = alone;
    beside.fields = {none, some, none};
    const Picture a = render(alone, camera_of(true), size, request), b = render(beside, camera_of(true), size, request);
    EXPECT_GT(largest_of(a.rgba), 0.1);
    EXPECT_EQ(a.rgba, b.rgba);
    EXPECT_EQ(a.coverage, b.coverage);
    EXPECT_EQ(a.slices, b.slices);
}

TEST(Ellipsoids, NudgedRadiusIsThatOfLargerSemiAxes) {
    EllipsoidArrays arrays = scattered(10, 20), larger = arrays;
    for (Vec3& scale : larger.scales) {
        scale *= 1.001;
    }
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        Scene scene = full_scene(make_ellipsoids(arrays, thresholded())), other = scene;
        other.fields = {make_ellipsoids(larger, thresholded())};
        scene.filter = other.filter = filter;
        Request request;
        request.nudge_radius = 1e-3;
        const auto nudged = render(scene, camera_of(true), size, request).rgba;
        EXPECT_LE(largest_difference(nudged, render(other, camera_of(true), size).rgba), 1e-12);
        EXPECT_GT(largest_difference(nudged, render(scene, camera_of(true), size).rgba), 1e-6);
    }
}

TEST(Ellipsoids, AmbiguousPixelsAreThoseOnTheEdge) {
    // Opaque at 0: the edge of the support is a jump.
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(2.0, 1.0, 1.0), glm::dquat(1.0, 0.0, 0.0, 0.0));
    Scene scene = make_scene(make_ellipsoids(arrays), TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
    scene.slice_spacing = 0.5;
    const double end = 2.0 * std::sqrt(1.0 - 0.25 * 0.25);
    const auto marks = [&](double distance) { return ambiguous_pixels(scene, front_camera(distance), Size{3, 1}); };
    EXPECT_EQ(marks(end * (1.0 + 1e-6)), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(end * 1.001), (std::vector<unsigned char>{0, 0, 0}));
}

TEST(Ellipsoids, SumsBeyondFloat64AreRefused) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0)};
    arrays.radii = {1.0, 1.0};
    arrays.values = {1e200, 1.0};
    arrays.weights = {1.0, 1e200};
    Scene scene = make_scene(make_ellipsoids(arrays));
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{2, 2}), InvalidInput);
    arrays.weights = {1.0, 1e100};
    scene.fields = {make_ellipsoids(arrays)};
    EXPECT_NO_THROW((void)render(scene, front_camera(4.0), Size{2, 2}));
}

} // namespace sheetsplat::reference::testing

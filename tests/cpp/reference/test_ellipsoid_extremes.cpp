// Needles, and sizes far apart in one field.
#include <gtest/gtest.h>

#include "reference/ellipsoid_scenes.hpp"
#include "reference/kernels.hpp"
#include "reference/support.hpp"

namespace sheetsplat::reference::testing {

namespace {

TEST(Ellipsoids, NeedlesOfOneInAHundredThousand) {
    // A view of a few units onto the middle, the flank and the tip of needles and plates a hundred thousand times as
    // long as thick, against long double from the same numbers; and what the covariance would have made of it.
    std::mt19937_64 generator(17);
    double worst = 0.0, by_covariance = 0.0;
    for (int n = 0; n < 24; ++n) {
        const glm::dquat rotation = random_rotation(generator);
        const Vec3 s = n % 2 == 0 ? Vec3(1e5, 1.0, 1.3) : Vec3(1e5, 0.7e5, 1.0);
        const auto field = make_ellipsoids(one_ellipsoid(Vec3(0.0), s, rotation), plain_ellipsoids());
        const Mat3 m = field->shape(0);
        const Mat3 form = glm::inverse(m * glm::transpose(m));
        using Wide = glm::mat<3, 3, long double, glm::defaultp>;
        const glm::dquat& q = field->arrays().rotations[0];
        const long double w = q.w, x = q.x, y = q.y, z = q.z;
        const Wide r(1.0L - 2.0L * (y * y + z * z), 2.0L * (x * y + w * z), 2.0L * (x * z - w * y),
                     2.0L * (x * y - w * z), 1.0L - 2.0L * (x * x + z * z), 2.0L * (y * z + w * x),
                     2.0L * (x * z + w * y), 2.0L * (y * z - w * x), 1.0L - 2.0L * (x * x + y * y));
        for (const double along : {0.0, 0.4, 0.9}) {
            const Vec3 place = along * m[0];
            for (int point = 0; point < 30; ++point) {
                const Vec3 at =
                    place + random_real(generator, -0.6, 0.6) * m[1] + random_real(generator, -0.6, 0.6) * m[2];
                long double r_squared = 0.0L;
                for (int axis = 0; axis < 3; ++axis) {
                    const long double part =
                        (r[axis][0] * at.x + r[axis][1] * at.y + r[axis][2] * at.z) / static_cast<long double>(s[axis]);
                    r_squared += part * part;
                }
                const double g = kernel_value(static_cast<double>(std::sqrt(r_squared)), 8.0);
                worst = std::max(worst, std::abs(sums_at(*field, at).d - g));
                by_covariance = std::max(
                    by_covariance, std::abs(kernel_value(std::sqrt(std::max(0.0, glm::dot(at, form * at))), 8.0) - g));
            }
        }
    }
    std::printf("needles and plates of 1:1e5: off by %.1e, by the covariance %.1e\n", worst, by_covariance);
    EXPECT_LE(worst, 1e-10);
    EXPECT_GT(by_covariance, 1e-8);
}

TEST(Ellipsoids, NeedlesInAPicture) {
    // Pixels and slices find all of a needle wherever it leans, near its middle and near its tip: nearly across the
    // view, cut into slabs thinner than it is, and at 45 degrees, cut into few.
    std::mt19937_64 generator(18);
    for (int n = 0; n < 24; ++n) {
        const bool perspective = n % 2 == 1, leaning = n % 4 >= 2;
        const double place = n % 3 == 0 ? 0.0 : n % 3 == 1 ? 0.5 : -0.9;
        EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(1e5, 1.0, 1.3), random_rotation(generator));
        arrays.values = {1.0 / kernel_value(place, 8.0)};
        const auto field = make_ellipsoids(arrays, plain_ellipsoids());
        const Mat3 m = field->shape(0);
        const Vec3 along = glm::normalize(m[0]), target = place * m[0];
        const Vec3 aside = glm::normalize(m[1] + 0.3 * m[2] + (leaning ? 1.0 : 1e-3) * along);
        const Vec3 up = along + random_real(generator, -1.0, 1.0) * m[2];
        const Camera camera = perspective ? Camera::perspective(target + 20.0 * aside, target, up, 12.0)
                                          : Camera::orthographic(target + 20.0 * aside, target, up, 4.0);
        Scene scene = make_scene(field);
        scene.mode = Mode::xray;
        scene.sampling = Sampling::slab;
        // The slab that holds the target must lie behind the near plane by more than half.
        scene.slice_spacing = !leaning ? 0.5 : perspective ? 30.0 : 500.0;
        const std::vector<double> expected = line_integrals(*field, camera, 8.0);
        EXPECT_GT(largest_of(expected), 0.2) << n;
        EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-9) << n;
        EXPECT_GT(largest_difference(line_integrals(*field, camera, 8.0 + 1e-6), expected), 1e-9);
        if (!leaning) {
            scene.sampling = Sampling::point;
            scene.slice_spacing = 0.05;
            EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-3) << n;
        }
    }
}

TEST(Ellipsoids, SizesFarApartInOneField) {
    // From 1e-8 to 1e3 on one ray: each adds its own line integral.
    EllipsoidArrays arrays;
    for (int n = 0; n < 12; ++n) {
        const double radius = std::pow(10.0, n - 8);
        arrays.centers.emplace_back(0.0, 0.0, -3.0 * n);
        arrays.radii.push_back(radius);
        arrays.values.push_back(1.0 / radius);
    }
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    scene.slice_spacing = 5.0;
    const Picture picture = render(scene, front_camera(1e-10), Size{1, 1});
    EXPECT_NEAR(picture.scalar[0], 12.0 * chord_integral(0.0, 8.0), 1e-12);
    EXPECT_EQ(picture.kernels_drawn, 12U);
    EXPECT_GT(std::abs(11.0 * chord_integral(0.0, 8.0) - picture.scalar[0]), 0.1);
}

TEST(Ellipsoids, EveryKernelHasItsOwnHalfDepth) {
    // A disc that faces the camera and one on edge: slices are those of the deepest only.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-3.0, 0.0, 0.0), Vec3(3.0, 0.0, 0.0)};
    arrays.scales = {Vec3(1.0, 1.0, 0.1), Vec3(0.1, 1.0, 0.9)};
    arrays.values = {1.0, 1.0};
    const auto slices = [&](double spacing) {
        Scene scene = make_scene(make_ellipsoids(arrays));
        scene.slice_spacing = spacing;
        return render(scene, front_camera(8.0), Size{8, 8});
    };
    EXPECT_EQ(slices(0.3).slices, 6);
    EXPECT_EQ(slices(0.3).first_slice, -3);
    EXPECT_EQ(slices(0.25).slices, 8);
    arrays.centers[1].z = 3.0;
    arrays.centers[0].z = -3.0;
    // Seen along -z the second is in front: from 0.9 before it to 0.1 behind the first.
    EXPECT_EQ(slices(0.5).first_slice, -8);
    EXPECT_EQ(slices(0.5).slices, 15);
}

} // namespace

} // namespace sheetsplat::reference::testing

// Where scattered kernels crowd, and where slabs are too thick for them.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "facts/crowd.hpp"
#include "index/ellipsoid_fields.hpp"

namespace sheetsplat {
namespace {

using test::Random;

EllipsoidField spheres(std::size_t count, double radius, double spread, const Vec3& middle = Vec3(0.0)) {
    Random random(3);
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < count; ++i) {
        arrays.centers.push_back(middle + spread * random.in_cube());
        arrays.radii.push_back(radius);
        arrays.values.push_back(1.0);
    }
    return EllipsoidField(std::move(arrays));
}

TEST(Crowd, OfEvenlySpreadKernelsIsTheirOverlap) {
    // In a cube of edge 2: overlap = n 4/3 pi r^3 / 8.
    for (const double radius : {0.1, 0.23, 0.4}) {
        const Crowd crowd = survey_crowd(spheres(20'000, radius, 1.0));
        const double overlap = 20'000 * 4.18879 * std::pow(radius, 3) / 8.0;
        EXPECT_GT(crowd.overlap, 0.4 * overlap);
        EXPECT_LT(crowd.overlap, 1.3 * overlap + 6.0 * std::sqrt(overlap));
        EXPECT_LT(crowd.alike, 4.0) << "nothing is alike";
    }
}

TEST(Crowd, CountsKernelsAtOnePlace) {
    const Crowd one = survey_crowd(spheres(5'000, 0.5, 0.0, Vec3(0.1, 0.2, 0.3)));
    EXPECT_EQ(one.overlap, 5'000.0);
    EXPECT_EQ(one.alike, 5'000.0);
    const Crowd near = survey_crowd(spheres(5'000, 0.5, 0.05));
    EXPECT_EQ(near.overlap, 5'000.0) << "they overlap, but are not alike";
    EXPECT_LT(near.alike, 10.0);
    EXPECT_EQ(survey_crowd(spheres(1, 1e-100, 0.0)).alike, 1.0);
    EXPECT_EQ(survey_crowd(spheres(0, 1.0, 0.0)).alike, 0.0);
}

TEST(Crowd, FindsAClusterAmongOthersOfAnySize) {
    Random random(5);
    EllipsoidArrays arrays;
    for (int i = 0; i < 6'000; ++i) {
        const bool inside = i % 3 == 0;
        arrays.centers.push_back(inside ? Vec3(0.0) : random.in_cube());
        arrays.scales.push_back(inside ? Vec3(0.3, 0.1, 0.2)
                                       : std::pow(10.0, random.uniform(-6.0, -1.0)) * Vec3(1, 2, 3));
        arrays.values.push_back(random.uniform(0.0, 1.0));
    }
    const Crowd crowd = survey_crowd(EllipsoidField(std::move(arrays)));
    EXPECT_EQ(crowd.alike, 2'000.0);
    EXPECT_GE(crowd.overlap, 2'000.0);
    EXPECT_LT(crowd.overlap, 2'100.0);
}

TEST(Crowd, OfManyKernelsIsKnownFromASample) {
    const Crowd crowd = survey_crowd(spheres(600'000, 0.2, 0.0));
    EXPECT_NEAR(crowd.alike, 600'000.0, 3.0);
}

TEST(ThinInSlabs, LoseWhatTheyAddTimesTheSlabsThickness) {
    const auto found = [](const Vec3& axes, double weight, double spacing, double thick = 3e3) {
        EllipsoidArrays arrays;
        arrays.centers = {Vec3(0.0)};
        arrays.scales = {axes};
        arrays.values = {0.5};
        arrays.weights = {weight};
        EllipsoidFieldOptions options;
        options.w0 = 0.25;
        const auto field = std::make_shared<const EllipsoidField>(std::move(arrays), options);
        const Camera camera = Camera::orthographic(Vec3(0.0, 0.0, 5.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 4.0);
        Scene scene{{field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
        scene.slice_spacing = spacing;
        return survey_slabs(*field, camera, make_frame(scene, camera, {10, 10}), thick);
    };
    EXPECT_EQ(found(Vec3(0.1, 0.2, 0.3), 1.0, 0.3 * 2.9e3).loss, 0.0) << "0.3 deep";
    // 0.62 h / ds of the height, over w0, times ds / h.
    EXPECT_NEAR(found(Vec3(0.1, 0.2, 0.3), 1.0, 0.3 * 3.1e3).loss, 0.5 * 0.62 / 0.25, 1e-9);
    EXPECT_NEAR(found(Vec3(0.1, 0.2, 0.3), 1.0, 0.3 * 1e4).peak, 0.5 * 0.62 / 0.25 / 1e4, 1e-12);
    EXPECT_NEAR(found(Vec3(0.1, 0.2, 0.3), 1e5, 0.3 * 1e4).loss, 0.5 * 1e4, 1e-6) << "alone, it divides by itself";
    EXPECT_NEAR(found(Vec3(0.3, 0.3, 0.3), 1.0, 0.3 * 1e9).loss, 0.5 * 0.62 / 0.25 * 1e-2, 1e-9) << "all of it is lost";
}

} // namespace
} // namespace sheetsplat

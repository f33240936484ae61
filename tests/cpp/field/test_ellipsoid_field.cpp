#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"
#include "support.hpp"
#include "support/draws.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

EllipsoidArrays spheres(std::size_t count, double radius = 1.0) {
    EllipsoidArrays arrays;
    for (std::size_t n = 0; n < count; ++n) {
        arrays.centers.emplace_back(static_cast<double>(n), 0.0, 0.0);
        arrays.values.push_back(static_cast<double>(n) - 1.0);
    }
    arrays.radii.assign(count, radius);
    return arrays;
}

/// Turned ellipsoids with weights, the same ones for a seed.
EllipsoidArrays soup(std::size_t count, unsigned seed = 1) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0.1, 2.0);
    EllipsoidArrays arrays;
    for (std::size_t n = 0; n < count; ++n) {
        arrays.centers.push_back(test::three([&] { return normal(generator); }));
        arrays.scales.push_back(test::three([&] { return uniform(generator); }));
        arrays.rotations.push_back(test::rotation([&] { return normal(generator); }));
        arrays.values.push_back(normal(generator));
        arrays.weights.push_back(uniform(generator));
    }
    return arrays;
}

std::string refused(EllipsoidArrays arrays, const EllipsoidFieldOptions& options = {}) {
    return message_of<InvalidInput>([&] { const EllipsoidField field(std::move(arrays), options); });
}

std::string refused_options(const EllipsoidFieldOptions& options) { return refused(spheres(3), options); }

TEST(EllipsoidField, knows_its_kernels) {
    EllipsoidArrays arrays = spheres(3, 2.0);
    const EllipsoidField field(arrays);
    EXPECT_EQ(field.kind(), FieldKind::ellipsoid);
    EXPECT_EQ(field.size(), 3U);
    EXPECT_TRUE(field.isotropic());
    EXPECT_EQ(field.center(2), Vec3(2.0, 0.0, 0.0));
    EXPECT_EQ(field.semi_axes(1), Vec3(2.0));
    EXPECT_EQ(field.extent(1), Vec3(2.0));
    EXPECT_EQ(field.shape(0), Mat3(2.0));
    EXPECT_EQ(field.value(2), 1.0);
    EXPECT_EQ(field.weight(2), 1.0);
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{-1.0, 1.0}));
    EXPECT_EQ(field.weight_range(), (std::array<double, 2>{1.0, 1.0}));
    EXPECT_EQ(field.scale_range(), (std::array<double, 2>{2.0, 2.0}));
    EXPECT_EQ(field.centres_world().upper, Vec3(2.0, 0.0, 0.0));
    EXPECT_EQ(field.supports_world().lower, Vec3(-2.0));
    EXPECT_EQ(field.supports_world().upper, Vec3(4.0, 2.0, 2.0));
    EXPECT_EQ(field.default_slice_spacing(), 1.0);
    EXPECT_EQ(field.kernel().falloff, 8.0);
    EXPECT_EQ(field.normalization(), Normalization::threshold);
    EXPECT_EQ(as_ellipsoids(&field), &field);
    EXPECT_EQ(as_regular(&field), nullptr);
}

TEST(EllipsoidField, a_sphere_takes_forty_bytes) {
    EllipsoidArrays arrays = spheres(1000);
    const EllipsoidField field(arrays);
    EXPECT_LE(field.memory(), 40 * 1000 + sizeof(EllipsoidField));
    EXPECT_GE(field.memory(), 40U * 1000U);
    // Turned spheres keep no rotations.
    arrays.rotations.assign(1000, glm::dquat(0.6, 0.8, 0.0, 0.0));
    const EllipsoidField turned(arrays);
    EXPECT_TRUE(turned.arrays().rotations.empty());
    EXPECT_LE(turned.memory(), 40 * 1000 + sizeof(EllipsoidField));
}

TEST(EllipsoidField, shapes_are_rotation_times_scale) {
    EllipsoidArrays arrays = spheres(1);
    arrays.radii.clear();
    arrays.scales = {{1.0, 2.0, 3.0}};
    // A quarter turn round z takes x to y.
    arrays.rotations = {glm::dquat(std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5))};
    const EllipsoidField field(arrays);
    const Mat3 shape = field.shape(0);
    const Vec3 columns[3] = {{0.0, 1.0, 0.0}, {-2.0, 0.0, 0.0}, {0.0, 0.0, 3.0}};
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_LT(glm::length(shape[axis] - columns[axis]), 1e-15) << axis;
    }
    EXPECT_LT(glm::length(field.extent(0) - Vec3(2.0, 1.0, 3.0)), 1e-15);
}

TEST(EllipsoidField, boxes_and_reaches_are_tight) {
    const EllipsoidArrays arrays = soup(20);
    const EllipsoidField field(arrays);
    std::mt19937 generator(7);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < 20; ++trial) {
        // Along axes, where the box must agree, and along others.
        const Vec3 direction = trial < 3 ? Vec3(trial == 0, trial == 1, trial == 2)
                                         : glm::normalize(test::three([&] { return normal(generator); }));
        const Vec3 from(0.3, -0.7, 1.1);
        double low = infinity, high = -infinity;
        for (std::size_t i = 0; i < field.size(); ++i) {
            // The farthest point of the ellipsoid: M u, u the direction of M^T d.
            const Mat3 shape = field.shape(i);
            const Vec3 farthest = shape * glm::normalize(glm::transpose(shape) * direction);
            for (const double sign : {-1.0, 1.0}) {
                const double at = glm::dot(field.center(i) + sign * farthest - from, direction);
                low = std::min(low, at);
                high = std::max(high, at);
            }
        }
        const std::array<double, 2> reach = field.reach_along(from, direction);
        EXPECT_NEAR(reach[0], low, 1e-13);
        EXPECT_NEAR(reach[1], high, 1e-13);
        if (trial < 3) {
            EXPECT_NEAR(field.supports_world().lower[trial], low + from[trial], 1e-13);
            EXPECT_NEAR(field.supports_world().upper[trial], high + from[trial], 1e-13);
        }
    }
}

TEST(EllipsoidField, slices_are_half_the_median_smallest_semi_axis_apart) {
    EllipsoidArrays arrays = spheres(4);
    for (Vec3& center : arrays.centers) {
        center *= 1e-6;
    }
    arrays.radii = {8.0, 2.0, 100.0, 1.0};
    EXPECT_DOUBLE_EQ(EllipsoidField(arrays).default_slice_spacing(), 2.5); // of 2 and 8
    arrays.radii.clear();
    arrays.scales = {{8.0, 9.0, 9.0}, {9.0, 2.0, 9.0}, {100.0, 100.0, 200.0}, {5.0, 5.0, 1.0}};
    EXPECT_DOUBLE_EQ(EllipsoidField(arrays).default_slice_spacing(), 2.5);
    arrays.centers.pop_back();
    arrays.scales.pop_back();
    arrays.values.pop_back();
    EXPECT_DOUBLE_EQ(EllipsoidField(arrays).default_slice_spacing(), 4.0); // of 2, 8, 100
    // But not more than 2048 over the diagonal of the centres' box.
    EllipsoidArrays far = spheres(2, 1e-6);
    far.centers[1] = {3.0, 4.0, 12.0};
    EXPECT_DOUBLE_EQ(EllipsoidField(far).default_slice_spacing(), 13.0 / 2048.0);
}

TEST(EllipsoidField, the_largest_and_smallest_lengths_are_fields) {
    for (const double size : {1e-100, 1e100}) {
        EllipsoidArrays arrays = spheres(2, size);
        arrays.centers = {Vec3(-size), Vec3(size)};
        const EllipsoidField field(arrays);
        EXPECT_TRUE(std::isfinite(field.default_slice_spacing()) && field.default_slice_spacing() > 0.0) << size;
        EXPECT_EQ(field.supports_world().upper, Vec3(2.0 * size));
    }
}

TEST(EllipsoidField, short_semi_axes_are_raised) {
    EllipsoidArrays arrays = spheres(2);
    arrays.radii.clear();
    arrays.scales = {{0.0, 1.0, 0.2}, {1.0, 1e-200, 3.0}};
    EllipsoidFieldOptions options;
    options.min_scale = 0.5;
    const EllipsoidField field(arrays, options);
    EXPECT_EQ(field.semi_axes(0), Vec3(0.5, 1.0, 0.5));
    EXPECT_EQ(field.semi_axes(1), Vec3(1.0, 0.5, 3.0));
    EXPECT_EQ(field.scale_range(), (std::array<double, 2>{0.5, 3.0}));
}

TEST(EllipsoidField, quaternions_near_unit_length_are_normalised) {
    EllipsoidArrays arrays = soup(3);
    const glm::dquat before = arrays.rotations[1];
    arrays.rotations[1] = before * 1.0009;
    const EllipsoidField field(arrays);
    EXPECT_NEAR(glm::dot(field.arrays().rotations[1], before), 1.0, 1e-15);
}

TEST(EllipsoidField, may_have_no_kernels) {
    const EllipsoidField field({});
    EXPECT_EQ(field.size(), 0U);
    EXPECT_TRUE(field.centres_world().empty());
    EXPECT_TRUE(field.supports_world().empty());
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{0.0, 0.0}));
    EXPECT_EQ(field.weight_range(), (std::array<double, 2>{1.0, 1.0}));
    EXPECT_EQ(field.scale_range(), (std::array<double, 2>{0.0, 0.0}));
    EXPECT_EQ(field.default_slice_spacing(), 0.0);
    const auto reach = field.reach_along(Vec3(0.0), Vec3(0.0, 0.0, 1.0));
    EXPECT_GT(reach[0], reach[1]);
}

TEST(EllipsoidField, duplicates_and_equal_values_are_fields) {
    EllipsoidArrays arrays = spheres(3);
    arrays.centers.assign(3, Vec3(1.0, 2.0, 3.0));
    arrays.values.assign(3, 5.0);
    const EllipsoidField field(arrays);
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{5.0, 5.0}));
    EXPECT_EQ(field.centres_world().extent(), Vec3(0.0));
}

TEST(EllipsoidField, lattice_constant_is_the_mass_over_the_cell) {
    EllipsoidArrays arrays = spheres(2);
    arrays.radii.clear();
    arrays.scales = {{1.0, 2.0, 3.0}, {6.0, 1.0, 1.0}};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::lattice;
    options.cell_volume = 4.0;
    EXPECT_DOUBLE_EQ(EllipsoidField(arrays, options).lattice_constant(), Kernel{8.0}.unit_mass() * 6.0 / 4.0);
    arrays.scales[1].x = 6.0 * (1.0 + 5e-7);
    EXPECT_NO_THROW(EllipsoidField(arrays, options));
    arrays.scales[1].x = 6.0 * (1.0 + 2e-6);
    expect_parts(refused(arrays, options), {"normalization = lattice", "one volume"});
    options.cell_volume.reset();
    expect_parts(refused(spheres(2), options), {"no cell_volume"});
}

TEST(EllipsoidField, a_periodic_box_has_images_behind_its_faces) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.5, 5.0, 5.0), Vec3(-4.0, 25.0, 5.0)};
    arrays.radii = {1.0, 2.0};
    arrays.values = {3.0, 4.0};
    EllipsoidFieldOptions options;
    options.periodic = Box{Vec3(0.0), Vec3(10.0, 10.0, 0.0)};
    const EllipsoidField field(arrays, options);
    EXPECT_EQ(field.center(1), Vec3(6.0, 5.0, 5.0));
    ASSERT_EQ(field.given(), 2u);
    ASSERT_EQ(field.size(), 3u);
    EXPECT_EQ(field.center(2), Vec3(10.5, 5.0, 5.0));
    EXPECT_EQ(field.value(2), 3.0);
    EXPECT_EQ(field.given_kernel(2), 0);
    EXPECT_EQ(field.given_kernel(-1), -1);
    EXPECT_EQ(field.centres_world(), (Box{Vec3(0.5, 5.0, 5.0), Vec3(6.0, 5.0, 5.0)}));
    ASSERT_TRUE(field.domain());
    EXPECT_EQ(field.domain()->box.upper.y, 10.0);
    EXPECT_EQ(field.domain()->box.upper.z, std::numeric_limits<double>::infinity());
    const auto alone = field.without_end();
    EXPECT_EQ(alone->size(), 2u);
    EXPECT_FALSE(alone->domain());

    options.periodic = Box{Vec3(0.0), Vec3(0.05, 0.05, 10.0)};
    try {
        const EllipsoidField thin(arrays, options);
        FAIL() << "a box that takes too many images";
    } catch (const InvalidInput& error) {
        EXPECT_NE(std::string(error.what()).find("images of kernel 0"), std::string::npos) << error.what();
    }
}

TEST(EllipsoidFieldChecks, lengths_of_the_arrays) {
    const auto changed = [](auto change) {
        EllipsoidArrays arrays = soup(4);
        change(arrays);
        return refused(arrays);
    };
    expect_parts(changed([](auto& a) { a.values.pop_back(); }), {"4 centers and 3 values"});
    expect_parts(changed([](auto& a) { a.scales.pop_back(); }), {"4 centers and 3 scales"});
    expect_parts(changed([](auto& a) { a.rotations.pop_back(); }), {"4 centers and 3 rotations"});
    expect_parts(changed([](auto& a) { a.weights.push_back(1.0); }), {"4 centers and 5 weights"});
    expect_parts(changed([](auto& a) { a.scales.clear(); }), {"4 centers and 0 radii"});
    expect_parts(changed([](auto& a) { a.radii.assign(4, 1.0); }), {"both radii and scales"});
    expect_parts(changed([](auto& a) { a.centers.clear(); }), {"0 centers and 4 scales"});
}

TEST(EllipsoidFieldChecks, numbers_that_are_not_finite) {
    for (const double bad : {nan, infinity, -infinity}) {
        for (int axis = 0; axis < 3; ++axis) {
            EllipsoidArrays arrays = soup(5);
            arrays.centers[3][axis] = bad;
            expect_parts(refused(arrays), {"center", "kernel 3"});
            arrays = soup(5);
            arrays.scales[4][axis] = bad;
            expect_parts(refused(arrays), {"scale", "kernel 4"});
        }
        EllipsoidArrays arrays = spheres(5);
        arrays.radii[2] = bad;
        expect_parts(refused(arrays), {"scale", "kernel 2"});
        arrays = soup(5);
        arrays.values[1] = bad;
        expect_parts(refused(arrays), {"value", "kernel 1"});
        arrays = soup(5);
        arrays.weights[0] = bad;
        expect_parts(refused(arrays), {"weight", "kernel 0"});
        arrays = soup(5);
        arrays.rotations[3].y = bad;
        expect_parts(refused(arrays), {"rotation", "kernel 3"});
    }
}

TEST(EllipsoidFieldChecks, semi_axes_quaternions_and_weights) {
    EllipsoidArrays arrays = spheres(5);
    arrays.radii[2] = 0.0;
    expect_parts(refused(arrays), {"no thickness", "kernel 2", "min_scale"});
    arrays.radii[2] = -1e-3;
    EllipsoidFieldOptions options;
    options.min_scale = 1.0;
    expect_parts(refused(arrays, options), {"kernel 2", "-0.001", "remove its sign"});
    arrays.radii[2] = 9e-101;
    expect_parts(refused(arrays), {"too thin", "kernel 2", "1e-100"});
    arrays.radii[2] = 1.1e100;
    expect_parts(refused(arrays), {"kernel 2", "1e100"});
    arrays = spheres(5);
    arrays.centers[4].y = -1.1e100;
    expect_parts(refused(arrays), {"kernel 4", "1e100"});
    arrays = spheres(5);
    arrays.values[1] = -1.1e300;
    expect_parts(refused(arrays), {"kernel 1", "1e300"});
    arrays.values[1] = 1e200;
    arrays.weights.assign(5, 1e101);
    expect_parts(refused(arrays), {"kernel 1", "product"});
    arrays = spheres(5);
    arrays.weights = {1.0, 1.0, -1e-9, 1.0, 1.0};
    expect_parts(refused(arrays), {"kernel 2", "at least 0"});
    arrays.weights.assign(5, 0.0);
    expect_parts(refused(arrays), {"all 0"});
    for (const double length : {0.0, 0.9989, 1.0011}) {
        EllipsoidArrays turned = soup(5);
        turned.rotations[4] = glm::dquat(length, 0.0, 0.0, 0.0);
        expect_parts(refused(turned), {"quaternion of length", "kernel 4"});
    }
}

TEST(EllipsoidFieldChecks, numbers_of_the_options) {
    for (const double bad : {0.0, -1.0, nan, infinity}) {
        EllipsoidFieldOptions options;
        options.falloff = bad;
        expect_parts(refused_options(options), {"falloff"});
        options = {};
        options.w0 = bad;
        expect_parts(refused_options(options), {"w0"});
        options = {};
        options.min_scale = bad;
        expect_parts(refused_options(options), {"min_scale"});
        options = {};
        options.cell_volume = bad;
        expect_parts(refused_options(options), {"cell_volume"});
    }
    EllipsoidFieldOptions options;
    options.min_scale = 1e101;
    expect_parts(refused_options(options), {"min_scale", "1e100"});
    options = {};
    options.normalization = Normalization::none;
    options.w0 = 0.0; // without a meaning there
    EXPECT_NO_THROW(EllipsoidField(spheres(3), options));
}

} // namespace
} // namespace sheetsplat

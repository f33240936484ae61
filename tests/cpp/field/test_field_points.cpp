#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "sheetsplat/field_points.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

constexpr std::size_t kernels = 3000, places = 2000;

std::vector<Vec3> random_points(std::size_t count, std::mt19937& random) {
    std::uniform_real_distribution<double> inside(0.0, 1.0);
    std::vector<Vec3> points(count);
    for (Vec3& point : points) {
        point = {inside(random), inside(random), inside(random)};
    }
    return points;
}

EllipsoidField turned_ellipsoids(double falloff) {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> length(0.02, 0.2);
    EllipsoidArrays arrays;
    arrays.centers = random_points(kernels, random);
    for (std::size_t i = 0; i < kernels; ++i) {
        arrays.scales.push_back({length(random), length(random), length(random)});
        arrays.rotations.push_back(
            glm::normalize(glm::dquat(normal(random), normal(random), normal(random), normal(random))));
        arrays.values.push_back(normal(random));
        arrays.weights.push_back(length(random));
    }
    EllipsoidFieldOptions options;
    options.falloff = falloff;
    return EllipsoidField(std::move(arrays), options);
}

/// D, W and their derivatives by the definition, all kernels at all points.
FieldSums by_definition(const EllipsoidField& field, const Vec3& point) {
    const double k = field.kernel().falloff, edge = std::exp(-k), gain = 1.0 / (1.0 - edge);
    FieldSums sums;
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Mat3 inverse = glm::inverse(field.shape(i));
        const Vec3 offset = point - field.center(i), q = inverse * offset;
        const double r2 = glm::dot(q, q);
        if (r2 < 1.0) {
            const double profile = (std::exp(-k * r2) - edge) * gain;
            const Vec3 slope = -2.0 * k * std::exp(-k * r2) * gain * (glm::transpose(inverse) * q);
            sums.values += field.weight(i) * field.value(i) * profile;
            sums.weights += field.weight(i) * profile;
            sums.values_slope += field.weight(i) * field.value(i) * slope;
            sums.weights_slope += field.weight(i) * slope;
            if (glm::dot(offset, offset) < sums.nearest_squared) {
                sums.nearest_squared = glm::dot(offset, offset);
                sums.nearest = static_cast<std::int64_t>(i);
            }
        }
    }
    return sums;
}

void expect_same_bits(const std::vector<FieldSums>& one, const std::vector<FieldSums>& other) {
    ASSERT_EQ(one.size(), other.size());
    for (std::size_t n = 0; n < one.size(); ++n) {
        EXPECT_EQ(one[n].values, other[n].values) << n;
        EXPECT_EQ(one[n].weights, other[n].weights) << n;
        EXPECT_EQ(one[n].values_slope, other[n].values_slope) << n;
        EXPECT_EQ(one[n].weights_slope, other[n].weights_slope) << n;
        EXPECT_EQ(one[n].nearest, other[n].nearest) << n;
    }
}

TEST(FieldSums, are_those_of_the_definition) {
    for (const double falloff : {0.25, 1.0, 8.0}) {
        const EllipsoidField field = turned_ellipsoids(falloff);
        std::mt19937 random(6);
        const std::vector<Vec3> points = random_points(300, random);
        const std::vector<FieldSums> sums = field_sums(field, points);
        std::size_t reached = 0;
        for (std::size_t n = 0; n < points.size(); ++n) {
            const FieldSums expected = by_definition(field, points[n]);
            EXPECT_NEAR(sums[n].values, expected.values, 1e-13);
            EXPECT_NEAR(sums[n].weights, expected.weights, 1e-13);
            EXPECT_LT(glm::length(sums[n].values_slope - expected.values_slope), 1e-10);
            EXPECT_LT(glm::length(sums[n].weights_slope - expected.weights_slope), 1e-10);
            EXPECT_EQ(sums[n].nearest, expected.nearest);
            reached += sums[n].nearest >= 0;
        }
        EXPECT_GT(reached, points.size() / 2);
    }
}

TEST(FieldSums, of_ellipsoids_do_not_depend_on_threads) {
    const EllipsoidField field = turned_ellipsoids(2.0);
    std::mt19937 random(7);
    const std::vector<Vec3> points = random_points(places, random);
    const std::vector<FieldSums> alone = field_sums(field, points, 1);
    for (const int threads : {2, 3, 8}) {
        expect_same_bits(alone, field_sums(field, points, threads));
    }
}

/// The same of a volume.
FieldSums by_definition(const RegularField& field, const Vec3& point) {
    const double k = field.kernel().falloff, edge = std::exp(-k), gain = 1.0 / (1.0 - edge);
    const auto [nk, nj, ni] = field.shape();
    FieldSums sums;
    for (std::size_t n = 0; n < nk * nj * ni; ++n) {
        const std::size_t i = n % ni, j = n / ni % nj, layer = n / (ni * nj);
        const Vec3 offset = point - field.position(i, j, layer), q = offset / field.kernel_axes().lengths;
        const double value = field.value(i, j, layer), r2 = glm::dot(q, q);
        if (r2 < 1.0 && !std::isnan(value)) {
            const double profile = (std::exp(-k * r2) - edge) * gain;
            const Vec3 slope = -2.0 * k * std::exp(-k * r2) * gain * (q / field.kernel_axes().lengths);
            sums.values += value * profile;
            sums.weights += profile;
            sums.values_slope += value * slope;
            sums.weights_slope += slope;
            if (glm::dot(offset, offset) < sums.nearest_squared) {
                sums.nearest_squared = glm::dot(offset, offset);
                sums.nearest = static_cast<std::int64_t>(n);
            }
        }
    }
    return sums;
}

TEST(FieldSums, of_volumes_are_those_of_the_definition) {
    std::mt19937 random(9);
    std::vector<double> samples(9 * 8 * 7);
    for (double& sample : samples) {
        sample = std::normal_distribution<double>()(random);
    }
    samples[200] = std::nan("");
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const double falloff : {0.25, 5.0}) {
            RegularFieldOptions options = test::zero_boundary();
            options.lattice = lattice;
            options.spacing = lattice == Lattice::bcc ? Vec3(1.5) : Vec3(1.0, 2.0, 0.5);
            options.origin = {-3.0, 1.0, 2.0};
            options.falloff = falloff;
            options.nan = NanPolicy::skip;
            const RegularField field(samples, {9, 8, 7}, options);
            const Box box = field.supports_world();
            std::vector<Vec3> points = random_points(1000, random);
            for (Vec3& point : points) {
                point = box.lower + point * box.extent();
            }
            const std::vector<FieldSums> sums = field_sums(field, points, 2);
            std::size_t reached = 0;
            for (std::size_t n = 0; n < points.size(); ++n) {
                const FieldSums expected = by_definition(field, points[n]);
                EXPECT_NEAR(sums[n].values, expected.values, 1e-13);
                EXPECT_NEAR(sums[n].weights, expected.weights, 1e-13);
                EXPECT_LT(glm::length(sums[n].values_slope - expected.values_slope), 1e-12);
                EXPECT_LT(glm::length(sums[n].weights_slope - expected.weights_slope), 1e-12);
                EXPECT_EQ(sums[n].nearest, expected.nearest);
                reached += sums[n].nearest >= 0;
            }
            EXPECT_GT(reached, points.size() / 2);
        }
    }
}

TEST(FieldSums, of_volumes_do_not_depend_on_threads) {
    std::mt19937 random(8);
    std::vector<float> samples(12 * 10 * 8);
    for (float& sample : samples) {
        sample = std::uniform_real_distribution<float>(0.0F, 1.0F)(random);
    }
    const RegularField field(std::move(samples), {12, 10, 8}, RegularFieldOptions{});
    std::vector<Vec3> points = random_points(2 * places, random);
    for (Vec3& point : points) {
        point *= 9.0;
    }
    const std::vector<FieldSums> alone = field_sums(field, points, 1);
    for (const int threads : {2, 5}) {
        expect_same_bits(alone, field_sums(field, points, threads));
    }
}

TEST(FieldSums, of_no_kernels_and_at_no_points_are_empty) {
    const EllipsoidField field = turned_ellipsoids(2.0), none(EllipsoidArrays{}, EllipsoidFieldOptions{});
    EXPECT_TRUE(field_sums(field, {}).empty());
    const std::vector<FieldSums> sums = field_sums(none, std::vector<Vec3>(5000, Vec3(0.0)));
    EXPECT_EQ(sums.size(), 5000u);
    EXPECT_EQ(sums[17].nearest, -1);
    EXPECT_EQ(sums[17].weights, 0.0);
}

} // namespace
} // namespace sheetsplat

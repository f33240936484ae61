// rho at points of the world, held against the sums of the reference.
#include "point_values.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "reference/reference.hpp"
#include "support/ellipsoid_scenes.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

double wanted_rho(const Field& field, const Vec3& at) {
    const reference::Sums sums = reference::sums_at(field, at);
    switch (field.normalization()) {
    case Normalization::none:
        return sums.d;
    case Normalization::lattice:
        return sums.d / as_regular(&field)->lattice_constant();
    case Normalization::threshold:
        break;
    }
    return sums.d / std::max(field.w0(), sums.w);
}

void expect_reference(const std::shared_ptr<const Field>& field) {
    const Scene scene{{field}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    const auto values = point_values(field, scene);
    const Box box = field->supports_world();
    std::mt19937 random(7);
    std::uniform_real_distribution<double> share(-0.05, 1.05);
    int reached = 0;
    for (int n = 0; n < 400; ++n) {
        const Vec3 at = box.lower + Vec3(share(random), share(random), share(random)) * box.extent();
        const PointValues::Value found = values->at(at);
        EXPECT_NEAR(found.rho, wanted_rho(*field, at), 1e-11 * (1.0 + std::abs(found.rho)));
        EXPECT_EQ(found.empty, reference::sums_at(*field, at).empty);
        reached += found.empty ? 0 : 1;
    }
    EXPECT_GT(reached, 50);
}

TEST(PointValues, AreThoseOfLattices) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> value(-1.0F, 2.0F);
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const Normalization normalization :
             {Normalization::none, Normalization::lattice, Normalization::threshold}) {
            std::vector<float> samples(7 * 6 * 5);
            for (float& sample : samples) {
                sample = value(random);
            }
            samples[40] = std::nanf("");
            RegularFieldOptions options = test::zero_boundary();
            options.lattice = lattice;
            options.spacing = lattice == Lattice::bcc ? Vec3(0.8) : Vec3(0.5, 0.7, 0.9);
            options.origin = Vec3(-1.0, 2.0, 0.3);
            options.normalization = normalization;
            options.nan = NanPolicy::skip;
            expect_reference(
                std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{7, 6, 5}, options));
        }
    }
}

TEST(PointValues, AreThoseOfWideKernels) {
    RegularFieldOptions options = test::zero_boundary();
    options.radius = 20.0;
    options.falloff = 30.0;
    std::vector<float> samples(4 * 4 * 4, 0.5F);
    samples[9] = 3.0F;
    expect_reference(std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{4, 4, 4}, options));
}

TEST(PointValues, AreThoseOfScatteredKernels) {
    EllipsoidFieldOptions options;
    for (const Normalization normalization : {Normalization::none, Normalization::threshold}) {
        options.normalization = normalization;
        expect_reference(testing::cloud(60, 0.2, 4.0, 5, options, normalization == Normalization::threshold));
    }
}

// Slab sampling divides means of sums: by weights that are 0 along part of the line too.
void expect_means(const std::shared_ptr<const Field>& field) {
    const Scene scene{{field}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    const auto values = point_values(field, scene);
    const Box box = field->supports_world();
    std::mt19937 random(7);
    std::uniform_real_distribution<double> share(-0.1, 1.0);
    int between = 0, touched = 0;
    for (int n = 0; n < 40; ++n) {
        const double x = share(random), y = share(random), z = share(random);
        const Vec3 from = box.lower + Vec3(x, y, z) * box.extent();
        // Along an axis, and longer than the kernels, by turns.
        const Vec3 to = from + (n % 3 == 0   ? Vec3(0.0, 0.0, 0.4)
                                : n % 3 == 1 ? Vec3(0.2, -0.1, 0.3)
                                             : 0.4 * box.extent() * Vec3(0.5, -0.8, 1.0));
        const int points = n % 3 == 2 ? 1500 : 300;
        reference::Sums wanted;
        for (int point = 0; point < points; ++point) {
            const reference::Sums one = reference::sums_at(*field, from + (point + 0.5) / points * (to - from));
            wanted.d += one.d / points;
            wanted.w += one.w / points;
            wanted.empty = wanted.empty && one.empty;
        }
        const double rho =
            field->normalization() == Normalization::none ? wanted.d : wanted.d / std::max(field->w0(), wanted.w);
        const PointValues::Value found = values->mean(from, to);
        EXPECT_NEAR(found.rho, rho, 2e-5 * (1.0 + std::abs(rho)));
        EXPECT_TRUE(wanted.empty || !found.empty) << n;
        between += found.rho != values->at(from).rho ? 1 : 0;
        touched += found.empty ? 0 : 1;
    }
    EXPECT_GT(between, 10);
    EXPECT_GT(touched, 10);
}

TEST(PointValues, MeansOfScatteredKernelsAreThoseOfSums) {
    EllipsoidFieldOptions options;
    for (const Normalization normalization : {Normalization::none, Normalization::threshold}) {
        options.normalization = normalization;
        expect_means(testing::cloud(60, 0.5, 4.0, 5, options, normalization == Normalization::threshold));
    }
}

TEST(PointValues, MeansOfLatticesAreThoseOfSums) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        RegularFieldOptions options = test::zero_boundary();
        options.lattice = lattice;
        options.spacing = lattice == Lattice::bcc ? Vec3(0.8) : Vec3(0.5, 0.7, 0.9);
        options.origin = Vec3(-1.0, 2.0, 0.3);
        options.nan = NanPolicy::skip;
        options.normalization = Normalization::none;
        std::vector<float> samples(7 * 6 * 5);
        for (std::size_t n = 0; n < samples.size(); ++n) {
            samples[n] = n % 11 == 0 ? std::numeric_limits<float>::quiet_NaN() : std::sin(1.7F * static_cast<float>(n));
        }
        expect_means(std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{7, 6, 5}, options));
    }
}

// One kernel whose end is just within a line's: samples along it would call it empty.
TEST(PointValues, LinesThatAKernelOnlyTouchesAreNotEmpty) {
    RegularFieldOptions options = test::zero_boundary();
    options.radius = 1.0;
    const auto field =
        std::make_shared<const RegularField>(std::vector<float>{1.0F}, std::array<std::size_t, 3>{1, 1, 1}, options);
    const Scene scene{{field}, TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 1.0}})};
    const auto values = point_values(field, scene);
    EXPECT_FALSE(values->mean(Vec3(0.0, 0.0, 0.999), Vec3(0.0, 0.0, 3.0)).empty);
    EXPECT_TRUE(values->mean(Vec3(0.0, 0.0, 1.001), Vec3(0.0, 0.0, 3.0)).empty);
}

} // namespace
} // namespace sheetsplat

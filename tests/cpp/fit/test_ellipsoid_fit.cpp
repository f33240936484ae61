// The fit of free ellipsoids: sums against the definition, derivatives against differences, the same bits on threads.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/instruction_set.hpp"
#include "sheetsplat/ellipsoid_fit.hpp"
#include "sheetsplat/error.hpp"

namespace {

using namespace sheetsplat;

constexpr std::array<std::size_t, 3> shape{9, 11, 14}; // {nk, nj, ni}
constexpr double falloff = 8.0;

std::vector<Vec3> lattice_points() {
    std::vector<Vec3> points;
    for (std::size_t k = 0; k < shape[0]; ++k) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            for (std::size_t i = 0; i < shape[2]; ++i) {
                points.emplace_back(i, j, k);
            }
        }
    }
    return points;
}

/// The sum by its definition.
double sum_at(const std::vector<FreeEllipsoid>& kernels, const Vec3& point) {
    double sum = 0.0;
    for (const FreeEllipsoid& one : kernels) {
        const Vec3 d = point - one.center;
        const auto& u = one.frame;
        const double q0 = u[0] * d.x + u[3] * d.y + u[4] * d.z, q1 = u[1] * d.y + u[5] * d.z, q2 = u[2] * d.z;
        const double r2 = q0 * q0 + q1 * q1 + q2 * q2;
        sum += one.value * std::max(0.0, (std::exp(-falloff * r2) - std::exp(-falloff)) / (1.0 - std::exp(-falloff)));
    }
    return sum;
}

std::vector<FreeEllipsoid> random_kernels(std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    std::vector<FreeEllipsoid> kernels(count);
    for (FreeEllipsoid& one : kernels) {
        one.center = {unit(random) * 13.0, unit(random) * 10.0, unit(random) * 8.0};
        for (std::size_t n = 0; n < 3; ++n) {
            one.frame[n] = 1.0 / (1.5 + 6.0 * unit(random));
            one.frame[n + 3] = 0.2 * (unit(random) - 0.5);
        }
        one.value = 4.0 * unit(random) - 2.0;
    }
    return kernels;
}

double* number(EllipsoidChange& change, std::size_t n) {
    return n < 3 ? &change.center[static_cast<int>(n)] : n < 9 ? &change.frame[n - 3] : &change.value;
}

struct Samples {
    std::vector<double> data, weights;
    Samples() {
        std::mt19937 random(5);
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        for (std::size_t n = 0; n < shape[0] * shape[1] * shape[2]; ++n) {
            data.push_back(unit(random));
            weights.push_back(unit(random) < 0.2 ? 0.0 : unit(random));
        }
    }
};

/// The same samples as a lattice and as points in another order.
std::unique_ptr<EllipsoidFit> make(bool points, int threads, const std::vector<double>& data,
                                   std::vector<double> weights) {
    EllipsoidFit::Options options{std::move(weights), falloff, threads};
    return points ? std::make_unique<EllipsoidFit>(lattice_points(), data, options)
                  : std::make_unique<EllipsoidFit>(shape, data, options);
}

class EllipsoidFits : public testing::TestWithParam<bool> {};

TEST_P(EllipsoidFits, SumsAreThoseOfTheDefinition) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(12, 1);
    const Samples samples;
    const auto fit = make(GetParam(), 2, samples.data, samples.weights);
    const std::vector<double> sums = fit->sums(kernels);
    const std::vector<Vec3> points = lattice_points();
    double largest = 0.0, sum = 0.0;
    for (std::size_t n = 0; n < points.size(); ++n) {
        const double wanted = sum_at(kernels, points[n]);
        largest = std::max(largest, std::abs(sums[n] - wanted));
        sum += 0.5 * samples.weights[n] * (wanted - samples.data[n]) * (wanted - samples.data[n]);
    }
    EXPECT_LT(largest, 1e-14);
    std::vector<EllipsoidChange> slope;
    EXPECT_NEAR(fit->objective(kernels, slope), sum, 1e-12 * sum);
}

TEST_P(EllipsoidFits, DerivativesAreThoseOfDifferences) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(6, 2);
    const Samples samples;
    const auto fit = make(GetParam(), 1, samples.data, samples.weights);
    std::vector<EllipsoidChange> slope, unused;
    fit->objective(kernels, slope);
    const double step = 1e-5;
    for (std::size_t n = 0; n < numbers_of_ellipsoid; ++n) {
        double scale = 0.0;
        for (EllipsoidChange& one : slope) {
            scale = std::max(scale, std::abs(*number(one, n)));
        }
        for (std::size_t i = 0; i < kernels.size(); ++i) {
            const auto at = [&](double by) {
                EllipsoidChange change;
                *number(change, n) = by;
                std::vector<FreeEllipsoid> moved = kernels;
                moved[i] = changed(kernels[i], change);
                return fit->objective(moved, unused);
            };
            const double difference =
                (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
            EXPECT_NEAR(*number(slope[i], n), difference, 1e-6 * scale) << "kernel " << i << ", number " << n;
        }
    }
}

TEST_P(EllipsoidFits, NormalEquationsAreThoseOfDifferencesAndOfBlocks) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(5, 3);
    const Samples samples;
    const auto fit = make(GetParam(), 2, samples.data, samples.weights);
    const auto blocks = fit->blocks(kernels);
    const double step = 1e-6;
    std::vector<std::vector<double>> jacobian; // of each number of each kernel, at all samples
    for (std::size_t i = 0; i < kernels.size(); ++i) {
        for (std::size_t n = 0; n < numbers_of_ellipsoid; ++n) {
            const auto at = [&](double by) {
                EllipsoidChange change;
                *number(change, n) = by;
                std::vector<FreeEllipsoid> moved = kernels;
                moved[i] = changed(kernels[i], change);
                return fit->sums(moved);
            };
            std::vector<double> column = at(step);
            const std::vector<double> below = at(-step);
            for (std::size_t m = 0; m < column.size(); ++m) {
                column[m] = (column[m] - below[m]) / (2.0 * step);
            }
            jacobian.push_back(std::move(column));
        }
    }
    const auto product = [&](std::size_t a, std::size_t b) {
        double sum = 0.0;
        for (std::size_t m = 0; m < samples.data.size(); ++m) {
            sum += samples.weights[m] * jacobian[a][m] * jacobian[b][m];
        }
        return sum;
    };
    for (std::size_t column = 0; column < jacobian.size(); ++column) {
        std::vector<EllipsoidChange> changes(kernels.size());
        const std::size_t of = column / numbers_of_ellipsoid, with = column % numbers_of_ellipsoid;
        *number(changes[of], with) = 1.0;
        std::vector<EllipsoidChange> products = fit->normal(kernels, changes);
        for (std::size_t row = 0; row < jacobian.size(); ++row) {
            const std::size_t i = row / numbers_of_ellipsoid, n = row % numbers_of_ellipsoid;
            const double wanted = product(row, column);
            const double scale = std::sqrt(product(row, row) * product(column, column));
            EXPECT_NEAR(*number(products[i], n), wanted, 1e-4 * scale);
            if (i == of && n >= with) {
                const std::size_t place = with * numbers_of_ellipsoid - with * (with + 1) / 2 + n;
                EXPECT_NEAR(blocks[i][place], *number(products[i], n), 1e-12 * scale) << with << " " << n;
            }
        }
    }
}

TEST_P(EllipsoidFits, OverlapsAreSumsOfProducts) {
    std::vector<FreeEllipsoid> kernels = random_kernels(9, 8);
    const Samples samples;
    const std::vector<double> overlaps = make(GetParam(), 2, samples.data, samples.weights)->overlaps(kernels);
    const std::vector<Vec3> points = lattice_points();
    for (FreeEllipsoid& one : kernels) {
        one.value = 1.0;
    }
    for (std::size_t a = 0; a < kernels.size(); ++a) {
        for (std::size_t b = 0; b < kernels.size(); ++b) {
            double sum = 0.0;
            for (std::size_t n = 0; n < points.size(); ++n) {
                sum += samples.weights[n] * sum_at({kernels[a]}, points[n]) * sum_at({kernels[b]}, points[n]);
            }
            EXPECT_NEAR(overlaps[a * kernels.size() + b], sum, 1e-13 * (1.0 + sum)) << a << " " << b;
        }
    }
}

TEST(EllipsoidFit, LongRowsKeepTheirDigits) {
    // Rows of 2,000 samples within one kernel.
    const std::array<std::size_t, 3> long_shape{1, 2, 2000};
    const std::vector<FreeEllipsoid> kernels{{{900.3, 0.4, 0.0}, {1e-3, 0.3, 0.3, 1e-4, 0.0, 0.0}, 1.0}};
    const EllipsoidFit fit(long_shape, std::vector<double>(4000, 0.0), {});
    const std::vector<double> sums = fit.sums(kernels);
    for (std::size_t n = 0; n < sums.size(); ++n) {
        EXPECT_NEAR(sums[n], sum_at(kernels, Vec3(n % 2000, n / 2000, 0.0)), 1e-13);
    }
}

TEST_P(EllipsoidFits, BitsAreTheSameOnAnyNumberOfThreads) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(40, 4);
    const Samples samples;
    std::vector<EllipsoidChange> first, other;
    const double found = make(GetParam(), 1, samples.data, samples.weights)->objective(kernels, first);
    for (const int threads : {2, 3, 8}) {
        EXPECT_EQ(make(GetParam(), threads, samples.data, samples.weights)->objective(kernels, other), found);
        for (std::size_t i = 0; i < kernels.size(); ++i) {
            EXPECT_EQ(first[i].center, other[i].center);
            EXPECT_EQ(first[i].frame, other[i].frame);
            EXPECT_EQ(first[i].value, other[i].value);
        }
    }
}

TEST_P(EllipsoidFits, InstructionSetsDifferInTheLastDigits) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(20, 9);
    const Samples samples;
    std::vector<EllipsoidChange> first, other;
    const double found = make(GetParam(), 1, samples.data, samples.weights)->objective(kernels, first);
    for (const std::string& name : instruction_sets()) {
        choose_instruction_set(name);
        const auto fit = make(GetParam(), 1, samples.data, samples.weights);
        EXPECT_NEAR(fit->objective(kernels, other), found, 1e-12 * found) << name;
        for (std::size_t i = 0; i < kernels.size(); ++i) {
            for (std::size_t n = 0; n < numbers_of_ellipsoid; ++n) {
                EXPECT_NEAR(*number(other[i], n), *number(first[i], n), 1e-11 * found) << name;
            }
        }
    }
    choose_instruction_set("");
}

TEST_P(EllipsoidFits, MissingSamplesCountForNothing) {
    const std::vector<FreeEllipsoid> kernels = random_kernels(8, 6);
    Samples samples;
    std::vector<EllipsoidChange> first, other;
    const double found = make(GetParam(), 1, samples.data, samples.weights)->objective(kernels, first);
    for (std::size_t n = 0; n < samples.data.size(); ++n) {
        if (samples.weights[n] == 0.0) {
            samples.data[n] = std::numeric_limits<double>::quiet_NaN();
        }
    }
    EXPECT_EQ(make(GetParam(), 1, samples.data, samples.weights)->objective(kernels, other), found);
    samples.weights.clear();
    EXPECT_THROW(make(GetParam(), 1, samples.data, samples.weights), InvalidInput);
}

INSTANTIATE_TEST_SUITE_P(All, EllipsoidFits, testing::Bool(),
                         [](const auto& test) { return test.param ? "points" : "lattice"; });

TEST(EllipsoidFit, ReachesWhatLiesOutsideOfItsSamples) {
    // Kernels outside, larger than everything, and much smaller than a sample's distance.
    std::vector<FreeEllipsoid> kernels(4);
    kernels[0] = {{-30.0, 4.0, 4.0}, {1.0, 1.0, 1.0, 0.0, 0.0, 0.0}, 1.0};
    kernels[1] = {{5.0, 5.0, 4.0}, {1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0}, 1.0};
    kernels[2] = {{5.3, 5.3, 4.3}, {1e4, 1e4, 1e4, 0.0, 0.0, 0.0}, 1.0};
    kernels[3] = {{5.0, 5.0, 4.0}, {1e4, 1e4, 1e4, 1e3, 0.0, 0.0}, 1.0};
    const std::size_t count = shape[0] * shape[1] * shape[2];
    const EllipsoidFit fit(shape, std::vector<double>(count, 0.0), {});
    const std::vector<double> sums = fit.sums(kernels);
    const std::vector<Vec3> points = lattice_points();
    for (std::size_t n = 0; n < count; ++n) {
        EXPECT_NEAR(sums[n], sum_at(kernels, points[n]), 1e-14);
    }
    kernels[0].frame[1] = 0.0;
    EXPECT_THROW(fit.sums(kernels), InvalidInput);
}

TEST(EllipsoidFit, CanBeCancelled) {
    const std::size_t count = shape[0] * shape[1] * shape[2];
    const EllipsoidFit fit(shape, std::vector<double>(count, 0.0), {});
    std::vector<EllipsoidChange> slope;
    EXPECT_THROW(fit.objective(random_kernels(5, 7), slope, [](double) { return false; }), Cancelled);
}

TEST(EllipsoidFit, FitsNothingToNothing) {
    const EllipsoidFit none({0, 3, 3}, {}, {});
    std::vector<EllipsoidChange> slope;
    EXPECT_EQ(none.objective(random_kernels(2, 1), slope), 0.0);
    const EllipsoidFit one(std::vector<Vec3>{{1.0, 1.0, 1.0}}, {2.0}, {});
    EXPECT_EQ(one.objective({}, slope), 2.0);
}

} // namespace

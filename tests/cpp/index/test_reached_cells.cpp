// Cells of a lattice that its drawn samples reach: none is left out, and most of what is far away is.
#include "index/reached_cells.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

using namespace sheetsplat;

namespace {

/// 1 at few samples, 0 elsewhere.
RegularField sparse(std::mt19937& random, const std::array<std::size_t, 3>& shape, int ones) {
    std::vector<std::uint8_t> samples(shape[0] * shape[1] * shape[2], 0);
    for (int one = 0; one < ones; ++one) {
        samples[random() % samples.size()] = 1;
    }
    return {std::move(samples), shape, RegularFieldOptions{}};
}

TEST(ReachedCells, HoldEachPointNearASample) {
    std::mt19937 random(5);
    std::size_t near = 0, left_out = 0;
    for (const double reach : {1.5, 4.0, 6.0}) {
        const std::array<std::size_t, 3> shape{33, 7, 150};
        const RegularField field = sparse(random, shape, 3);
        const VisibleRuns runs = VisibleRuns::of(field, VisibilityQuery{});
        const ReachedCells cells(field, runs, reach);
        std::uniform_real_distribution<double> place(-9.0, 160.0);
        for (int trial = 0; trial < 20000; ++trial) {
            const Vec3 point(place(random), std::fmod(place(random), 16.0), std::fmod(place(random), 42.0));
            bool expected = false;
            for (std::size_t row = 0; row < runs.rows(); ++row) {
                for (const sheetsplat::Run* run = runs.begin(row); run != runs.end(row); ++run) {
                    for (std::uint32_t i = run->begin; i < run->end; ++i) {
                        expected = expected || (std::abs(point.x - i) <= reach &&
                                                std::abs(point.y - static_cast<double>(row % shape[1])) <= reach &&
                                                std::abs(point.z - static_cast<double>(row / shape[1])) <= reach);
                    }
                }
            }
            near += expected ? 1 : 0;
            left_out += cells.reached(point) ? 0 : 1;
            ASSERT_TRUE(!expected || cells.reached(point)) << point.x << " " << point.y << " " << point.z;
        }
    }
    EXPECT_GT(near, 300U);
    EXPECT_GT(left_out, 30000U);
}

} // namespace

// Light through a grid of absorption, next to sums along lines; blocks of a volume.
#include "light/march.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "light/blocks.hpp"
#include "light/surface_lines.hpp"
#include "rays.hpp"
#include "support/draws.hpp"

namespace sheetsplat {
namespace {

constexpr double spacing = 0.5; ///< slice distance, world
constexpr WhereLight everywhere = WhereLight::everywhere;

/// Two smooth blobs, as absorption of a slice distance.
double blobs(const Vec3& x) {
    const Vec3 a = x - Vec3(7.0, 9.0, 6.0), b = x - Vec3(11.0, 7.0, 10.0);
    return 0.4 * std::exp(-glm::dot(a, a) / 5.0) + 0.9 * std::exp(-glm::dot(b, b) / 3.0);
}

/// On a grid whose axes point elsewhere than the world's, with another step along the last one.
LightVolume grid(double across, double along) {
    LightVolume volume;
    volume.origin = Vec3(-1.0, 18.0, 18.5);
    volume.per_step = {Vec3(1.0 / across, 0, 0), Vec3(0, -1.0 / across, 0), Vec3(0, 0, -1.0 / along)};
    volume.counts = {static_cast<int>(20.0 / across) + 1, static_cast<int>(19.0 / across) + 1,
                     static_cast<int>(21.0 / along) + 1};
    for (int w = 0; w < volume.counts[2]; ++w) {
        for (int v = 0; v < volume.counts[1]; ++v) {
            for (int u = 0; u < volume.counts[0]; ++u) {
                const bool face = u == 0 || v == 0 || u + 1 == volume.counts[0] || v + 1 == volume.counts[1];
                const Vec3 world = volume.origin + Vec3(u * across, -v * across, -w * along);
                volume.values.push_back(face ? 0.0F : static_cast<float>(blobs(world)));
            }
        }
    }
    return volume;
}

double left_along(const Vec3& from, const Vec3& direction, double steps) {
    double sum = 0.0;
    for (double step = 1.0; step <= steps; step += 1.0) {
        sum += blobs(from + step * spacing * direction);
    }
    return std::exp(-sum);
}

std::vector<Vec3> places() {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> within(2.0, 15.0);
    std::vector<Vec3> found(400);
    for (Vec3& place : found) {
        place = test::three([&] { return within(random); });
    }
    return found;
}

template <class Expected>
double rmse(const LightVolume& volume, const Expected& expected) {
    double sum = 0.0;
    const std::vector<Vec3> all = places();
    for (const Vec3& place : all) {
        sum += std::pow(volume.at(place) - expected(place), 2.0);
    }
    return std::sqrt(sum / static_cast<double>(all.size()));
}

std::vector<Vec3> some_directions() {
    std::vector<Vec3> found;
    for (const Vec3& direction : around_world()) {
        found.push_back(direction);
    }
    for (const Vec3& direction : {Vec3(1, 0.3, -0.2), Vec3(-0.4, 1, 0.9), Vec3(0.1, -0.5, -1), Vec3(-0.9, -0.8, 1)}) {
        found.push_back(glm::normalize(direction));
    }
    return found;
}

TEST(LightMarch, TransmittanceIsThatOfSumsAlongLines) {
    ThreadPool pool(2);
    const LightVolume fine = grid(spacing, spacing), coarse = grid(1.3 * spacing, 2.0 * spacing);
    const std::vector<Vec3> directions = some_directions();
    for (std::size_t n = 0; n < directions.size(); ++n) {
        const auto exact = [&](const Vec3& x) { return left_along(x, directions[n], 80.0); };
        EXPECT_LT(rmse(transmittance(FollowedGrid(fine, everywhere), directions[n], spacing, pool, {}), exact), 4e-3)
            << n;
        EXPECT_LT(rmse(transmittance(FollowedGrid(coarse, everywhere), directions[n], spacing, pool, {}), exact),
                  1.2e-2)
            << n;
        // Of another direction, or of points that begin a slice distance farther, it is not.
        const auto other = [&](const Vec3& x) { return left_along(x, directions[(n + 2) % directions.size()], 80.0); };
        EXPECT_GT(rmse(transmittance(FollowedGrid(fine, everywhere), directions[n], spacing, pool, {}), other), 5e-2)
            << n;
        const auto farther = [&](const Vec3& x) {
            return left_along(x + spacing * directions[n], directions[n], 80.0);
        };
        EXPECT_GT(rmse(transmittance(FollowedGrid(fine, everywhere), directions[n], spacing, pool, {}), farther),
                  1.5e-2)
            << n;
    }
}

TEST(LightMarch, OpennessIsTheMeanOverShortLines) {
    ThreadPool pool(2);
    const std::vector<Vec3> directions = some_directions();
    for (const double steps : {1.0, 4.0, 9.0}) {
        const auto exact = [&](const Vec3& x) {
            double sum = 0.0;
            for (const Vec3& direction : directions) {
                sum += left_along(x, direction, steps);
            }
            return sum / static_cast<double>(directions.size());
        };
        const LightVolume fine = grid(spacing, spacing);
        EXPECT_LT(rmse(openness(FollowedGrid(fine, everywhere), directions, steps, spacing, pool, {}), exact), 5e-3)
            << steps;
        EXPECT_LT(rmse(openness(FollowedGrid(halved(fine), everywhere), directions, steps, spacing, pool, {}), exact),
                  2e-2)
            << steps;
        EXPECT_GT(rmse(openness(FollowedGrid(fine, everywhere), directions, steps + 2.0, spacing, pool, {}), exact),
                  1e-2)
            << steps;
    }
}

TEST(LightMarch, NothingDependsOnThreads) {
    ThreadPool one(1), three(3);
    const LightVolume volume = grid(spacing, spacing);
    const Vec3 direction = glm::normalize(Vec3(0.5, -0.7, 0.6));
    EXPECT_EQ(transmittance(FollowedGrid(volume, everywhere), direction, spacing, one, {}).values,
              transmittance(FollowedGrid(volume, everywhere), direction, spacing, three, {}).values);
    EXPECT_EQ(openness(FollowedGrid(volume, everywhere), {direction, -direction}, 5.0, spacing, one, {}).values,
              openness(FollowedGrid(volume, everywhere), {direction, -direction}, 5.0, spacing, three, {}).values);
}

/// Whether an element or one beside it absorbs.
bool near_matter(const LightVolume& volume, int u, int v, int w) {
    for (int z = std::max(w - 1, 0); z <= std::min(w + 1, volume.counts[2] - 1); ++z) {
        for (int y = std::max(v - 1, 0); y <= std::min(v + 1, volume.counts[1] - 1); ++y) {
            for (int x = std::max(u - 1, 0); x <= std::min(u + 1, volume.counts[0] - 1); ++x) {
                if (volume.values[volume.index(x, y, z)] > 0.0F) {
                    return true;
                }
            }
        }
    }
    return false;
}

TEST(LightMarch, EveryElementHasARayBeforeItsOwn) {
    // The last plane has an offset of 1, or of what rounding leaves of it: less for one light in twenty.
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (int number = 0; number < 1000; ++number) {
        const std::array<int, 3> counts{3 + number % 50, 4 + number % 31, 5 + number % 23};
        const LightVolume volume{Vec3(0.0), {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, counts, {}};
        const light_march::Rays rays(volume, glm::normalize(test::three([&] { return uniform(random); })), 0.7);
        for (int plane = 0; plane < rays.planes(); ++plane) {
            for (const light_march::Rays::Axis& axis : {rays.columns(), rays.rows()}) {
                ASSERT_GE(light_march::between(axis.offset(plane)).whole, 1) << number << ", plane " << plane;
                ASSERT_LE(light_march::between(axis.offset(plane)).whole + axis.elements + 2, axis.rays) << number;
            }
        }
    }
}

TEST(LightMarch, NearMatterLightIsWhatItIsEverywhere) {
    ThreadPool pool(2);
    // Thin threads of matter with space between them, over more than one stretch of a row.
    for (const std::array<int, 3>& counts :
         std::vector<std::array<int, 3>>{{70, 31, 23}, {1100, 9, 8}, {9, 50, 30}, {5, 4, 70}}) {
        LightVolume volume{Vec3(0.0), {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, counts, {}};
        volume.values.assign(volume.index(0, 0, counts[2]), 0.0F);
        std::mt19937 random(17);
        for (int thread = 0; thread < 12; ++thread) {
            std::array<int, 3> at{};
            std::transform(counts.begin(), counts.end(), at.begin(),
                           [&](int count) { return static_cast<int>(random() % static_cast<unsigned>(count)); });
            const auto axis = static_cast<std::size_t>(thread % 3);
            for (int n = 0; n < 11; ++n) {
                at[axis] = (at[axis] + 1) % counts[axis];
                volume.values[volume.index(at[0], at[1], at[2])] = 0.7F;
            }
        }
        std::size_t left_out = 0;
        const std::vector<Vec3> directions = some_directions();
        for (std::size_t number = 0; number < directions.size(); number += 3) {
            const Vec3& direction = directions[number];
            const auto light = [&](WhereLight where) {
                return transmittance(FollowedGrid(volume, where), direction, 1.0, pool, {});
            };
            const auto open = [&](WhereLight where) {
                return openness(FollowedGrid(volume, where), {direction}, 3.0, 1.0, pool, {});
            };
            const LightVolume all = light(everywhere), some = light(WhereLight::near_matter);
            const LightVolume all_open = open(everywhere), some_open = open(WhereLight::near_matter);
            for (int w = 0; w < counts[2]; ++w) {
                for (int v = 0; v < counts[1]; ++v) {
                    for (int u = 0; u < counts[0]; ++u) {
                        const std::size_t at = volume.index(u, v, w);
                        if (near_matter(volume, u, v, w)) {
                            ASSERT_NEAR(all.values[at], some.values[at], 1e-6F) << u << " " << v << " " << w;
                            ASSERT_NEAR(all_open.values[at], some_open.values[at], 1e-6F) << u << " " << v << " " << w;
                        }
                        left_out += all.values[at] < 0.9F && some.values[at] == 1.0F ? 1 : 0;
                    }
                }
            }
        }
        EXPECT_GT(left_out, 0U);
    }
}

TEST(LightMarch, OpaqueMatterLeavesNothingAndEmptySpaceAll) {
    ThreadPool pool(1);
    LightVolume volume = grid(spacing, spacing);
    std::fill(volume.values.begin(), volume.values.end(), 0.0F);
    for (const float left : transmittance(FollowedGrid(volume, everywhere), Vec3(0, 0, 1), spacing, pool, {}).values) {
        ASSERT_EQ(left, 1.0F);
    }
    // A wall across x.
    for (int w = 0; w < volume.counts[2]; ++w) {
        for (int v = 0; v < volume.counts[1]; ++v) {
            volume.values[volume.index(20, v, w)] = volume.values[volume.index(21, v, w)] = 20.0F;
        }
    }
    const LightVolume left = transmittance(FollowedGrid(volume, everywhere), Vec3(1, 0, 0), spacing, pool, {});
    EXPECT_LT(left.values[left.index(15, 20, 20)], 1e-6F);
    EXPECT_GT(left.values[left.index(26, 20, 20)], 1.0F - 1e-6F);
    const std::vector<float> fewest(1, 3.0F);
    const LightVolume single{Vec3(0.0), {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, {1, 1, 1}, fewest};
    for (const Vec3& direction : some_directions()) {
        const float alone = transmittance(FollowedGrid(single, everywhere), direction, 1.0, pool, {}).values.front();
        EXPECT_GE(alone, 0.0F);
        EXPECT_LE(alone, 1.0F);
        EXPECT_GT(openness(FollowedGrid(single, everywhere), {direction}, 3.0, 1.0, pool, {}).values.front(), 0.0F);
    }
}

TEST(LightBlocks, HoldWhatLookUpsFind) {
    for (const std::array<int, 3>& counts : std::vector<std::array<int, 3>>{{13, 9, 5}, {1, 2, 8}, {4, 17, 6}}) {
        LightVolume volume{Vec3(0.0), {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, counts, {}};
        std::mt19937 random(11);
        std::uniform_real_distribution<float> number(-1.0F, 1.0F);
        volume.values.resize(volume.index(0, 0, counts[2]));
        std::generate(volume.values.begin(), volume.values.end(), [&] { return number(random); });
        const LightBlocks blocks(volume);
        std::uniform_real_distribution<double> place(-0.2, 1.2);
        double narrowest = 2.0;
        for (int n = 0; n < 5000; ++n) {
            const Vec3 at(place(random) * counts[0], place(random) * counts[1], place(random) * counts[2]);
            const LightBlocks::Range& range = blocks.ranges()[blocks.at(at)];
            const double found = volume.at(at);
            EXPECT_GE(found, static_cast<double>(range.least) - 1e-6);
            EXPECT_LE(found, static_cast<double>(range.greatest) + 1e-6);
            narrowest = std::min(narrowest, static_cast<double>(range.greatest - range.least));
        }
        EXPECT_LT(narrowest, 2.0);
    }
}

TEST(ClearCells, HaveNothingInTheCellsAroundThem) {
    for (const std::array<int, 3>& counts : std::vector<std::array<int, 3>>{{141, 9, 5}, {1, 2, 8}, {64, 17, 1}}) {
        LightVolume volume{Vec3(0.0), {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)}, counts, {}};
        std::mt19937 random(12);
        std::bernoulli_distribution absorbs(0.01);
        volume.values.resize(volume.index(0, 0, counts[2]));
        std::generate(volume.values.begin(), volume.values.end(), [&] { return absorbs(random) ? 0.5F : 0.0F; });
        volume.values[volume.values.size() / 2] = 0.5F;
        const ClearCells cells(volume);
        std::uniform_real_distribution<double> place(-0.2, 1.2);
        int clear = 0;
        for (int n = 0; n < 5000; ++n) {
            const Vec3 at(place(random) * counts[0], place(random) * counts[1], place(random) * counts[2]);
            std::array<int, 3> first{}, last{};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const int most = counts[axis] - 1;
                const int cell = std::clamp(static_cast<int>(at[static_cast<int>(axis)]), 0, std::max(most - 1, 0));
                first[axis] = std::max(cell - 1, 0);
                last[axis] = std::min(cell + 2, most);
            }
            bool any = false;
            for (int w = first[2]; w <= last[2]; ++w) {
                for (int v = first[1]; v <= last[1]; ++v) {
                    for (int u = first[0]; u <= last[0]; ++u) {
                        any = any || volume.values[volume.index(u, v, w)] > 0.0F;
                    }
                }
            }
            EXPECT_EQ(cells.at(at), !any) << at.x << " " << at.y << " " << at.z;
            clear += any ? 0 : 1;
        }
        EXPECT_GT(clear, 500);
        EXPECT_LT(clear, 5000);
    }
}

} // namespace
} // namespace sheetsplat

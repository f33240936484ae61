// Exactly which samples are drawn, how they are stored, and what that costs.
#include "index/visible_runs.hpp"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <new>

#include "index/brute_force.hpp"
#include "sheetsplat/error.hpp"
#include "support/lattices.hpp"

// Sanitizers bring operators new and limits of their own.
#ifndef SHEETSPLAT_SANITIZED
#define MEMORY_IS_COUNTED

namespace {

// Bytes that are allocated now, and the most that were since the mark was set.
std::atomic<std::size_t> allocated{0};
std::atomic<std::size_t> most_allocated{0};

void note_allocation(void* block) {
    const std::size_t now = allocated += malloc_usable_size(block);
    if (now > most_allocated) {
        most_allocated = now;
    }
}

void release(void* block) {
    if (block != nullptr) {
        allocated -= malloc_usable_size(block);
    }
    std::free(block);
}

} // namespace

void* operator new(std::size_t size) {
    void* block = std::malloc(size);
    if (block == nullptr) {
        throw std::bad_alloc();
    }
    note_allocation(block);
    return block;
}
void operator delete(void* block) noexcept { release(block); }
void operator delete(void* block, std::size_t) noexcept { release(block); }
#endif

namespace sheetsplat::test {
namespace {

TransferFunction ramp(double from, double to) { return TransferFunction({{from, Vec3(1), 0.0}, {to, Vec3(1), 1.0}}); }

VisibilityQuery asking(const TransferFunction& transfer_function) {
    VisibilityQuery query;
    query.transfer_function = &transfer_function;
    return query;
}

/// A ball of noise around 200 in a cube of n^3 samples, noise below `background` outside.
std::vector<std::uint8_t> noisy_ball(std::size_t n, double radius, unsigned background) {
    std::mt19937 engine(7);
    std::vector<std::uint8_t> values;
    values.reserve(n * n * n);
    const Vec3 middle(0.5 * static_cast<double>(n - 1));
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const bool inside = glm::distance(Vec3(i, j, k), middle) < radius * static_cast<double>(n);
                values.push_back(static_cast<std::uint8_t>(inside           ? 150 + engine() % 100
                                                           : background > 0 ? engine() % background
                                                                            : 0));
            }
        }
    }
    return values;
}

/// Three thin winding tubes, 0 outside.
std::vector<std::uint8_t> thin_tubes(std::size_t n) {
    std::vector<std::uint8_t> values(n * n * n, 0);
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                for (int tube = 0; tube < 3; ++tube) {
                    const double t = static_cast<double>(k) / static_cast<double>(n) * 6.0 + 2.0 * tube;
                    const double size = static_cast<double>(n);
                    const double dx = static_cast<double>(i) - size * (0.5 + 0.3 * std::sin(t));
                    const double dy = static_cast<double>(j) - size * (0.5 + 0.3 * std::cos(1.3 * t));
                    const double height = 255.0 * (1.0 - (dx * dx + dy * dy) / 9.0);
                    auto& value = values[(k * n + j) * n + i];
                    value = std::max(value, static_cast<std::uint8_t>(std::max(0.0, height)));
                }
            }
        }
    }
    return values;
}

/// Samples whose kernel (and, where the reach is more than 0, whose stencil) really holds a visible point, of a grid of
/// points `finer` times as fine as the samples.
Mask needed(const RegularField& field, const TransferFunction& transfer_function, double reach, int finer) {
    const BruteForce brute_force(field);
    const auto& shape = field.shape();
    Mask mask(brute_force.size(), 0);
    const auto points = [&](std::size_t axis) { return static_cast<int>(shape[axis] - 1) * finer; };
    const double far = field.options().radius + reach;
    for (int k = 0; k <= points(0); ++k) {
        for (int j = 0; j <= points(1); ++j) {
            for (int i = 0; i <= points(2); ++i) {
                const Vec3 x = Vec3(i, j, k) / static_cast<double>(finer);
                const Sums sums = brute_force.at(x, nullptr);
                if (sums.empty || transfer_function.at(brute_force.rho(sums)).opacity <= 0.0) {
                    continue;
                }
                const glm::ivec3 first = glm::max(Vec3(0.0), glm::ceil(x - far));
                const glm::ivec3 last = glm::min(Vec3(shape[2] - 1, shape[1] - 1, shape[0] - 1), glm::floor(x + far));
                for (int c = first.z; c <= last.z; ++c) {
                    for (int b = first.y; b <= last.y; ++b) {
                        for (int a = first.x; a <= last.x; ++a) {
                            if (glm::distance(x, Vec3(a, b, c)) < far) {
                                const std::size_t row =
                                    static_cast<std::size_t>(c) * shape[1] + static_cast<std::size_t>(b);
                                const std::size_t n = row * shape[2] + static_cast<std::size_t>(a);
                                mask[n] = brute_force.value(n) != 0.0 ? 1 : 0;
                            }
                        }
                    }
                }
            }
        }
    }
    return mask;
}

TEST(VisibleRuns, SortedDisjointAndWithinRows) {
    for (unsigned seed = 0; seed < 60; ++seed) {
        Random random(seed);
        const auto field = random_field(random, seed % 2 == 0 ? Lattice::cartesian : Lattice::bcc);
        const TransferFunction transfer_function = random_transfer_function(random, *field);
        const VisibleRuns runs = VisibleRuns::of(*field, asking(transfer_function));
        ASSERT_EQ(runs.rows(), field->shape()[0] * field->shape()[1]);
        std::size_t samples = 0;
        std::size_t count_of_runs = 0;
        for (std::size_t row = 0; row < runs.rows(); ++row) {
            ASSERT_LE(runs.begin(row), runs.end(row));
            std::int64_t end_before = -1;
            for (const auto* run = runs.begin(row); run != runs.end(row); ++run) {
                ASSERT_LT(run->begin, run->end);
                // Touching runs would be one.
                ASSERT_GT(static_cast<std::int64_t>(run->begin), end_before);
                ASSERT_LE(run->end, field->shape()[2]);
                end_before = run->end;
                for (std::size_t i = run->begin; i < run->end; ++i) {
                    const double value = field->value(i, row % field->shape()[1], row / field->shape()[1]);
                    ASSERT_FALSE(std::isnan(value));
                    ++samples;
                }
                ++count_of_runs;
            }
        }
        EXPECT_EQ(samples, runs.samples());
        EXPECT_EQ(runs.bytes(), 8 * count_of_runs + 4 * (runs.rows() + 1));
    }
}

TEST(VisibleRuns, DrawsWhatIsWithinTwoRadiiOfASeed) {
    for (unsigned seed = 0; seed < 40; ++seed) {
        Random random(seed);
        const std::array<std::size_t, 3> shape{random.whole(1, 14), random.whole(1, 14), random.whole(1, 150)};
        std::vector<std::uint8_t> values(shape[0] * shape[1] * shape[2]);
        const double density = random.one_of({0.001, 0.01, 0.3});
        for (auto& value : values) {
            value = random.chance(density) ? std::uint8_t{100} : static_cast<std::uint8_t>(random.whole(0, 2));
        }
        RegularFieldOptions options = test::zero_boundary();
        options.lattice = random.one_of({Lattice::cartesian, Lattice::bcc});
        options.radius = random.one_of({0.6, 1.0, 2.0, 2.5});
        options.spacing = Vec3(random.uniform(0.2, 3.0));
        const RegularField field(values, shape, options);
        const TransferFunction transfer_function = ramp(90.0, 200.0);
        VisibilityQuery query = asking(transfer_function);
        query.reach_world = random.uniform(0.0, 2.0) * options.spacing.x;
        query.reach_world += random.uniform(0.0, 1.0) * options.spacing.x;
        const double reach = 2.0 * field.kernel_axes().lengths.x + query.reach_world;
        const Mask drawn = mask_of(VisibleRuns::of(field, query), field);
        const BruteForce brute_force(field);
        std::vector<Vec3> seeds;
        for (std::size_t n = 0; n < values.size(); ++n) {
            if (values[n] == 100) {
                seeds.push_back(brute_force.centre(n));
            }
        }
        for (std::size_t n = 0; n < values.size(); ++n) {
            const bool near = std::any_of(seeds.begin(), seeds.end(), [&](const Vec3& centre) {
                return glm::distance(centre, brute_force.centre(n)) < reach * (1.0 - 1e-12);
            });
            ASSERT_EQ(drawn[n] == 1, near && values[n] != 0) << "sample " << n << ", seed " << seed;
        }
    }
}

TEST(VisibleRuns, SeedsStartWhereTheRippleReachesTheFirstOpaqueValue) {
    RegularFieldOptions options = test::zero_boundary();
    const auto drawn = [&](double value, double first_opaque, Normalization normalization, double w0) {
        options.normalization = normalization;
        options.w0 = w0;
        const RegularField field(std::vector<double>(27, value), {3, 3, 3}, options);
        const TransferFunction up = ramp(first_opaque, first_opaque + 10.0);
        const TransferFunction down({{-first_opaque - 10.0, Vec3(1), 1.0}, {-first_opaque, Vec3(1), 0.0}});
        return VisibleRuns::of(field, asking(value > 0.0 ? up : down)).samples();
    };
    const RegularField plain(std::vector<double>(27, 1.0), {3, 3, 3}, options);
    const double ripple = lattice_ripple(plain).upper;
    const double constant = plain.lattice_constant();
    for (const double sign : {1.0, -1.0}) {
        EXPECT_EQ(drawn(sign * 99.9, 99.8 * ripple, Normalization::lattice, 1.0), 27U);
        EXPECT_EQ(drawn(sign * 99.9, 100.0 * ripple, Normalization::lattice, 1.0), 0U);
        EXPECT_EQ(drawn(sign * 99.9, 99.8 * ripple * constant, Normalization::none, 1.0), 27U);
        EXPECT_EQ(drawn(sign * 99.9, 100.0 * ripple * constant, Normalization::none, 1.0), 0U);
        EXPECT_EQ(drawn(sign * 99.9, 99.8, Normalization::threshold, 1.0), 27U);
        EXPECT_EQ(drawn(sign * 99.9, 100.0, Normalization::threshold, 1.0), 0U);
        EXPECT_EQ(drawn(sign * 99.9, 99.8 * ripple * constant / 8.0, Normalization::threshold, 8.0), 27U);
        EXPECT_EQ(drawn(sign * 99.9, 100.0 * ripple * constant / 8.0, Normalization::threshold, 8.0), 0U);
    }
}

TEST(VisibleRuns, InvisibleIsEmpty) {
    const RegularField field(noisy_ball(16, 0.4, 30), {16, 16, 16}, test::zero_boundary());
    const TransferFunction nothing({{0.0, Vec3(1), 0.0}, {255.0, Vec3(1), 0.0}});
    const TransferFunction beyond = ramp(260.0, 300.0);
    const TransferFunction negative({{-5.0, Vec3(1), 1.0}, {0.0, Vec3(1), 0.0}});
    for (const TransferFunction* transfer_function : {&nothing, &beyond, &negative}) {
        const VisibleRuns runs = VisibleRuns::of(field, asking(*transfer_function));
        EXPECT_EQ(runs.samples(), 0U);
        EXPECT_EQ(runs.rows(), 256U);
    }
    VisibilityQuery query;
    query.isosurface = true;
    query.iso_values = {260.0};
    EXPECT_EQ(VisibleRuns::of(field, query).samples(), 0U);
    query.iso_values = {200.0};
    EXPECT_GT(VisibleRuns::of(field, query).samples(), 0U);
}

TEST(VisibleRuns, ZerosAreDrawnOnlyWhereTheyMatter) {
    // Row of samples 0 0 0 0 0 0 9 0 NaN 0 0 0 0 0 0; supports of radius 1, so that a seed draws what is less than 2
    // away.
    std::vector<float> values(15, 0.0F);
    values[6] = 9.0F;
    values[8] = std::nanf("");
    RegularFieldOptions options = test::zero_boundary();
    options.radius = 1.0;
    options.nan = NanPolicy::skip;
    const std::array<std::size_t, 3> shape{1, 1, 15};
    const RegularField lattice(values, shape, options);
    options.normalization = Normalization::threshold;
    const RegularField threshold(values, shape, options);
    const TransferFunction from_zero = ramp(0.0, 10.0);
    const TransferFunction opaque_at_zero({{0.0, Vec3(1), 0.5}, {10.0, Vec3(1), 1.0}});
    const auto samples = [](const RegularField& field, const VisibilityQuery& query) {
        return VisibleRuns::of(field, query).samples();
    };

    VisibilityQuery query = asking(from_zero);
    EXPECT_EQ(samples(lattice, query), 1U);
    EXPECT_EQ(samples(threshold, query), 3U);
    query.weights_matter = true;
    EXPECT_EQ(samples(lattice, query), 3U);
    query.reach_world = 1.0;
    EXPECT_EQ(samples(lattice, query), 4U);
    EXPECT_EQ(samples(lattice, asking(opaque_at_zero)), 14U);

    query = asking(from_zero);
    query.alone = false;
    EXPECT_EQ(samples(lattice, query), 1U);
    EXPECT_EQ(samples(threshold, query), 14U);
    query.cull = false;
    EXPECT_EQ(samples(lattice, query), 14U);
    // Every value visible (xray, mip).
    EXPECT_EQ(samples(lattice, VisibilityQuery{}), 1U);
    EXPECT_EQ(samples(threshold, VisibilityQuery{}), 14U);
}

TEST(VisibleRuns, OtherFieldsMakeInvisibleValuesMatter) {
    const RegularField field(noisy_ball(16, 0.4, 30), {16, 16, 16}, test::zero_boundary());
    const TransferFunction transfer_function = ramp(260.0, 300.0);
    VisibilityQuery query = asking(transfer_function);
    query.alone = false;
    const auto& values = std::get<std::vector<std::uint8_t>>(field.samples());
    const auto not_zero =
        static_cast<std::size_t>(std::count_if(values.begin(), values.end(), [](std::uint8_t v) { return v != 0; }));
    EXPECT_EQ(VisibleRuns::of(field, query).samples(), not_zero);
    EXPECT_LT(not_zero, values.size());
}

TEST(VisibleRuns, StepsOfTheTransferFunctionCountOnTheirSide) {
    const auto drawn = [](double value, std::vector<TransferPoint> points) {
        const RegularField field(std::vector<double>{value}, {1, 1, 1}, test::zero_boundary());
        const TransferFunction transfer_function(std::move(points));
        return VisibleRuns::of(field, asking(transfer_function)).samples() == 1;
    };
    const Vec3 white(1.0);
    // Opaque below 0 only, up to a step at 0; and the other way round.
    EXPECT_TRUE(drawn(-1e-30, {{0.0, white, 1.0}, {0.0, white, 0.0}}));
    EXPECT_FALSE(drawn(1.0, {{0.0, white, 1.0}, {0.0, white, 0.0}}));
    EXPECT_TRUE(drawn(1e-30, {{0.0, white, 0.0}, {0.0, white, 1.0}}));
    // At 0 itself the later point holds: then every sample is drawn.
    EXPECT_TRUE(drawn(-1.0, {{0.0, white, 0.0}, {0.0, white, 1.0}}));
    EXPECT_TRUE(drawn(0.0, {{0.0, white, 0.0}, {0.0, white, 1.0}}));
    // A point between two others at the same value is never seen.
    EXPECT_FALSE(drawn(20.0, {{10.0, white, 0.0}, {10.0, white, 1.0}, {10.0, white, 0.0}}));
    // Beyond the last point its opacity holds.
    EXPECT_TRUE(drawn(20.0, {{10.0, white, 0.0}, {10.0, white, 1.0}}));
    EXPECT_FALSE(drawn(20.0, {{30.0, white, 0.0}, {40.0, white, 1.0}}));
    EXPECT_TRUE(drawn(-20.0, {{-10.0, white, 0.2}, {-5.0, white, 0.0}}));
}

TEST(VisibleRuns, EveryTypeDecidesAlike) {
    Random random(3);
    std::vector<double> values(std::size_t{20} * 20 * 20);
    for (double& value : values) {
        value =
            random.chance(0.02) ? static_cast<double>(random.whole(0, 255)) : static_cast<double>(random.whole(0, 10));
    }
    const std::array<std::size_t, 3> shape{20, 20, 20};
    const TransferFunction transfer_function = ramp(150.25, 255.0);
    const auto mask = [&](SampleArray samples) {
        const RegularField field(std::move(samples), shape, test::zero_boundary());
        return mask_of(VisibleRuns::of(field, asking(transfer_function)), field);
    };
    const Mask expected = mask(values);
    EXPECT_GT(count(expected), 0U);
    EXPECT_LT(count(expected), values.size());
    EXPECT_EQ(mask(std::vector<float>(values.begin(), values.end())), expected);
    EXPECT_EQ(mask(rounded<std::uint8_t>(values)), expected);
    EXPECT_EQ(mask(rounded<std::int16_t>(values)), expected);
    EXPECT_EQ(mask(rounded<std::uint16_t>(values)), expected);
}

TEST(VisibleRuns, ExtremeNumbers) {
    const TransferFunction far({{1e300, Vec3(1), 0.0}, {1.1e300, Vec3(1), 1.0}});
    const TransferFunction both({{-1e-300, Vec3(1), 1.0}, {0.0, Vec3(1), 0.0}, {1e-300, Vec3(1), 1.0}});
    const RegularField small(std::vector<float>{-1e-45F, 0.0F, 1e-45F}, {1, 1, 3}, test::zero_boundary());
    EXPECT_EQ(VisibleRuns::of(small, asking(far)).samples(), 0U);
    EXPECT_EQ(VisibleRuns::of(small, asking(both)).samples(), 2U);
    const RegularField integers(std::vector<std::int16_t>{-32768, 0, 32767}, {1, 1, 3}, test::zero_boundary());
    EXPECT_EQ(VisibleRuns::of(integers, asking(far)).samples(), 0U);
    EXPECT_EQ(VisibleRuns::of(integers, asking(both)).samples(), 2U);
    VisibilityQuery query = asking(both);
    query.reach_world = std::numeric_limits<double>::infinity();
    query.weights_matter = true;
    EXPECT_EQ(VisibleRuns::of(integers, query).samples(), 3U);
    query.reach_world = 1e300;
    EXPECT_EQ(VisibleRuns::of(integers, query).samples(), 3U);
}

TEST(VisibleRuns, RefusesLengthsThatMakeNoSense) {
    const RegularField field(std::vector<float>{1.0F}, {1, 1, 1}, test::zero_boundary());
    const TransferFunction transfer_function = ramp(0.0, 1.0);
    VisibilityQuery query = asking(transfer_function);
    query.reach_world = -1.0;
    EXPECT_THROW(VisibleRuns::of(field, query), InvalidInput);
    query.reach_world = std::nan("");
    EXPECT_THROW(VisibleRuns::of(field, query), InvalidInput);
}

// At most 1.25 times as many as really have a visible point in their support; a box instead of a ball would draw more
// than that.
TEST(VisibleRuns, TightOnTheNoisyBall) {
    constexpr std::size_t n = 40;
    const RegularField field(noisy_ball(n, 0.38, 30), {n, n, n}, test::zero_boundary());
    const TransferFunction transfer_function = ramp(40.0, 255.0);
    VisibilityQuery query = asking(transfer_function);
    query.reach_world = 1.0;
    const auto drawn = static_cast<double>(VisibleRuns::of(field, query).samples());
    const auto ideal = static_cast<double>(count(needed(field, transfer_function, 1.0, 2)));
    EXPECT_LE(drawn, 1.25 * ideal);
    EXPECT_GE(drawn, ideal);
    std::printf("[ figures  ] noisy ball %zu^3: %.0f drawn, %.0f needed\n", n, drawn, ideal);

    Mask by_box(n * n * n, 0);
    const auto& values = std::get<std::vector<std::uint8_t>>(field.samples());
    constexpr std::ptrdiff_t reach = 4;
    constexpr auto size = static_cast<std::ptrdiff_t>(n);
    for (std::ptrdiff_t k = 0; k < size; ++k) {
        for (std::ptrdiff_t j = 0; j < size; ++j) {
            for (std::ptrdiff_t i = 0; i < size; ++i) {
                if (values[static_cast<std::size_t>((k * size + j) * size + i)] < 40) {
                    continue;
                }
                for (std::ptrdiff_t z = std::max<std::ptrdiff_t>(0, k - reach); z <= std::min(size - 1, k + reach);
                     ++z) {
                    for (std::ptrdiff_t y = std::max<std::ptrdiff_t>(0, j - reach); y <= std::min(size - 1, j + reach);
                         ++y) {
                        for (std::ptrdiff_t x = std::max<std::ptrdiff_t>(0, i - reach);
                             x <= std::min(size - 1, i + reach); ++x) {
                            by_box[static_cast<std::size_t>((z * size + y) * size + x)] = 1;
                        }
                    }
                }
            }
        }
    }
    EXPECT_GT(static_cast<double>(count(by_box)), 1.25 * ideal);
}

TEST(VisibleRuns, TightOnThinTubes) {
    constexpr std::size_t n = 40;
    const RegularField field(thin_tubes(n), {n, n, n}, test::zero_boundary());
    const auto& values = std::get<std::vector<std::uint8_t>>(field.samples());
    const auto not_zero =
        static_cast<std::size_t>(std::count_if(values.begin(), values.end(), [](std::uint8_t v) { return v != 0; }));
    const TransferFunction from_zero = ramp(0.0, 255.0);
    VisibilityQuery query = asking(from_zero);
    query.reach_world = 1.0;
    EXPECT_EQ(VisibleRuns::of(field, query).samples(), not_zero);
    // Of opaque values only in the tubes' middle, nearly all of each tube is still within reach, and nothing else.
    const TransferFunction middle = ramp(150.0, 255.0);
    query.transfer_function = &middle;
    const std::size_t drawn = VisibleRuns::of(field, query).samples();
    EXPECT_LE(drawn, not_zero);
    EXPECT_GE(drawn, count(needed(field, middle, 1.0, 2)));
}

// Blocks only add samples: with one seed, nothing farther than a block's diagonal beyond the neighbourhood is drawn.
TEST(VisibleRuns, WideReachesAreDecidedInBlocks) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        constexpr std::size_t n = 90;
        std::vector<std::uint8_t> values(n * n * n, 1);
        values[(20 * n + 41) * n + 33] = 200;
        RegularFieldOptions options = test::zero_boundary();
        options.lattice = lattice;
        const RegularField field(values, {n, n, n}, options);
        const TransferFunction transfer_function = ramp(150.0, 255.0);
        VisibilityQuery query = asking(transfer_function);
        query.reach_world = 26.0;
        const Vec3 seed = field.position(33, 41, 20);
        const double reach = 2.0 * field.kernel_axes().lengths.x + query.reach_world;
        // Blocks of up to 5 layers of BCC, else of up to 3 samples: twice their diagonals.
        const double more = 2.0 * std::sqrt(3.0) * 3.0;
        const Mask drawn = mask_of(VisibleRuns::of(field, query), field);
        const BruteForce brute_force(field);
        for (std::size_t at = 0; at < drawn.size(); ++at) {
            const double distance = glm::distance(seed, brute_force.centre(at));
            if (distance < reach) {
                ASSERT_EQ(drawn[at], 1) << at;
            } else if (distance > reach + more) {
                ASSERT_EQ(drawn[at], 0) << at;
            }
        }
        EXPECT_LT(count(drawn), drawn.size());
    }
}

#ifdef MEMORY_IS_COUNTED
TEST(VisibleRuns, TakesLittleMemoryBesideTheResult) {
    constexpr std::size_t n = 128;
    const RegularField field(noisy_ball(n, 0.38, 60), {n, n, n}, test::zero_boundary());
    const TransferFunction transfer_function = ramp(40.0, 255.0);
    VisibilityQuery query = asking(transfer_function);
    query.reach_world = 1.0;
    const std::size_t before = allocated;
    most_allocated = before;
    const VisibleRuns runs = VisibleRuns::of(field, query);
    const std::size_t most = most_allocated - before;
    EXPECT_GT(runs.bytes(), 0U);
    EXPECT_LT(most, runs.bytes() + n * n * n * 3 / 10);
    // What the index holds is counted, too: the allocations that are left are the result's own.
    EXPECT_LT(allocated - before, runs.bytes() + 4096);
}

TEST(VisibleRunsDeathTest, MemoryIsCheckedBeforeItIsTaken) {
    constexpr std::size_t n = 256;
    const RegularField field(noisy_ball(n, 0.38, 60), {n, n, n}, test::zero_boundary());
    const TransferFunction transfer_function = ramp(40.0, 255.0);
    const auto try_with = [&](std::size_t bytes_left) {
        std::size_t pages = 0;
        std::ifstream("/proc/self/statm") >> pages;
        rlimit limit{};
        limit.rlim_cur = limit.rlim_max = pages * 4096 + bytes_left;
        setrlimit(RLIMIT_AS, &limit);
        try {
            (void)VisibleRuns::of(field, asking(transfer_function));
        } catch (const OutOfMemory&) {
            std::_Exit(7);
        }
        std::_Exit(0);
    };
    EXPECT_EXIT(try_with(std::size_t{1} << 20), testing::ExitedWithCode(7), "");
    EXPECT_EXIT(try_with(std::size_t{1} << 28), testing::ExitedWithCode(0), "");
}
#endif

TEST(VisibleRuns, OfAnyHoldWhatOneOfThemHolds) {
    const std::array<std::size_t, 3> shape{4, 5, 90};
    std::vector<VisibleRuns> runs;
    std::vector<const VisibleRuns*> all;
    for (unsigned number = 0; number < 3; ++number) {
        std::vector<std::uint8_t> samples(shape[0] * shape[1] * shape[2]);
        for (std::size_t i = 0; i < samples.size(); ++i) {
            // Runs that overlap, touch and lie apart; none in some rows.
            samples[i] = (i * 2654435761U >> (9 + number)) % 5 == 0 && (i / 90) % (number + 2) != 0 ? 1 : 0;
        }
        const RegularField field(std::move(samples), shape, zero_boundary());
        runs.push_back(VisibleRuns::of(field, VisibilityQuery{}));
    }
    for (const VisibleRuns& one : runs) {
        all.push_back(&one);
    }
    const VisibleRuns any = VisibleRuns::of_any(all);
    std::size_t count = 0;
    for (std::size_t row = 0; row < any.rows(); ++row) {
        std::vector<int> held(shape[2], 0), wanted(shape[2], 0);
        std::uint32_t end = 0;
        for (const auto* run = any.begin(row); run != any.end(row); ++run) {
            EXPECT_TRUE(run == any.begin(row) || run->begin > end);
            end = run->end;
            std::fill(held.begin() + run->begin, held.begin() + run->end, 1);
        }
        for (const VisibleRuns& one : runs) {
            for (const auto* run = one.begin(row); run != one.end(row); ++run) {
                std::fill(wanted.begin() + run->begin, wanted.begin() + run->end, 1);
            }
        }
        EXPECT_EQ(held, wanted) << "row " << row;
        count += static_cast<std::size_t>(std::count(wanted.begin(), wanted.end(), 1));
    }
    EXPECT_EQ(any.samples(), count);
    EXPECT_GT(count, runs.front().samples());
}

TEST(VisibleRuns, Timing) {
    const TransferFunction transfer_function = ramp(40.0, 255.0);
    // Noise below 30 is transparent; of noise below 60 every sample is within reach of a seed.
    for (const unsigned background : {30U, 60U}) {
        for (const std::size_t n : {std::size_t{128}, std::size_t{256}}) {
            const RegularField field(noisy_ball(n, 0.38, background), {n, n, n}, test::zero_boundary());
            VisibilityQuery query = asking(transfer_function);
            query.reach_world = 2.0;
            double best = 1e300;
            VisibleRuns runs;
            for (int repeat = 0; repeat < 3; ++repeat) {
                const std::clock_t start = std::clock();
                runs = VisibleRuns::of(field, query);
                best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
            }
            std::printf("[ figures  ] %zu^3 uint8, noise below %u around: %.1f ms of CPU, %zu drawn, %.2f bytes each\n",
                        n, background, 1e3 * best, runs.samples(),
                        static_cast<double>(runs.bytes()) / static_cast<double>(runs.samples()));
            EXPECT_GT(runs.samples(), 0U);
        }
    }
}

} // namespace
} // namespace sheetsplat::test

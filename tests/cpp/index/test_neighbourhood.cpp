// Bits of rows, and how they spread.
#include "index/neighbourhood.hpp"

#include <gtest/gtest.h>

#include "index/brute_force.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {
namespace {

TEST(BitRows, RunsAreFoundAndSet) {
    Random random(1);
    for (int trial = 0; trial < 300; ++trial) {
        const std::size_t n = random.whole(1, 300);
        const double density = random.one_of({0.02, 0.5, 0.98, 1.0});
        std::vector<std::uint8_t> flags(n);
        for (auto& flag : flags) {
            flag = random.chance(density) ? 1 : 0;
        }
        std::vector<BitWord> packed(words_for(n), ~BitWord{0});
        pack_row(flags.data(), n, packed.data(), [](std::uint8_t flag) { return flag == 1; });
        std::vector<std::uint8_t> unpacked(n, 0);
        std::vector<BitWord> set(words_for(n), 0);
        std::size_t end_before = 0;
        bool first = true;
        for_each_run(packed.data(), packed.size(), [&](std::size_t begin, std::size_t end) {
            ASSERT_LT(begin, end);
            ASSERT_LE(end, n);
            ASSERT_TRUE(first || begin > end_before);
            first = false;
            end_before = end;
            std::fill(unpacked.begin() + static_cast<std::ptrdiff_t>(begin),
                      unpacked.begin() + static_cast<std::ptrdiff_t>(end), 1);
            set_bits(set.data(), begin, end);
        });
        EXPECT_EQ(unpacked, flags);
        EXPECT_EQ(set, packed);
    }
}

/// True where `offset` is inside the sum of a ball and an ellipsoid by more than `margin` (negative: outside by less
/// than that): looked at from many directions, and then from ever nearer to the one that separates best.
bool inside_sum(const Vec3& offset, double ball, const Vec3& ellipsoid, double margin) {
    const auto distance = [&](const Vec3& u) { return glm::dot(offset, u) - ball - glm::length(ellipsoid * u); };
    Random random(9);
    Vec3 best(1.0, 0.0, 0.0);
    for (int n = 0; n < 400; ++n) {
        const double spread = n < 200 ? 2.0 : std::pow(0.5, (n - 200) / 20.0);
        const Vec3 u = glm::normalize(best + spread * random.in_ball() + Vec3(1e-12));
        best = distance(u) > distance(best) ? u : best;
    }
    return distance(best) < -margin;
}

TEST(Neighbourhood, UnequalSpacingLosesNothingAndAddsLittle) {
    Random random(2);
    std::size_t set = 0;
    std::size_t inside = 0;
    for (int trial = 0; trial < 10; ++trial) {
        const std::array<std::size_t, 3> shape{21, 21, 21};
        RegularFieldOptions options = test::zero_boundary();
        options.radius = random.one_of({1.0, 1.5, 2.0});
        options.spacing = Vec3(random.uniform(0.4, 2.0), random.uniform(0.4, 2.0), random.uniform(0.4, 2.0));
        const RegularField field(std::vector<std::uint8_t>(std::size_t{21} * 21 * 21, 1), shape, options);
        const double reach = random.uniform(0.2, 1.5);
        const Neighbourhood neighbourhood(field, reach);
        ASSERT_EQ(neighbourhood.block(), (std::array<std::size_t, 3>{1, 1, 1}));
        BitRows seeds(shape);
        set_bits(seeds.row(10, 10), 10, 11);
        const BitRows spread = neighbourhood.spread(seeds);
        // One octant: the set is symmetric along each axis.
        for (std::size_t k = 10; k < 21; ++k) {
            for (std::size_t j = 10; j < 21; ++j) {
                for (std::size_t i = 10; i < 21; ++i) {
                    const Vec3 offset = Vec3(i, j, k) - 10.0;
                    const bool bit = ((spread.row(j, k)[0] >> i) & 1U) != 0;
                    const bool really = inside_sum(offset, 2.0 * options.radius, reach / options.spacing, 1e-3);
                    ASSERT_TRUE(bit || !really) << "trial " << trial << " offset " << i << " " << j << " " << k;
                    set += bit ? 1 : 0;
                    inside += really ? 1 : 0;
                }
            }
        }
    }
    EXPECT_LE(static_cast<double>(set), 1.03 * static_cast<double>(inside));
}

} // namespace
} // namespace sheetsplat::test

// The quadrature of slab means keeps the digits that its limits promise.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "plan/slab_nodes.hpp"

namespace sheetsplat {
namespace {

TEST(SlabNodes, KeepSevenDigits) {
    struct Rule {
        int nodes;
        std::vector<double> at, share;
    };
    // Gauss-Legendre on [-1, 1].
    const std::vector<Rule> rules{{4,
                                   {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526},
                                   {0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538}},
                                  {6,
                                   {-0.9324695142031521, -0.6612093864662645, -0.2386191860831969, 0.2386191860831969,
                                    0.6612093864662645, 0.9324695142031521},
                                   {0.1713244923791704, 0.3607615730481386, 0.4679139345726910, 0.4679139345726910,
                                    0.3607615730481386, 0.1713244923791704}}};
    const auto worst = [](const Rule& rule, double width) {
        double largest = 0.0;
        for (double start = -4.0; start <= 4.0; start += 0.01) {
            double sum = 0.0;
            for (std::size_t n = 0; n < rule.at.size(); ++n) {
                const double x = start + 0.5 * width * (rule.at[n] + 1.0);
                sum += 0.5 * rule.share[n] * std::exp(-x * x);
            }
            const double exact = 0.5 * std::sqrt(std::acos(-1.0)) * (std::erf(start + width) - std::erf(start)) / width;
            largest = std::max(largest, std::abs(sum - exact));
        }
        return largest;
    };
    for (const auto& [rule, widest] : {std::pair{rules[0], four_node_slab}, std::pair{rules[1], six_node_slab}}) {
        EXPECT_EQ(slab_nodes(0.99 * widest), rule.nodes);
        EXPECT_NE(slab_nodes(widest), rule.nodes);
        EXPECT_LT(worst(rule, widest), 2e-8);
        EXPECT_GT(worst(rule, 1.5 * widest), 1e-7) << "the limits are not far too small";
    }
    EXPECT_EQ(slab_nodes(2.0), 0);
    EXPECT_EQ(slab_pieces(0.1), 1);
    EXPECT_EQ(slab_pieces(1.6), 2);
    EXPECT_EQ(slab_pieces(100.0), 4);
}

} // namespace
} // namespace sheetsplat

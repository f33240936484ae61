#include "backend_cpu/lattice_extremes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <variant>

#include "base/memory.hpp"
#include "index/visible_runs.hpp"

namespace sheetsplat::backend_cpu {

namespace {

float rounded_up(double share) {
    const auto rounded = static_cast<float>(share);
    return static_cast<double>(rounded) < share ? std::nextafter(rounded, std::numeric_limits<float>::max()) : rounded;
}

} // namespace

LatticeExtremes LatticeExtremes::of(const RegularField& field, double sign, bool filled, ThreadPool& pool,
                                    const std::function<void()>& poll) {
    LatticeExtremes found;
    const bool smallest = sign > 0.0;
    const std::array<std::size_t, 3> shape = field.shape();
    // C++17 lets lambdas capture variables, not structured bindings.
    const std::size_t nk = shape[0], nj = shape[1], ni = shape[2];
    const double radius = field.options().radius;
    const auto [least, greatest] = field.value_range();
    const double farthest = std::max(std::abs(least), std::abs(greatest));
    const double largest = farthest > 0.0 ? farthest : 1.0;
    const double base = field.counted_from();
    const Ripple ripple = lattice_ripple(field);
    found.scale_ = largest * ExtremeBlocks::weights(field, ripple.upper);
    found.blocks_ = {ExtremeBlocks::count_along(ni, radius), ExtremeBlocks::count_along(nj, radius),
                     ExtremeBlocks::count_along(nk, radius)};
    const auto across = static_cast<std::size_t>(found.blocks_[0]), down = static_cast<std::size_t>(found.blocks_[1]);
    const auto deep = static_cast<std::size_t>(found.blocks_[2]);
    const std::string what = "the bounds of blocks of samples";
    require_memory(checked_product(across * down * deep, sizeof(float), what), what, "use a smaller volume");
    found.bounds_.assign(across * down * deep, 0.0F);
    // What the least value of a block makes of a bound from below; of values above 0, where all weights are there.
    const double inner = ripple.lower / ripple.upper;
    const auto below = [&](double value, bool inside) {
        const double share = value / largest;
        return -rounded_up(-(share <= 0.0 ? share : inside ? share * inner : 0.0));
    };
    std::visit(
        [&](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            // (A NaN is not beyond anything.)
            const auto beyond = [smallest](Value a, Value b) { return smallest ? a < b : a > b; };
            const Value nothing = smallest ? std::numeric_limits<Value>::max() : std::numeric_limits<Value>::lowest();
            pool.run(
                deep,
                [&](std::size_t k, int) {
                    const auto block_k = static_cast<int>(k);
                    const ExtremeBlocks::Samples layers = ExtremeBlocks::reaching_into(block_k, nk, radius);
                    std::vector<Value> most(ni);
                    for (std::size_t j = 0; j < down; ++j) {
                        const auto block_j = static_cast<int>(j);
                        const ExtremeBlocks::Samples rows = ExtremeBlocks::reaching_into(block_j, nj, radius);
                        std::fill(most.begin(), most.end(), nothing);
                        for (std::size_t layer = layers.begin; layer < layers.end; ++layer) {
                            for (std::size_t row = rows.begin; row < rows.end; ++row) {
                                const Value* from = samples.data() + field.row(row, layer);
                                if (smallest) {
                                    for (std::size_t i = 0; i < ni; ++i) {
                                        most[i] = from[i] < most[i] ? from[i] : most[i];
                                    }
                                } else {
                                    for (std::size_t i = 0; i < ni; ++i) {
                                        most[i] = from[i] > most[i] ? from[i] : most[i];
                                    }
                                }
                            }
                        }
                        const bool inside = filled || (ExtremeBlocks::is_inside(block_k, nk, radius) &&
                                                       ExtremeBlocks::is_inside(block_j, nj, radius));
                        float* bounds = found.bounds_.data() + (k * down + j) * across;
                        for (std::size_t i = 0; i < across; ++i) {
                            const auto block_i = static_cast<int>(i);
                            const ExtremeBlocks::Samples along = ExtremeBlocks::reaching_into(block_i, ni, radius);
                            if (along.begin >= along.end) {
                                continue;
                            }
                            const auto value = static_cast<double>(
                                *std::max_element(most.data() + along.begin, most.data() + along.end,
                                                  [&](Value a, Value b) { return beyond(b, a); }));
                            bounds[i] = below(sign * (value - base),
                                              inside && (filled || ExtremeBlocks::is_inside(block_i, ni, radius)));
                        }
                    }
                },
                poll);
        },
        field.samples());
    found.least_ = *std::min_element(found.bounds_.begin(), found.bounds_.end());
    return found;
}

} // namespace sheetsplat::backend_cpu

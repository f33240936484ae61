#include "backend_cpu/lattice_maxima.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <variant>

#include "base/memory.hpp"
#include "index/visible_runs.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// Blocks that samples of an axis reach into, from the first one on.
int blocks_along(std::size_t samples, double radius) {
    return static_cast<int>(std::floor((static_cast<double>(samples) - 1.0 + radius) / LatticeMaxima::block_edge)) + 2;
}

struct Samples {
    std::size_t begin, end;
};
/// The samples of an axis that reach into block b.
Samples reaching_into(int b, std::size_t samples, double radius) {
    const double low = LatticeMaxima::block_edge * (b - 1.0) - radius, high = LatticeMaxima::block_edge * b + radius;
    const double most = static_cast<double>(samples);
    const double begin = std::clamp(std::floor(low) + 1.0, 0.0, most), end = std::clamp(std::ceil(high), 0.0, most);
    return {static_cast<std::size_t>(begin), static_cast<std::size_t>(std::max(begin, end))};
}

/// value / greatest as a float that is no less.
float share_of(double value, double greatest) {
    const double share = value / greatest;
    const auto rounded = static_cast<float>(share);
    return static_cast<double>(rounded) < share ? std::nextafter(rounded, 2.0F) : rounded;
}

} // namespace

bool LatticeMaxima::fit(const RegularField& field) {
    const double radius = field.options().radius;
    if (field.lattice() != Lattice::cartesian || field.normalization() == Normalization::threshold ||
        radius > largest_radius) {
        return false;
    }
    // Sums of samples stay within float32.
    const auto [least, greatest] = field.value_range();
    const double largest = std::max(std::abs(least), std::abs(greatest));
    if (largest > 0.0 && (largest < 1e-25 || largest > 1e30)) {
        return false;
    }
    // Blocks are numbered in 32 bits.
    double blocks = 1.0;
    for (const std::size_t samples : field.shape()) {
        blocks *= blocks_along(samples, radius);
    }
    return blocks < static_cast<double>(std::numeric_limits<std::int32_t>::max());
}

LatticeMaxima LatticeMaxima::of(const RegularField& field, ThreadPool& pool, const std::function<void()>& poll) {
    LatticeMaxima found;
    const auto [nk, nj, ni] = field.shape();
    const double radius = field.options().radius;
    const double greatest = field.value_range()[1];
    found.greatest_ = greatest;
    found.weight_bound_ = lattice_ripple(field).upper * field.lattice_constant() / field.kernel().gain();
    found.blocks_ = {blocks_along(ni, radius), blocks_along(nj, radius), blocks_along(nk, radius)};
    if (greatest <= 0.0) {
        return found;
    }
    const auto across = static_cast<std::size_t>(found.blocks_[0]), down = static_cast<std::size_t>(found.blocks_[1]);
    const auto deep = static_cast<std::size_t>(found.blocks_[2]);
    const std::string what = "the greatest samples of blocks";
    require_memory(checked_product(across * down * deep, sizeof(float), what), what, "use a smaller volume");
    found.shares_.assign(across * down * deep, 0.0F);
    std::visit(
        [&](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            pool.run(
                deep,
                [&](std::size_t k, int) {
                    const Samples layers = reaching_into(static_cast<int>(k), nk, radius);
                    std::vector<Value> most(ni);
                    for (std::size_t j = 0; j < down; ++j) {
                        const Samples rows = reaching_into(static_cast<int>(j), nj, radius);
                        std::fill(most.begin(), most.end(), Value{0});
                        for (std::size_t layer = layers.begin; layer < layers.end; ++layer) {
                            for (std::size_t row = rows.begin; row < rows.end; ++row) {
                                const Value* from = samples.data() + (layer * nj + row) * ni;
                                // (A NaN is not larger than anything.)
                                for (std::size_t i = 0; i < ni; ++i) {
                                    most[i] = from[i] > most[i] ? from[i] : most[i];
                                }
                            }
                        }
                        float* shares = found.shares_.data() + (k * down + j) * across;
                        for (std::size_t i = 0; i < across; ++i) {
                            const Samples along = reaching_into(static_cast<int>(i), ni, radius);
                            if (along.begin < along.end) {
                                const Value value =
                                    *std::max_element(most.data() + along.begin, most.data() + along.end);
                                shares[i] = share_of(static_cast<double>(value), greatest);
                            }
                        }
                    }
                },
                poll);
        },
        field.samples());
    return found;
}

} // namespace sheetsplat::backend_cpu

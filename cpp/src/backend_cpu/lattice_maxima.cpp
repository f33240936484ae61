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

/// value / greatest as a float that is no less.
float share_of(double value, double greatest) {
    const double share = value / greatest;
    const auto rounded = static_cast<float>(share);
    return static_cast<double>(rounded) < share ? std::nextafter(rounded, 2.0F) : rounded;
}

} // namespace

LatticeMaxima LatticeMaxima::of(const RegularField& field, ThreadPool& pool, const std::function<void()>& poll) {
    LatticeMaxima found;
    const auto [nk, nj, ni] = field.shape();
    const double radius = field.options().radius;
    const double greatest = field.value_range()[1];
    found.greatest_ = greatest;
    found.weight_bound_ = MaximaBlocks::weight_bound(field, lattice_ripple(field).upper);
    found.blocks_ = {MaximaBlocks::count_along(ni, radius), MaximaBlocks::count_along(nj, radius),
                     MaximaBlocks::count_along(nk, radius)};
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
                    const MaximaBlocks::Samples layers = MaximaBlocks::reaching_into(static_cast<int>(k), nk, radius);
                    std::vector<Value> most(ni);
                    for (std::size_t j = 0; j < down; ++j) {
                        const MaximaBlocks::Samples rows = MaximaBlocks::reaching_into(static_cast<int>(j), nj, radius);
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
                            const MaximaBlocks::Samples along =
                                MaximaBlocks::reaching_into(static_cast<int>(i), ni, radius);
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

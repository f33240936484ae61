// Which samples are drawn.
//
// Values are counted from the field's base. At a point, kernels that reach it with values from lo to hi give a rho in
// [s min(0, lo), s max(0, hi)], s being the largest weight that one value can get. The 0 belongs to this range inside
// the lattice too: between a region whose kernels are drawn and one whose kernels are dropped the drawn ones alone make
// the picture, and their sum runs from the full value to 0 through everything between. A region above an opaque band is
// thus never dropped beside one in the band.
//
// So a point can be visible only where a sample that reaches it is, times s, at or beyond the first opaque value on its
// side of 0. Such samples are the seeds; every sample that shares a visible point (or a stencil of one) with a seed is
// drawn.
#include "index/visible_runs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>

#include "base/memory.hpp"
#include "index/bit_rows.hpp"
#include "index/neighbourhood.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Of numbers of two sizes, what rounding of their sum or difference comes to at most.
double rounding_of(double a, double b) {
    return 4.0 * std::numeric_limits<double>::epsilon() * (std::abs(a) + std::abs(b));
}

/// The least number of type T that lies at least `bound` above the base, and above it at all; none where there is none.
template <typename T>
std::optional<T> least_from(double bound, double base) {
    // Rounding of the bound must not lose a value that meets it.
    const double wanted = base + bound * (1.0 - 1e-12) - (base == 0.0 ? 0.0 : rounding_of(base, bound));
    if (!(wanted <= static_cast<double>(std::numeric_limits<T>::max()))) {
        return std::nullopt;
    }
    if constexpr (std::is_integral_v<T>) {
        const double least =
            std::max({std::ceil(wanted), std::floor(base) + 1.0, static_cast<double>(std::numeric_limits<T>::min())});
        return least <= static_cast<double>(std::numeric_limits<T>::max()) ? std::optional<T>(static_cast<T>(least))
                                                                           : std::nullopt;
    } else {
        const double lowest = static_cast<double>(std::numeric_limits<T>::lowest());
        T value = static_cast<T>(std::max(wanted, lowest));
        if (static_cast<double>(value) > wanted) {
            value = std::nextafter(value, std::numeric_limits<T>::lowest());
        }
        T above = static_cast<T>(std::clamp(base, lowest, -lowest));
        if (!(static_cast<double>(above) > base)) {
            above = std::nextafter(above, std::numeric_limits<T>::max());
        }
        return std::max(value, above);
    }
}

/// The greatest number of type T that lies at least `bound` below the base, and below it at all.
template <typename T>
std::optional<T> greatest_to(double bound, double base) {
    const double wanted = base - bound * (1.0 - 1e-12) + (base == 0.0 ? 0.0 : rounding_of(base, bound));
    if (!(wanted >= static_cast<double>(std::numeric_limits<T>::lowest()))) {
        return std::nullopt;
    }
    if constexpr (std::is_integral_v<T>) {
        const double most =
            std::min({std::floor(wanted), std::ceil(base) - 1.0, static_cast<double>(std::numeric_limits<T>::max())});
        return most >= static_cast<double>(std::numeric_limits<T>::lowest()) ? std::optional<T>(static_cast<T>(most))
                                                                             : std::nullopt;
    } else {
        const double highest = static_cast<double>(std::numeric_limits<T>::max());
        T value = static_cast<T>(std::min(wanted, highest));
        if (static_cast<double>(value) < wanted) {
            value = std::nextafter(value, std::numeric_limits<T>::max());
        }
        T below = static_cast<T>(std::clamp(base, -highest, highest));
        if (!(static_cast<double>(below) < base)) {
            below = std::nextafter(below, std::numeric_limits<T>::lowest());
        }
        return std::min(value, below);
    }
}

/// Seeds are the samples at or above `up` and those at or below `down`.
template <typename T>
struct SeedTest {
    std::optional<T> up, down;

    /// True where every value other than the base in the range [lower, upper], counted from it, is a seed.
    [[nodiscard]] bool takes_all(double lower, double upper, double base) const {
        return (upper <= 0.0 || up == least_from<T>(0.0, base)) && (lower >= 0.0 || down == greatest_to<T>(0.0, base));
    }
    void mark(const T* values, std::size_t n, BitWord* row) const {
        if (up && down) {
            pack_row(values, n, row,
                     [at_least = *up, at_most = *down](T v) { return (v >= at_least) | (v <= at_most); });
        } else if (up) {
            pack_row(values, n, row, [at_least = *up](T v) { return v >= at_least; });
        } else if (down) {
            pack_row(values, n, row, [at_most = *down](T v) { return v <= at_most; });
        }
    }
};

/// Marks the samples that may be drawn at all: no NaN, and the base's value only where it is asked for.
template <typename T>
void mark_kernels(const T* values, std::size_t n, bool zeros, double base, BitWord* row) {
    if (!zeros && static_cast<double>(static_cast<T>(base)) == base) {
        // Both comparisons are false for NaN, which is left out.
        pack_row(values, n, row, [from = static_cast<T>(base)](T v) { return (v < from) | (v > from); });
    } else if constexpr (std::is_integral_v<T>) {
        std::fill(row, row + words_for(n), BitWord{0});
        set_bits(row, 0, n);
    } else {
        pack_row(values, n, row, [](T v) { return v == v; });
    }
}

/// A bit for each block of samples: set where the block holds a seed.
template <typename T>
BitRows seeds_in_blocks(const T* values, const RegularField& field, const SeedTest<T>& test,
                        const Neighbourhood& neighbourhood) {
    const auto [nk, nj, ni] = field.shape();
    const auto [block_k, block_j, block_i] = neighbourhood.block();
    BitRows seeds(neighbourhood.blocks());
    std::vector<BitWord> scratch(words_for(ni), 0);
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            test.mark(values + field.row(j, k), ni, scratch.data());
            BitWord* row = seeds.row(j / block_j, k / block_k);
            if (block_i == 1) {
                for (std::size_t w = 0; w < scratch.size(); ++w) {
                    row[w] |= scratch[w];
                }
            } else {
                for_each_run(scratch.data(), scratch.size(), [row, size = block_i](std::size_t begin, std::size_t end) {
                    set_bits(row, begin / size, (end - 1) / size + 1);
                });
            }
        }
    }
    return seeds;
}

/// The same of other lattices of the same samples.
BitRows seeds_in_others(const std::vector<SeenBeside>& others, const Neighbourhood& neighbourhood) {
    BitRows all(neighbourhood.blocks());
    for (const SeenBeside& other : others) {
        const RegularField& lattice = *as_regular(other.field.get());
        std::visit(
            [&](const auto& samples) {
                using T = typename std::decay_t<decltype(samples)>::value_type;
                const double base = lattice.counted_from();
                const SeedTest<T> test{least_from<T>(other.above, base), greatest_to<T>(other.below, base)};
                const BitRows own = seeds_in_blocks(samples.data(), lattice, test, neighbourhood);
                for (std::size_t k = 0; k < neighbourhood.blocks()[0]; ++k) {
                    for (std::size_t j = 0; j < neighbourhood.blocks()[1]; ++j) {
                        for (std::size_t word = 0; word < all.words(); ++word) {
                            all.row(j, k)[word] |= own.row(j, k)[word];
                        }
                    }
                }
            },
            lattice.samples());
    }
    return all;
}

/// Clears the bits of a row of samples whose blocks are not set.
void keep_blocks(const BitWord* blocks, std::size_t block_words, std::size_t block_size, std::vector<BitWord>& scratch,
                 std::vector<BitWord>& row, std::size_t n) {
    const BitWord* kept = blocks;
    if (block_size > 1) {
        std::fill(scratch.begin(), scratch.end(), BitWord{0});
        for_each_run(blocks, block_words, [&](std::size_t begin, std::size_t end) {
            set_bits(scratch.data(), std::min(n, begin * block_size), std::min(n, end * block_size));
        });
        kept = scratch.data();
    }
    for (std::size_t w = 0; w < row.size(); ++w) {
        row[w] &= kept[w];
    }
}

/// Clears the bits of a row outside of a range.
void keep_bits(BitWord* row, std::size_t n, const SampleRange& kept) {
    if (kept.begin == 0 && kept.end >= n) {
        return;
    }
    for (std::size_t w = 0; w < words_for(n); ++w) {
        const std::size_t base = w * word_bits;
        const auto below = [base](std::size_t bit) {
            return bit <= base ? BitWord{0} : bit >= base + word_bits ? ~BitWord{0} : (BitWord{1} << (bit - base)) - 1;
        };
        row[w] &= below(kept.end) & ~below(kept.begin);
    }
}

} // namespace

double largest_weight(const RegularField& field, double filter_gain) {
    const double normalised =
        filter_gain > 0.0 ? filter_gain * largest_filtered_sum(field) : lattice_ripple(field).upper;
    switch (field.normalization()) {
    case Normalization::none:
        return normalised * field.lattice_constant();
    case Normalization::lattice:
        return normalised;
    case Normalization::threshold:
        break;
    }
    // Above 0 however large w0 is, since it is divided by.
    return std::clamp(normalised * field.lattice_constant() / field.w0(), std::numeric_limits<double>::min(), 1.0);
}

VisibleRuns VisibleRuns::of(const RegularField& field, const VisibilityQuery& query) {
    check_reach(query);
    const std::size_t nk = field.shape()[0];
    const std::size_t nj = field.shape()[1];
    const std::size_t ni = field.shape()[2];
    const std::string what = "the index of drawn samples";
    const std::string next = "make the transfer function transparent over more values, or use a smaller volume";
    const std::uint64_t rows = checked_product(nk, nj, what);
    if (checked_product(rows, ni, what) > std::numeric_limits<std::uint32_t>::max()) {
        throw Unsupported(Complaint{
            "VisibleRuns: the field cannot be indexed",
            std::to_string(nk) + " x " + std::to_string(nj) + " x " + std::to_string(ni) + " samples",
            "at most 4294967295 samples in one field", "split the volume into several fields, or coarsen it"});
    }

    const bool classified = query.isosurface || query.transfer_function != nullptr;
    // 0: from the least number on.
    VisibleFrom from{0.0, 0.0};
    if (classified) {
        const auto first = [](double x) { return x <= std::numeric_limits<double>::denorm_min() ? 0.0 : x; };
        from = visible_from(query);
        from = {first(from.above), first(from.below)};
    }
    // A point where kernels sum to 0 is visible, unlike an empty one.
    const bool at_zero = classified && !query.isosurface && query.transfer_function->at(0.0).opacity > 0.0;
    const bool zeros = !query.cull || query.weights_matter || query.reach_matters || at_zero ||
                       field.normalization() == Normalization::threshold;
    const bool every_kernel = !query.cull || !classified || !query.alone || at_zero;

    VisibleRuns result;
    require_memory((rows + 1) * sizeof(std::uint32_t), what, next);
    result.row_offset_.assign(rows + 1, 0);
    std::visit(
        [&](const auto& samples) {
            using T = typename std::decay_t<decltype(samples)>::value_type;
            std::optional<Neighbourhood> neighbourhood;
            std::optional<BitRows> reached;
            if (!every_kernel) {
                const double weight = largest_weight(field, query.filter_gain);
                const double base = field.counted_from();
                const SeedTest<T> test{least_from<T>(from.above / weight, base),
                                       greatest_to<T>(from.below / weight, base)};
                const auto [least, greatest] = field.value_range();
                if (zeros || !test.takes_all(least, greatest, base)) {
                    neighbourhood.emplace(field, query.reach_world);
                    reached = neighbourhood->spread(seeds_in_blocks(samples.data(), field, test, *neighbourhood));
                }
            } else if (!query.only_near.empty()) {
                const bool in_cells = std::all_of(query.only_near.begin(), query.only_near.end(),
                                                  [](const SeenBeside& other) { return other.in_cells; });
                neighbourhood.emplace(field, query.reach_world, in_cells);
                reached = neighbourhood->spread(seeds_in_others(query.only_near, *neighbourhood));
            }
            std::vector<BitWord> row(words_for(ni));
            std::vector<BitWord> scratch(row.size());
            const auto visit_runs = [&](auto&& visit) {
                for (std::size_t k = 0; k < nk; ++k) {
                    for (std::size_t j = 0; j < nj; ++j) {
                        mark_kernels(samples.data() + field.row(j, k), ni, zeros, field.counted_from(), row.data());
                        keep_bits(row.data(), ni, field.kernels_of_row(j, k));
                        if (reached) {
                            const auto& block = neighbourhood->block();
                            keep_blocks(reached->row(j / block[1], k / block[0]), reached->words(), block[2], scratch,
                                        row, ni);
                        }
                        for_each_run(row.data(), row.size(), [&, at = k * nj + j](std::size_t begin, std::size_t end) {
                            visit(at, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end));
                        });
                    }
                }
            };
            // Counted first, so that memory is allocated once.
            visit_runs([&](std::size_t at, std::uint32_t, std::uint32_t) { ++result.row_offset_[at + 1]; });
            for (std::size_t at = 0; at < rows; ++at) {
                result.row_offset_[at + 1] += result.row_offset_[at];
            }
            const std::size_t count = result.row_offset_[rows];
            require_memory(count * sizeof(Run), what, next);
            result.runs_.reserve(count);
            visit_runs([&](std::size_t, std::uint32_t begin, std::uint32_t end) {
                result.runs_.push_back({begin, end});
                result.samples_ += end - begin;
            });
        },
        field.samples());
    return result;
}

VisibleRuns VisibleRuns::of_any(const std::vector<const VisibleRuns*>& all) {
    std::size_t most = 0;
    for (const VisibleRuns* one : all) {
        most += one->runs_.size();
    }
    const std::size_t rows = all.front()->rows();
    require_memory(most * sizeof(Run) + (rows + 1) * sizeof(std::uint32_t), "the index of drawn samples",
                   "make the transfer functions transparent over more values, or use smaller volumes");
    VisibleRuns result;
    result.row_offset_.assign(rows + 1, 0);
    result.runs_.reserve(most);
    std::vector<Run> row;
    for (std::size_t number = 0; number < rows; ++number) {
        row.clear();
        for (const VisibleRuns* one : all) {
            row.insert(row.end(), one->begin(number), one->end(number));
        }
        std::sort(row.begin(), row.end(), [](const Run& a, const Run& b) { return a.begin < b.begin; });
        const std::size_t first = result.runs_.size();
        for (const Run& run : row) {
            if (result.runs_.size() > first && run.begin <= result.runs_.back().end) {
                result.runs_.back().end = std::max(result.runs_.back().end, run.end);
            } else {
                result.runs_.push_back(run);
            }
        }
        for (std::size_t run = first; run < result.runs_.size(); ++run) {
            result.samples_ += result.runs_[run].end - result.runs_[run].begin;
        }
        result.row_offset_[number + 1] = static_cast<std::uint32_t>(result.runs_.size());
    }
    return result;
}

std::size_t VisibleRuns::bytes() const {
    return row_offset_.capacity() * sizeof(std::uint32_t) + runs_.capacity() * sizeof(Run);
}

} // namespace sheetsplat

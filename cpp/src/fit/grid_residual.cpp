// Residuals of samples on grids.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/instruction_set.hpp"
#include "residual.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "grid_residual.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "hwy/highway.h"

#ifndef SHEETSPLAT_GRID_RESIDUAL
#define SHEETSPLAT_GRID_RESIDUAL
namespace sheetsplat::fit {

/// Numbers behind each row, which vectors may read and write.
constexpr std::size_t behind_row = 64;

/// A row of a kernel's samples: places from the node's, rounded down.
template <class T>
struct KernelRow {
    std::int32_t dy, dz, first, last;
    T across; ///< the Gaussian of the distances along y and z
};

/// A kernel at samples, for nodes that lie alike between them.
template <class T>
struct Stencil {
    std::vector<KernelRow<T>> rows;
    std::vector<T> along; ///< the Gaussian along x, from -reach on, zeros behind
    std::array<std::int32_t, 3> reach{};
};

template <class T>
struct Grid {
    std::array<std::int32_t, 3> counts{};
    std::array<double, 3> offset{};
    std::size_t stride = 0;
    std::vector<T> residual;
    std::vector<T> known; ///< 1 or 0; empty: all are
};

template <class T>
struct RowRange {
    const Grid<T>* grid;
    const Stencil<T>* stencil;
    std::array<std::int32_t, 3> at; ///< of the node, rounded down
    T lowered, scale;
};

template <class T>
struct Loops {
    Correlation (*correlate)(const RowRange<T>& range);
    void (*subtract)(const RowRange<T>& range, double change, T* residual);
};

} // namespace sheetsplat::fit
#endif

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::fit::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Calls use(place of the first number, kernel's values, known ones or null, count) for each vector of the kernel's
/// rows.
template <bool all_known, class T, class Use>
HWY_INLINE void visit(const RowRange<T>& range, const Use& use) {
    const hn::ScalableTag<T> d;
    const auto lanes = static_cast<std::int32_t>(hn::Lanes(d));
    const Grid<T>& grid = *range.grid;
    const Stencil<T>& stencil = *range.stencil;
    const auto lowered = hn::Set(d, range.lowered);
    const std::int32_t nx = grid.counts[0], ny = grid.counts[1], nz = grid.counts[2];
    for (const KernelRow<T>& row : stencil.rows) {
        const std::int32_t y = range.at[1] + row.dy, z = range.at[2] + row.dz;
        if (y < 0 || z < 0 || y >= ny || z >= nz) {
            continue;
        }
        const std::int32_t x0 = std::max(0, range.at[0] + row.first), x1 = std::min(nx - 1, range.at[0] + row.last);
        if (x0 > x1) {
            continue;
        }
        const std::size_t place =
            (static_cast<std::size_t>(z) * static_cast<std::size_t>(ny) + static_cast<std::size_t>(y)) * grid.stride +
            static_cast<std::size_t>(x0);
        const T* const along = stencil.along.data() + (x0 - range.at[0] + stencil.reach[0]);
        const auto across = hn::Set(d, row.across);
        const std::int32_t count = x1 - x0 + 1;
        for (std::int32_t i = 0; i < count; i += lanes) {
            auto g = hn::Max(hn::MulSub(across, hn::LoadU(d, along + i), lowered), hn::Zero(d));
            if (i + lanes > count) {
                g = hn::IfThenElseZero(hn::FirstN(d, static_cast<std::size_t>(count - i)), g);
            }
            if constexpr (!all_known) {
                g = hn::Mul(g, hn::LoadU(d, grid.known.data() + place + static_cast<std::size_t>(i)));
            }
            use(place + static_cast<std::size_t>(i), g);
        }
    }
}

template <bool all_known, class T>
Correlation correlate_at(const RowRange<T>& range) {
    const hn::ScalableTag<T> d;
    auto product = hn::Zero(d), norm = hn::Zero(d);
    const T* const residual = range.grid->residual.data();
    visit<all_known, T>(range, [&](std::size_t place, hn::Vec<decltype(d)> g) {
        product = hn::MulAdd(g, hn::LoadU(d, residual + place), product);
        norm = hn::MulAdd(g, g, norm);
    });
    const auto scale = static_cast<double>(range.scale);
    return {scale * static_cast<double>(hn::GetLane(hn::SumOfLanes(d, product))),
            scale * scale * static_cast<double>(hn::GetLane(hn::SumOfLanes(d, norm)))};
}

template <class T>
Correlation correlate(const RowRange<T>& range) {
    return range.grid->known.empty() ? correlate_at<true, T>(range) : correlate_at<false, T>(range);
}

template <bool all_known, class T>
void subtract_at(const RowRange<T>& range, double change, T* residual) {
    const hn::ScalableTag<T> d;
    const auto by = hn::Set(d, static_cast<T>(change * static_cast<double>(range.scale)));
    visit<all_known, T>(range, [&](std::size_t place, hn::Vec<decltype(d)> g) {
        hn::StoreU(hn::NegMulAdd(by, g, hn::LoadU(d, residual + place)), d, residual + place);
    });
}

template <class T>
void subtract(const RowRange<T>& range, double change, T* residual) {
    if (range.grid->known.empty()) {
        subtract_at<true, T>(range, change, residual);
    } else {
        subtract_at<false, T>(range, change, residual);
    }
}

template <class T>
Loops<T> of_this_set() {
    return {&correlate<T>, &subtract<T>};
}

} // namespace sheetsplat::fit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sheetsplat::fit {

namespace {

template <class T>
Loops<T> chosen_loops() {
    switch (chosen_instruction_set()) {
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return N_SSE4::of_this_set<T>();
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return N_AVX2::of_this_set<T>();
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return N_AVX3::of_this_set<T>();
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return N_NEON::of_this_set<T>();
#endif
    default:
        return HWY_STATIC_DISPATCH(of_this_set<T>)();
    }
}

template <class T>
class GridResidual final : public Residual {
  public:
    GridResidual(std::vector<SampleGrid> grids, const std::vector<Nodes>& levels, double falloff, double radius)
        : levels_(levels), lowered_(static_cast<T>(std::exp(-falloff))),
          scale_(static_cast<T>(-1.0 / std::expm1(-falloff))), loops_(chosen_loops<T>()) {
        for (SampleGrid& one : grids) {
            grids_.push_back(grid_of(one));
            one.samples = {};
        }
        for (const Nodes& nodes : levels_) {
            for (unsigned phase = 0; phase < 8; ++phase) {
                stencils_.push_back(phase > 0 && !has_halves(nodes) ? Stencil<T>()
                                                                    : stencil_of(nodes, phase, falloff, radius));
            }
        }
    }

    [[nodiscard]] Correlation correlation(std::size_t level, const std::array<int, 3>& node) const override {
        Correlation sum;
        for (const Grid<T>& grid : grids_) {
            const RowRange<T> range = range_of(grid, level, node);
            const Correlation one = loops_.correlate(range);
            sum.product += one.product;
            sum.squared_norm += one.squared_norm;
        }
        return sum;
    }

    void subtract(std::size_t level, const std::array<int, 3>& node, double change) override {
        for (Grid<T>& grid : grids_) {
            loops_.subtract(range_of(grid, level, node), change, grid.residual.data());
        }
    }

    [[nodiscard]] std::array<double, 2> misfit() const override {
        double squares = 0.0, largest = 0.0;
        for_each_row([&](const T* row, std::size_t count) {
            for (std::size_t i = 0; i < count; ++i) {
                const auto value = static_cast<double>(row[i]);
                squares += value * value;
                largest = std::max(largest, std::fabs(value));
            }
        });
        return {squares, largest};
    }

    [[nodiscard]] std::vector<double> numbers() const override {
        std::vector<double> all;
        for (const Grid<T>& grid : grids_) {
            for (std::size_t row = 0; row < rows(grid); ++row) {
                for (std::size_t i = row * grid.stride;
                     i < row * grid.stride + static_cast<std::size_t>(grid.counts[0]); ++i) {
                    const bool known = grid.known.empty() || grid.known[i] > T(0);
                    all.push_back(known ? static_cast<double>(grid.residual[i])
                                        : std::numeric_limits<double>::quiet_NaN());
                }
            }
        }
        return all;
    }

  private:
    static std::size_t rows(const Grid<T>& grid) {
        return static_cast<std::size_t>(grid.counts[1]) * static_cast<std::size_t>(grid.counts[2]);
    }

    template <class Use>
    void for_each_row(const Use& use) const {
        for (const Grid<T>& grid : grids_) {
            for (std::size_t row = 0; row < rows(grid); ++row) {
                use(grid.residual.data() + row * grid.stride, static_cast<std::size_t>(grid.counts[0]));
            }
        }
    }

    static Grid<T> grid_of(const SampleGrid& given) {
        Grid<T> grid;
        grid.offset = given.offset;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            grid.counts[axis] = static_cast<std::int32_t>(given.counts[axis]);
        }
        const std::size_t count = given.counts[0];
        grid.stride = count + behind_row;
        grid.residual.assign(rows(grid) * grid.stride, T(0));
        const bool some_missing =
            std::any_of(given.samples.begin(), given.samples.end(), [](double one) { return std::isnan(one); });
        if (some_missing) {
            grid.known.assign(grid.residual.size(), T(0));
        }
        for (std::size_t row = 0; row < rows(grid); ++row) {
            for (std::size_t i = 0; i < count; ++i) {
                const double value = given.samples[row * count + i];
                if (!std::isnan(value)) {
                    grid.residual[row * grid.stride + i] = static_cast<T>(value);
                    if (some_missing) {
                        grid.known[row * grid.stride + i] = T(1);
                    }
                }
            }
        }
        return grid;
    }

    [[nodiscard]] bool has_halves(const Nodes& nodes) const {
        const auto is_whole = [](double number) { return number == std::floor(number); };
        return !is_whole(nodes.spacing) || std::any_of(grids_.begin(), grids_.end(), [&](const Grid<T>& grid) {
            return !std::all_of(grid.offset.begin(), grid.offset.end(), is_whole);
        });
    }

    static Stencil<T> stencil_of(const Nodes& nodes, unsigned phase, double falloff, double radius) {
        Stencil<T> made;
        const double reach = radius * nodes.spacing;
        const auto whole = static_cast<std::int32_t>(std::ceil(reach)) + 1;
        made.reach = {whole, whole, whole};
        const auto squared = [&](std::int32_t place, unsigned axis) {
            const double distance = (place - ((phase >> axis) & 1U ? 0.5 : 0.0)) / reach;
            return distance * distance;
        };
        for (std::int32_t i = -whole; i <= whole; ++i) {
            made.along.push_back(static_cast<T>(std::exp(-falloff * squared(i, 0))));
        }
        made.along.insert(made.along.end(), behind_row, T(0));
        for (std::int32_t dz = -whole; dz <= whole; ++dz) {
            for (std::int32_t dy = -whole; dy <= whole; ++dy) {
                const double aside = squared(dy, 1) + squared(dz, 2);
                std::int32_t first = -whole, last = whole;
                while (first <= last && aside + squared(first, 0) >= 1.0) {
                    ++first;
                }
                while (last >= first && aside + squared(last, 0) >= 1.0) {
                    --last;
                }
                if (first <= last) {
                    made.rows.push_back({dy, dz, first, last, static_cast<T>(std::exp(-falloff * aside))});
                }
            }
        }
        return made;
    }

    [[nodiscard]] RowRange<T> range_of(const Grid<T>& grid, std::size_t level, const std::array<int, 3>& node) const {
        const Nodes& nodes = levels_[level];
        std::array<std::int32_t, 3> at{};
        unsigned phase = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double place = (nodes.first[axis] + node[axis]) * nodes.spacing - grid.offset[axis];
            const double whole = std::floor(place);
            at[axis] = static_cast<std::int32_t>(whole);
            phase |= (place > whole ? 1U : 0U) << axis;
        }
        return {&grid, &stencils_[8 * level + phase], at, lowered_, scale_};
    }

    std::vector<Nodes> levels_;
    T lowered_, scale_;
    Loops<T> loops_;
    std::vector<Grid<T>> grids_;
    std::vector<Stencil<T>> stencils_;
};

} // namespace

std::unique_ptr<Residual> residual_of(std::vector<SampleGrid> grids, const std::vector<Nodes>& levels, double falloff,
                                      double radius, bool exact) {
    if (exact) {
        return std::make_unique<GridResidual<double>>(std::move(grids), levels, falloff, radius);
    }
    return std::make_unique<GridResidual<float>>(std::move(grids), levels, falloff, radius);
}

} // namespace sheetsplat::fit
#endif

#include "sheetsplat/lattice_descent.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "base/poll.hpp"
#include "base/threads.hpp"
#include "residual.hpp"

namespace sheetsplat::fit {

namespace {

/// Kernels of which less than this share of the squared norm lies within the samples have no coefficient.
constexpr double least_share = 0.02;
/// Layers of nodes that one thread works through at a time: more than two radii, so that every second block's kernels
/// are apart from each other.
constexpr int layers_of_block = 12;
/// Bits of a sign.
constexpr double sign_bits = 1.0;

double full_norm(const Nodes& nodes, double falloff, double radius) {
    constexpr double pi = 3.14159265358979323846;
    // Of the Gaussian without its lowering, which changes it by less than exp(-falloff).
    const double width = std::sqrt(pi / (2.0 * falloff)) * radius * nodes.spacing;
    return std::sqrt(width * width * width);
}

/// Magnitudes of coefficients around a node, in steps.
class Neighbours {
  public:
    Neighbours(const Nodes& nodes, const std::vector<float>& values, double step)
        : nodes_(&nodes), values_(&values), per_step_(static_cast<float>(1.0 / step)) {}

    [[nodiscard]] int at(int x, int y, int z, int most) const {
        const auto& counts = nodes_->counts;
        if (x < 0 || y < 0 || z < 0 || x >= counts[0] || y >= counts[1] || z >= counts[2]) {
            return 0;
        }
        const auto row =
            static_cast<std::size_t>(z) * static_cast<std::size_t>(counts[1]) + static_cast<std::size_t>(y);
        const float value = (*values_)[row * static_cast<std::size_t>(counts[0]) + static_cast<std::size_t>(x)];
        return static_cast<int>(std::min(std::fabs(value) * per_step_ + 0.5F, static_cast<float>(most)));
    }
    [[nodiscard]] const Nodes& nodes() const { return *nodes_; }

  private:
    const Nodes* nodes_;
    const std::vector<float>* values_;
    float per_step_;
};

/// Largest magnitudes that contexts tell apart.
constexpr int most_beside = 7, most_above = 3;

/// What neighbours that are known before a node say, 0 to 7: those of the phases before its own.
int class_beside(const Neighbours& level, const std::array<int, 3>& node) {
    const auto& first = level.nodes().first;
    const auto phase_of = [&](int x, int y, int z) {
        return ((first[0] + x) & 1) | ((first[1] + y) & 1) << 1 | ((first[2] + z) & 1) << 2;
    };
    const int phase = phase_of(node[0], node[1], node[2]);
    if (phase == 0) {
        return 7;
    }
    int sum = 0, weight = 0;
    for (int dz = -1; dz <= 1; ++dz) {
        for (int dy = -1; dy <= 1; ++dy) {
            for (int dx = -1; dx <= 1; ++dx) {
                const int x = node[0] + dx, y = node[1] + dy, z = node[2] + dz;
                if (phase_of(x, y, z) < phase) {
                    const int own = std::abs(dx) + std::abs(dy) + std::abs(dz) == 1 ? 2 : 1;
                    sum += own * level.at(x, y, z, most_beside);
                    weight += own;
                }
            }
        }
    }
    if (sum == 0) {
        return 0;
    }
    const int share = 8 * sum / weight;
    return share < 1 ? 1 : share < 2 ? 2 : share < 4 ? 3 : share < 8 ? 4 : share < 16 ? 5 : 6;
}

/// What the coarser level says, 0 to 3.
int class_above(const Neighbours& coarser, const Nodes& nodes, const std::array<int, 3>& node) {
    const auto& first = coarser.nodes().first;
    std::array<int, 3> low{}, odd{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const int place = nodes.first[axis] + node[axis];
        odd[axis] = place & 1;
        low[axis] = (place - odd[axis]) / 2 - first[axis];
    }
    int largest = 0;
    for (int dz = 0; dz <= odd[2]; ++dz) {
        for (int dy = 0; dy <= odd[1]; ++dy) {
            for (int dx = 0; dx <= odd[0]; ++dx) {
                largest = std::max(largest, coarser.at(low[0] + dx, low[1] + dy, low[2] + dz, most_above));
            }
        }
    }
    if (largest > 0) {
        return largest == 1 ? 2 : 3;
    }
    for (int dz = -1; dz <= 1; ++dz) {
        for (int dy = -1; dy <= 1; ++dy) {
            for (int dx = -1; dx <= 1; ++dx) {
                if (coarser.at(low[0] + dx, low[1] + dy, low[2] + dz, 1) > 0) {
                    return 1;
                }
            }
        }
    }
    return 0;
}

} // namespace

struct DescentParts {
    std::unique_ptr<Residual> residual;
    OwnPool pool;
};

LatticeDescent::LatticeDescent(std::vector<SampleGrid> grids, std::vector<Nodes> levels, double falloff, double radius,
                               int threads, bool exact)
    : levels_(std::move(levels)),
      parts_(new DescentParts{residual_of(std::move(grids), levels_, falloff, radius, exact),
                              OwnPool(new ThreadPool(threads))}) {
    for (const Nodes& one : levels_) {
        coefficients_.emplace_back(one.size(), 0.0F);
        norms_.push_back(full_norm(one, falloff, radius));
    }
}

LatticeDescent::LatticeDescent(SamplePoints points, std::vector<Nodes> levels, double falloff, double radius,
                               int threads)
    : levels_(std::move(levels)), parts_(new DescentParts{residual_of(std::move(points), levels_, falloff, radius),
                                                          OwnPool(new ThreadPool(threads))}) {
    for (const Nodes& one : levels_) {
        coefficients_.emplace_back(one.size(), 0.0F);
        norms_.push_back(full_norm(one, falloff, radius));
    }
}

LatticeDescent::~LatticeDescent() = default;

std::array<double, 2> LatticeDescent::misfit() const { return parts_->residual->misfit(); }

std::vector<double> LatticeDescent::residual() const { return parts_->residual->numbers(); }

template <class Change>
Pass LatticeDescent::sweep(std::size_t level, bool only_active, const Change& change) {
    const Nodes& nodes = levels_[level];
    std::vector<float>& values = coefficients_[level];
    const double least = least_share * norms_[level] * norms_[level];
    const auto blocks = static_cast<std::size_t>((nodes.counts[2] + layers_of_block - 1) / layers_of_block);
    std::vector<Pass> found(blocks);
    // Blocks of one parity are apart, so that threads never meet; the order of changes is the same for any number of
    // threads.
    for (std::size_t parity = 0; parity < 2; ++parity) {
        const std::size_t count = (blocks + 1 - parity) / 2;
        parts_->pool->run(
            count,
            [&](std::size_t number, int) {
                const std::size_t block = 2 * number + parity;
                Pass& pass = found[block];
                const int first = static_cast<int>(block) * layers_of_block;
                const int last = std::min(first + layers_of_block, nodes.counts[2]);
                for (int z = first; z < last; ++z) {
                    for (int y = 0; y < nodes.counts[1]; ++y) {
                        std::size_t place = (static_cast<std::size_t>(z) * static_cast<std::size_t>(nodes.counts[1]) +
                                             static_cast<std::size_t>(y)) *
                                            static_cast<std::size_t>(nodes.counts[0]);
                        for (int x = 0; x < nodes.counts[0]; ++x, ++place) {
                            const float old = values[place];
                            if (only_active && old == 0.0F) {
                                continue;
                            }
                            const std::array<int, 3> node{x, y, z};
                            const Correlation with = parts_->residual->correlation(level, node);
                            if (!(with.squared_norm > least)) {
                                continue;
                            }
                            pass.largest =
                                std::max(pass.largest, std::fabs(with.product) / std::sqrt(with.squared_norm));
                            const double best = old + with.product / with.squared_norm;
                            const auto made = static_cast<float>(change(node, best, with.squared_norm));
                            if (made != old) {
                                values[place] = made;
                                parts_->residual->subtract(level, node, static_cast<double>(made) - old);
                            }
                            pass.active += made != 0.0F;
                        }
                    }
                }
            },
            [] { poll(); });
    }
    Pass all;
    for (const Pass& one : found) {
        all.largest = std::max(all.largest, one.largest);
        all.active += one.active;
    }
    return all;
}

Pass LatticeDescent::soften(std::size_t level, double threshold, bool only_active) {
    return sweep(level, only_active, [&](const std::array<int, 3>&, double best, double squared_norm) {
        const double within = threshold / std::sqrt(squared_norm);
        return best > within ? best - within : best < -within ? best + within : 0.0;
    });
}

Pass LatticeDescent::round_off(std::size_t level, double step, double lambda, const BitTable& bits, bool only_active) {
    const Neighbours own(levels_[level], coefficients_[level], step);
    const bool has_coarser = level + 1 < levels_.size();
    // Steps fall with the norm, as those of all levels do.
    const std::size_t above = has_coarser ? level + 1 : level;
    const Neighbours coarser(levels_[above], coefficients_[above], step * norms_[level] / norms_[above]);
    return sweep(level, only_active, [&](const std::array<int, 3>& node, double best, double squared_norm) {
        const double multiple = std::fabs(best) / step;
        if (multiple < 0.5) {
            return 0.0;
        }
        const int context =
            8 * (has_coarser ? class_above(coarser, levels_[level], node) : 2) + class_beside(own, node);
        const auto& of_magnitude = bits[static_cast<std::size_t>(context)];
        const double from = std::floor(multiple);
        double least = squared_norm * best * best + lambda * static_cast<double>(of_magnitude[0]), chosen = 0.0;
        for (double magnitude = std::max(1.0, from - 1.0); magnitude <= from + 1.0; magnitude += 1.0) {
            const double beyond = magnitude - (told_magnitudes - 1);
            const double told = std::min(magnitude, static_cast<double>(told_magnitudes - 1));
            const double cost = static_cast<double>(of_magnitude[static_cast<std::size_t>(told)]) + sign_bits +
                                (beyond >= 0.0 ? 1.0 + 2.0 * std::log2(beyond + 1.0) : 0.0);
            const double off = (multiple - magnitude) * step;
            const double total = squared_norm * off * off + lambda * cost;
            if (total < least) {
                least = total;
                chosen = magnitude;
            }
        }
        return std::copysign(chosen * step, best);
    });
}

void LatticeDescent::set(std::size_t level, const std::vector<double>& coefficients) {
    const Nodes& nodes = levels_[level];
    std::size_t place = 0;
    for (int z = 0; z < nodes.counts[2]; ++z) {
        for (int y = 0; y < nodes.counts[1]; ++y) {
            for (int x = 0; x < nodes.counts[0]; ++x, ++place) {
                const auto old = static_cast<double>(coefficients_[level][place]);
                if (coefficients[place] != old) {
                    parts_->residual->subtract(level, {x, y, z}, coefficients[place] - old);
                    coefficients_[level][place] = static_cast<float>(coefficients[place]);
                }
            }
        }
        poll();
    }
}

} // namespace sheetsplat::fit

#include "sheetsplat/ellipsoid_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <variant>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "ellipsoid_runs.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

using fitting::LatticePlaces;
using fitting::ScatteredPlaces;
using fitting::Tile;

/// Points of a cell, on the average.
constexpr double points_a_cell = 8.0;
/// Cells along an axis at most, so that their lists stay small.
constexpr std::size_t most_cells = 1024;
/// Tiles that the samples are cut into, however many threads there are.
constexpr std::size_t wanted_tiles = 64;
/// Kernels that a thread takes at a time.
constexpr std::size_t kernels_at_a_time = 4;

const char* const owner = "EllipsoidFit";

std::vector<Tile> tiles_of(std::size_t layers, std::size_t rows) {
    const std::size_t along_k = std::min(layers, wanted_tiles);
    const std::size_t along_j =
        std::min(rows, std::max<std::size_t>(1, wanted_tiles / std::max<std::size_t>(1, along_k)));
    std::vector<Tile> tiles;
    for (std::size_t a = 0; a < along_k; ++a) {
        for (std::size_t b = 0; b < along_j; ++b) {
            tiles.push_back(
                {layers * a / along_k, layers * (a + 1) / along_k, rows * b / along_j, rows * (b + 1) / along_j});
        }
    }
    return tiles;
}

/// The points in cells, and the order that they are sorted in.
ScatteredPlaces sorted(const std::vector<Vec3>& points, std::vector<std::size_t>& order) {
    ScatteredPlaces places;
    Vec3 low(0.0), high(0.0);
    if (!points.empty()) {
        low = high = points.front();
    }
    for (const Vec3& point : points) {
        if (!is_finite(point)) {
            throw InvalidInput(Complaint{"EllipsoidFit: a point cannot be used", text_of(point), "finite numbers", ""});
        }
        low = glm::min(low, point);
        high = glm::max(high, point);
    }
    const Vec3 sides = high - low;
    // Cells of equal sides, along the axes along which there is more than one place.
    int axes = 0;
    double volume = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        if (sides[axis] > 0.0) {
            ++axes;
            volume *= sides[axis];
        }
    }
    const double cells = std::max(1.0, static_cast<double>(points.size()) / points_a_cell);
    const double edge = axes > 0 ? std::pow(volume / cells, 1.0 / axes) : 1.0;
    std::array<std::size_t, 3> counts{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double wanted = edge > 0.0 ? std::floor(sides[axis] / edge) : 1.0;
        counts[a] = static_cast<std::size_t>(std::clamp(wanted, 1.0, static_cast<double>(most_cells)));
        places.origin[a] = low[axis];
        places.cell[a] = sides[axis] > 0.0 ? sides[axis] / static_cast<double>(counts[a]) : 1.0;
    }
    places.columns = counts[0];
    places.rows = counts[1];
    places.layers = counts[2];
    require_memory(sizeof(std::size_t) * (counts[0] * counts[1] * counts[2] + points.size() * 4), "the cells of points",
                   "use fewer points");
    std::vector<std::size_t> cell(points.size());
    places.starts.assign(counts[0] * counts[1] * counts[2] + 1, 0);
    for (std::size_t n = 0; n < points.size(); ++n) {
        std::array<std::size_t, 3> at{};
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double place = std::floor((points[n][axis] - places.origin[a]) / places.cell[a]);
            at[a] = std::min(static_cast<std::size_t>(std::max(0.0, place)), counts[a] - 1);
        }
        cell[n] = (at[2] * counts[1] + at[1]) * counts[0] + at[0];
        ++places.starts[cell[n] + 1];
    }
    std::partial_sum(places.starts.begin(), places.starts.end(), places.starts.begin());
    std::vector<std::size_t> next(places.starts.begin(), places.starts.end() - 1);
    order.resize(points.size());
    for (std::size_t n = 0; n < points.size(); ++n) {
        order[next[cell[n]]++] = n;
    }
    for (int axis = 0; axis < 3; ++axis) {
        std::vector<double>& numbers = places.at[static_cast<std::size_t>(axis)];
        numbers.assign(points.size() + fitting::slack, 0.0);
        for (std::size_t n = 0; n < points.size(); ++n) {
            numbers[n] = points[order[n]][axis];
        }
    }
    return places;
}

/// 1 where there are none.
EllipsoidChange own_value(const FreeEllipsoid& kernel) {
    EllipsoidChange change;
    change.value = kernel.value;
    return change;
}

} // namespace

struct EllipsoidFit::State {
    std::variant<LatticePlaces, ScatteredPlaces> places;
    std::vector<std::size_t> order; ///< empty: that of the caller
    std::vector<double> data, weights;
    std::size_t size = 0;
    fitting::Profile profile{8.0};
    int threads = 1;
    std::vector<Tile> tiles;
    InstructionSet set = InstructionSet::baseline;

    State(std::size_t count, std::vector<double> given, Options options)
        : data(std::move(given)), weights(std::move(options.weights)), size(count), profile(options.falloff),
          threads(options.threads > 0 ? options.threads : usable_threads()), set(chosen_instruction_set()) {
        if (data.size() != size || (!weights.empty() && weights.size() != size)) {
            throw InvalidInput(Complaint{"EllipsoidFit: the samples cannot be used",
                                         text_of_count(data.size()) + " numbers and " + text_of_count(weights.size()) +
                                             " weights at " + text_of_count(size) + " places",
                                         "one number, and one weight or none, at each place", ""});
        }
        if (!(options.falloff > 0.0) || !std::isfinite(options.falloff) || options.falloff > 500.0) {
            throw InvalidInput(Complaint{std::string(owner) + ": " + option_ref("falloff") + " cannot be used",
                                         text_of(options.falloff), "a number above 0, at most 500", ""});
        }
        for (std::size_t n = 0; n < weights.size(); ++n) {
            if (!(weights[n] >= 0.0) || !std::isfinite(weights[n])) {
                throw InvalidInput(Complaint{"EllipsoidFit: a weight cannot be used", text_of(weights[n]),
                                             "finite numbers of at least 0", ""});
            }
            // A missing sample adds 0, whatever its number is.
            data[n] = weights[n] == 0.0 ? 0.0 : data[n];
        }
        for (const double one : data) {
            if (!std::isfinite(one)) {
                throw InvalidInput(Complaint{"EllipsoidFit: a sample cannot be used", text_of(one), "finite numbers",
                                             "give missing samples the weight 0"});
            }
        }
    }

    /// Numbers in the order of the samples, with slack behind them.
    [[nodiscard]] std::vector<double> sorted(const std::vector<double>& numbers) const {
        std::vector<double> made(numbers.size() + fitting::slack, 0.0);
        for (std::size_t n = 0; n < numbers.size(); ++n) {
            made[n] = numbers[order.empty() ? n : order[n]];
        }
        return made;
    }
    /// Numbers in the caller's order.
    [[nodiscard]] std::vector<double> given_order(std::vector<double> numbers) const {
        numbers.resize(size);
        if (order.empty()) {
            return numbers;
        }
        std::vector<double> made(size);
        for (std::size_t n = 0; n < size; ++n) {
            made[order[n]] = numbers[n];
        }
        return made;
    }
    void sort_samples() {
        data = sorted(data);
        if (!weights.empty()) {
            weights = sorted(weights);
        }
        std::visit([&](const auto& all) { tiles = tiles_of(all.layers, all.rows); }, places);
    }

    /// task(i) for i < count on the threads, with questions whether it is still wanted.
    template <class Task>
    void run(std::size_t count, const Progress& progress, Task&& task) const {
        const PollScope scope([&] { report_progress(progress, 0.0); });
        poll();
        ThreadPool pool(count < 2 ? 1 : std::min<int>(threads, static_cast<int>(std::min<std::size_t>(count, 1024))));
        pool.run(
            count, [&](std::size_t i, int) { task(i); }, [] { poll(); });
    }

    /// Sums of changes at the samples, and done(tile, first, last) for each stretch of samples of a finished tile.
    template <class Done>
    std::vector<double> sum(const std::vector<FreeEllipsoid>& kernels, const std::vector<EllipsoidChange>& changes,
                            const Progress& progress, Done&& done) const {
        std::vector<double> out(size + fitting::slack, 0.0);
        std::visit(
            [&](const auto& all) {
                const auto& text = fitting::loops<std::decay_t<decltype(all)>>(set);
                run(tiles.size(), progress, [&](std::size_t t) {
                    const Tile& tile = tiles[t];
                    for (std::size_t i = 0; i < kernels.size(); ++i) {
                        text.add(all, profile, kernels[i], changes.empty() ? own_value(kernels[i]) : changes[i], tile,
                                 out.data());
                    }
                    for (std::size_t k = tile.k0; k < tile.k1; ++k) {
                        done(t, out.data(), all.begin(k, tile.j0), all.begin(k, tile.j1));
                    }
                });
            },
            places);
        return out;
    }

    /// What `made` gives of each kernel's loops.
    template <class Result, class Make>
    std::vector<Result> each(const std::vector<FreeEllipsoid>& kernels, const Progress& progress, Make&& make) const {
        std::vector<Result> results(kernels.size());
        std::visit(
            [&](const auto& all) {
                const auto& text = fitting::loops<std::decay_t<decltype(all)>>(set);
                run((kernels.size() + kernels_at_a_time - 1) / kernels_at_a_time, progress, [&](std::size_t block) {
                    const std::size_t last = std::min(kernels.size(), (block + 1) * kernels_at_a_time);
                    for (std::size_t i = block * kernels_at_a_time; i < last; ++i) {
                        results[i] = make(text, all, kernels[i]);
                    }
                });
            },
            places);
        return results;
    }

    std::vector<EllipsoidChange> project(const std::vector<FreeEllipsoid>& kernels, const double* field,
                                         const Progress& progress) const {
        return each<EllipsoidChange>(kernels, progress, [&](const auto& text, const auto& all, const auto& kernel) {
            return text.project(all, profile, kernel, field);
        });
    }

    /// Of each sample w (sum - data), and F.
    std::vector<double> left(const std::vector<FreeEllipsoid>& kernels, double& objective,
                             const Progress& progress) const {
        std::vector<double> parts(tiles.size(), 0.0);
        std::vector<double> made =
            sum(kernels, {}, progress, [&](std::size_t tile, double* out, std::size_t first, std::size_t last) {
                double squares = 0.0;
                for (std::size_t n = first; n < last; ++n) {
                    const double away = out[n] - data[n];
                    out[n] = weights.empty() ? away : weights[n] * away;
                    squares += away * out[n];
                }
                parts[tile] += squares;
            });
        objective = 0.5 * std::accumulate(parts.begin(), parts.end(), 0.0);
        return made;
    }
};

namespace {

void check(const std::vector<FreeEllipsoid>& kernels) {
    for (const FreeEllipsoid& kernel : kernels) {
        bool usable = is_finite(kernel.center) && std::isfinite(kernel.value);
        for (std::size_t n = 0; n < 6; ++n) {
            usable = usable && std::isfinite(kernel.frame[n]) && (n >= 3 || kernel.frame[n] > 0.0);
        }
        if (!usable) {
            throw InvalidInput(
                Complaint{"EllipsoidFit: a kernel cannot be used",
                          "the centre " + text_of(kernel.center) + ", the value " + text_of(kernel.value),
                          "finite numbers, and a frame with a positive diagonal", ""});
        }
    }
}

} // namespace

EllipsoidFit::EllipsoidFit(std::array<std::size_t, 3> shape, std::vector<double> data, Options options) {
    const std::size_t layer = checked_product(shape[1], shape[2], "the samples");
    state_ =
        std::make_unique<State>(checked_product(shape[0], layer, "the samples"), std::move(data), std::move(options));
    state_->places = LatticePlaces{shape[0], shape[1], shape[2]};
    state_->sort_samples();
}

EllipsoidFit::EllipsoidFit(const std::vector<Vec3>& points, std::vector<double> data, Options options)
    : state_(std::make_unique<State>(points.size(), std::move(data), std::move(options))) {
    state_->places = sorted(points, state_->order);
    state_->sort_samples();
}

EllipsoidFit::~EllipsoidFit() = default;

std::size_t EllipsoidFit::size() const { return state_->size; }

double EllipsoidFit::objective(const std::vector<FreeEllipsoid>& kernels, std::vector<EllipsoidChange>& slope,
                               const Progress& progress) const {
    check(kernels);
    double found = 0.0;
    const std::vector<double> left = state_->left(kernels, found, progress);
    slope = state_->project(kernels, left.data(), progress);
    return found;
}

double EllipsoidFit::residual(const std::vector<FreeEllipsoid>& kernels, std::vector<double>& left,
                              const Progress& progress) const {
    check(kernels);
    double found = 0.0;
    left = state_->given_order(state_->left(kernels, found, progress));
    return found;
}

std::vector<double> EllipsoidFit::sums(const std::vector<FreeEllipsoid>& kernels, const Progress& progress) const {
    check(kernels);
    return state_->given_order(
        state_->sum(kernels, {}, progress, [](std::size_t, const double*, std::size_t, std::size_t) {}));
}

std::vector<EllipsoidChange> EllipsoidFit::project(const std::vector<FreeEllipsoid>& kernels,
                                                   const std::vector<double>& field, const Progress& progress) const {
    check(kernels);
    if (field.size() != state_->size) {
        throw InvalidInput(Complaint{"EllipsoidFit: the field cannot be used", text_of_count(field.size(), "number"),
                                     "one a sample", ""});
    }
    return state_->project(kernels, state_->sorted(field).data(), progress);
}

std::vector<EllipsoidChange> EllipsoidFit::normal(const std::vector<FreeEllipsoid>& kernels,
                                                  const std::vector<EllipsoidChange>& changes,
                                                  const Progress& progress) const {
    check(kernels);
    if (changes.size() != kernels.size()) {
        throw InvalidInput(Complaint{"EllipsoidFit: the changes cannot be used",
                                     text_of_count(changes.size()) + " of them", "one a kernel", ""});
    }
    const std::vector<double>& weights = state_->weights;
    const std::vector<double> field =
        state_->sum(kernels, changes, progress, [&](std::size_t, double* out, std::size_t first, std::size_t last) {
            for (std::size_t n = first; n < last && !weights.empty(); ++n) {
                out[n] *= weights[n];
            }
        });
    return state_->project(kernels, field.data(), progress);
}

std::vector<std::array<double, numbers_of_block>> EllipsoidFit::blocks(const std::vector<FreeEllipsoid>& kernels,
                                                                       const Progress& progress) const {
    check(kernels);
    const double* const weights = state_->weights.empty() ? nullptr : state_->weights.data();
    return state_->each<fitting::Block>(kernels, progress, [&](const auto& text, const auto& all, const auto& kernel) {
        return text.block(all, state_->profile, kernel, weights);
    });
}

std::vector<double> EllipsoidFit::overlaps(const std::vector<FreeEllipsoid>& kernels, const Progress& progress) const {
    check(kernels);
    const std::size_t count = kernels.size();
    require_memory(checked_product(count, count * sizeof(double), "the overlaps of kernels"), "the overlaps of kernels",
                   "use fewer kernels");
    const double* const weights = state_->weights.empty() ? nullptr : state_->weights.data();
    std::vector<double> sums(count * count, 0.0);
    std::visit(
        [&](const auto& all) {
            const auto& text = fitting::loops<std::decay_t<decltype(all)>>(state_->set);
            state_->run(count, progress, [&](std::size_t a) {
                for (std::size_t b = a; b < count; ++b) {
                    sums[a * count + b] = text.overlap(all, state_->profile, kernels[a], kernels[b], weights);
                }
            });
        },
        state_->places);
    for (std::size_t a = 0; a < count; ++a) {
        for (std::size_t b = 0; b < a; ++b) {
            sums[a * count + b] = sums[b * count + a];
        }
    }
    return sums;
}

FreeEllipsoid changed(const FreeEllipsoid& kernel, const EllipsoidChange& change) {
    const auto& [xx, yy, zz, xy, xz, yz] = kernel.frame;
    const auto& [sx, sy, sz, txy, txz, tyz] = change.frame;
    const double x = std::exp(sx), y = std::exp(sy), z = std::exp(sz);
    FreeEllipsoid made;
    // U d = t from below.
    const double dz = change.center.z / zz;
    const double dy = (change.center.y - yz * dz) / yy;
    const double dx = (change.center.x - xy * dy - xz * dz) / xx;
    made.center = kernel.center + Vec3(dx, dy, dz);
    made.frame = {x * xx, y * yy, z * zz, x * xy + txy * yy, x * xz + txy * yz + txz * zz, y * yz + tyz * zz};
    made.value = kernel.value + change.value;
    return made;
}

} // namespace sheetsplat

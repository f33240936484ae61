// A lattice of samples f_n at x_n gets the coefficients c_n with sum_m c_m g(x_n - x_m) = f_n - b at every sample.
//
// With the boundary `zero` there is no kernel beyond the box: the matrix of g(x_n - x_m) is a block of the infinite
// lattice's convolution, so its eigenvalues lie between the smallest and the largest value of that convolution's
// spectrum (Cauchy's interlacing theorem). With `edge` coefficients are mirrored as the samples are, so that the sums
// are the convolution of periodic volumes that are even about their outermost samples: its eigenvectors are products of
// cosines (of the discrete cosine transform I), its eigenvalues values of the spectrum. Either way, where the spectrum
// is above 0 the coefficients exist, are unique, and lose no more digits than the ratio of the spectrum's ends.
//
// Each step adds a share of an approximate inverse of what the sums miss (preconditioned Richardson iteration). On a
// Cartesian lattice the kernels are nearly a product of three functions of one axis, whose inverse, border included, is
// a short filter along each axis; on a BCC lattice the approximation is a stencil of the nearest samples. The shares
// are the inverse zeros of Chebyshev's polynomial over the eigenvalues that are left (D. M. Young, On Richardson's
// method for solving linear systems with positive definite matrices, 1953), so that no sums over the volume and no
// further volumes are needed. What the sums miss is accumulated in float64 and kept in float32.
#include "field/prefilter.hpp"

#include <algorithm>
#include <cmath>
#include <new>
#include <type_traits>
#include <utility>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "prefilter_fit.hpp"
#include "prefilter_passes.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

using namespace prefiltering;

/// Wider supports need large stencils and are of no use.
constexpr double widest = 16.0;
/// A solution in float64 starts where float32 has no digits left for small coefficients, or no numbers for large ones.
constexpr double smallest_narrow = 1e-25, largest_narrow = 1e25;
/// Remainders, relative to the largest sample's distance from the base, below which nothing is left to do.
template <class C>
constexpr double enough = std::is_same_v<C, float> ? 2e-8 : 1e-12;
/// By how much a cycle of steps reduces the error.
template <class C>
constexpr double reduction = std::is_same_v<C, float> ? 3e-8 : 1e-13;
/// Sums are float32 while the step before left more than the first, relative to the same, and they themselves find more
/// than the second.
constexpr double coarse_above = 1e-3, coarse_until = 1e-5;
/// Steps of a cycle; longer cycles lose digits between its first and its last step.
constexpr int longest_cycle = 16;
/// The factor of the largest eigenvalue after a cycle that gained nothing.
constexpr double widening = 1.3;
/// Bytes of rows that stay in the cache of one core while a tile is worked on, and the layers of a tile.
constexpr std::size_t cached = 400000;
constexpr std::size_t most_layers = 32;
/// Bytes for each sample of a row that a thread keeps, and of filters for each index.
constexpr std::size_t row_bytes = 128, filter_bytes = 64;
/// Smaller volumes are done before threads have started.
constexpr std::size_t fewest_for_threads = 1 << 15;

Words refused() { return "RegularField: " + option_ref("prefilter", "true") + " cannot be used"; }

std::string text_of_shape(const Shape& shape) {
    return text_of_count(shape[0]) + " x " + text_of_count(shape[1]) + " x " + text_of_count(shape[2]);
}

const char* name_of(Lattice lattice) { return lattice == Lattice::bcc ? "bcc" : "cartesian"; }

/// The inverse zeros of Chebyshev's polynomial over [low, high], in an order in which their products stay small
/// (F. Leja 1957), as many as reduce an error by the factor, but at most longest_cycle.
std::vector<double> shares_of(double low, double high, double factor) {
    const double middle = 0.5 * (low + high), half = std::max(0.5 * (high - low), 1e-6 * middle);
    const double growth = std::acosh(middle / half);
    const int count = std::clamp(static_cast<int>(std::ceil(std::acosh(1.0 / factor) / growth)), 1, longest_cycle);
    std::vector<double> zeros;
    for (int n = 0; n < count; ++n) {
        zeros.push_back(middle + half * std::cos(3.14159265358979323846 * (n + 0.5) / count));
    }
    // The first one reduces the largest eigenvalue's part.
    for (std::size_t done = 1; done < zeros.size(); ++done) {
        const auto product = [&](double zero) {
            double value = 1.0;
            for (std::size_t n = 0; n < done; ++n) {
                value *= std::abs(zero - zeros[n]) / half;
            }
            return value;
        };
        const auto next = std::max_element(zeros.begin() + static_cast<std::ptrdiff_t>(done), zeros.end(),
                                           [&](double a, double b) { return product(a) < product(b); });
        std::iter_swap(zeros.begin() + static_cast<std::ptrdiff_t>(done), next);
    }
    for (double& zero : zeros) {
        zero = 1.0 / zero;
    }
    return zeros;
}

/// Tiles whose rows, as far as a sum reaches in layers, stay in the cache.
std::vector<Tile> tiles_of(const Shape& shape, std::size_t reach, std::size_t threads) {
    const auto [nk, nj, ni] = shape;
    const std::size_t rows =
        std::clamp<std::size_t>(cached / (4 * (2 * reach + 1) * ni), 16, std::max<std::size_t>(nj, 16));
    const std::size_t blocks = (nj + rows - 1) / rows;
    const std::size_t layers = std::clamp<std::size_t>(nk * blocks / (8 * threads), 1, most_layers);
    std::vector<Tile> tiles;
    for (std::size_t k = 0; k < nk; k += layers) {
        for (std::size_t block = 0; block < blocks; ++block) {
            tiles.push_back({k, std::min(nk, k + layers), block * nj / blocks, (block + 1) * nj / blocks});
        }
    }
    return tiles;
}

template <class C>
struct Solution {
    std::vector<C> coefficients;
    double residual = 0.0;
    int steps = 0;
};

/// Steps until the remainder is small enough or does not fall any more. largest: |sample - base|.
template <class C>
Solution<C> solve(const Equations& equations, const Fit& fitted, double largest, int most_steps, ThreadPool& pool) {
    const auto [nk, nj, ni] = equations.shape;
    const std::size_t count = nk * nj * ni;
    Solution<C> found{std::vector<C>(count, C(0))};
    Room<float> room;
    float* const remainder = room.of(count);
    const Passes<C>& loops = passes<C>(chosen_instruction_set());
    const Preconditioner& inverse = equations.preconditioner;
    const auto threads = static_cast<std::size_t>(pool.threads());
    std::vector<Scratch> scratch(threads);
    const std::vector<Tile> reading =
        tiles_of(equations.shape, static_cast<std::size_t>(equations.kernel.reach), threads);
    const std::vector<Tile> adding =
        tiles_of(equations.shape,
                 static_cast<std::size_t>(inverse.separable() ? inverse.axes.band : inverse.stencil.reach), threads);
    const auto largest_of = [&](const std::vector<Tile>& tiles, const auto& pass) {
        std::vector<double> values(tiles.size());
        pool.run(
            tiles.size(),
            [&](std::size_t n, int thread) { values[n] = pass(tiles[n], scratch[static_cast<std::size_t>(thread)]); },
            [] { poll(); });
        return *std::max_element(values.begin(), values.end());
    };
    double squares = 0.0;
    for (const auto& row : equations.kernel.rows) {
        for (std::size_t column = 0; column < equations.kernel.columns; ++column) {
            const double tap = equations.kernel.taps[row.kind * equations.kernel.columns + column];
            squares += (column == 0 ? 1.0 : 2.0) * tap * tap;
        }
    }
    const double relative = largest / equations.unit;
    double high = fitted.high;
    std::vector<double> shares = shares_of(fitted.low, high, reduction<C>);
    double top = 0.0, before = 1.0;
    for (std::size_t next = 0;; ++next) {
        const C* const so_far = found.steps == 0 ? nullptr : found.coefficients.data();
        const auto measure = [&](Accuracy accuracy) {
            const double left = largest_of(reading, [&](const Tile& tile, Scratch& own) {
                return loops.subtract(accuracy, equations, so_far, tile, own, remainder);
            });
            found.residual = left / relative;
        };
        // Sums in float32 are good enough for a remainder that is far above their rounding.
        const bool coarse = std::is_same_v<C, float> && (found.steps == 0 || found.residual > coarse_above);
        measure(coarse ? Accuracy::coarse : Accuracy::fine);
        if (coarse && (next == shares.size() || found.steps >= most_steps || found.residual < coarse_until)) {
            measure(Accuracy::fine);
        }
        if (found.residual <= enough<C> || found.steps >= most_steps) {
            return found;
        }
        if (next == shares.size()) {
            // What the coefficients' own rounding leaves, in the largest of many samples.
            const double rounding =
                std::is_same_v<C, float> ? 2.0 * std::ldexp(1.0, -24) * std::sqrt(squares) * top / largest : 0.0;
            if (found.residual <= std::min(rounding, 0.9 * worst_prefilter_residual)) {
                return found;
            }
            if (found.residual < 0.5 * before) {
                shares = shares_of(fitted.low, high, std::cbrt(reduction<C>));
            } else if (found.residual > coarse_above) {
                // Far from any rounding: borders have larger eigenvalues than were estimated.
                high *= widening;
                shares = shares_of(fitted.low, high, reduction<C>);
            } else {
                return found;
            }
            before = found.residual;
            next = 0;
        }
        top = largest_of(adding, [&](const Tile& tile, Scratch& own) {
            return loops.add(equations, remainder, shares[next], tile, own, found.coefficients.data());
        });
        ++found.steps;
    }
}

/// The first sample that is no finite number.
template <class T>
void require_finite(const std::vector<T>& samples, const Shape& shape, const RegularFieldOptions& options) {
    const auto bad = std::find_if_not(samples.begin(), samples.end(), [](T value) { return std::isfinite(value); });
    if (bad == samples.end()) {
        return;
    }
    const auto n = static_cast<std::size_t>(bad - samples.begin());
    Words found = text_of(static_cast<double>(*bad)) + " at sample [" + text_of_count(n / shape[2] / shape[1]) + ", " +
                  text_of_count(n / shape[2] % shape[1]) + ", " + text_of_count(n % shape[2]) + "]";
    if (options.nan == NanPolicy::skip && std::isnan(*bad)) {
        found += ", which " + option_ref("nan", "skip") + " leaves out";
    }
    throw InvalidInput(Complaint{refused(), found,
                                 "finite numbers, since each coefficient depends on the samples all around it",
                                 "fill such samples before, or leave out " + option_ref("prefilter")});
}

template <class T>
double largest_difference(const std::vector<T>& samples, double base) {
    const auto [low, high] = std::minmax_element(samples.begin(), samples.end());
    return std::max(base - static_cast<double>(*low), static_cast<double>(*high) - base);
}

/// The taps of kernels that can be prefiltered, and their condition number.
std::pair<Taps, double> checked_taps(Lattice lattice, double radius, double falloff) {
    const Words failed = "RegularField: " + option_ref("prefilter", "true") + " cannot be used with this kernel";
    if (radius > widest) {
        throw InvalidInput(Complaint{failed, "radius " + text_of(radius, 6),
                                     "at most " + text_of(widest) + " sample distances",
                                     "use (radius, falloff) = (2, 5), (2.5, 7) or (3, 8)"});
    }
    Taps taps = kernel_taps(lattice, radius, falloff);
    const auto [low, high] = spectrum_range(taps);
    if (low > 0.0 && high / low <= worst_prefilter_condition) {
        return {std::move(taps), high / low};
    }
    std::string found = "radius " + text_of(radius, 6) + " with falloff " + text_of(falloff, 6) + " on a " +
                        name_of(lattice) + " lattice, ";
    if (low > 0.0) {
        found += "whose equations have the condition number " + text_of(high / low, 3);
    } else {
        found += "whose spectrum goes from " + text_of(low, 3) + " to " + text_of(high, 3) +
                 ", so that not all samples can be passed through";
    }
    throw InvalidInput(Complaint{
        failed, found, "a spectrum above 0 and a condition number of at most " + text_of(worst_prefilter_condition),
        "use a larger " + option_ref("falloff") + " or a smaller " + option_ref("radius") +
            ": radius 2 with falloff 5, 2.5 with 7 and 3 with 8 can be used"});
}

} // namespace

double prefilter_condition(Lattice lattice, double radius, double falloff) {
    return checked_taps(lattice, radius, falloff).second;
}

PrefilteredSamples prefiltered(const SampleArray& samples, const std::array<std::size_t, 3>& shape,
                               const RegularFieldOptions& options, const PrefilterLimits& limits) {
    if (options.normalization == Normalization::threshold) {
        throw InvalidInput(
            Complaint{refused(), option_ref("normalization", "threshold") + ", a mean that passes through no sample",
                      option_ref("normalization", "none") + ", which " + option_ref("prefilter", "true") + " sets",
                      "leave out one or the other"});
    }
    const auto [taps, condition] = checked_taps(options.lattice, options.radius, options.falloff);
    PrefilteredSamples result;
    result.figures.condition = condition;
    Equations equations;
    equations.shape = shape;
    // (The mirrors of a BCC lattice need layers of both kinds.)
    equations.mirrored = options.boundary == Boundary::edge && !(taps.bcc && shape[0] < 2);
    equations.base = options.base.value_or(0.0);
    double largest = 0.0;
    bool narrow = true;
    std::visit(
        [&](const auto& array) {
            using T = typename std::decay_t<decltype(array)>::value_type;
            if constexpr (std::is_floating_point_v<T>) {
                require_finite(array, shape, options);
            }
            largest = largest_difference(array, equations.base);
            narrow = !std::is_same_v<T, double> &&
                     (largest == 0.0 || (largest > smallest_narrow && largest < largest_narrow));
            equations.samples = array.data();
        },
        samples);
    const std::size_t count = shape[0] * shape[1] * shape[2];
    const int most_threads = limits.threads > 0 ? limits.threads : usable_threads();
    const std::size_t threads = count < fewest_for_threads ? 1 : static_cast<std::size_t>(most_threads);
    require_memory(count * ((narrow ? sizeof(float) : sizeof(double)) + sizeof(float)) +
                       threads * shape[2] * row_bytes + (shape[0] + shape[1] + shape[2]) * filter_bytes,
                   "the prefilter of " + text_of_shape(shape) + " samples",
                   "use a smaller volume, or leave out " + option_ref("prefilter"));
    if (largest == 0.0) {
        if (narrow) {
            result.coefficients = std::vector<float>(count);
        } else {
            result.coefficients = std::vector<double>(count);
        }
        return result;
    }
    int exponent = 0;
    static_cast<void>(std::frexp(largest, &exponent));
    equations.unit = std::ldexp(1.0, std::max(exponent - 1, -1000));
    equations.kind = samples.index();
    equations.kernel = stencil_of<double>(taps);
    equations.coarse_kernel = stencil_of<float>(taps);
    Fit fitted = fit(taps, shape, equations.mirrored);
    equations.preconditioner = std::move(fitted.preconditioner);
    ThreadPool pool(static_cast<int>(threads));
    const auto keep = [&](auto solution) {
        result.figures.residual = solution.residual;
        result.figures.steps += solution.steps;
        result.coefficients = std::move(solution.coefficients);
    };
    if (narrow) {
        keep(solve<float>(equations, fitted, largest, limits.steps, pool));
    }
    if (!narrow || !(result.figures.residual <= worst_prefilter_residual)) {
        // Reached in float32 only for rough samples and kernels close to the worst condition number.
        result.coefficients = std::vector<float>();
        keep(solve<double>(equations, fitted, largest, limits.steps, pool));
    }
    if (!(result.figures.residual <= worst_prefilter_residual)) {
        throw Error(Complaint{"RegularField: the samples cannot be prefiltered",
                              "sums that are " + text_of(result.figures.residual, 2) +
                                  " of the largest difference from the base away from the samples after " +
                                  text_of_count(static_cast<std::uint64_t>(result.figures.steps)) + " steps",
                              "at most " + text_of(worst_prefilter_residual),
                              "use a larger " + option_ref("falloff") + " or a smaller " + option_ref("radius") +
                                  ", or scale the values towards 1"});
    }
    return result;
}

} // namespace sheetsplat

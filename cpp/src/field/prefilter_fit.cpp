#include "prefilter_fit.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "mirrored.hpp"

namespace sheetsplat::prefiltering {
namespace {

constexpr double pi = 3.14159265358979323846;

/// Frequencies along an axis at which a spectrum is evaluated, from 0 to the lattice's highest.
constexpr std::size_t frequencies = 65;

// ------------------------------------------------------------------------------------------------------ spectra

/// [frequency][n]: what a pair of even taps at -n and n adds to a spectrum.
std::vector<double> cosines(std::size_t frequency_count, std::size_t length) {
    std::vector<double> table(frequency_count * length);
    for (std::size_t f = 0; f < frequency_count; ++f) {
        const double angle = pi * static_cast<double>(f) / static_cast<double>(frequency_count - 1);
        for (std::size_t n = 0; n < length; ++n) {
            table[f * length + n] = n == 0 ? 1.0 : 2.0 * std::cos(angle * static_cast<double>(n));
        }
    }
    return table;
}

/// Calls use(k, j, i, value) for the spectrum at all frequencies k >= j >= i, of which all others are permutations.
template <class Use>
void for_spectrum(const Taps& taps, std::size_t count, Use&& use) {
    const std::size_t length = taps.length;
    const std::vector<double> table = cosines(count, length);
    std::vector<double> plane(length * length), line(length);
    for (std::size_t k = 0; k < count; ++k) {
        std::fill(plane.begin(), plane.end(), 0.0);
        for (std::size_t a = 0; a < length; ++a) {
            for (std::size_t n = 0; n < plane.size(); ++n) {
                plane[n] += table[k * length + a] * taps.values[a * plane.size() + n];
            }
        }
        for (std::size_t j = 0; j <= k; ++j) {
            std::fill(line.begin(), line.end(), 0.0);
            for (std::size_t b = 0; b < length; ++b) {
                for (std::size_t n = 0; n < length; ++n) {
                    line[n] += table[j * length + b] * plane[b * length + n];
                }
            }
            for (std::size_t i = 0; i <= j; ++i) {
                double value = 0.0;
                for (std::size_t n = 0; n < length; ++n) {
                    value += table[i * length + n] * line[n];
                }
                use(k, j, i, value);
            }
        }
    }
}

// ------------------------------------------------------------------------------------------------- Cartesian lattices

/// Frequencies for the fit of separable filters, and so twice the taps that their inverses may have.
constexpr std::size_t fitted_frequencies = 33;
/// What filters of finite length may leave of each axis's share of the remainder.
constexpr double cut_off = 0.01;

/// The inverse of a symmetric positive definite matrix, by elimination without pivots.
std::vector<double> inverse(std::vector<double> matrix, std::size_t n) {
    std::vector<double> made(n * n, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
        made[i * n + i] = 1.0;
    }
    for (std::size_t p = 0; p < n; ++p) {
        const double pivot = 1.0 / matrix[p * n + p];
        for (std::size_t c = 0; c < n; ++c) {
            matrix[p * n + c] *= pivot;
            made[p * n + c] *= pivot;
        }
        for (std::size_t r = 0; r < n; ++r) {
            const double share = matrix[r * n + p];
            if (r == p || share == 0.0) {
                continue;
            }
            for (std::size_t c = 0; c < n; ++c) {
                matrix[r * n + c] -= share * matrix[p * n + c];
                made[r * n + c] -= share * made[p * n + c];
            }
        }
    }
    return made;
}

/// The symmetric Toeplitz matrix of even taps.
std::vector<double> toeplitz(const std::vector<double>& taps, std::size_t n) {
    std::vector<double> matrix(n * n, 0.0);
    for (std::size_t r = 0; r < n; ++r) {
        for (std::size_t c = 0; c < n; ++c) {
            const std::size_t away = r > c ? r - c : c - r;
            matrix[r * n + c] = away < taps.size() ? taps[away] : 0.0;
        }
    }
    return matrix;
}

/// The smallest band that a matrix's inverse can be cut to, and what |inverse * matrix - 1| (largest sum of a row) is
/// then.
std::pair<int, double> band_of(const std::vector<double>& matrix, const std::vector<double>& inverted, std::size_t n) {
    for (std::size_t band = 0;; ++band) {
        double worst = 0.0;
        for (std::size_t r = 0; r < n; ++r) {
            double sum = 0.0;
            for (std::size_t c = 0; c < n; ++c) {
                double entry = r == c ? -1.0 : 0.0;
                for (std::size_t m = r - std::min(r, band); m < std::min(n, r + band + 1); ++m) {
                    entry += inverted[r * n + m] * matrix[m * n + c];
                }
                sum += std::abs(entry);
            }
            worst = std::max(worst, sum);
        }
        if (worst <= cut_off || band + 1 >= filter_border) {
            return {static_cast<int>(band), worst};
        }
    }
}

/// The same filter at all samples of an axis, beyond whose ends samples are mirrored.
void set_mirrored_filters(const std::vector<double>& filter, std::size_t axis, std::size_t length, AxisFilters& axes) {
    const int band = axes.band;
    for (std::size_t index = 0; index < length; ++index) {
        std::vector<double> folded(filter.size(), 0.0);
        for (int offset = -band; offset <= band; ++offset) {
            const auto at = static_cast<std::ptrdiff_t>(index);
            const auto image = static_cast<std::ptrdiff_t>(mirrored_index(at + offset, length));
            folded[static_cast<std::size_t>(image - at + band)] += filter[static_cast<std::size_t>(offset + band)];
        }
        for (std::size_t n = 0; n < folded.size(); ++n) {
            axes.taps[axis][n * length + index] = static_cast<float>(folded[n]);
        }
    }
}

/// ln of the spectrum is fitted by u(k) + u(j) + u(i), which has a closed form; exp u is the spectrum of a filter along
/// one axis. The three filters' matrix on a box is a Kronecker product of Toeplitz matrices, and so is its inverse,
/// with the border. Quotients of Toeplitz matrices have eigenvalues between the ends of the quotient of their spectra.
/// With mirrored samples kernels and filters are those of an endless lattice on volumes that are mirrored again and
/// again, whose frequencies are some of those of all volumes.
Fit fit_separable(const Taps& taps, const Shape& shape, bool mirrored) {
    constexpr std::size_t count = fitted_frequencies;
    std::vector<double> logarithms(count * count * count);
    for_spectrum(taps, count, [&](std::size_t k, std::size_t j, std::size_t i, double value) {
        logarithms[(k * count + j) * count + i] = std::log(value);
    });
    const auto logarithm = [&](std::size_t k, std::size_t j, std::size_t i) {
        const std::size_t low = std::min({k, j, i}), high = std::max({k, j, i});
        return logarithms[(high * count + (k + j + i - low - high)) * count + low];
    };
    const auto weight = [](std::size_t n) { return (n == 0 || n + 1 == count ? 0.5 : 1.0) / (count - 1); };
    std::vector<double> along(count, 0.0);
    double mean = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
        for (std::size_t j = 0; j < count; ++j) {
            for (std::size_t i = 0; i < count; ++i) {
                along[k] += weight(j) * weight(i) * logarithm(k, j, i);
            }
        }
        mean += weight(k) * along[k];
    }
    Fit made;
    double least = 1e300, most = -1e300;
    for (std::size_t k = 0; k < count; ++k) {
        for (std::size_t j = 0; j <= k; ++j) {
            for (std::size_t i = 0; i <= j; ++i) {
                const double rest = logarithm(k, j, i) - (along[k] + along[j] + along[i] - 2.0 * mean);
                least = std::min(least, rest);
                most = std::max(most, rest);
            }
        }
    }
    std::vector<double> filter(count - 1, 0.0);
    for (std::size_t n = 0; n < filter.size(); ++n) {
        for (std::size_t f = 0; f < count; ++f) {
            filter[n] += weight(f) * std::exp(along[f] - 2.0 / 3.0 * mean) *
                         std::cos(pi * static_cast<double>(f * n) / (count - 1));
        }
    }
    AxisFilters& axes = made.preconditioner.axes;
    constexpr std::size_t longest = 2 * filter_border;
    const std::vector<double> whole = toeplitz(filter, longest), whole_inverse = inverse(whole, longest);
    const auto [band, rest] = band_of(whole, whole_inverse, longest);
    axes.band = band;
    // The axes are cut at different frequencies: where all three are at their worst, steps gain a little less.
    made.low = std::exp(least) * (1.0 - rest);
    made.high = std::exp(most) * (1.0 + rest);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t length = shape[axis];
        std::vector<float>& entries = axes.taps[axis];
        entries.assign(static_cast<std::size_t>(2 * band + 1) * length + filter_slack, 0.0F);
        if (mirrored) {
            std::vector<double> middle;
            for (int offset = -band; offset <= band; ++offset) {
                middle.push_back(
                    whole_inverse[longest / 2 * (longest + 1) + static_cast<std::size_t>(std::abs(offset))]);
            }
            set_mirrored_filters(middle, axis, length, axes);
            continue;
        }
        const std::size_t n = std::min(length, longest);
        const std::vector<double> inverted = inverse(toeplitz(filter, n), n);
        for (std::size_t index = 0; index < length; ++index) {
            // The middle row stands for all that are far from the ends.
            const std::size_t row = index < filter_border ? index : std::max(n - std::min(n, length - index), n / 2);
            for (int offset = -band; offset <= band; ++offset) {
                const auto column = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(row) + offset);
                if (column < n && static_cast<std::size_t>(static_cast<std::ptrdiff_t>(index) + offset) < length) {
                    entries[static_cast<std::size_t>(offset + band) * length + index] =
                        static_cast<float>(inverted[row * n + column]);
                }
            }
        }
    }
    return made;
}

// ------------------------------------------------------------------------------------------------------- BCC lattices

/// Frequencies along an axis for the fit of a stencil.
constexpr std::size_t stencil_frequencies = 17;
/// Distances of samples that a stencil may have, and the remainder that is small enough to need no more of them.
constexpr std::size_t fewest_shells = 4, most_shells = 12;
constexpr double small_remainder = 0.45;
constexpr int reweightings = 12;

/// Larger than any |offset| of so many shells.
constexpr std::size_t farthest_shell = 8;

using Shell = std::array<std::size_t, 3>; ///< |offsets|, the largest first

/// The shells of a BCC lattice, the nearest first.
std::vector<Shell> nearest_shells(std::size_t count) {
    std::vector<Shell> shells;

    for (std::size_t k = 0; k <= farthest_shell; ++k) {
        for (std::size_t j = 0; j <= k; ++j) {
            for (std::size_t i = 0; i <= j; ++i) {
                if (k % 2 == j % 2 && j % 2 == i % 2) {
                    shells.push_back({k, j, i});
                }
            }
        }
    }
    const auto square = [](const Shell& s) { return s[0] * s[0] + s[1] * s[1] + s[2] * s[2]; };
    std::stable_sort(shells.begin(), shells.end(),
                     [&](const Shell& a, const Shell& b) { return square(a) < square(b); });
    shells.resize(count);
    return shells;
}

/// Solves a symmetric positive definite system in place.
void solve(std::vector<double>& matrix, std::vector<double>& right, std::size_t n) {
    const std::vector<double> inverted = inverse(std::move(matrix), n);
    std::vector<double> made(n, 0.0);
    for (std::size_t r = 0; r < n; ++r) {
        for (std::size_t c = 0; c < n; ++c) {
            made[r] += inverted[r * n + c] * right[c];
        }
    }
    right = std::move(made);
}

/// A stencil of the nearest shells whose spectrum times that of the kernels is nearly 1: least squares, of which
/// frequencies with large errors get more weight step by step (C. L. Lawson 1961), so that the largest error falls.
struct ShellFit {
    std::vector<double> values; ///< of the shells
    double low = 0.0, high = 0.0;
    [[nodiscard]] double remainder() const { return (high - low) / (high + low); }
};

ShellFit fit_shells(const std::vector<std::vector<double>>& basis, std::size_t shells) {
    const std::size_t places = basis[0].size();
    std::vector<double> weights(places, 1.0);
    ShellFit best;
    for (int round = 0; round < reweightings; ++round) {
        std::vector<double> matrix(shells * shells, 0.0), values(shells, 0.0);
        for (std::size_t r = 0; r < shells; ++r) {
            for (std::size_t c = 0; c <= r; ++c) {
                for (std::size_t n = 0; n < places; ++n) {
                    matrix[r * shells + c] += weights[n] * basis[r][n] * basis[c][n];
                }
                matrix[c * shells + r] = matrix[r * shells + c];
            }
            for (std::size_t n = 0; n < places; ++n) {
                values[r] += weights[n] * basis[r][n];
            }
        }
        solve(matrix, values, shells);
        ShellFit found{values, 1e300, -1e300};
        double total = 0.0;
        std::vector<double> errors(places);
        for (std::size_t n = 0; n < places; ++n) {
            double sum = 0.0;
            for (std::size_t r = 0; r < shells; ++r) {
                sum += values[r] * basis[r][n];
            }
            found.low = std::min(found.low, sum);
            found.high = std::max(found.high, sum);
            errors[n] = std::abs(sum - 1.0);
            total += weights[n] * errors[n];
        }
        if (best.values.empty() || (found.low > 0.0 && !(best.remainder() <= found.remainder()))) {
            best = found;
        }
        const double mean = total / static_cast<double>(places);
        for (std::size_t n = 0; n < places && mean > 0.0; ++n) {
            weights[n] *= (errors[n] + 1e-3 * mean) / mean;
        }
    }
    return best;
}

/// The largest eigenvalue of stencil times kernels on a box, which the border of any larger box does not exceed by
/// much: by power iteration.
double largest_eigenvalue(const Taps& kernel, const Taps& stencil, const Shape& shape) {
    std::vector<std::array<int, 3>> places;
    constexpr Shape most{8, 4, 4};
    for (std::size_t k = 0; k < std::min(shape[0], most[0]); ++k) {
        for (std::size_t j = 0; j < std::min(shape[1], most[1]); ++j) {
            for (std::size_t i = 0; i < std::min(shape[2], most[2]); ++i) {
                places.push_back(
                    {static_cast<int>(k), static_cast<int>(2 * j + k % 2), static_cast<int>(2 * i + k % 2)});
            }
        }
    }
    const std::size_t n = places.size();
    const auto matrix_of = [&](const Taps& taps) {
        std::vector<double> matrix(n * n, 0.0);
        for (std::size_t r = 0; r < n; ++r) {
            for (std::size_t c = 0; c < n; ++c) {
                const auto away = [&](std::size_t axis) {
                    return static_cast<std::size_t>(std::abs(places[r][axis] - places[c][axis]));
                };
                if (std::max({away(0), away(1), away(2)}) < taps.length) {
                    matrix[r * n + c] = taps.at(away(0), away(1), away(2));
                }
            }
        }
        return matrix;
    };
    const std::vector<double> first = matrix_of(kernel), second = matrix_of(stencil);
    std::vector<double> vector(n), image(n);
    for (std::size_t i = 0; i < n; ++i) {
        vector[i] = 1.0 + std::sin(static_cast<double>(i * i));
    }
    const auto multiply = [&](const std::vector<double>& matrix) {
        for (std::size_t r = 0; r < n; ++r) {
            image[r] = 0.0;
            for (std::size_t c = 0; c < n; ++c) {
                image[r] += matrix[r * n + c] * vector[c];
            }
        }
        std::swap(vector, image);
    };
    double value = 1.0;
    constexpr int rounds = 24;
    for (int round = 0; round < rounds; ++round) {
        multiply(first);
        multiply(second);
        value = 0.0;
        for (const double entry : vector) {
            value += entry * entry;
        }
        value = std::sqrt(value);
        for (double& entry : vector) {
            entry /= value;
        }
    }
    return value;
}

Fit fit_stencil(const Taps& taps, const Shape& shape, bool mirrored) {
    const std::vector<Shell> shells = nearest_shells(most_shells);
    // Each shell's spectrum times that of the kernels.
    std::vector<std::vector<double>> basis(shells.size());
    constexpr std::size_t count = stencil_frequencies;
    constexpr std::size_t longest = farthest_shell + 1;
    const std::vector<double> table = cosines(count, longest);
    const auto cosine = [&](std::size_t f, std::size_t n) { return table[f * longest + n]; };
    for_spectrum(taps, count, [&](std::size_t k, std::size_t j, std::size_t i, double value) {
        for (std::size_t n = 0; n < shells.size(); ++n) {
            Shell at = shells[n];
            std::sort(at.begin(), at.end());
            double sum = 0.0;
            do {
                sum += cosine(k, at[0]) * cosine(j, at[1]) * cosine(i, at[2]);
            } while (std::next_permutation(at.begin(), at.end()));
            basis[n].push_back(value * sum);
        }
    });
    ShellFit found = fit_shells(basis, fewest_shells);
    for (std::size_t n = fewest_shells + 1;
         n <= most_shells && !(found.low > 0.0 && found.remainder() <= small_remainder); ++n) {
        found = fit_shells(basis, n);
    }
    Taps inverse_taps{true, 0, {}};
    for (std::size_t n = 0; n < found.values.size(); ++n) {
        inverse_taps.length = std::max(inverse_taps.length, shells[n][0] + 1);
    }
    const std::size_t length = inverse_taps.length;
    inverse_taps.values.assign(length * length * length, 0.0);
    for (std::size_t n = 0; n < found.values.size(); ++n) {
        Shell at = shells[n];
        std::sort(at.begin(), at.end());
        do {
            inverse_taps.values[(at[0] * length + at[1]) * length + at[2]] = found.values[n];
        } while (std::next_permutation(at.begin(), at.end()));
    }
    Fit made;
    made.preconditioner.stencil = stencil_of<float>(inverse_taps);
    made.low = found.low;
    constexpr double margin = 1.03;
    // The eigenvalues of mirrored volumes are values of the spectrum, those of others are larger at borders.
    made.high =
        mirrored ? margin * found.high : std::max(found.high, margin * largest_eigenvalue(taps, inverse_taps, shape));
    return made;
}

} // namespace

Taps kernel_taps(Lattice lattice, double radius, double falloff) {
    const bool bcc = lattice == Lattice::bcc;
    const double reach = bcc ? radius * std::sqrt(2.0) : radius;
    // A sample at the very edge has g = 0.
    const auto length = static_cast<std::size_t>(std::max(1.0, std::ceil(reach)));
    Taps taps{bcc, length, std::vector<double>(length * length * length, 0.0)};
    const Kernel kernel{falloff};
    for (std::size_t k = 0; k < length; ++k) {
        for (std::size_t j = 0; j < length; ++j) {
            for (std::size_t i = 0; i < length; ++i) {
                const double square = static_cast<double>(k * k + j * j + i * i) / (reach * reach);
                if (!bcc || (k % 2 == j % 2 && j % 2 == i % 2)) {
                    taps.values[(k * length + j) * length + i] =
                        std::max(0.0, (std::exp(-falloff * square) - kernel.edge()) * kernel.gain());
                }
            }
        }
    }
    return taps;
}

std::array<double, 2> spectrum_range(const Taps& taps) {
    std::array<double, 2> range{1e300, -1e300};
    for_spectrum(taps, frequencies, [&](std::size_t, std::size_t, std::size_t, double value) {
        range = {std::min(range[0], value), std::max(range[1], value)};
    });
    return range;
}

template <class T>
Stencil<T> stencil_of(const Taps& taps) {
    // Taps that float64 cannot tell from 0 beside the middle one.
    const double negligible = 1e-18 * std::abs(taps.at(0, 0, 0));
    const auto counts = [&](std::size_t k, std::size_t j, std::size_t i) {
        return std::abs(taps.at(k, j, i)) > negligible;
    };
    const auto length = static_cast<int>(taps.length);
    Stencil<T> made;
    made.bcc = taps.bcc;
    std::map<std::pair<std::size_t, std::size_t>, std::size_t> kinds;
    for (std::size_t j = 0; j < taps.length; ++j) {
        for (std::size_t k = 0; k <= j; ++k) {
            for (std::size_t i = taps.length; i-- > 0;) {
                if (counts(k, j, i)) {
                    kinds.emplace(std::pair{k, j}, kinds.size());
                    made.columns = std::max(made.columns, i + 1);
                    break;
                }
            }
        }
    }
    made.kinds = kinds.size();
    made.taps.assign(made.kinds * made.columns, T(0));
    for (const auto& [at, kind] : kinds) {
        for (std::size_t i = 0; i < made.columns; ++i) {
            const double tap = taps.at(at.first, at.second, i);
            made.taps[kind * made.columns + i] = static_cast<T>(counts(at.first, at.second, i) ? tap : 0.0);
        }
    }
    for (int k = 1 - length; k < length; ++k) {
        for (int j = 1 - length; j < length; ++j) {
            const auto away_k = static_cast<std::size_t>(std::abs(k)), away_j = static_cast<std::size_t>(std::abs(j));
            const auto found = kinds.find({std::min(away_k, away_j), std::max(away_k, away_j)});
            if (found != kinds.end()) {
                // On BCC lattices rows of odd layers lie half an edge further.
                const bool between = taps.bcc && j % 2 != 0;
                const int even = !taps.bcc ? j : between ? (j - 1) / 2 : j / 2;
                made.rows.push_back({k, {even, between ? even + 1 : even}, found->second});
                made.reach = std::max(made.reach, k);
            }
        }
    }
    std::stable_sort(made.rows.begin(), made.rows.end(), [](const auto& a, const auto& b) { return a.kind < b.kind; });
    return made;
}

template Stencil<float> stencil_of<float>(const Taps& taps);
template Stencil<double> stencil_of<double>(const Taps& taps);

Fit fit(const Taps& taps, const Shape& shape, bool mirrored) {
    return taps.bcc ? fit_stencil(taps, shape, mirrored) : fit_separable(taps, shape, mirrored);
}

} // namespace sheetsplat::prefiltering

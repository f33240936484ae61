// Sums of ellipsoids over runs of samples, compiled once for each instruction set.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/instruction_set.hpp"
#include "sheetsplat/ellipsoid_fit.hpp"

namespace sheetsplat::fitting {

/// Numbers behind the samples, so that whole vectors can be read.
constexpr std::size_t slack = 16;

/// exp(-k r^2) lowered by its value at the edge (conventions, section 2).
struct Profile {
    double falloff = 0.0, edge = 0.0, gain = 0.0;
    explicit Profile(double k) : falloff(k), edge(std::exp(-k)), gain(-1.0 / std::expm1(-k)) {}
};

/// Rows j0 to j1 - 1 of the layers k0 to k1 - 1, of samples or of cells.
struct Tile {
    std::size_t k0 = 0, k1 = 0, j0 = 0, j1 = 0;
};

/// Samples of a lattice, and their places: indices.
struct LatticePlaces {
    std::size_t layers = 0, rows = 0, columns = 0;
    [[nodiscard]] std::size_t begin(std::size_t k, std::size_t j) const { return (k * rows + j) * columns; }
};

/// Points, sorted by the cells that they are in, row of cells by row.
struct ScatteredPlaces {
    std::size_t layers = 0, rows = 0, columns = 0;
    std::array<double, 3> origin{}, cell{}; ///< of the first cell, and the sizes of all
    std::vector<std::size_t> starts;        ///< of each cell's points, and the end
    std::array<std::vector<double>, 3> at;  ///< x, y, z with slack
    [[nodiscard]] std::size_t begin(std::size_t k, std::size_t j) const { return starts[(k * rows + j) * columns]; }
};

using Block = std::array<double, numbers_of_block>;

/// field, weights: of each sample with slack behind it, sorted as the places are; weights may be null: 1 each.
template <class Places>
struct Loops {
    /// out += what the kernel's value and shape change by `change` at the samples of a tile: with the change {0, 0, f}
    /// of a kernel, f g.
    void (*add)(const Places& places, const Profile& profile, const FreeEllipsoid& kernel,
                const EllipsoidChange& change, const Tile& tile, double* out);
    /// The sums over all samples of field times derivatives.
    EllipsoidChange (*project)(const Places& places, const Profile& profile, const FreeEllipsoid& kernel,
                               const double* field);
    /// The sums over all samples of weight times products of two derivatives.
    Block (*block)(const Places& places, const Profile& profile, const FreeEllipsoid& kernel, const double* weights);
    /// The sum over all samples of weight times the product of two kernels' g.
    double (*overlap)(const Places& places, const Profile& profile, const FreeEllipsoid& first,
                      const FreeEllipsoid& other, const double* weights);
};

/// `set`: one of usable_instruction_sets().
template <class Places>
const Loops<Places>& loops(InstructionSet set);
extern template const Loops<LatticePlaces>& loops<LatticePlaces>(InstructionSet set);
extern template const Loops<ScatteredPlaces>& loops<ScatteredPlaces>(InstructionSet set);

} // namespace sheetsplat::fitting

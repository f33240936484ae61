// Few kernels on lattices of dyadic spacing for the samples of a field: coordinate descent on the residual.
//
// Level l has nodes at multiples of spacing(l) = finest * 2^l, in the coordinates of the samples' index space, and a
// kernel of radius r * spacing(l) at each, the profile g of conventions, section 2. What is sought are coefficients c
// with sum over levels and nodes of c g close to the samples and most of them 0.
//
// soften() makes one pass of coordinate descent for 1/2 |residual|^2 + sum of threshold |g| |c| (|g| a kernel's norm at
// the samples), which is convex: passes with falling thresholds lead to its minimum. round_off() makes one pass that
// leaves whole multiples of a step, each the one whose squared error plus lambda times its bits is least.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat::fit {

/// Samples at offset + (i, j, k), i fastest; NaN: missing.
struct SampleGrid {
    std::array<std::size_t, 3> counts{}; ///< of i, j, k
    std::array<double, 3> offset{};      ///< multiples of 1/2
    std::vector<double> samples;         ///< less the base
};

/// Samples anywhere, in the same coordinates.
struct SamplePoints {
    std::vector<Vec3> places;
    std::vector<double> samples;
};

/// Nodes of a level: node (x, y, z) is at (first + (x, y, z)) * spacing.
struct Nodes {
    std::array<int, 3> first{}, counts{};
    double spacing = 1.0;

    [[nodiscard]] std::size_t size() const {
        return static_cast<std::size_t>(counts[0]) * static_cast<std::size_t>(counts[1]) *
               static_cast<std::size_t>(counts[2]);
    }
};

/// What a pass found.
struct Pass {
    double largest = 0.0; ///< |correlation| / |g| of a kernel with the residual, before it changed; of those looked at
    std::size_t active = 0; ///< coefficients that are not 0 after it
};

/// Magnitudes that have bits of their own, and larger ones, whose bits grow with their logarithm.
constexpr int told_magnitudes = 16;
/// Contexts: 4 by the coarser level, 8 by neighbours.
constexpr int contexts = 32;
using BitTable = std::array<std::array<float, told_magnitudes>, contexts>;

class LatticeDescent {
  public:
    /// levels >= 1, whose spacings are multiples of 1/2; radius > 0 in spacings; exact: the residual is kept in
    /// float64. Throws OutOfMemory.
    LatticeDescent(std::vector<SampleGrid> grids, std::vector<Nodes> levels, double falloff, double radius, int threads,
                   bool exact);
    LatticeDescent(SamplePoints points, std::vector<Nodes> levels, double falloff, double radius, int threads);
    ~LatticeDescent();
    LatticeDescent(const LatticeDescent&) = delete;
    LatticeDescent& operator=(const LatticeDescent&) = delete;

    [[nodiscard]] const std::vector<Nodes>& levels() const { return levels_; }
    /// Coefficients of a level, x fastest.
    [[nodiscard]] const std::vector<float>& coefficients(std::size_t level) const { return coefficients_[level]; }
    /// |g| of a kernel that lies within the samples, for volume 1 a sample.
    [[nodiscard]] double norm(std::size_t level) const { return norms_[level]; }
    /// Residual of the known samples: sum of squares, and the largest magnitude.
    [[nodiscard]] std::array<double, 2> misfit() const;
    /// The residual, of the grids one after the other, or of the points; NaN where samples are missing.
    [[nodiscard]] std::vector<double> residual() const;

    Pass soften(std::size_t level, double threshold, bool only_active);
    /// The coefficients become multiples of step; lambda: squared error a bit.
    Pass round_off(std::size_t level, double step, double lambda, const BitTable& bits, bool only_active);
    /// Sets the coefficients of a level.
    void set(std::size_t level, const std::vector<double>& coefficients);

  private:
    template <class Change>
    Pass sweep(std::size_t level, bool only_active, const Change& change);

    std::vector<Nodes> levels_;
    std::vector<std::vector<float>> coefficients_;
    std::vector<double> norms_;
    std::unique_ptr<struct DescentParts> parts_;
};

} // namespace sheetsplat::fit

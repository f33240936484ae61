// The residual of samples, and what kernels on the levels' nodes have to do with it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "sheetsplat/lattice_descent.hpp"

namespace sheetsplat::fit {

/// A kernel at the samples: its product with the residual, and its squared norm.
struct Correlation {
    double product = 0.0, squared_norm = 0.0;
};

class Residual {
  public:
    virtual ~Residual() = default;
    Residual() = default;
    Residual(const Residual&) = delete;
    Residual& operator=(const Residual&) = delete;

    [[nodiscard]] virtual Correlation correlation(std::size_t level, const std::array<int, 3>& node) const = 0;
    /// Subtracts change times the kernel. Kernels whose supports are apart may be changed by several threads at once.
    virtual void subtract(std::size_t level, const std::array<int, 3>& node, double change) = 0;
    [[nodiscard]] virtual std::array<double, 2> misfit() const = 0;
    [[nodiscard]] virtual std::vector<double> numbers() const = 0;
};

std::unique_ptr<Residual> residual_of(std::vector<SampleGrid> grids, const std::vector<Nodes>& levels, double falloff,
                                      double radius, bool exact);
std::unique_ptr<Residual> residual_of(SamplePoints points, const std::vector<Nodes>& levels, double falloff,
                                      double radius);

} // namespace sheetsplat::fit

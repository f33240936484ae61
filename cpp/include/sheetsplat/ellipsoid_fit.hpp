// Few free ellipsoids against samples: how far their sum is from the samples, and all derivatives of that.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// An ellipsoid whose every number may change. q = U (x - center) with the upper triangular U, whose diagonal is
/// positive, so that U^T U is positive definite; |q| = 1 is where the kernel ends (conventions, section 2).
struct FreeEllipsoid {
    Vec3 center{0.0};
    std::array<double, 6> frame{}; ///< U: xx, yy, zz, xy, xz, yz
    double value = 0.0;            ///< what is counted from the base
};

/// A small change of a kernel, in the kernel's own space, so that the same numbers mean the same for kernels of any
/// size: U becomes T U with the upper triangular T = 1 + `frame` (of whose diagonal the logarithms count), and the
/// centre moves by U^-1 `center`. `frame` has the order of the kernel's.
using EllipsoidChange = FreeEllipsoid;

constexpr std::size_t numbers_of_ellipsoid = 10;
/// A symmetric matrix of these numbers, its upper triangle row by row.
constexpr std::size_t numbers_of_block = numbers_of_ellipsoid * (numbers_of_ellipsoid + 1) / 2;

/// F = 1/2 sum of w (sum of f g - data)^2 over the samples, and its parts. All sums are in float64 and have the same
/// bits with any number of threads. Samples and weights are those of the constructor, in their order. `progress` is
/// asked every few milliseconds; Cancelled where it returns false. Not to be used by two threads at once.
class EllipsoidFit {
  public:
    using Progress = std::function<bool(double)>;
    /// `data`: counted from the base. weights: empty (1 each) or one a sample, at least 0; a sample of weight 0 is
    /// missing, whatever its number. threads: 0: all that the process may use.
    struct Options {
        std::vector<double> weights{};
        double falloff = 8.0;
        int threads = 0;
    };

    /// Samples of a lattice of shape {nk, nj, ni}; places are indices (i, j, k).
    EllipsoidFit(std::array<std::size_t, 3> shape, std::vector<double> data, Options options);
    /// Samples at points.
    EllipsoidFit(const std::vector<Vec3>& points, std::vector<double> data, Options options);
    ~EllipsoidFit();
    EllipsoidFit(const EllipsoidFit&) = delete;
    EllipsoidFit& operator=(const EllipsoidFit&) = delete;

    [[nodiscard]] std::size_t size() const;

    /// F and its derivatives by the changes of each kernel.
    double objective(const std::vector<FreeEllipsoid>& kernels, std::vector<EllipsoidChange>& slope,
                     const Progress& progress = {}) const;
    /// F alone; `left`: w (sum of f g - data) of each sample.
    double residual(const std::vector<FreeEllipsoid>& kernels, std::vector<double>& left,
                    const Progress& progress = {}) const;
    /// sum of f g of each sample.
    std::vector<double> sums(const std::vector<FreeEllipsoid>& kernels, const Progress& progress = {}) const;
    /// J^T field: the derivatives of sum of (sum of f g) field.
    std::vector<EllipsoidChange> project(const std::vector<FreeEllipsoid>& kernels, const std::vector<double>& field,
                                         const Progress& progress = {}) const;
    /// J^T w J change, for the equations of a Gauss-Newton step.
    std::vector<EllipsoidChange> normal(const std::vector<FreeEllipsoid>& kernels,
                                        const std::vector<EllipsoidChange>& changes,
                                        const Progress& progress = {}) const;
    /// The block of J^T w J that belongs to each kernel, numbers in the order center, frame, value.
    std::vector<std::array<double, numbers_of_block>> blocks(const std::vector<FreeEllipsoid>& kernels,
                                                             const Progress& progress = {}) const;
    /// The sums of w g g of each two kernels, row by row: the equations of the values alone.
    std::vector<double> overlaps(const std::vector<FreeEllipsoid>& kernels, const Progress& progress = {}) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The kernel after a change.
FreeEllipsoid changed(const FreeEllipsoid& kernel, const EllipsoidChange& change);

} // namespace sheetsplat

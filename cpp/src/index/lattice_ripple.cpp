// Bounds of the weight sum of a lattice, W(x) = sum of g(x - c), over all x.
//
// W is evaluated on a grid of step h over the part of the unit cell that symmetry leaves, and continued between its
// points by what is known of its curvature. g is a smooth bump cut off at 0 from below, so along any line its second
// derivative is at least -kappa gain exp(-k r^2), kappa = 2 k / R^2; the cut-off only bends it upwards. Hence, with
// delta = h sqrt(3) / 2 the farthest that a point is from the grid and n the most supports that overlap:
//   - at the maximum the slope is 0, and W falls from there to the next grid point by at most kappa (W_max + n gain
//   exp(-k)) delta^2 / 2;
//   - around a grid point, the sum of the uncut bumps that reach it is nowhere above W, and differs from its value
//   there by at
//     most |slope| delta + kappa (W_max + 2 n gain exp(-k)) delta^2 / 2 downwards.
// Lengths are in index units (bcc: the edge a of the cube).
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <glm/geometric.hpp>

#include "index/visible_runs.hpp"

namespace sheetsplat {

namespace {

constexpr double pi = 3.14159265358979323846;
// Beyond this radius only the bound by Gaussian sums is used, because the ripple is small.
constexpr double widest_sampled = 64.0;
constexpr double wanted_margin = 2e-4;
constexpr int coarsest_grid = 4;
constexpr int finest_grid = 64;

struct LatticeGeometry {
    double radius;              ///< of the support
    double cell_volume;         ///< of a sample
    double nearest;             ///< distance of two samples
    double covering_radius;     ///< the farthest that a point can be from all samples
    std::vector<double> shifts; ///< of the cubic lattices that it consists of, along each axis
};

LatticeGeometry geometry_of(const RegularField& field) {
    const double radius = field.options().radius;
    if (field.lattice() == Lattice::bcc) {
        return {radius / std::sqrt(2.0), 0.5, std::sqrt(0.75), std::sqrt(5.0) / 4.0, {0.0, 0.5}};
    }
    return {radius, 1.0, 1.0, std::sqrt(0.75), {0.0}};
}

/// Sum of exp(-width (i + shift)^2) over all integers i, from above.
double gaussian_sum(double width, double shift) {
    constexpr int terms = 64;
    double sum = 0.0;
    for (int i = -terms; i <= terms; ++i) {
        sum += std::exp(-width * (i + shift) * (i + shift));
    }
    // What is left falls monotonically on both sides: no more than its integral.
    return sum + std::sqrt(pi / width) * std::erfc((terms - shift) * std::sqrt(width));
}

/// A bound of W that holds for every kernel: a sum of Gaussians over a lattice is largest at a lattice point, since its
/// Fourier coefficients are positive.
double gaussian_bound(const LatticeGeometry& lattice, const Kernel& kernel) {
    const double width = kernel.falloff / (lattice.radius * lattice.radius);
    double sum = 0.0;
    for (const double shift : lattice.shifts) {
        sum += std::pow(gaussian_sum(width, shift), 3);
    }
    return kernel.gain() * sum;
}

/// Sums over the kernels that reach each grid point of a column (x, y, z), x = 0, h, 2h, ... 1/2.
struct Column {
    std::vector<double> gaussians, count;
    std::vector<Vec3> moments; ///< of the Gaussians: sum of (x - c) exp(-k r^2)
};

/// Running sums over one row of kernels, as seen from each grid point on its axis.
class RowSums {
  public:
    RowSums(double width, double radius, double shift, int grid) : shift_(shift), reach_(static_cast<int>(radius) + 2) {
        const std::size_t kernels = 2 * static_cast<std::size_t>(reach_) + 2;
        stride_ = kernels + 1;
        sums_.assign(static_cast<std::size_t>(grid + 1) * stride_, {0.0, 0.0});
        for (int a = 0; a <= grid; ++a) {
            for (std::size_t n = 0; n < kernels; ++n) {
                const double d = 0.5 * a / grid - position(static_cast<int>(n) - reach_);
                const double g = std::exp(-width * d * d);
                const std::size_t at = static_cast<std::size_t>(a) * stride_ + n;
                sums_[at + 1] = {sums_[at][0] + g, sums_[at][1] + d * g};
            }
        }
    }
    [[nodiscard]] double position(int index) const { return index + shift_; }
    [[nodiscard]] int reach() const { return reach_; }

    struct Part {
        double gaussians, moment;
        int count;
    };
    /// Over the kernels less than half_chord from grid point a, which lies at x.
    [[nodiscard]] Part within(int a, double x, double half_chord) const {
        // Both numbers are positive, so that cutting off decimals rounds down.
        const double end_exact = x - shift_ + half_chord + reach_;
        const int first = static_cast<int>(x - shift_ - half_chord + reach_ + 1.0);
        const int cut_off = static_cast<int>(end_exact);
        const int end = cut_off + (static_cast<double>(cut_off) < end_exact ? 1 : 0);
        const std::size_t at = static_cast<std::size_t>(a) * stride_;
        const std::array<double, 2>& from = sums_[at + static_cast<std::size_t>(first)];
        const std::array<double, 2>& upto = sums_[at + static_cast<std::size_t>(std::max(first, end))];
        return {upto[0] - from[0], upto[1] - from[1], std::max(0, end - first)};
    }

  private:
    double shift_;
    int reach_;
    std::size_t stride_ = 0;
    std::vector<std::array<double, 2>> sums_;
};

struct Sampled {
    double largest = 0.0;
    double least_continued = 0.0; ///< the least of W - |slope| delta
};

Sampled sample(const LatticeGeometry& lattice, const Kernel& kernel, int grid, double delta) {
    const double radius = lattice.radius;
    const double width = kernel.falloff / (radius * radius);
    const double gain = kernel.gain();
    const double edge = kernel.edge();
    std::vector<RowSums> rows;
    for (const double shift : lattice.shifts) {
        rows.emplace_back(width, radius, shift, grid);
    }
    Sampled result{0.0, 1e300};
    std::vector<double> weight(static_cast<std::size_t>(grid) + 1);
    std::vector<Vec3> moment(weight.size());
    // The cube's symmetries leave the points with 1/2 >= x >= y >= z >= 0.
    for (int c = 0; c <= grid; ++c) {
        for (int b = c; b <= grid; ++b) {
            std::fill(weight.begin(), weight.end(), 0.0);
            std::fill(moment.begin(), moment.end(), Vec3(0.0));
            for (const RowSums& row : rows) {
                for (int k = -row.reach(); k <= row.reach() + 1; ++k) {
                    for (int j = -row.reach(); j <= row.reach() + 1; ++j) {
                        const double dy = 0.5 * b / grid - row.position(j);
                        const double dz = 0.5 * c / grid - row.position(k);
                        const double square = radius * radius - dy * dy - dz * dz;
                        if (square <= 0.0) {
                            continue;
                        }
                        const double half_chord = std::sqrt(square);
                        const double g = std::exp(-width * (dy * dy + dz * dz));
                        for (int a = b; a <= grid; ++a) {
                            const RowSums::Part part = row.within(a, 0.5 * a / grid, half_chord);
                            const auto at = static_cast<std::size_t>(a);
                            weight[at] += gain * (g * part.gaussians - edge * part.count);
                            moment[at] += g * Vec3(part.moment, dy * part.gaussians, dz * part.gaussians);
                        }
                    }
                }
            }
            for (auto at = static_cast<std::size_t>(b); at < weight.size(); ++at) {
                const double slope = 2.0 * width * gain * glm::length(moment[at]);
                result.largest = std::max(result.largest, weight[at]);
                result.least_continued = std::min(result.least_continued, weight[at] - slope * delta);
            }
        }
    }
    return result;
}

} // namespace

Ripple lattice_ripple(const RegularField& field) {
    const LatticeGeometry lattice = geometry_of(field);
    const Kernel& kernel = field.kernel();
    const double constant = field.lattice_constant();
    if (lattice.radius <= 0.5 * lattice.nearest) {
        return {0.0, 1.0 / constant};
    }
    const double everywhere = gaussian_bound(lattice, kernel);
    if (lattice.radius > widest_sampled) {
        return {0.0, everywhere / constant};
    }
    const double curvature = 2.0 * kernel.falloff / (lattice.radius * lattice.radius);
    const double overlap = 4.0 / 3.0 * pi * std::pow(lattice.radius + lattice.covering_radius, 3) / lattice.cell_volume;
    const double cut = overlap * kernel.gain() * kernel.edge();
    const double steps = std::sqrt(0.75 * curvature * (1.0 + cut / constant) / (8.0 * wanted_margin));
    const auto grid = static_cast<int>(std::clamp(std::ceil(steps), 1.0 * coarsest_grid, 1.0 * finest_grid));
    const double delta = std::sqrt(0.75) * 0.5 / grid;
    const Sampled sampled = sample(lattice, kernel, grid, delta);

    const double bend = 0.5 * curvature * delta * delta;
    double largest = everywhere;
    if (bend < 0.5) {
        largest = std::min(largest, (sampled.largest + bend * cut) / (1.0 - bend));
    }
    const double least = sampled.least_continued - bend * (largest + 2.0 * cut);
    return {std::clamp(least / constant, 0.0, 1.0), largest / constant};
}

double largest_filtered_sum(const RegularField& field) {
    return gaussian_bound(geometry_of(field), field.kernel()) / field.lattice_constant();
}

} // namespace sheetsplat

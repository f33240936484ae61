// A field at points: sums over the kernels that reach them, and places around ellipsoids that none reaches.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// What the kernels of a field add up to at a point. Source: conventions, section 2.
struct FieldSums {
    double values = 0.0, weights = 0.0;         ///< D and W
    Vec3 values_slope{0.0}, weights_slope{0.0}; ///< their derivatives along the world's axes
    std::int64_t nearest = -1;                  ///< number of the kernel with the nearest centre; -1: none reaches
    double nearest_squared = std::numeric_limits<double>::infinity(); ///< distance of that centre, squared
};

/// The sums of a field at each point (world), the same with any number of threads; 0 threads: all that the process may
/// use. Time: that of the kernels and points that meet, and of a look at each ellipsoid.
std::vector<FieldSums> field_sums(const Field& field, const std::vector<Vec3>& points, int threads = 0);

/// Places for kernels of value 0 around a field ([NM06] section 4.1), and the kernel whose shape each takes.
struct GhostPoints {
    std::vector<std::size_t> owners;
    std::vector<Vec3> centers;
};

/// Ghost points around each kernel with a weight, `distance` >= 1 of its own semi-axes from its centre, along its axes
/// and the diagonals between them: the places that no support reaches and from which the kernel's shape reaches no
/// centre. Of those closer together than half the smallest semi-axis, and of kernels of about one size, the first is
/// kept. OutOfMemory for more than `most` candidates.
GhostPoints ghost_points(const EllipsoidField& field, double distance, std::size_t most);

} // namespace sheetsplat

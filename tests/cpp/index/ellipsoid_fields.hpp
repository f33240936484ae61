// Scattered kernels to try the index on, and the field that they make as conventions, section 2 writes it.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "index/brute_force.hpp"
#include "index/spatial_grid.hpp"
#include "support/draws.hpp"

namespace sheetsplat::test {

inline double normal(Random& random) {
    double sum = 0.0;
    for (int n = 0; n < 12; ++n) {
        sum += random.uniform(-0.5, 0.5);
    }
    return sum;
}

inline glm::dquat random_rotation(Random& random) {
    for (;;) {
        const glm::dquat q(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
        const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
        if (length > 0.1 && length < 1.0) {
            return {q.w / length, q.x / length, q.y / length, q.z / length};
        }
    }
}

enum class Scatter {
    even,     ///< spheres in a cube, some 20 over each place
    turned,   ///< ellipsoids of aspects up to 1:20 in a cube
    sizes,    ///< sizes from 1e-8 to 1e3, half of them in a cluster of their own size
    clusters, ///< each decade of size in a cluster a tenth as wide
    one_spot, ///< one centre, sizes from 1e-8 to 1e3
    copies,   ///< one kernel, many times
    far_off,  ///< near (1e9, -1e9, 1e9), with one kernel at the origin
    aligned,  ///< on a lattice of powers of two, as large as cells are
    flat,     ///< in a plane
};
inline constexpr Scatter all_scatters[] = {Scatter::even,     Scatter::turned,   Scatter::sizes,
                                           Scatter::clusters, Scatter::one_spot, Scatter::copies,
                                           Scatter::far_off,  Scatter::aligned,  Scatter::flat};
inline const char* name_of(Scatter scatter) {
    static const char* const names[] = {"Even",   "Turned", "Sizes",   "Clusters", "OneSpot",
                                        "Copies", "FarOff", "Aligned", "Flat"};
    return names[static_cast<int>(scatter)];
}

/// Values lie in [-1, 1], and are smooth functions of the place.
inline EllipsoidArrays scattered(Random& random, Scatter scatter, std::size_t n) {
    EllipsoidArrays arrays;
    const double even_radius = std::cbrt(20.0 / (4.2 * static_cast<double>(n)));
    for (std::size_t i = 0; i < n; ++i) {
        const double decades = random.uniform(-8.0, 3.0);
        Vec3 centre = 0.5 * random.in_cube();
        double radius = even_radius;
        switch (scatter) {
        case Scatter::even:
            break;
        case Scatter::turned: {
            const double aspect = std::pow(20.0, random.uniform(0.0, 1.0));
            const double least = even_radius / std::cbrt(aspect);
            arrays.scales.emplace_back(least, least * random.uniform(1.0, aspect), least * aspect);
            arrays.rotations.push_back(random_rotation(random));
            break;
        }
        case Scatter::sizes:
            radius = std::pow(10.0, decades);
            centre *= random.chance(0.5) ? 1e3 : 5.0 * radius;
            break;
        case Scatter::clusters: {
            const double scale = std::pow(10.0, -static_cast<double>(random.whole(0, 9)));
            radius = 0.05 * scale;
            centre = scale * test::three([&] { return normal(random); });
            break;
        }
        case Scatter::one_spot:
            radius = std::pow(10.0, decades);
            centre = Vec3(1.0, 2.0, 3.0);
            break;
        case Scatter::copies:
            radius = 0.25;
            centre = Vec3(-7.0, 0.1, 1e-3);
            break;
        case Scatter::far_off:
            centre = i == 0 ? Vec3(0.0) : centre + Vec3(1e9, -1e9, 1e9);
            break;
        case Scatter::aligned:
            radius = std::ldexp(1.0, -static_cast<int>(random.whole(1, 5)));
            centre = glm::floor(16.0 * centre) / 16.0;
            break;
        case Scatter::flat:
            centre.z = 0.5;
            break;
        }
        arrays.centers.push_back(centre);
        if (scatter != Scatter::turned) {
            arrays.radii.push_back(radius);
        }
        const Vec3 phase = 4.0 * (centre - glm::floor(centre));
        arrays.values.push_back(std::sin(phase.x) * std::cos(phase.y + phase.z));
    }
    return arrays;
}

inline EllipsoidField scattered_field(unsigned seed, Scatter scatter, std::size_t n) {
    Random random(seed);
    return EllipsoidField(scattered(random, scatter, n));
}

inline Box box_of(const EllipsoidField& field, std::size_t kernel, double wider = 0.0) {
    const Vec3 half = field.extent(kernel) + wider;
    return {field.center(kernel) - half, field.center(kernel) + half};
}

inline bool meet(const Box& a, const Box& b) {
    return glm::all(glm::lessThanEqual(a.lower, b.upper)) && glm::all(glm::lessThanEqual(b.lower, a.upper));
}

/// Sums at a point; drawn: null for all kernels.
inline Sums sums_at(const EllipsoidField& field, const Vec3& x, const Mask* drawn) {
    Sums sums;
    const double k = field.kernel().falloff, edge = std::exp(-k);
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Vec3 from_centre = x - field.center(i);
        const Vec3 half = field.extent(i);
        if ((drawn != nullptr && (*drawn)[i] == 0) || glm::any(glm::greaterThan(glm::abs(from_centre), half))) {
            continue;
        }
        const Vec3 q = glm::inverse(field.shape(i)) * from_centre;
        const double square = glm::dot(q, q);
        if (square < 1.0) {
            const double g = (std::exp(-k * square) - edge) / (1.0 - edge);
            sums.values += field.weight(i) * field.value(i) * g;
            sums.weights += field.weight(i) * g;
            sums.empty = false;
        }
    }
    return sums;
}

inline double rho_of(const EllipsoidField& field, const Sums& sums) {
    switch (field.normalization()) {
    case Normalization::none:
        return sums.values;
    case Normalization::lattice:
        return sums.values / field.lattice_constant();
    case Normalization::threshold:
        break;
    }
    return sums.values / std::max(field.w0(), sums.weights);
}

} // namespace sheetsplat::test

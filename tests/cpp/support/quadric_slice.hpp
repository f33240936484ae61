// Slicing an ellipsoid by its quadric: the analytic way that [NM06] section 3.2 (equations 2 to 6) sets out from,
// checks its own method with and leaves out. A test oracle: it inverts, multiplies out and takes roots where the
// renderers keep the factors, so it agrees with them only by being right. Carried in long double, because the errors
// grow with the aspect's fourth power: r^2 in a slice is good to 1e-8 for aspects up to 1:1000, and to a percent
// only at 1:1e5.
#pragma once

#include <array>
#include <cmath>

#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <glm/matrix.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

namespace sheetsplat::test {

/// The ellipse in which a plane z = const cuts an ellipsoid.
struct ConicSlice {
    bool exists = false;
    glm::dvec2 centre{0.0};                ///< x, y
    std::array<glm::dvec2, 2> semi_axes{}; ///< perpendicular vectors, the longer one first
    glm::dvec2 extent{0.0};                ///< half the extents along x and y
    double least_r_squared = 1.0;          ///< r^2 at the centre: the least of the whole plane, also where it misses
};

class Quadric {
  public:
    /// The ellipsoid { centre + m q : |q| <= 1 }; the columns of m are its semi-axes as vectors (M = R S).
    Quadric(const glm::dvec3& centre, const glm::dmat3& m) {
        Real4 affine(1.0L);
        for (int column = 0; column < 3; ++column) {
            affine[column] = {m[column].x, m[column].y, m[column].z, 0.0L};
        }
        affine[3] = {centre.x, centre.y, centre.z, 1.0L};
        // Equation 5: Q = (M^-1)^T I' M^-1, I' the unit sphere.
        Real4 sphere(1.0L);
        sphere[3][3] = -1.0L;
        const Real4 inverse = glm::inverse(affine);
        q_ = glm::transpose(inverse) * sphere * inverse;
    }

    /// r^2 of a point: 1 on the ellipsoid, 0 in its centre.
    [[nodiscard]] double r_squared(const glm::dvec3& point) const {
        const Vector4 x(point.x, point.y, point.z, 1.0L);
        return static_cast<double>(1.0L + glm::dot(x, q_ * x));
    }

    [[nodiscard]] ConicSlice slice(double z) const {
        // x = P (x, y, 1) is a point of the plane; P^T Q P is the conic's 3 x 3 matrix:
        // a x^2 + 2 b x y + c y^2 + 2 d x + 2 e y + f = 0.
        const Real a = q_[0][0], b = q_[0][1], c = q_[1][1];
        const Real d = q_[0][2] * z + q_[0][3], e = q_[1][2] * z + q_[1][3];
        const Real f = q_[2][2] * z * z + 2.0L * q_[2][3] * z + q_[3][3];
        // The gradient is 0 in the centre.
        const Real determinant = a * c - b * b;
        const Real x = (b * e - c * d) / determinant, y = (b * d - a * e) / determinant;
        const Real level = d * x + e * y + f;
        ConicSlice result;
        result.centre = {static_cast<double>(x), static_cast<double>(y)};
        result.least_r_squared = static_cast<double>(1.0L + level);
        result.exists = level < 0.0L;
        if (!result.exists) {
            return result;
        }
        // a (dx)^2 + 2 b dx dy + c (dy)^2 = -level: the axes are the eigenvectors, the smaller eigenvalue's the longer.
        const Real middle = 0.5L * (a + c), half = std::hypot(0.5L * (a - c), b);
        const Real larger = middle + half, smaller = determinant / larger;
        const Real angle = 0.5L * std::atan2(2.0L * b, a - c); // of the larger eigenvalue's
        const Real longer = std::sqrt(-level / smaller), shorter = std::sqrt(-level / larger);
        result.semi_axes[0] = {static_cast<double>(-longer * std::sin(angle)),
                               static_cast<double>(longer * std::cos(angle))};
        result.semi_axes[1] = {static_cast<double>(shorter * std::cos(angle)),
                               static_cast<double>(shorter * std::sin(angle))};
        result.extent = {static_cast<double>(std::sqrt(-level * c / determinant)),
                         static_cast<double>(std::sqrt(-level * a / determinant))};
        return result;
    }

  private:
    using Real = long double;
    using Real4 = glm::mat<4, 4, Real, glm::defaultp>;
    using Vector4 = glm::vec<4, Real, glm::defaultp>;
    Real4 q_{1.0L};
};

} // namespace sheetsplat::test

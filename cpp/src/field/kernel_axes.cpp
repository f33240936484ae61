#include "kernel_axes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

namespace sheetsplat {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr int most_sweeps = 60;
/// Semi-axes that differ by less are equal: steps in decimal digits, turned, are not exact.
constexpr double round_sphere = 1e-12;

/// Turns two columns in their plane until they are at right angles; false where they are.
bool turn(Vec3& a, Vec3& b) {
    const double aa = glm::dot(a, a), bb = glm::dot(b, b), ab = glm::dot(a, b);
    if (!(std::abs(ab) > epsilon * std::sqrt(aa) * std::sqrt(bb))) {
        return false;
    }
    const double zeta = (bb - aa) / (2.0 * ab);
    const double tangent = std::copysign(1.0, zeta) / (std::abs(zeta) + std::hypot(1.0, zeta));
    const double cosine = 1.0 / std::hypot(1.0, tangent), sine = cosine * tangent;
    const Vec3 old = a;
    a = cosine * old - sine * b;
    b = sine * old + cosine * b;
    return true;
}

} // namespace

KernelAxes axes_of(const Mat3& shape) {
    double unit = 0.0;
    for (int column = 0; column < 3; ++column) {
        for (int row = 0; row < 3; ++row) {
            unit = std::max(unit, std::abs(shape[column][row]));
        }
    }
    Mat3 turned = shape / unit;
    bool any = true;
    for (int sweep = 0; sweep < most_sweeps && any; ++sweep) {
        any = turn(turned[0], turned[1]);
        any = turn(turned[0], turned[2]) || any;
        any = turn(turned[1], turned[2]) || any;
    }
    KernelAxes axes;
    for (int column = 0; column < 3; ++column) {
        const double length = glm::length(turned[column]);
        axes.lengths[column] = unit * length;
        axes.directions[column] = turned[column] / length;
    }
    if (axes.longest() - axes.least() <= round_sphere * axes.longest()) {
        return {Mat3(1.0), Vec3(axes.lengths.x)};
    }
    if (glm::determinant(axes.directions) < 0.0) {
        axes.directions[2] = -axes.directions[2];
    }
    return axes;
}

} // namespace sheetsplat

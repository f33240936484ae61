#include "reference/kernels.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace sheetsplat::reference {

namespace {

constexpr double root_pi = 1.7724538509055160273;
// Below this length, in units of the Gaussian's width, the difference of two erf has lost too many digits.
constexpr double thin = 0.1;

struct Node {
    double place, weight; // on [-1, 1]
};
// Five points: exact to rounding for exp(-x^2) over a length of `thin`.
constexpr Node gauss_legendre_5[] = {{-0.90617984593866399, 0.23692688505618909},
                                     {-0.53846931010568309, 0.47862867049936647},
                                     {0.0, 0.56888888888888889},
                                     {0.53846931010568309, 0.47862867049936647},
                                     {0.90617984593866399, 0.23692688505618909}};

} // namespace

Profile::Profile(double falloff)
    : falloff_(falloff), root_falloff_(std::sqrt(falloff)), edge_(std::exp(-falloff)),
      gain_(-1.0 / std::expm1(-falloff)) {}

double Profile::integral(double b_squared, double from, double to) const {
    const double length = to - from;
    if (root_falloff_ * length < thin) {
        double sum = 0.0;
        for (const Node& node : gauss_legendre_5) {
            const double u = from + 0.5 * length * (1.0 + node.place);
            sum += node.weight * at(b_squared + u * u);
        }
        return std::max(0.0, 0.5 * length * sum);
    }
    const double gaussian = std::exp(-falloff_ * b_squared) * 0.5 * root_pi / root_falloff_ *
                            (std::erf(root_falloff_ * to) - std::erf(root_falloff_ * from));
    return std::max(0.0, (gaussian - edge_ * length) * gain_);
}

KernelShape::KernelShape(const RegularField& field, const Camera& camera, double radius_factor)
    : eye_(camera.eye()), right_(camera.right_world()), up_(camera.up_world()), backward_(camera.back_world()),
      profile_(field.kernel().falloff) {
    // M = S: the supports' axes are the world's. M^-1 of an eye-space difference turns it into the world first.
    const Vec3 semi_axes = field.semi_axes_world() * radius_factor;
    to_unit_ = Mat3(right_ / semi_axes, up_ / semi_axes, backward_ / semi_axes);
    reach_ = Vec3(glm::length(semi_axes * right_), glm::length(semi_axes * up_), glm::length(semi_axes * backward_));
}

Vec3 KernelShape::centre_eye(const Vec3& position_world) const {
    const Vec3 from_eye = position_world - eye_;
    return {glm::dot(from_eye, right_), glm::dot(from_eye, up_), glm::dot(from_eye, backward_)};
}

Chord KernelShape::mean(const Vec3& beside, double slope_x, double slope_y, double front, double back) const {
    const Vec3 per_depth = to_unit(Vec3(slope_x, slope_y, -1.0));
    const double speed = glm::length(per_depth);
    const Vec3 along = per_depth / speed;
    const Vec3 q = to_unit(beside);
    const double start = glm::dot(q, along);
    // The foot of the perpendicular, not |q|^2 - start^2: that would lose b where the ray is oblique.
    const Vec3 foot = q - start * along;
    const double b_squared = glm::dot(foot, foot);
    if (b_squared >= 1.0) {
        return {};
    }
    const double half_chord = std::sqrt(1.0 - b_squared);
    const double from = std::max(-half_chord, start + front * speed);
    const double to = std::min(half_chord, start + back * speed);
    if (from >= to) {
        return {};
    }
    return {true, profile_.integral(b_squared, from, to) / (speed * (back - front))};
}

} // namespace sheetsplat::reference

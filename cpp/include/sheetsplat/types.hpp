// Small value types that every public header shares.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include <glm/common.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace sheetsplat {

using Vec3 = glm::dvec3; ///< Three float64 numbers: a point, a direction or a colour.
using Vec2 = glm::dvec2; ///< Two float64 numbers.
using Mat3 = glm::dmat3; ///< Three columns of Vec3.

/// Size of a picture in pixels.
struct Size {
    int width = 0;
    int height = 0;
};

/// An axis-aligned box; empty (lower > upper) until a point is added.
struct Box {
    Vec3 lower{1.0, 1.0, 1.0};
    Vec3 upper{-1.0, -1.0, -1.0};

    [[nodiscard]] bool empty() const { return lower.x > upper.x; }
    [[nodiscard]] Vec3 centre() const { return lower + 0.5 * (upper - lower); }
    [[nodiscard]] Vec3 extent() const { return empty() ? Vec3(0.0) : upper - lower; }
    friend bool operator==(const Box& a, const Box& b) { return a.lower == b.lower && a.upper == b.upper; }
    friend bool operator!=(const Box& a, const Box& b) { return !(a == b); }
};

/// The points x with box.lower <= to_box x <= box.upper: a box along the world's axes, unless `to_box` is another
/// matrix than the identity.
struct Parallelepiped {
    Box box{};
    Mat3 to_box{1.0};

    Parallelepiped() = default;
    Parallelepiped(const Box& along_the_world) : box(along_the_world) {} // NOLINT(google-explicit-constructor)
    Parallelepiped(const Box& inside, const Mat3& matrix) : box(inside), to_box(matrix) {}

    [[nodiscard]] bool upright() const { return to_box == Mat3(1.0); }
    /// With the points of all faces.
    [[nodiscard]] bool holds(const Vec3& world) const {
        const Vec3 at = to_box * world;
        return glm::clamp(at, box.lower, box.upper) == at;
    }
    friend bool operator==(const Parallelepiped& a, const Parallelepiped& b) {
        return a.box == b.box && a.to_box == b.to_box;
    }
    friend bool operator!=(const Parallelepiped& a, const Parallelepiped& b) { return !(a == b); }
};

/// Called now and then with the share that is done, 0 to 1. Returning false stops the work (Cancelled).
using Progress = std::function<bool(double)>;

} // namespace sheetsplat

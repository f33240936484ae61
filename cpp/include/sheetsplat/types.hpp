// Small value types that every public header shares.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

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

/// Called now and then with the share that is done, 0 to 1. Returning false stops the work (Cancelled).
using Progress = std::function<bool(double)>;

} // namespace sheetsplat

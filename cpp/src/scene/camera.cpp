#include "sheetsplat/camera.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/unusable.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

constexpr double pi = 3.14159265358979323846;
/// Share of |eye - target| in front of which nothing is shown, unless given.
constexpr double default_near_share = 1e-3;
/// Sine of the angle between view and up below which up says nothing.
constexpr double parallel = 1e-9;

double largest_component(const Vec3& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// Unit vector; v must not be 0. Scaled first, since squares overflow or vanish long before the vector does.
Vec3 unit(const Vec3& v) { return glm::normalize(v / largest_component(v)); }

constexpr const char* owner = "Camera";

struct Axes {
    Vec3 right, up, back;
};

Axes axes_of(const Vec3& back, const Vec3& up, const Vec3& up_given) {
    const Vec3 across = glm::cross(up, back);
    if (!(glm::length(across) > parallel)) {
        throw InvalidInput(Complaint{unusable(owner, "up"),
                                     "up " + text_of(up_given) + " along the view direction " + text_of(-back),
                                     "a direction that is not along the view", "give another up"});
    }
    Vec3 right = glm::normalize(across);
    // Where up is nearly along the view the cross product has few digits left; a second step makes it orthogonal.
    right = glm::normalize(right - glm::dot(right, back) * back);
    return {right, glm::normalize(glm::cross(back, right)), back};
}

void require_finite(const Vec3& v, const char* name) {
    if (!is_finite(v)) {
        throw InvalidInput(Complaint{unusable(owner, name), text_of(v), "three finite numbers"});
    }
}

void require_up(const Vec3& up) {
    require_finite(up, "up");
    if (largest_component(up) == 0.0) {
        throw InvalidInput(Complaint{unusable(owner, "up"), text_of(up), "a direction", "give for example (0, 1, 0)"});
    }
}

Axes look_at(const Vec3& eye, const Vec3& target, const Vec3& up) {
    require_finite(eye, "eye");
    require_finite(target, "target");
    require_up(up);
    const Vec3 back = eye - target;
    if (largest_component(back) == 0.0) {
        throw InvalidInput(Complaint{"Camera: there is no view direction", "eye and target both at " + text_of(eye),
                                     "two different points", "move the eye away from the target"});
    }
    if (!is_finite(back)) {
        throw InvalidInput(Complaint{"Camera: there is no view direction",
                                     "eye " + text_of(eye) + " and target " + text_of(target),
                                     "two points whose distance is a finite number", "choose another unit of length"});
    }
    return axes_of(unit(back), unit(up), up);
}

void require_height(double height) {
    if (!(height > 0.0) || !is_finite(height)) {
        throw InvalidInput(
            Complaint{unusable(owner, "height"), text_of(height), "a finite number of world units above 0"});
    }
}

double half_tangent(double fov_y) { return std::tan(0.5 * fov_y * pi / 180.0); }

void require_fov(double fov_y) {
    if (!(fov_y > 0.0 && fov_y < 180.0) || !std::isnormal(half_tangent(fov_y))) {
        throw InvalidInput(
            Complaint{unusable(owner, "fov_y"), text_of(fov_y), "an angle in degrees above 0 and below 180"});
    }
}

void require_near(double near) {
    if (!(near > 0.0) || !is_finite(near)) {
        throw InvalidInput(Complaint{unusable(owner, "near"), text_of(near), "a finite depth above 0"});
    }
}

void require_shift(const Vec2& shift) {
    if (!std::isfinite(shift.x) || !std::isfinite(shift.y)) {
        throw InvalidInput(Complaint{unusable(owner, "shift"), text_of(shift.x) + ", " + text_of(shift.y),
                                     "two finite numbers of heights of the picture, right and up"});
    }
}

} // namespace

Camera Camera::orthographic(const Vec3& eye, const Vec3& target, const Vec3& up, double height) {
    const Axes axes = look_at(eye, target, up);
    require_height(height);
    Camera camera;
    camera.projection_ = Projection::orthographic;
    camera.eye_ = eye;
    camera.target_ = target;
    camera.up_ = up;
    camera.right_ = axes.right;
    camera.true_up_ = axes.up;
    camera.back_ = axes.back;
    camera.height_ = height;
    return camera;
}

Camera Camera::perspective(const Vec3& eye, const Vec3& target, const Vec3& up, double fov_y,
                           std::optional<double> near, const Vec2& shift) {
    const Axes axes = look_at(eye, target, up);
    require_fov(fov_y);
    const double scale = largest_component(eye - target);
    const double depth = near.value_or(default_near_share * (scale * glm::length((eye - target) / scale)));
    require_near(depth);
    require_shift(shift);
    Camera camera;
    camera.projection_ = Projection::perspective;
    camera.eye_ = eye;
    camera.target_ = target;
    camera.up_ = up;
    camera.right_ = axes.right;
    camera.true_up_ = axes.up;
    camera.back_ = axes.back;
    camera.fov_y_ = fov_y;
    camera.near_ = depth;
    camera.shift_ = shift;
    return camera;
}

Camera Camera::fit(const Box& box_world, const Vec3& direction, const Vec3& up, Projection projection, double margin,
                   double fov_y) {
    const Vec3 extent = box_world.upper - box_world.lower;
    if (!is_finite(box_world.lower) || !is_finite(box_world.upper) || !is_finite(extent) ||
        std::min({extent.x, extent.y, extent.z}) < 0.0) {
        throw InvalidInput(Complaint{"Camera.fit: there is nothing to look at",
                                     "a box from " + text_of(box_world.lower) + " to " + text_of(box_world.upper),
                                     "a box with at least one point and finite numbers",
                                     "check that the field has samples that are not NaN"});
    }
    require_finite(direction, "direction");
    if (largest_component(direction) == 0.0) {
        throw InvalidInput(
            Complaint{unusable(owner, "direction"), text_of(direction), "a direction other than (0, 0, 0)"});
    }
    require_up(up);
    if (!(margin > 0.0) || !is_finite(margin)) {
        throw InvalidInput(Complaint{unusable(owner, "margin"), text_of(margin), "a finite number above 0",
                                     "1.05 leaves a small border"});
    }
    // The axes come from the direction as it was given: the difference of eye and target has lost digits where the box
    // is far from 0.
    const Axes axes = axes_of(unit(-direction), unit(up), up);
    const double longest = largest_component(extent);
    const double diagonal = longest > 0.0 ? longest * glm::length(extent / longest) : 0.0;
    const Vec3 centre = box_world.centre();
    // Nearer to the target than that, the eye would fall on the same float64 numbers.
    const double least = std::max(1e-12 * largest_component(centre), std::numeric_limits<double>::min() * 1e6);

    Camera camera;
    camera.projection_ = projection;
    camera.target_ = centre;
    camera.up_ = up;
    camera.right_ = axes.right;
    camera.true_up_ = axes.up;
    camera.back_ = axes.back;
    double distance = 0.0;
    if (projection == Projection::orthographic) {
        const double across = glm::dot(glm::abs(axes.right), extent);
        const double upward = glm::dot(glm::abs(axes.up), extent);
        const double seen = std::max(across, upward);
        camera.height_ = seen > 0.0 ? margin * seen : 1.0;
        require_height(camera.height_);
        distance = diagonal > 0.0 ? diagonal : 1.0;
    } else {
        require_fov(fov_y);
        camera.fov_y_ = fov_y;
        const double radius = diagonal > 0.0 ? 0.5 * diagonal : 0.5;
        distance = margin * radius / std::sin(0.5 * fov_y * pi / 180.0);
    }
    distance = std::max(distance, least);
    camera.eye_ = centre + distance * axes.back;
    require_finite(camera.eye_, "eye");
    if (projection == Projection::perspective) {
        camera.near_ = default_near_share * distance;
        require_near(camera.near_);
    }
    return camera;
}

Vec3 Camera::to_eye(const Vec3& point_world) const { return direction_to_eye(point_world - eye_); }

Vec3 Camera::direction_to_eye(const Vec3& direction_world) const {
    return {glm::dot(right_, direction_world), glm::dot(true_up_, direction_world), glm::dot(back_, direction_world)};
}

double Camera::half_height() const {
    return projection_ == Projection::perspective ? half_tangent(fov_y_) : 0.5 * height_;
}

} // namespace sheetsplat

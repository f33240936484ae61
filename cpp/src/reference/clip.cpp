#include "reference/clip.hpp"

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

namespace sheetsplat::reference {

namespace {

// Share of a slice distance.
constexpr double on_a_plane = 1e-6;

} // namespace

Clipping::Clipping(const Clip& clip, const Camera& camera, double slice_distance) : spacing_(slice_distance) {
    for (const Clip::Plane& plane : clip.half_spaces()) {
        // Normals may be so long or short that their squares do not fit.
        const double length = std::hypot(plane.normal.x, plane.normal.y, plane.normal.z);
        const Vec3 normal = plane.normal / length;
        const Vec3 in_eye(glm::dot(normal, camera.right_world()), glm::dot(normal, camera.up_world()),
                          glm::dot(normal, camera.back_world()));
        const double least = plane.offset / length - glm::dot(normal, camera.eye());
        half_spaces_.push_back({in_eye, least - on_a_plane * slice_distance, {}});
        if (plane.center) {
            half_spaces_.back().center = camera.to_eye(*plane.center);
        }
    }
}

bool Clipping::keeps(const Vec3& point_eye) const {
    for (const HalfSpace& half_space : half_spaces_) {
        if (!(glm::dot(half_space.normal, point_eye) >= half_space.least)) {
            return false;
        }
    }
    return true;
}

CutFace Clipping::entered(const Vec3& start, const Vec3& along, CutFace before) const {
    constexpr double at_one_place = 1e-3;
    for (const HalfSpace& half_space : half_spaces_) {
        const double rises = glm::dot(half_space.normal, along);
        if (!(rises > 0.0)) {
            continue;
        }
        const double depth = (half_space.least - glm::dot(half_space.normal, start)) / rises;
        if (depth > before.depth + at_one_place * spacing_) {
            const Vec3 outward =
                half_space.center ? glm::normalize(start + depth * along - *half_space.center) : -half_space.normal;
            before = {depth, outward};
        }
    }
    return before;
}

Cell::Cell(const Scene& scene, const Camera& camera)
    : lower_(-std::numeric_limits<double>::infinity()), upper_(std::numeric_limits<double>::infinity()) {
    if (scene.part) {
        const Parallelepiped& cell = scene.part->cell;
        to_box_ = cell.to_box * Mat3(camera.right_world(), camera.up_world(), camera.back_world());
        lower_ = cell.box.lower - cell.to_box * camera.eye();
        upper_ = cell.box.upper - cell.to_box * camera.eye();
    }
}

bool Cell::holds(const Vec3& point_eye) const {
    const Vec3 place = to_box_ * point_eye;
    for (int axis = 0; axis < 3; ++axis) {
        if (!(place[axis] >= lower_[axis] && place[axis] < upper_[axis])) {
            return false;
        }
    }
    return true;
}

} // namespace sheetsplat::reference

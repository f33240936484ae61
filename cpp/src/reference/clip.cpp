#include "reference/clip.hpp"

#include <cmath>

#include <glm/geometric.hpp>

namespace sheetsplat::reference {

namespace {

// Share of a slice distance.
constexpr double on_a_plane = 1e-6;

} // namespace

Clipping::Clipping(const Scene& scene, const Camera& camera) {
    for (const Clip::Plane& plane : scene.clip.half_spaces()) {
        // Normals may be so long or short that their squares do not fit.
        const double length = std::hypot(plane.normal.x, plane.normal.y, plane.normal.z);
        const Vec3 normal = plane.normal / length;
        const Vec3 in_eye(glm::dot(normal, camera.right_world()), glm::dot(normal, camera.up_world()),
                          glm::dot(normal, camera.back_world()));
        const double least = plane.offset / length - glm::dot(normal, camera.eye());
        half_spaces_.push_back({in_eye, least - on_a_plane * scene.slice_distance()});
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

} // namespace sheetsplat::reference

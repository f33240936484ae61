#include "view/half_spaces.hpp"

#include <algorithm>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace sheetsplat {

namespace {

constexpr double on_a_plane = 1e-6;

} // namespace

std::vector<KeptHalfSpace> half_spaces_in_eye(const Clip& clip, const Camera& camera, double slice_spacing) {
    std::vector<KeptHalfSpace> kept;
    for (const Clip::Plane& plane : clip.half_spaces()) {
        // Scaled first: the length of a normal may be beyond float64's squares.
        const Vec3 size = glm::abs(plane.normal);
        const double largest = std::max({size.x, size.y, size.z});
        const Vec3 scaled = plane.normal / largest;
        const double length = glm::length(scaled);
        const Vec3 normal = scaled / length;
        kept.push_back({Vec3(glm::dot(normal, camera.right_world()), glm::dot(normal, camera.up_world()),
                             glm::dot(normal, camera.back_world())),
                        glm::dot(normal, camera.eye()) - plane.offset / largest / length + on_a_plane * slice_spacing,
                        {}});
        if (plane.center) {
            kept.back().center = camera.to_eye(*plane.center);
        }
    }
    return kept;
}

} // namespace sheetsplat

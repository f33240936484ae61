#include "reference/surroundings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "reference/classify.hpp"

namespace sheetsplat::reference {

Surroundings::Surroundings(const Scene& scene, const Camera& camera, const Screen& screen, const Clipping& clipping,
                           double radius_factor)
    : scene_(scene), clipping_(clipping), spacing_(scene.slice_distance()),
      lengths_(scene.slice_distance() / scene.reference_distance()) {
    for (const auto& field : scene.fields) {
        fields_.emplace_back(*field, scene, camera, screen, radius_factor);
        const Box& box = fields_.back().supports_eye();
        if (!box.empty()) {
            supports_eye_ = supports_eye_.empty() ? box
                                                  : Box{glm::min(supports_eye_.lower, box.lower),
                                                        glm::max(supports_eye_.upper, box.upper)};
        }
    }
    if (scene.ambient_occlusion) {
        // A radius of whole slice distances may come out a little short.
        occlusion_steps_ = std::max(1.0, std::floor(scene.ambient_occlusion->radius / spacing_ + 1e-6));
    }
    std::size_t next = 0;
    for (int x = -1; x <= 1; ++x) {
        for (int y = -1; y <= 1; ++y) {
            for (int z = -1; z <= 1; ++z) {
                const int parts = std::abs(x) + std::abs(y) + std::abs(z);
                if (parts == 1 || parts == 3) {
                    const Vec3 world = glm::normalize(Vec3(x, y, z));
                    around_[next++] = Vec3(glm::dot(world, camera.right_world()), glm::dot(world, camera.up_world()),
                                           glm::dot(world, camera.back_world()));
                }
            }
        }
    }
}

double Surroundings::steps_to_end(const Vec3& point_eye, const Vec3& direction) const {
    if (supports_eye_.empty()) {
        return 0.0;
    }
    double end = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] != 0.0) {
            const double side = direction[axis] > 0.0 ? supports_eye_.upper[axis] : supports_eye_.lower[axis];
            end = std::min(end, (side - point_eye[axis]) / direction[axis]);
        }
    }
    // One more for rounding: points outside are empty.
    return std::floor(end / spacing_) + 1.0;
}

double Surroundings::left_along(const Vec3& point_eye, const Vec3& direction, double steps, double rho_shift) const {
    const double last = std::min(steps, steps_to_end(point_eye, direction));
    double left = 1.0;
    for (double step = 1.0; step <= last && left > 0.0; step += 1.0) {
        const Vec3 point = point_eye + step * spacing_ * direction;
        double rho = 0.0;
        bool empty = true;
        for (const PointSums& field : fields_) {
            const PointSums::Value value = field.at(point);
            rho += value.rho;
            empty = empty && value.empty;
        }
        if (!empty && clipping_.keeps(point)) {
            left *= 1.0 - opacity_over(look_up(scene_.transfer_function, rho + rho_shift).opacity, lengths_);
        }
    }
    return left;
}

double Surroundings::light(const Vec3& point_eye, const Vec3& to_light, double rho_shift) const {
    return left_along(point_eye, to_light, std::numeric_limits<double>::infinity(), rho_shift);
}

double Surroundings::ambient(const Vec3& point_eye, double rho_shift) const {
    double sum = 0.0;
    for (const Vec3& direction : around_) {
        sum += left_along(point_eye, direction, occlusion_steps_, rho_shift);
    }
    const double open = sum / static_cast<double>(around_.size());
    return 1.0 - scene_.ambient_occlusion->strength * (1.0 - open);
}

} // namespace sheetsplat::reference

#include "reference/shade.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <glm/geometric.hpp>

namespace sheetsplat::reference {

static std::vector<double> weakest_differences(const CountedScene& counted) {
    std::vector<double> weakest;
    for (const Group& group : counted.scene().groups()) {
        weakest.push_back(counted.weakest_difference(group));
    }
    return weakest;
}

Shader::Shader(const CountedScene& counted, const Camera& camera)
    : Shader(counted.scene(), camera, weakest_differences(counted)) {}

Shader::Shader(const Scene& scene, const Camera& camera, std::vector<double> weakest_differences)
    : material_(scene.material), weakest_gradients_(std::move(weakest_differences)), shadows_(scene.shadows),
      occlusion_(scene.ambient_occlusion.has_value()) {
    for (const Light& light : scene.lights) {
        Vec3 direction = light.direction;
        if (light.space == LightSpace::world) {
            direction =
                Vec3(glm::dot(light.direction, camera.right_world()), glm::dot(light.direction, camera.up_world()),
                     glm::dot(light.direction, camera.back_world()));
        }
        lights_.push_back({glm::normalize(direction), light.color});
    }
}

Vec3 Shader::normal(const Vec3& gradient, std::size_t group) const {
    const double length = std::hypot(gradient.x, gradient.y, gradient.z);
    if (length == 0.0) {
        return Vec3(0.0);
    }
    return -gradient / std::max(length, weakest_gradients_[group]);
}

Vec3 Shader::added_by(std::size_t light, const Vec3& color, const Vec3& outward, const Vec3& to_viewer) const {
    const auto& [direction, bright] = lights_[light];
    double facing = glm::dot(outward, direction);
    Vec3 turned = outward;
    if (material_.two_sided && facing < 0.0) {
        facing = -facing;
        turned = -turned;
    }
    if (facing <= 0.0) {
        return Vec3(0.0);
    }
    const Vec3 reflected = 2.0 * facing * turned - direction;
    const double highlight = std::pow(std::max(0.0, glm::dot(reflected, to_viewer)), material_.shininess);
    return bright * facing * (color * material_.diffuse + Vec3(material_.specular * highlight));
}

Vec3 Shader::shade(const Vec3& color, const Vec3& gradient, const Lighting& lighting) const {
    const double open = occlusion_ ? lighting.surroundings->ambient(lighting.point, lighting.nudge) : 1.0;
    if (!lit()) {
        return color * open;
    }
    const Vec3 outward = (1.0 - lighting.on_face) * normal(gradient, lighting.group) + lighting.on_face * lighting.face;
    Vec3 shaded = color * (material_.ambient * open);
    for (std::size_t light = 0; light < lights_.size(); ++light) {
        const Vec3 added = added_by(light, color, outward, lighting.to_viewer);
        if (added != Vec3(0.0)) {
            shaded += shadows_ ? lighting.surroundings->light(lighting.point, direction(light), lighting.nudge) * added
                               : added;
        }
    }
    return shaded;
}

} // namespace sheetsplat::reference

#include "reference/shade.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace sheetsplat::reference {

Vec3 gradient_eye(const Screen& screen, const Sheet& before, const Sheet& here, const Sheet& after, double depth,
                  double spacing, double length, int column, int row) {
    const auto rho = [&](const Sheet& sheet, int i, int j) { return sheet.rho[sheet.index(i, j)]; };
    // Rows count downwards, y upwards.
    const double over_columns = rho(here, column + 1, row) - rho(here, column - 1, row);
    const double over_rows = rho(here, column, row - 1) - rho(here, column, row + 1);
    const double over_depth = (rho(after, column, row) - rho(before, column, row)) / (2.0 * spacing / length);
    // Where a sheet is blank its plane may be at or behind the eye, where pixels have no width.
    const double two_pixels = 2.0 * screen.pixel_width(depth) / length;
    const double dx = over_columns != 0.0 ? over_columns / two_pixels : 0.0;
    const double dy = over_rows != 0.0 ? over_rows / two_pixels : 0.0;
    return {dx, dy, screen.slope_x(column) * dx + screen.slope_y(row) * dy - over_depth};
}

Shader::Shader(const CountedScene& counted, const Camera& camera)
    : material_(counted.scene().material), shadows_(counted.scene().shadows),
      occlusion_(counted.scene().ambient_occlusion.has_value()) {
    const Scene& scene = counted.scene();
    for (const Group& group : scene.groups()) {
        weakest_gradients_.push_back(counted.weakest_difference(group));
    }
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

Vec3 Shader::shade(const Vec3& color, const Vec3& gradient, const Lighting& lighting) const {
    const double open = occlusion_ ? lighting.surroundings->ambient(lighting.point, lighting.nudge) : 1.0;
    if (!lit()) {
        return color * open;
    }
    const Vec3 outward = normal(gradient, lighting.group);
    Vec3 shaded = color * (material_.ambient * open);
    for (const DirectedLight& light : lights_) {
        double facing = glm::dot(outward, light.direction);
        Vec3 turned = outward;
        if (material_.two_sided && facing < 0.0) {
            facing = -facing;
            turned = -turned;
        }
        if (facing <= 0.0) {
            continue;
        }
        const Vec3 reflected = 2.0 * facing * turned - light.direction;
        const double highlight = std::pow(std::max(0.0, glm::dot(reflected, lighting.to_viewer)), material_.shininess);
        const double reaches =
            shadows_ ? lighting.surroundings->light(lighting.point, light.direction, lighting.nudge) : 1.0;
        shaded += reaches * light.color * facing * (color * material_.diffuse + Vec3(material_.specular * highlight));
    }
    return shaded;
}

} // namespace sheetsplat::reference

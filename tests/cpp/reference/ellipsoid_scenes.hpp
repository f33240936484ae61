// The scene and cameras that tests of scattered ellipsoids share.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "reference/support.hpp"

namespace sheetsplat::reference::testing {

constexpr Size size{24, 18};

inline Scene full_scene(std::shared_ptr<const Field> field) {
    Scene scene = make_scene(std::move(field));
    scene.lights = two_lights();
    scene.material = {0.2, 0.7, 0.4, 12.0, true};
    scene.slice_spacing = 0.5;
    scene.reference_length = 0.9;
    return scene;
}

inline Camera camera_of(bool perspective, const Vec3& target = Vec3(0.0), double scale = 1.0) {
    const Vec3 eye = target + scale * Vec3(4.0, 3.0, 8.0), up(0.125, 1.0, 0.0);
    return perspective ? Camera::perspective(eye, target, up, 45.0, 0.5 * scale)
                       : Camera::orthographic(eye, target, up, 7.0 * scale);
}

inline EllipsoidFieldOptions thresholded(double w0 = 0.6) {
    EllipsoidFieldOptions options;
    options.normalization = Normalization::threshold;
    options.w0 = w0;
    return options;
}

/// Integral of m g along each pixel's whole ray, from the ray in the kernel's unit-sphere space (by a general inverse).
inline std::vector<double> line_integrals(const EllipsoidField& field, const Camera& camera, double falloff) {
    std::vector<double> integrals;
    for (int j = 0; j < size.height; ++j) {
        for (int i = 0; i < size.width; ++i) {
            const double x = (2.0 * (i + 0.5) / size.width - 1.0) * size.width / size.height,
                         y = 1.0 - 2.0 * (j + 0.5) / size.height;
            const double h = camera.half_height();
            const Vec3 aside = h * (x * camera.right_world() + y * camera.up_world());
            const bool perspective = camera.projection() == Projection::perspective;
            const Vec3 ray = glm::normalize((perspective ? aside : Vec3(0.0)) - camera.back_world());
            const Vec3 start = camera.eye() + (perspective ? Vec3(0.0) : aside);
            double sum = 0.0;
            for (std::size_t n = 0; n < field.size(); ++n) {
                const Mat3 inverse = glm::inverse(field.shape(n));
                const Vec3 q = inverse * (start - field.center(n)), v = inverse * ray;
                const double b = glm::length(glm::cross(q, v)) / glm::length(v);
                sum += field.weight(n) * field.value(n) * chord_integral(b, falloff) / glm::length(v);
            }
            integrals.push_back(sum);
        }
    }
    return integrals;
}

} // namespace sheetsplat::reference::testing

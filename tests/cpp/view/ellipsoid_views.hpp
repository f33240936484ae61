// Ellipsoids and views of them, for tests of sections, records and places.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat2x2.hpp>
#include <glm/matrix.hpp>

#include "index/ellipsoid_fields.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat {

using test::Random;

constexpr double pi = 3.14159265358979323846;
/// No kernel is so slender that it is placed in float64.
constexpr double never = std::numeric_limits<double>::infinity();

inline Mat3 turned(const glm::dquat& rotation, const Vec3& axes) {
    const Mat3 r = glm::mat3_cast(rotation);
    return Mat3(r[0] * axes.x, r[1] * axes.y, r[2] * axes.z);
}

inline EyeKernel sliced(const Vec3& center, const Mat3& b) {
    const Mat3 rows = glm::transpose(b);
    return slice_kernel(center, rows[0], rows[1], rows[2]);
}

/// |M^-1 x| by the factors, which keeps the digits of needles.
inline double unit_radius(const glm::dquat& rotation, const Vec3& axes, const Vec3& from_center) {
    return glm::length(glm::transpose(glm::mat3_cast(rotation)) * from_center / axes);
}

/// A A^T of the section at s = 0, A = [B u, B v].
inline glm::dmat2 conic(const EyeKernel& kernel) {
    return glm::outerProduct(kernel.axis_u, kernel.axis_u) + glm::outerProduct(kernel.axis_v, kernel.axis_v);
}

inline double largest_entry(const glm::dmat2& m) {
    return std::max({std::abs(m[0][0]), std::abs(m[0][1]), std::abs(m[1][0]), std::abs(m[1][1])});
}

/// Semi-axes from `least` to aspect times that, the longest one in any place.
inline Vec3 random_axes(Random& random, double least, double aspect) {
    Vec3 axes(least, least * random.uniform(1.0, aspect), least * aspect);
    const int turn = static_cast<int>(random.whole(0, 2));
    return {axes[turn], axes[(turn + 1) % 3], axes[(turn + 2) % 3]};
}

inline std::shared_ptr<const EllipsoidField> field_of(EllipsoidArrays arrays, EllipsoidFieldOptions options = {}) {
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

/// Ellipsoids of aspects up to `aspect` in a cube of edge 2 around `middle`; aspect 1: spheres.
inline std::shared_ptr<const EllipsoidField> random_field(unsigned seed, std::size_t n, double aspect,
                                                          double least = 0.02, const Vec3& middle = Vec3(0.0)) {
    Random random(seed);
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        arrays.centers.push_back(middle + random.in_cube());
        if (aspect == 1.0) {
            arrays.radii.push_back(least * random.uniform(1.0, 20.0));
        } else {
            arrays.scales.push_back(random_axes(random, least, std::pow(aspect, random.uniform(0.0, 1.0))));
            arrays.rotations.push_back(test::random_rotation(random));
        }
        arrays.values.push_back(random.uniform(-1.0, 1.0));
        arrays.weights.push_back(random.chance(0.1) ? 0.0 : random.uniform(0.1, 3.0));
    }
    return field_of(std::move(arrays));
}

/// A field, a camera, and what the slicer makes of them.
struct Look {
    std::shared_ptr<const EllipsoidField> field;
    Camera camera;
    Frame frame;
    Sampling sampling;
    EllipsoidView view;

    Look(std::shared_ptr<const EllipsoidField> kernels, const Camera& from, Size size, double spacing,
         Sampling how = Sampling::point, Filter filter = Filter::none, double value_unit = 1.0)
        : field(std::move(kernels)), camera(from), frame(frame_of(*this, size, spacing, filter)), sampling(how),
          view(*field, camera, frame, sampling, filter, value_unit, 1.0) {}
    Look(const Look&) = delete;
    Look& operator=(const Look&) = delete;

    [[nodiscard]] glm::dquat rotation(std::size_t i) const {
        return field->arrays().rotations.empty() ? glm::dquat(1.0, 0.0, 0.0, 0.0) : field->arrays().rotations[i];
    }
    [[nodiscard]] Vec3 world(const Vec3& eye) const {
        return camera.eye() + eye.x * camera.right_world() + eye.y * camera.up_world() + eye.z * camera.back_world();
    }
    /// B: columns are the semi-axes in eye space.
    [[nodiscard]] Mat3 in_eye(std::size_t i) const {
        return glm::transpose(Mat3(camera.right_world(), camera.up_world(), camera.back_world())) * field->shape(i);
    }

  private:
    static Frame frame_of(const Look& look, Size size, double spacing, Filter filter) {
        Scene scene{{look.field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
        scene.slice_spacing = spacing;
        scene.filter = filter;
        return make_frame(scene, look.camera, size);
    }
};

inline Camera orthographic(double height = 2.5, const Vec3& target = Vec3(0.0)) {
    return Camera::orthographic(target + Vec3(3.0, 1.4, 2.2), target, Vec3(0.1, 1.0, 0.2), height);
}

inline Camera perspective(double distance = 1.0, double near = 1e-3, double fov = 50.0) {
    return Camera::perspective(distance * Vec3(3.0, 1.4, 2.2), Vec3(0.1, 0.0, -0.1), Vec3(0.1, 1.0, 0.2), fov, near);
}

inline Mat3 squared(const EyeKernel& kernel) {
    const glm::dmat2 across = conic(kernel) + glm::outerProduct(kernel.lean, kernel.lean);
    const glm::dvec2 aside = kernel.half_depth * kernel.lean;
    return Mat3(Vec3(across[0], aside.x), Vec3(across[1], aside.y), Vec3(aside, kernel.half_depth * kernel.half_depth));
}

} // namespace sheetsplat

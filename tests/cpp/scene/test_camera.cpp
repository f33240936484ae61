#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
const Vec3 y_up{0.0, 1.0, 0.0};

void expect_near(const Vec3& a, const Vec3& b, double tolerance) {
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(a[axis], b[axis], tolerance) << "component " << axis;
    }
}

void expect_right_handed(const Camera& camera) {
    const Vec3 &x = camera.right_world(), &y = camera.up_world(), &z = camera.back_world();
    for (const Vec3& v : {x, y, z}) {
        EXPECT_NEAR(glm::length(v), 1.0, 4e-16);
    }
    EXPECT_NEAR(glm::dot(x, y), 0.0, 4e-16);
    EXPECT_NEAR(glm::dot(y, z), 0.0, 4e-16);
    EXPECT_NEAR(glm::dot(z, x), 0.0, 4e-16);
    expect_near(glm::cross(x, y), z, 4e-16);
}

TEST(Camera, looks_along_minus_z) {
    const Camera camera = Camera::orthographic({0.0, 0.0, 5.0}, {0.0, 0.0, 0.0}, y_up, 4.0);
    EXPECT_EQ(camera.projection(), Projection::orthographic);
    expect_near(camera.right_world(), {1.0, 0.0, 0.0}, 0.0);
    expect_near(camera.up_world(), {0.0, 1.0, 0.0}, 0.0);
    expect_near(camera.back_world(), {0.0, 0.0, 1.0}, 0.0);
    expect_near(camera.to_eye({1.0, 2.0, 3.0}), {1.0, 2.0, -2.0}, 0.0);
    EXPECT_EQ(camera.height(), 4.0);
    EXPECT_EQ(camera.half_height(), 2.0);
}

TEST(Camera, up_need_not_be_straight_nor_of_unit_length) {
    const Camera camera = Camera::orthographic({7.0, 1.0, -2.0}, {3.0, 4.0, 5.0}, {0.3, 9.0, -1.0}, 1.0);
    expect_right_handed(camera);
    EXPECT_EQ(camera.up(), Vec3(0.3, 9.0, -1.0));
    EXPECT_GT(glm::dot(camera.up_world(), camera.up()), 0.0);
    EXPECT_NEAR(glm::dot(camera.right_world(), camera.up()), 0.0, 1e-14);
    expect_near(camera.to_eye(camera.target()), {0.0, 0.0, -glm::length(camera.eye() - camera.target())}, 1e-14);
    expect_near(camera.to_eye(camera.eye()), Vec3(0.0), 0.0);
    expect_near(camera.direction_to_eye(camera.right_world()), {1.0, 0.0, 0.0}, 1e-15);
}

TEST(Camera, axes_are_orthogonal_even_where_up_is_nearly_along_the_view) {
    for (const double tilt : {1e-2, 1e-4, 1e-6, 1e-8}) {
        expect_right_handed(
            Camera::orthographic({0.3, 0.1, 0.9}, Vec3(0.0), Vec3(0.3, 0.1, 0.9) + tilt * Vec3(0.2, 1.0, 0.5), 1.0));
    }
}

TEST(Camera, large_coordinates_keep_their_detail) {
    const Vec3 far{1e9, -1e9, 1e9};
    const Camera camera = Camera::orthographic(far + Vec3(0.0, 0.0, 5.0), far, y_up, 1.0);
    expect_near(camera.back_world(), {0.0, 0.0, 1.0}, 0.0);
    // 2^-10 is a step that float64 holds at 1e9.
    expect_near(camera.to_eye(far + Vec3(0.0009765625, 0.0, 0.0)), {0.0009765625, 0.0, -5.0}, 0.0);
    expect_right_handed(Camera::orthographic({1e200, 2e200, 3e200}, {-1e200, 0.0, 0.0}, {0.0, 1e-200, 0.0}, 1.0));
    expect_right_handed(Camera::perspective({1e-200, 2e-200, 3e-200}, Vec3(0.0), {0.0, 1e200, 0.0}, 30.0));
}

TEST(Camera, perspective) {
    const Camera camera = Camera::perspective({3.0, 4.0, 0.0}, Vec3(0.0), {0.0, 0.0, 1.0}, 60.0);
    EXPECT_EQ(camera.projection(), Projection::perspective);
    EXPECT_DOUBLE_EQ(camera.half_height(), 1.0 / std::sqrt(3.0));
    EXPECT_DOUBLE_EQ(camera.near(), 5e-3);
    EXPECT_EQ(camera.fov_y(), 60.0);
    EXPECT_EQ(Camera::perspective({3.0, 4.0, 0.0}, Vec3(0.0), {0.0, 0.0, 1.0}, 60.0, 0.25).near(), 0.25);
    expect_right_handed(camera);
}

TEST(Camera, shift_is_kept_and_finite) {
    const Vec3 eye(0.0, 0.0, 5.0), target(0.0), up(0.0, 1.0, 0.0);
    EXPECT_EQ(Camera::perspective(eye, target, up, 30.0).shift(), Vec2(0.0));
    EXPECT_EQ(Camera::perspective(eye, target, up, 30.0, 0.1, Vec2(0.5, -3.0)).shift(), Vec2(0.5, -3.0));
    EXPECT_THROW(Camera::perspective(eye, target, up, 30.0, 0.1, Vec2(nan, 0.0)), InvalidInput);
    EXPECT_THROW(Camera::perspective(eye, target, up, 30.0, 0.1, Vec2(0.0, infinity)), InvalidInput);
}

TEST(Camera, refuses_what_has_no_meaning) {
    const Vec3 eye{1.0, 2.0, 3.0};
    const auto orthographic = [](const Vec3& from, const Vec3& to, const Vec3& up, double height) {
        return message_of<InvalidInput>([&] { Camera::orthographic(from, to, up, height); });
    };
    const auto perspective = [&eye](double fov, std::optional<double> near) {
        return message_of<InvalidInput>([&] { Camera::perspective(eye, Vec3(0.0), y_up, fov, near); });
    };
    expect_parts(orthographic(eye, eye, y_up, 1.0), {"no view direction", "eye and target both at (1, 2, 3)"});
    expect_parts(orthographic({0, 3, 0}, Vec3(0.0), y_up, 1.0), {"up (0, 1, 0) along the view", "give another up"});
    expect_parts(orthographic({0, -3, 0}, Vec3(0.0), y_up, 1.0), {"up (0, 1, 0) along the view"});
    expect_parts(orthographic(eye, Vec3(0.0), eye * (1.0 + 1e-15), 1.0), {"along the view"});
    expect_parts(orthographic(eye, Vec3(0.0), Vec3(0.0), 1.0), {"up cannot be used", "(0, 0, 0)"});
    expect_parts(orthographic({nan, 0, 0}, Vec3(0.0), y_up, 1.0), {"eye cannot be used", "(NaN, 0, 0)"});
    expect_parts(orthographic(eye, {0, infinity, 0}, y_up, 1.0), {"target cannot be used"});
    expect_parts(orthographic(eye, Vec3(0.0), {0, nan, 0}, 1.0), {"up cannot be used"});
    expect_parts(orthographic(Vec3(1.5e308), Vec3(-1.5e308), y_up, 1.0), {"no view direction", "unit of length"});
    for (const double height : {0.0, -1.0, nan, infinity}) {
        expect_parts(orthographic(eye, Vec3(0.0), y_up, height), {"height cannot be used"});
    }
    for (const double fov : {0.0, -30.0, 180.0, 400.0, nan, infinity, 1e-320}) {
        expect_parts(perspective(fov, std::nullopt), {"fov_y cannot be used", "below 180"});
    }
    for (const double near : {0.0, -1.0, nan, infinity}) {
        expect_parts(perspective(30.0, near), {"near cannot be used"});
    }
    EXPECT_NO_THROW(Camera::perspective(eye, Vec3(0.0), y_up, 179.9));
}

TEST(CameraFit, orthographic_shows_the_box_with_its_margin) {
    const Box box{{0.0, 0.0, 0.0}, {10.0, 4.0, 2.0}};
    const Camera front = Camera::fit(box, {0.0, 0.0, -1.0}, y_up);
    EXPECT_DOUBLE_EQ(front.height(), 10.5);
    EXPECT_EQ(front.target(), Vec3(5.0, 2.0, 1.0));
    expect_near(front.back_world(), {0.0, 0.0, 1.0}, 0.0);
    EXPECT_GT(front.eye().z, 2.0);
    const Camera side = Camera::fit(box, {3.0, 0.0, 0.0}, y_up, Projection::orthographic, 2.0);
    EXPECT_DOUBLE_EQ(side.height(), 8.0);
    EXPECT_LT(side.eye().x, 0.0);
    expect_near(side.back_world(), {-1.0, 0.0, 0.0}, 0.0);
}

/// The largest |x| or |y| of the box's corners in units of half a square picture; fails where a corner is not in front
/// of the eye.
double reach(const Camera& camera, const Box& box) {
    double result = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        const Vec3 p((corner & 1) != 0 ? box.upper.x : box.lower.x, (corner & 2) != 0 ? box.upper.y : box.lower.y,
                     (corner & 4) != 0 ? box.upper.z : box.lower.z);
        const Vec3 eye = camera.to_eye(p);
        const double depth = -eye.z;
        EXPECT_GT(depth, camera.near());
        const double half =
            camera.projection() == Projection::perspective ? depth * camera.half_height() : camera.half_height();
        result = std::max({result, std::abs(eye.x) / half, std::abs(eye.y) / half});
    }
    return result;
}

TEST(CameraFit, every_corner_is_seen_from_every_side) {
    const Box box{{-1.0, 2.0, 3.0}, {9.0, 4.0, 3.5}};
    for (int n = 0; n < 100; ++n) {
        const Vec3 direction{std::cos(0.7 * n), std::sin(1.3 * n), std::sin(0.9 * n + 0.2)};
        const Camera flat = Camera::fit(box, direction, y_up, Projection::orthographic, 1.25);
        expect_right_handed(flat);
        EXPECT_NEAR(reach(flat, box), 1.0 / 1.25, 1e-12) << n;
        for (const double fov : {1.0, 30.0, 90.0, 150.0}) {
            const Camera deep = Camera::fit(box, direction, y_up, Projection::perspective, 1.001, fov);
            EXPECT_EQ(deep.fov_y(), fov);
            EXPECT_DOUBLE_EQ(deep.near(), 1e-3 * glm::length(deep.eye() - deep.target()));
            EXPECT_LT(reach(deep, box), 1.0) << n << " fov " << fov;
        }
    }
}

TEST(CameraFit, perspective_distance_holds_the_bounding_sphere) {
    const Box box{Vec3(-1.0), Vec3(1.0)};
    const Camera camera = Camera::fit(box, {0.0, 0.0, -1.0}, y_up, Projection::perspective, 1.5, 60.0);
    EXPECT_DOUBLE_EQ(camera.eye().z, 1.5 * std::sqrt(3.0) / 0.5);
}

TEST(CameraFit, a_box_without_extent_still_gives_a_camera) {
    for (const double place : {0.0, 3.0, 1e9, 1e20}) {
        const Box point{Vec3(place), Vec3(place)};
        const Camera flat = Camera::fit(point, {0.0, 0.0, -1.0}, y_up);
        EXPECT_EQ(flat.height(), 1.0);
        EXPECT_NE(flat.eye(), flat.target());
        expect_right_handed(flat);
        const Camera deep = Camera::fit(point, {0.0, 0.0, -1.0}, y_up, Projection::perspective);
        EXPECT_GT(deep.near(), 0.0);
        EXPECT_NE(deep.eye(), deep.target());
    }
    // A line seen end on.
    EXPECT_EQ(Camera::fit({Vec3(0.0), {0.0, 0.0, 7.0}}, {0.0, 0.0, -1.0}, y_up).height(), 1.0);
    EXPECT_DOUBLE_EQ(Camera::fit({Vec3(0.0), {0.0, 0.0, 7.0}}, {1.0, 0.0, 0.0}, y_up).height(), 7.35);
}

TEST(CameraFit, far_from_the_origin_the_direction_is_the_one_given) {
    const Vec3 far{1e9, 1e9, -1e9};
    const Vec3 direction = glm::normalize(Vec3(1.0, -2.0, 0.5));
    const Camera camera = Camera::fit({far, far + Vec3(1.0, 1.0, 1.0)}, direction, y_up);
    expect_near(camera.back_world(), -direction, 1e-15);
}

TEST(CameraFit, refuses_what_has_no_meaning) {
    const Box box{Vec3(0.0), Vec3(1.0)};
    const auto refused = [](const Box& b, const Vec3& direction, const Vec3& up, double margin, double fov = 30.0) {
        return message_of<InvalidInput>([&] { Camera::fit(b, direction, up, Projection::perspective, margin, fov); });
    };
    expect_parts(refused({}, {0, 0, -1}, y_up, 1.0), {"nothing to look at", "at least one point"});
    expect_parts(refused({{0, 0, 0}, {1, -1, 1}}, {0, 0, -1}, y_up, 1.0), {"nothing to look at"});
    expect_parts(refused({{0, 0, 0}, {1, infinity, 1}}, {0, 0, -1}, y_up, 1.0), {"nothing to look at"});
    expect_parts(refused({{0, nan, 0}, {1, 1, 1}}, {0, 0, -1}, y_up, 1.0), {"nothing to look at"});
    expect_parts(refused(box, {0, 0, 0}, y_up, 1.0), {"direction cannot be used"});
    expect_parts(refused(box, {0, nan, 0}, y_up, 1.0), {"direction cannot be used"});
    expect_parts(refused(box, {0, 2, 0}, y_up, 1.0), {"up (0, 1, 0) along the view"});
    expect_parts(refused(box, {0, 0, -1}, Vec3(0.0), 1.0), {"up cannot be used"});
    for (const double margin : {0.0, -1.0, nan, infinity}) {
        expect_parts(refused(box, {0, 0, -1}, y_up, margin), {"margin cannot be used"});
    }
    expect_parts(refused(box, {0, 0, -1}, y_up, 1.0, 180.0), {"fov_y cannot be used"});
    expect_parts(refused({Vec3(0.0), Vec3(1e300)}, {0, 0, -1}, y_up, 1e10), {"eye cannot be used"});
}

} // namespace
} // namespace sheetsplat

// Cross-sections of ellipsoids, plain and filtered.
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "support/quadric_slice.hpp"
#include "view/ellipsoid_views.hpp"

namespace sheetsplat {
namespace {

TEST(SliceKernel, CutsTheQuadric) {
    Random random(1);
    double worst_control = 0.0;
    for (const double aspect : {1.0, 1.5, 8.0, 60.0, 1000.0}) {
        for (int n = 0; n < 60; ++n) {
            const Vec3 center = 3.0 * random.in_cube();
            const Mat3 b = turned(test::random_rotation(random), random_axes(random, 0.01, aspect));
            const EyeKernel kernel = sliced(center, b);
            const test::Quadric quadric(center, b);
            for (const double s : {-0.97, -0.4, 0.0, 0.3, 0.9}) {
                const test::ConicSlice oracle = quadric.slice(center.z + s * kernel.half_depth);
                ASSERT_TRUE(oracle.exists);
                const double radius = std::sqrt(1.0 - s * s);
                const double shorter = glm::length(oracle.semi_axes[1]);
                // The oracle's own errors grow with the aspect.
                const double tolerance = aspect > 100.0 ? 2e-6 : 1e-9;
                EXPECT_NEAR(radius * glm::length(kernel.axis_u) / glm::length(oracle.semi_axes[0]), 1.0, tolerance);
                EXPECT_NEAR(radius * glm::length(kernel.axis_v) / shorter, 1.0, tolerance);
                const glm::dmat2 theirs = glm::outerProduct(oracle.semi_axes[0], oracle.semi_axes[0]) +
                                          glm::outerProduct(oracle.semi_axes[1], oracle.semi_axes[1]);
                EXPECT_LE(largest_entry(radius * radius * conic(kernel) - theirs), tolerance * largest_entry(theirs));
                const glm::dvec2 at = glm::dvec2(center) + s * kernel.lean;
                EXPECT_LE(glm::length(at - oracle.centre), tolerance * glm::length(oracle.semi_axes[0]));
                worst_control = std::max(worst_control,
                                         glm::length(glm::dvec2(center) - s * kernel.lean - oracle.centre) / shorter);
            }
            EXPECT_FALSE(quadric.slice(center.z + 1.001 * kernel.half_depth).exists);
            EXPECT_FALSE(quadric.slice(center.z - 1.001 * kernel.half_depth).exists);
        }
    }
    EXPECT_GT(worst_control, 0.1) << "the other sign of the lean would pass as well";
}

TEST(SliceKernel, HasItsEdgeOnTheEllipsoid) {
    Random random(2);
    for (const double aspect : {1.0, 3.0, 100.0, 1e3, 1e5}) {
        for (int n = 0; n < 40; ++n) {
            const glm::dquat rotation = test::random_rotation(random);
            const Vec3 axes = random_axes(random, 1.0, aspect);
            const EyeKernel kernel = sliced(Vec3(0.0), turned(rotation, axes));
            const double tolerance = 4e-15 * aspect;
            for (const double s : {-0.9, -0.2, 0.0, 0.5, 0.99}) {
                for (double angle = 0.1; angle < 6.2; angle += 0.9) {
                    const glm::dvec2 xy = s * kernel.lean + std::sqrt(1.0 - s * s) * (std::cos(angle) * kernel.axis_u +
                                                                                      std::sin(angle) * kernel.axis_v);
                    EXPECT_NEAR(unit_radius(rotation, axes, Vec3(xy, s * kernel.half_depth)), 1.0, tolerance);
                    EXPECT_GT(std::abs(unit_radius(rotation, axes, Vec3(1.001 * xy, s * kernel.half_depth)) - 1.0),
                              tolerance);
                }
            }
            const double u = glm::length(kernel.axis_u), v = glm::length(kernel.axis_v);
            EXPECT_GE(u, v);
            EXPECT_LE(std::abs(glm::dot(kernel.axis_u, kernel.axis_v)), 1e-15 * u * (u + v));
            // Lengths of the rows, and the volume: area of the section times h.
            EXPECT_NEAR(u * v * kernel.half_depth / (axes.x * axes.y * axes.z), 1.0, tolerance);
        }
    }
}

TEST(SliceKernel, KeepsTheDigitsOfNeedlesAndDiscs) {
    for (const double aspect : {1.0 + 1e-9, 10.0, 1e3, 1e5}) {
        for (const double angle : {0.0, 1e-7, 1e-5, 1e-3, 0.3, 0.7853981633974483, 1.2, 1.5706, 0.5 * pi}) {
            for (const bool disc : {false, true}) {
                // Own x axis (cos, 0, sin), y axis (0, 1, 0): an ellipse in the plane y = 0, with closed forms.
                const double a = disc ? 1.0 : aspect, b = disc ? aspect : 1.0;
                const double across = disc ? aspect : 1.0;
                const double c = std::cos(angle), s = std::sin(angle);
                const Mat3 shape(Vec3(c, 0.0, s) * a, Vec3(0.0, across, 0.0), Vec3(-s, 0.0, c) * b);
                const EyeKernel kernel = sliced(Vec3(0.0), shape);
                const double h = std::hypot(a * s, b * c);
                const double along = a * b / h;
                const double tolerance = 1e-15 * aspect + 1e-14;
                EXPECT_NEAR(kernel.half_depth / h, 1.0, 1e-14);
                EXPECT_NEAR(glm::length(kernel.axis_u) / std::max(along, across), 1.0, tolerance);
                EXPECT_NEAR(glm::length(kernel.axis_v) / std::min(along, across), 1.0, tolerance);
                EXPECT_NEAR(kernel.lean.x, (a - b) * (a + b) * s * c / h, 1e-14 * std::max(a, b));
                EXPECT_NEAR(kernel.lean.y, 0.0, 1e-14 * std::max(a, b));
                EXPECT_NEAR(kernel.extent.x / std::hypot(a * c, b * s), 1.0, 1e-14);
                EXPECT_NEAR(kernel.extent.y / across, 1.0, 1e-14);
            }
        }
    }
}

TEST(EllipsoidView, KernelsAreSlicedWhereTheyStand) {
    for (const double aspect : {1.0, 50.0}) {
        for (const bool deep : {false, true}) {
            const Look look(random_field(3, 30, aspect), deep ? perspective() : orthographic(), {64, 48}, 0.05);
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                const EyeKernel kernel = look.view.kernel(i);
                const EyeKernel wanted = sliced(look.camera.to_eye(look.field->center(i)), look.in_eye(i));
                EXPECT_LE(glm::length(kernel.center - wanted.center), 1e-13);
                EXPECT_NEAR(kernel.half_depth, wanted.half_depth, 1e-13);
                EXPECT_LE(largest_entry(conic(kernel) - conic(wanted)), 1e-13);
                EXPECT_LE(glm::length(kernel.lean - wanted.lean), 1e-13);
                EXPECT_LE(glm::length(kernel.extent - wanted.extent), 1e-13);
                EXPECT_EQ(kernel.amplitude, 1.0);
                const EllipsoidView::Depths depths = look.view.depths(i);
                EXPECT_NEAR(depths.center, -kernel.center.z, 1e-13);
                EXPECT_NEAR(depths.half, kernel.half_depth, 1e-13);
                const Vec3 first = look.view.first_point_world(i);
                EXPECT_NEAR(unit_radius(look.rotation(i), look.field->semi_axes(i), first - look.field->center(i)), 1.0,
                            1e-12);
                EXPECT_NEAR(-look.camera.to_eye(first).z, depths.center - depths.half, 1e-12);
            }
        }
    }
}

// B B^T from its parts: rows' lengths, what the centre leans, and the section as the Schur complement.

TEST(EllipsoidView, FilterWidensByAPixelAndASliceDistance) {
    double most = 0.0;
    for (const double aspect : {1.0, 4.0, 100.0}) {
        for (const bool deep : {false, true}) {
            const double spacing = 0.07;
            const Look look(random_field(4, 40, aspect), deep ? perspective() : orthographic(), {40, 30}, spacing,
                            Sampling::point, Filter::ewa);
            EXPECT_TRUE(look.view.filtered());
            EXPECT_FALSE(look.view.spheres());
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                const EyeKernel kernel = look.view.kernel(i);
                // Of half a standard deviation each, as supports of falloff 8 have them.
                const double pixel = 2.0 * look.frame.pixel * (deep ? -kernel.center.z : 1.0);
                const Mat3 b = look.in_eye(i);
                const Mat3 old = b * glm::transpose(b);
                Mat3 wanted = old;
                wanted[0][0] += pixel * pixel;
                wanted[1][1] += pixel * pixel;
                wanted[2][2] += 4.0 * spacing * spacing;
                const Mat3 got = squared(kernel);
                const double scale = std::max({wanted[0][0], wanted[1][1], wanted[2][2]});
                for (int c = 0; c < 3; ++c) {
                    for (int r = 0; r < 3; ++r) {
                        EXPECT_NEAR(got[c][r], wanted[c][r], 1e-13 * scale) << c << r;
                    }
                }
                EXPECT_NEAR(kernel.extent.x, std::sqrt(wanted[0][0]), 1e-13);
                EXPECT_NEAR(kernel.extent.y, std::sqrt(wanted[1][1]), 1e-13);
                EXPECT_NEAR(look.view.depths(i).half, kernel.half_depth, 1e-13);
                const double less = std::sqrt(glm::determinant(old) / glm::determinant(wanted));
                EXPECT_NEAR(kernel.amplitude / less, 1.0, 1e-9);
                most = std::max(most, 1.0 - less);
            }
        }
    }
    EXPECT_GT(most, 0.5) << "no kernel was small enough to be changed";
}

TEST(EllipsoidView, FilterLeavesHugeKernelsAndKeepsTheMassOfTinyOnes) {
    EllipsoidArrays arrays;
    Random random(5);
    for (const Vec3 axes : {Vec3(1e-8), Vec3(1e-8, 2e-8, 3e-8), Vec3(1e-8, 1e-8, 1e-3), Vec3(1e6), Vec3(1e6, 2e6, 3e8),
                            Vec3(1e-8, 1e8, 1.0), Vec3(1e-99), Vec3(1e99)}) {
        arrays.centers.push_back(random.in_cube());
        arrays.scales.push_back(axes);
        arrays.rotations.push_back(test::random_rotation(random));
        arrays.values.push_back(1.0);
    }
    const auto field = field_of(std::move(arrays));
    const Camera camera = orthographic();
    // The slices of so wide a field would be too many: the frame is made by hand.
    Frame frame;
    frame.size = {64, 64};
    frame.axis_x = frame.axis_y = 32.0;
    frame.pixel = 0.04;
    frame.slice_spacing = 0.1;
    frame.slices = 10;
    frame.first_depth = -camera.to_eye(Vec3(0.0)).z - 0.5;
    const EllipsoidView view(*field, camera, frame, Sampling::point, Filter::ewa, 1.0, 1.0);
    for (std::size_t i = 0; i < field->size(); ++i) {
        const EyeKernel kernel = view.kernel(i);
        const SectionRecord record = view.record(i, kernel, 5);
        for (const double part : {kernel.half_depth, kernel.axis_u.x, kernel.axis_u.y, kernel.axis_v.x, kernel.axis_v.y,
                                  kernel.lean.x, kernel.lean.y, kernel.extent.x, kernel.amplitude}) {
            EXPECT_TRUE(std::isfinite(part)) << i;
        }
        if (i < 6) {
            for (const float part : {record.whole_x, record.part_x, record.s, record.step_s, record.value, record.ux,
                                     record.uy, record.vx, record.vy, record.step_x, record.step_y, record.weight}) {
                EXPECT_TRUE(std::isfinite(part)) << i;
            }
        }
        EXPECT_GE(glm::length(kernel.axis_v), 0.999 * 2.0 * std::min(frame.pixel, frame.slice_spacing));
        EXPECT_GE(kernel.half_depth, 2.0 * frame.slice_spacing);
    }
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
        const EyeKernel kernel = view.kernel(i);
        const Vec3 axes = field->semi_axes(i);
        EXPECT_NEAR(kernel.axis_u.x * kernel.axis_u.x + kernel.axis_v.x * kernel.axis_v.x, 4.0 * 0.0016, 1e-13);
        EXPECT_NEAR(kernel.half_depth, 0.2, 1e-13);
        // The mass that an integral over the plane and its slices sees is the old one's.
        EXPECT_NEAR(kernel.amplitude * 0.08 * 0.08 * 0.2 / (axes.x * axes.y * axes.z), 1.0, 1e-9);
    }
    for (const std::size_t i : {std::size_t{3}, std::size_t{4}}) {
        const EyeKernel kernel = view.kernel(i);
        const EyeKernel bare = sliced(
            kernel.center,
            Mat3(glm::transpose(Mat3(camera.right_world(), camera.up_world(), camera.back_world()))) * field->shape(i));
        EXPECT_NEAR(kernel.amplitude, 1.0, 1e-12);
        EXPECT_NEAR(kernel.half_depth / bare.half_depth, 1.0, 1e-12);
        EXPECT_LE(largest_entry(conic(kernel) - conic(bare)), 1e-11 * largest_entry(conic(bare)));
    }
    EXPECT_NEAR(view.kernel(6).amplitude * 0.08 * 0.08 * 0.2 / 1e-297, 1.0, 1e-9);
    EXPECT_NEAR(view.kernel(7).amplitude, 1.0, 1e-12);
}

/// The section that a record says in a slice, in pixels from the optical axis (perspective: its axes times depth), as
/// glsl/ellipsoid.frag reads it.

} // namespace
} // namespace sheetsplat

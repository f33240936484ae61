// Cross-sections of ellipsoids, what the GPU gets of them, and where they reach.
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat2x2.hpp>
#include <glm/matrix.hpp>
#include <gtest/gtest.h>

#include "index/ellipsoid_fields.hpp"
#include "support/quadric_slice.hpp"
#include "view/ellipsoid_survey.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat {
namespace {

using test::Random;

constexpr double pi = 3.14159265358979323846;
/// No kernel is so slender that it is placed in float64.
constexpr double never = std::numeric_limits<double>::infinity();

Mat3 turned(const glm::dquat& rotation, const Vec3& axes) {
    const Mat3 r = glm::mat3_cast(rotation);
    return Mat3(r[0] * axes.x, r[1] * axes.y, r[2] * axes.z);
}

EyeKernel sliced(const Vec3& center, const Mat3& b) {
    const Mat3 rows = glm::transpose(b);
    return slice_kernel(center, rows[0], rows[1], rows[2]);
}

/// |M^-1 x| by the factors, which keeps the digits of needles.
double unit_radius(const glm::dquat& rotation, const Vec3& axes, const Vec3& from_center) {
    return glm::length(glm::transpose(glm::mat3_cast(rotation)) * from_center / axes);
}

/// A A^T of the section at s = 0, A = [B u, B v].
glm::dmat2 conic(const EyeKernel& kernel) {
    return glm::outerProduct(kernel.axis_u, kernel.axis_u) + glm::outerProduct(kernel.axis_v, kernel.axis_v);
}

double largest_entry(const glm::dmat2& m) {
    return std::max({std::abs(m[0][0]), std::abs(m[0][1]), std::abs(m[1][0]), std::abs(m[1][1])});
}

/// Semi-axes from `least` to aspect times that, the longest one in any place.
Vec3 random_axes(Random& random, double least, double aspect) {
    Vec3 axes(least, least * random.uniform(1.0, aspect), least * aspect);
    const int turn = static_cast<int>(random.whole(0, 2));
    return {axes[turn], axes[(turn + 1) % 3], axes[(turn + 2) % 3]};
}

// ---- slice_kernel

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

// ---- views

std::shared_ptr<const EllipsoidField> field_of(EllipsoidArrays arrays, EllipsoidFieldOptions options = {}) {
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

/// Ellipsoids of aspects up to `aspect` in a cube of edge 2 around `middle`; aspect 1: spheres.
std::shared_ptr<const EllipsoidField> random_field(unsigned seed, std::size_t n, double aspect, double least = 0.02,
                                                   const Vec3& middle = Vec3(0.0)) {
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

Camera orthographic(double height = 2.5, const Vec3& target = Vec3(0.0)) {
    return Camera::orthographic(target + Vec3(3.0, 1.4, 2.2), target, Vec3(0.1, 1.0, 0.2), height);
}

Camera perspective(double distance = 1.0, double near = 1e-3, double fov = 50.0) {
    return Camera::perspective(distance * Vec3(3.0, 1.4, 2.2), Vec3(0.1, 0.0, -0.1), Vec3(0.1, 1.0, 0.2), fov, near);
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
Mat3 squared(const EyeKernel& kernel) {
    const glm::dmat2 across = conic(kernel) + glm::outerProduct(kernel.lean, kernel.lean);
    const glm::dvec2 aside = kernel.half_depth * kernel.lean;
    return Mat3(Vec3(across[0], aside.x), Vec3(across[1], aside.y), Vec3(aside, kernel.half_depth * kernel.half_depth));
}

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
                const double pixel = look.frame.pixel * (deep ? -kernel.center.z : 1.0);
                const Mat3 b = look.in_eye(i);
                const Mat3 old = b * glm::transpose(b);
                Mat3 wanted = old;
                wanted[0][0] += pixel * pixel;
                wanted[1][1] += pixel * pixel;
                wanted[2][2] += spacing * spacing;
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
        EXPECT_GE(glm::length(kernel.axis_v), 0.999 * std::min(frame.pixel, frame.slice_spacing));
        EXPECT_GE(kernel.half_depth, frame.slice_spacing);
    }
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
        const EyeKernel kernel = view.kernel(i);
        const Vec3 axes = field->semi_axes(i);
        EXPECT_NEAR(kernel.axis_u.x * kernel.axis_u.x + kernel.axis_v.x * kernel.axis_v.x, 0.0016, 1e-13);
        EXPECT_NEAR(kernel.half_depth, 0.1, 1e-13);
        // The mass that an integral over the plane and its slices sees is the old one's.
        EXPECT_NEAR(kernel.amplitude * 0.04 * 0.04 * 0.1 / (axes.x * axes.y * axes.z), 1.0, 1e-9);
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
    EXPECT_NEAR(view.kernel(6).amplitude * 0.04 * 0.04 * 0.1 / 1e-297, 1.0, 1e-9);
    EXPECT_NEAR(view.kernel(7).amplitude, 1.0, 1e-12);
}

/// The section that a record says in a slice, in pixels from the optical axis (perspective: its axes times depth), as
/// glsl/ellipsoid.frag reads it.
struct Decoded {
    glm::dvec2 center, u, v;
    double s;
};
Decoded decoded(const SectionRecord& record, const Frame& frame, std::int64_t slice) {
    const double since = static_cast<double>(slice) - static_cast<double>(record.first);
    glm::dvec2 moved = since * glm::dvec2(record.step_x, record.step_y);
    if (frame.projection == Projection::perspective) {
        moved /= frame.depth_of(slice);
    }
    Decoded section;
    section.center = glm::dvec2(record.whole_x, record.whole_y) + (glm::dvec2(record.part_x, record.part_y) + moved);
    section.u = glm::dvec2(record.ux, record.uy);
    section.v = glm::dvec2(record.vx, record.vy);
    section.s = static_cast<double>(record.s) - since * static_cast<double>(record.step_s);
    return section;
}

/// The same in float64, straight from the kernel.
Decoded exact(const EyeKernel& kernel, const Frame& frame, std::int64_t slice) {
    const double depth = frame.depth_of(slice);
    const double scale = frame.projection == Projection::perspective ? depth : 1.0;
    const auto screen = [&](const glm::dvec2& eye) { return glm::dvec2(eye.x, -eye.y) / frame.pixel; };
    Decoded section;
    section.s = (-kernel.center.z - depth) / kernel.half_depth;
    section.center = screen(glm::dvec2(kernel.center) + section.s * kernel.lean) / scale;
    section.u = screen(kernel.axis_u);
    section.v = screen(kernel.axis_v);
    return section;
}

/// Largest distance of a section's parts in the plane of the unit sphere: place, axes and height.
double distance(const Decoded& a, const Decoded& b, double scale) {
    const auto in_plane = [&](const glm::dvec2& px) {
        return std::hypot(glm::dot(px, b.u) / glm::dot(b.u, b.u), glm::dot(px, b.v) / glm::dot(b.v, b.v));
    };
    return std::max(
        {scale * in_plane(a.center - b.center), in_plane(a.u - b.u), in_plane(a.v - b.v), std::abs(a.s - b.s)});
}

struct Far {
    const char* name;
    bool deep;
    double height; ///< of the picture in world units, or per unit of depth
    double offset; ///< of the kernels from the optical axis, world units
};

class Records : public testing::TestWithParam<Far> {};

TEST_P(Records, HoldTheSectionsOfABatch) {
    const Far& far = GetParam();
    for (const double aspect : {1.0, 2.0, 50.0, 1000.0}) {
        Random random(6);
        const double spacing = 0.05;
        const Vec3 target(0.3, -0.2, 0.1);
        const Camera camera = far.deep ? Camera::perspective(target + Vec3(3.0, 1.4, 2.2), target, Vec3(0.1, 1.0, 0.2),
                                                             2.0 * std::atan(0.5 * far.height) * 180.0 / pi, 0.01)
                                       : orthographic(far.height, target);
        EllipsoidArrays arrays;
        for (int n = 0; n < 40; ++n) {
            arrays.centers.push_back(target + random.in_cube() +
                                     far.offset * (random.chance(0.5) ? camera.right_world() : camera.up_world()));
            arrays.scales.push_back(random_axes(random, 2.0 / aspect, aspect));
            arrays.rotations.push_back(test::random_rotation(random));
            arrays.values.push_back(random.uniform(-1.0, 1.0));
            arrays.weights.push_back(random.uniform(0.0, 2.0));
        }
        const Look look(field_of(std::move(arrays)), camera, {512, 512}, spacing, Sampling::point, Filter::none, 0.5);
        double worst = 0.0, farthest = 0.0, worst_edge = 0.0;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            const EyeKernel kernel = look.view.kernel(i);
            const EllipsoidView::Span span = look.view.span(look.view.depths(i));
            // Record by record for batches of eight slabs, and one for all.
            for (std::int64_t first = -4; first <= span.last; first = first < 0 ? span.first / 4 * 4 : first + 8) {
                const std::int64_t begin = std::max<std::int64_t>(first, 0);
                const std::int64_t last =
                    first < 0 ? look.frame.slices - 1 : std::min(first + 7, look.frame.slices - 1);
                const SectionRecord record = look.view.record(i, kernel, look.view.anchor(kernel, begin, last));
                EXPECT_GE(record.part_x, 0.0F);
                EXPECT_LE(record.part_x, 1.0F);
                EXPECT_EQ(record.whole_y, std::floor(record.whole_y));
                for (std::int64_t slice = std::max(begin, span.first); slice <= std::min(last, span.last); ++slice) {
                    const double scale = far.deep ? look.frame.depth_of(slice) : 1.0;
                    const Decoded got = decoded(record, look.frame, slice);
                    const Decoded wanted = exact(kernel, look.frame, slice);
                    worst = std::max(worst, distance(got, wanted, scale));
                    farthest = std::max(farthest, glm::length(wanted.center));
                    // And its edge lies on the ellipsoid itself.
                    const double radius = std::sqrt(std::max(0.0, 1.0 - got.s * got.s));
                    for (const double angle : {0.2, 1.7, 3.5, 5.1}) {
                        const glm::dvec2 px =
                            got.center * scale + radius * (std::cos(angle) * got.u + std::sin(angle) * got.v);
                        const Vec3 eye(px.x * look.frame.pixel, -px.y * look.frame.pixel, -look.frame.depth_of(slice));
                        const double r = unit_radius(look.rotation(i), look.field->semi_axes(i),
                                                     look.world(eye) - look.field->center(i));
                        worst_edge = std::max(worst_edge, std::abs(r - 1.0));
                    }
                }
                EXPECT_NEAR(static_cast<double>(record.value),
                            look.field->value(i) * look.field->weight(i) * look.view.value_scale(), 1e-6);
                EXPECT_NEAR(static_cast<double>(record.weight), look.field->weight(i) * look.view.weight_scale(), 1e-6);
            }
        }
        EXPECT_LE(worst, std::max(1e-7, 6e-8 * aspect)) << "more than float32's own steps";
        EXPECT_LE(worst_edge, std::max(1e-7, 2e-8 * aspect));
        EXPECT_GT(worst_edge, 1e-9) << "float32 cannot be so good: nothing was compared";
        if (far.offset > 0.0) {
            EXPECT_GT(farthest, 1e6);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Far, Records,
                         testing::Values(Far{"whole", false, 3.0, 0.0}, Far{"zoomed", false, 1e-3, 0.0},
                                         Far{"aside", false, 1e-3, 5.0}, Far{"perspective", true, 0.9, 0.0},
                                         Far{"perspective_zoomed", true, 3e-4, 0.0},
                                         Far{"perspective_aside", true, 3e-4, 3.0}),
                         [](const auto& one) { return std::string(one.param.name); });

TEST(EllipsoidView, RecordsHoldWhereTheEyeIsInsideTheKernel) {
    // The first slices may lie as close to the eye as the near plane allows, where places on the screen are huge.
    for (const double near : {1e-2, 1e-4, 1e-6}) {
        for (const double aspect : {1.0, 20.0}) {
            Random random(7);
            EllipsoidArrays arrays;
            const Camera camera = Camera::perspective(Vec3(0.0), Vec3(1.0, 2.0, -0.5), Vec3(0.0, 0.0, 1.0), 60.0, near);
            for (int n = 0; n < 200; ++n) {
                arrays.centers.push_back(4.0 * random.in_cube());
                arrays.scales.push_back(random_axes(random, 8.0 / aspect, aspect));
                arrays.rotations.push_back(test::random_rotation(random));
                arrays.values.push_back(1.0);
            }
            const Look look(field_of(std::move(arrays)), camera, {64, 64}, 0.125);
            double worst = 0.0, closest = 1.0;
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                const EyeKernel kernel = look.view.kernel(i);
                const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                Frame frame = look.frame;
                // Slices as they may happen to lie: the first one just behind the near plane.
                frame.first_depth = 1.01 * near;
                const EllipsoidView view(*look.field, camera, frame, Sampling::point, Filter::none, 1.0, 1.0);
                for (std::int64_t first = -4; first <= span.last; first = first < 0 ? span.first / 4 * 4 : first + 8) {
                    const std::int64_t begin = std::max<std::int64_t>(first, 0);
                    const std::int64_t last = first < 0 ? frame.slices - 1 : std::min(first + 7, frame.slices - 1);
                    const SectionRecord record = view.record(i, kernel, view.anchor(kernel, begin, last));
                    for (std::int64_t slice = std::max(begin, span.first); slice <= std::min(last, span.last);
                         ++slice) {
                        const double depth = frame.depth_of(slice);
                        closest = std::min(closest, depth);
                        worst = std::max(worst,
                                         distance(decoded(record, frame, slice), exact(kernel, frame, slice), depth));
                    }
                }
            }
            EXPECT_LE(worst, std::max(2e-7, 6e-8 * aspect));
            EXPECT_LT(closest, 1.1 * near);
        }
    }
}

// ---- which slices, which pixels

TEST(EllipsoidView, SpansAreTheSlicesThatMeetTheSupport) {
    std::size_t cut = 0, none = 0, checked = 0;
    for (const bool deep : {false, true}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            for (const double spacing : {0.031, 0.4}) {
                // In perspective the eye stands among the kernels.
                const Camera camera = deep ? Camera::perspective(Vec3(0.1, 0.2, -0.1), Vec3(1.0, 0.5, 0.7),
                                                                 Vec3(0.0, 1.0, 0.0), 70.0, 0.3)
                                           : orthographic();
                const Look look(random_field(8, 300, 20.0), camera, {32, 32}, spacing, sampling);
                EXPECT_EQ(look.frame.cut_by_near, deep);
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    // Depths of the support from the ellipsoid itself.
                    const double center = -look.camera.to_eye(look.field->center(i)).z;
                    const double h = glm::length(glm::transpose(look.field->shape(i)) * look.camera.back_world());
                    const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                    for (const int wider : {0, 1, 3}) {
                        const EllipsoidView::Span wide = look.view.span(look.view.depths(i), wider);
                        const double half = (sampling == Sampling::slab ? 0.5 * spacing : 0.0) + wider * spacing;
                        for (std::int64_t slice = 0; slice < look.frame.slices; ++slice) {
                            const double away = std::abs(look.frame.depth_of(slice) - center) - h - half;
                            const bool inside = wide.first <= slice && slice <= wide.last;
                            if (std::abs(away) > 1e-9) {
                                EXPECT_EQ(inside, away < 0.0) << "kernel " << i << " slice " << slice;
                                ++checked;
                            }
                        }
                    }
                    none += span.first > span.last ? 1 : 0;
                    cut += span.first <= span.last && center - h < look.frame.depth_of(0) - spacing ? 1 : 0;
                }
            }
        }
    }
    EXPECT_GT(cut, 50U) << "kernels that reach through the near plane";
    EXPECT_GT(none, 50U) << "kernels that no slice meets";
    EXPECT_GT(checked, 100000U);
}

// Points of a support, inside and on its edge.
std::vector<Vec3> points_of(const Look& look, std::size_t i, Random& random, int count) {
    std::vector<Vec3> points;
    const Mat3 m = look.field->shape(i);
    while (static_cast<int>(points.size()) < count) {
        const Vec3 q = 2.0 * random.in_cube() - (random.in_cube() - random.in_cube());
        const double length = glm::length(q);
        if (length > 1e-3) {
            points.push_back(look.field->center(i) +
                             m * (q / length * (random.chance(0.8) ? 1.0 : random.uniform(0.0, 1.0))));
        }
    }
    return points;
}

TEST(EllipsoidView, BoundsHoldAllPixelsOfTheSupport) {
    Random random(9);
    std::size_t seen = 0, unbounded = 0, clipped = 0;
    double largest_slack = 0.0;
    for (const bool deep : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            for (const double aspect : {1.0, 30.0}) {
                const double spacing = aspect == 1.0 ? 0.1 : 0.17;
                const Camera camera = deep ? Camera::perspective(Vec3(0.1, 0.2, -0.1), Vec3(1.0, 0.5, 0.7),
                                                                 Vec3(0.0, 1.0, 0.0), 70.0, 0.001)
                                           : orthographic(1.2);
                const Look look(random_field(10, 60, aspect), camera, {50, 36}, spacing, Sampling::slab, filter);
                const Tile tile{7, 5, 21, 19};
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                    if (span.first > span.last) {
                        continue;
                    }
                    const double front = look.view.front_of(span.first), back = look.view.back_of(span.last);
                    const EyeKernel kernel = look.view.kernel(i);
                    const EllipsoidView::ScreenBounds bounds = look.view.bounds(kernel, front, back);
                    const EllipsoidView::ScreenBounds same = look.view.support_bounds(i, front, back);
                    EXPECT_EQ(bounds.unbounded, same.unbounded);
                    for (const auto& [a, b] : {std::array<double, 2>{bounds.left, same.left},
                                               {bounds.right, same.right},
                                               {bounds.top, same.top},
                                               {bounds.bottom, same.bottom}}) {
                        EXPECT_NEAR(a, b, 1e-9 * (1.0 + std::abs(a)));
                    }
                    unbounded += bounds.unbounded ? 1 : 0;
                    const PixelBox box = EllipsoidView::pixels(bounds, look.frame, tile, 0);
                    const PixelBox wider = EllipsoidView::pixels(bounds, look.frame, tile, 3);
                    EXPECT_TRUE(wider.x0 <= box.x0 && wider.y0 <= box.y0 && wider.x1 >= box.x1 && wider.y1 >= box.y1);
                    EXPECT_TRUE(wider.x1 <= tile.target_width() && wider.y1 <= tile.target_height());
                    double left = 1e300, right = -1e300;
                    for (const Vec3& point : points_of(look, i, random, 200)) {
                        const Vec3 eye = look.camera.to_eye(point);
                        const double depth = -eye.z;
                        if (deep && (depth < front || depth > back || depth <= 1e-6)) {
                            continue;
                        }
                        const double scale = look.frame.pixel * (deep ? depth : 1.0);
                        const double x = eye.x / scale, y = -eye.y / scale;
                        left = std::min(left, x);
                        right = std::max(right, x);
                        const double slack = 1e-9 * (1.0 + std::abs(x) + std::abs(y));
                        const bool inside =
                            bounds.unbounded || (x >= bounds.left - slack && x <= bounds.right + slack &&
                                                 y >= bounds.top - slack && y <= bounds.bottom + slack);
                        EXPECT_TRUE(inside) << "kernel " << i << " at " << x << ", " << y;
                        // Target pixel of the tile.
                        const double tx = std::floor(x + 25.0 - tile.x + 1.0), ty = std::floor(y + 18.0 - tile.y + 1.0);
                        if (tx >= 0.0 && ty >= 0.0 && tx < tile.target_width() && ty < tile.target_height()) {
                            EXPECT_TRUE(tx >= box.x0 && tx < box.x1 && ty >= box.y0 && ty < box.y1)
                                << "kernel " << i << " at " << tx << ", " << ty;
                            ++seen;
                        } else {
                            ++clipped;
                        }
                    }
                    if (!deep && filter == Filter::none && aspect == 1.0) {
                        largest_slack = std::max({largest_slack, (left - bounds.left) / (right - left),
                                                  (bounds.right - right) / (right - left)});
                    }
                }
            }
        }
    }
    EXPECT_GT(seen, 2000U);
    EXPECT_GT(clipped, 2000U);
    EXPECT_GT(unbounded, 5U);
    EXPECT_LT(largest_slack, 0.1) << "bounds of spheres that are no bounds";
}

TEST(EllipsoidView, BoundsEndWhereTheSupportDoes) {
    // One ellipsoid with its axes along the eye's, in pixels of 0.1 and, in perspective, of 0.1 at depth 1.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(1.0, 0.5, -4.0)};
    arrays.scales = {Vec3(0.2, 0.3, 2.0)};
    arrays.values = {1.0};
    const auto field = field_of(std::move(arrays));
    const Look flat(field, Camera::orthographic(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0), 2.0), {40, 20},
                    0.5);
    const EllipsoidView::ScreenBounds whole = flat.view.support_bounds(0, 0.0, 10.0);
    EXPECT_FALSE(whole.unbounded);
    EXPECT_NEAR(whole.left, 8.0, 1e-12);
    EXPECT_NEAR(whole.right, 12.0, 1e-12);
    EXPECT_NEAR(whole.top, -8.0, 1e-12);
    EXPECT_NEAR(whole.bottom, -2.0, 1e-12);
    // Pixel 0 of the targets is the border's; the axis meets pixel corner 20, 10 of the picture.
    const PixelBox box = EllipsoidView::pixels(whole, flat.frame, {0, 0, 40, 20}, 0);
    EXPECT_LE(box.x0, 29);
    EXPECT_GE(box.x0, 27);
    EXPECT_GE(box.x1, 33);
    EXPECT_LE(box.x1, 35);
    EXPECT_LE(box.y0, 3);
    EXPECT_GE(box.y1, 9);
    EXPECT_TRUE(EllipsoidView::pixels(whole, flat.frame, {0, 0, 20, 20}, 0).empty()) << "beside the tile";
    EXPECT_FALSE(EllipsoidView::pixels(whole, flat.frame, {20, 0, 20, 20}, 0).empty());

    const Look deep(field,
                    Camera::perspective(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0),
                                        2.0 * std::atan(1.0) * 180.0 / pi, 1e-3),
                    {40, 20}, 0.5);
    EXPECT_NEAR(deep.frame.pixel, 0.1, 1e-12);
    const EllipsoidView::ScreenBounds cut = deep.view.support_bounds(0, 2.5, 5.0);
    EXPECT_NEAR(cut.left, 0.8 / 5.0 * 10.0, 1e-12);
    EXPECT_NEAR(cut.right, 1.2 / 2.5 * 10.0, 1e-12);
    EXPECT_NEAR(cut.top, -0.8 / 2.5 * 10.0, 1e-12);
    EXPECT_NEAR(cut.bottom, -0.2 / 5.0 * 10.0, 1e-12);
    EXPECT_NEAR(deep.view.support_bounds(0, 0.0, 10.0).right, 1.2 / 2.0 * 10.0, 1e-12) << "no nearer than its support";
    EXPECT_FALSE(deep.view.support_bounds(0, -1.0, 10.0).unbounded);

    EllipsoidArrays around;
    around.centers = {Vec3(0.0, 0.0, -1.0)};
    around.radii = {1.5};
    around.values = {1.0};
    const Look inside(field_of(std::move(around)),
                      Camera::perspective(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0), 60.0, 1e-3), {8, 8},
                      0.5);
    EXPECT_TRUE(inside.view.support_bounds(0, -0.1, 1.0).unbounded);
    EXPECT_TRUE(inside.view.support_bounds(0, 0.0, 1.0).unbounded);
    EXPECT_FALSE(inside.view.support_bounds(0, 0.1, 1.0).unbounded);
    const Tile tile{2, 1, 4, 5};
    const PixelBox all = EllipsoidView::pixels(inside.view.support_bounds(0, 0.0, 1.0), inside.frame, tile, 0);
    EXPECT_TRUE(all.x0 == 0 && all.y0 == 0 && all.x1 == tile.target_width() && all.y1 == tile.target_height());
}

// ---- how kernels are drawn

TEST(EllipsoidView, SpritesAreSmallSpheresInOrthographicView) {
    EllipsoidArrays round, oval;
    for (const double radius : {0.01, 0.2, 0.5}) {
        round.centers.emplace_back(radius, 0.0, 0.0);
        round.radii.push_back(radius);
        round.values.push_back(1.0);
        oval.centers.emplace_back(radius, 0.0, 0.0);
        oval.scales.emplace_back(radius, radius, radius);
        oval.values.push_back(1.0);
    }
    const auto spheres = field_of(std::move(round));
    const auto ovals = field_of(std::move(oval));
    const auto groups = [](const Look& look, double sprite_px) {
        std::vector<bool> sprites;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            sprites.push_back(look.view.group(i, look.view.depths(i), sprite_px, never) == SectionGroup::sprite);
        }
        return sprites;
    };
    // Radii of 0.2, 4 and 10 pixels.
    const Size size{50, 50};
    const Look look(spheres, orthographic(2.5), size, 0.05);
    EXPECT_TRUE(look.view.spheres());
    EXPECT_EQ(groups(look, 5.0), (std::vector<bool>{true, true, false}));
    EXPECT_EQ(groups(look, 10.1), (std::vector<bool>{true, true, true}));
    EXPECT_EQ(groups(look, 0.0), (std::vector<bool>{false, false, false}));
    const std::vector<bool> none{false, false, false};
    EXPECT_EQ(groups(Look(spheres, orthographic(2.5), size, 0.05, Sampling::slab), 100.0), none);
    EXPECT_EQ(groups(Look(spheres, orthographic(2.5), size, 0.05, Sampling::point, Filter::ewa), 100.0), none);
    EXPECT_EQ(groups(Look(spheres, perspective(), size, 0.05), 100.0), none);
    EXPECT_EQ(groups(Look(ovals, orthographic(2.5), size, 0.05), 100.0), none);
}

TEST(EllipsoidView, SlabsAreThinMediumOrThickAgainstTheKernel) {
    std::array<int, section_groups> count{};
    for (const double spacing : {0.005, 0.03, 0.2}) {
        for (const double aspect : {1.0, 40.0}) {
            const Look look(random_field(11, 120, aspect), orthographic(), {50, 50}, spacing, Sampling::slab);
            const double k = look.field->kernel().falloff;
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                // |B^-1 e_z| ds: how far the ray gets through the unit sphere in a slab, by the inverse itself.
                const Vec3 w = glm::inverse(look.in_eye(i)) * Vec3(0.0, 0.0, 1.0);
                const double width = std::sqrt(k) * glm::length(w) * spacing;
                const SectionGroup group = look.view.group(i, look.view.depths(i), 100.0, never);
                if (std::abs(width - 0.6) > 1e-6 && std::abs(width - 1.5) > 1e-6) {
                    EXPECT_EQ(group, width < 0.6   ? SectionGroup::thin
                                     : width < 1.5 ? SectionGroup::medium
                                                   : SectionGroup::thick)
                        << width;
                }
                ++count[static_cast<std::size_t>(group)];
            }
        }
    }
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::thin)], 20);
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::medium)], 20);
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::thick)], 20);
}

TEST(EllipsoidView, SlabsAreNeverThoughtThinnerThanTheyAre) {
    // Where rays differ from pixel to pixel, and where a filter hides the axes, bounds decide.
    int thin = 0;
    for (const bool deep : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            for (const double spacing : {0.005, 0.03, 0.2}) {
                const Look look(random_field(12, 100, 40.0), deep ? perspective() : orthographic(), {50, 40}, spacing,
                                Sampling::slab, filter);
                const double root = std::sqrt(look.field->kernel().falloff);
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    const EyeKernel kernel = look.view.kernel(i);
                    double widest = 0.0;
                    for (const double x : {-25.0, 0.0, 25.0}) {
                        for (const double y : {-20.0, 0.0, 20.0}) {
                            // From one slab to the next the ray moves (X, Y, -1) ds: in the plane of the unit sphere
                            // against the section's own movement.
                            const glm::dvec2 ray = deep ? look.frame.pixel * glm::dvec2(x, y) : glm::dvec2(0.0);
                            const glm::dvec2 across = ray + kernel.lean / kernel.half_depth;
                            const glm::dvec2 in_plane(
                                glm::dot(across, kernel.axis_u) / glm::dot(kernel.axis_u, kernel.axis_u),
                                glm::dot(across, kernel.axis_v) / glm::dot(kernel.axis_v, kernel.axis_v));
                            widest = std::max(widest, std::hypot(glm::length(in_plane), 1.0 / kernel.half_depth));
                        }
                    }
                    const double width = root * widest * spacing;
                    const SectionGroup group = look.view.group(i, look.view.depths(i), 100.0, never);
                    if (group == SectionGroup::thin) {
                        EXPECT_LE(width, 0.6 * (1.0 + 1e-9)) << i;
                        ++thin;
                    } else if (group == SectionGroup::medium) {
                        EXPECT_LE(width, 1.5 * (1.0 + 1e-9)) << i;
                    }
                }
            }
        }
    }
    EXPECT_GT(thin, 50);
}

TEST(EllipsoidView, SlenderKernelsArePlacedInFloat64) {
    EllipsoidArrays arrays;
    for (const double aspect : {1.0, 99.0, 100.0, 1e5}) {
        for (const Vec3 axes : {Vec3(aspect, 1.0, 1.0), Vec3(1.0, aspect, aspect)}) {
            arrays.centers.emplace_back(0.1 * static_cast<double>(arrays.centers.size()));
            arrays.scales.push_back(0.01 * axes);
            arrays.values.push_back(1.0);
        }
    }
    const auto field = field_of(std::move(arrays));
    for (const bool deep : {false, true}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            for (const double spacing : {0.004, 0.02, 0.2}) {
                // From a hundred times as far, at an angle that leaves pixels as small.
                const Look look(field, deep ? perspective(100.0, 1e-3, 0.5) : orthographic(), {50, 50}, spacing,
                                sampling);
                for (std::size_t i = 0; i < field->size(); ++i) {
                    const SectionGroup group = look.view.group(i, look.view.depths(i), 5.0, 100.0);
                    const SectionGroup usual = look.view.group(i, look.view.depths(i), 5.0, never);
                    EXPECT_FALSE(is_precise(usual));
                    if (i < 4) {
                        EXPECT_EQ(group, usual);
                    } else if (sampling == Sampling::point) {
                        EXPECT_EQ(group, SectionGroup::precise_plain);
                    } else {
                        EXPECT_EQ(group, usual == SectionGroup::thin     ? SectionGroup::precise_thin
                                         : usual == SectionGroup::medium ? SectionGroup::precise_medium
                                                                         : SectionGroup::precise_thick);
                    }
                }
            }
        }
    }
}

TEST(EllipsoidView, TinyKernelsArePlacedInFloat64) {
    for (const bool deep : {false, true}) {
        // Pixels of 0.05 at the middle's depth, in both cameras.
        const Vec3 from(0.0, 0.0, 50.0), up(0.0, 1.0, 0.0);
        const Camera camera = deep ? Camera::perspective(from, Vec3(0.0), up, 2.0 * std::atan(0.025) * 180.0 / pi)
                                   : Camera::orthographic(from, Vec3(0.0), up, 2.5);
        for (const bool flat : {false, true}) {
            EllipsoidArrays arrays;
            for (const double px : {0.011, 0.009, 1e-6, 3.0}) {
                arrays.centers.emplace_back(0.0);
                if (flat) {
                    arrays.scales.push_back(0.05 * px * Vec3(1.0, 2.0, 3.0));
                } else {
                    arrays.radii.push_back(0.05 * px);
                }
                arrays.values.push_back(1.0);
            }
            const auto field = field_of(std::move(arrays));
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                const Look look(field, camera, {50, 50}, 0.02, sampling);
                const Look wide(field, camera, {50, 50}, 0.02, sampling, Filter::ewa);
                for (std::size_t i = 0; i < field->size(); ++i) {
                    const EllipsoidView::Depths depths = look.view.depths(i);
                    EXPECT_EQ(is_precise(look.view.group(i, depths, 5.0, 100.0)), i == 1 || i == 2);
                    EXPECT_FALSE(is_precise(look.view.group(i, depths, 5.0, never))) << "float64 is not there";
                    EXPECT_FALSE(is_precise(wide.view.group(i, wide.view.depths(i), 5.0, 100.0)))
                        << "a filtered kernel is no smaller than a pixel";
                }
            }
        }
    }
}

TEST(EllipsoidView, WhatLiesBetweenTheCentresOfPixelsIsNotDrawn) {
    const Frame frame = [] {
        Frame made;
        made.size = {10, 10};
        return made;
    }();
    const Tile tile = [] {
        Tile made;
        made.width = made.height = 10;
        return made;
    }();
    // Centres lie at halves, counted from the optical axis.
    const auto drawn = [&](double left, double right, int wider) {
        const PixelBox box = EllipsoidView::pixels({left, right, 0.2, 1.3, false}, frame, tile, wider);
        return box.x0 < box.x1 && box.y0 < box.y1;
    };
    EXPECT_TRUE(drawn(0.4, 0.6, 0));
    EXPECT_TRUE(drawn(0.5 - 1e-12, 0.5 + 1e-12, 0));
    EXPECT_FALSE(drawn(0.51, 1.49, 0));
    EXPECT_TRUE(drawn(0.51, 1.51, 0));
    EXPECT_FALSE(drawn(-0.49, 0.49, 0));
    EXPECT_TRUE(drawn(0.51, 1.49, 1)) << "gradients look one pixel further";
}

TEST(EllipsoidView, RecordsKeepPlacesBeyondTwoToThe24Pixels) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(1234567890.123, -9876543210.456, 0.0)};
    arrays.radii = {1e10};
    arrays.values = {1.0};
    const Camera camera = Camera::orthographic(Vec3(0.0, 0.0, 5.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 50.0);
    const Look look(field_of(std::move(arrays)), camera, {50, 50}, 1e9); // pixels of 1
    SectionRest rest{};
    const SectionRecord record = look.view.record(0, look.view.kernel(0), 10, &rest);
    const auto sum = [](float whole, float part, float left) {
        return static_cast<double>(whole) + static_cast<double>(part) + static_cast<double>(left);
    };
    EXPECT_NEAR(sum(record.whole_x, record.part_x, rest.part_x), 1234567890.123, 1e-5);
    EXPECT_NEAR(sum(record.whole_y, record.part_y, rest.part_y), 9876543210.456, 1e-5);
}

TEST(EllipsoidView, RecordsWithTheirRestsKeepNeedlesOfOneToAHundredThousand) {
    Random random(14);
    for (const bool deep : {false, true}) {
        EllipsoidArrays arrays;
        for (int n = 0; n < 40; ++n) {
            arrays.centers.push_back(random.in_cube());
            arrays.scales.push_back(random_axes(random, 1e-5, 1e5));
            arrays.rotations.push_back(test::random_rotation(random));
            arrays.values.push_back(1.0);
        }
        const Look look(field_of(std::move(arrays)), deep ? perspective() : orthographic(), {500, 500}, 0.01);
        double rough = 0.0, fine = 0.0;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            const EyeKernel kernel = look.view.kernel(i);
            const EllipsoidView::Span span = look.view.span(look.view.depths(i));
            for (std::int64_t first = span.first / 4 * 4; first <= span.last; first += 8) {
                const std::int64_t last = std::min(first + 7, look.frame.slices - 1);
                SectionRest rest{};
                const SectionRecord record = look.view.record(i, kernel, look.view.anchor(kernel, first, last), &rest);
                for (std::int64_t slice = std::max(first, span.first); slice <= std::min(last, span.last); ++slice) {
                    const double scale = deep ? look.frame.depth_of(slice) : 1.0;
                    const Decoded wanted = exact(kernel, look.frame, slice);
                    Decoded got = decoded(record, look.frame, slice);
                    rough = std::max(rough, distance(got, wanted, scale));
                    const double since = static_cast<double>(slice) - static_cast<double>(record.first);
                    got.center +=
                        glm::dvec2(rest.part_x, rest.part_y) + since * glm::dvec2(rest.step_x, rest.step_y) / scale;
                    got.u += glm::dvec2(rest.ux, rest.uy);
                    got.v += glm::dvec2(rest.vx, rest.vy);
                    got.s += static_cast<double>(rest.s) - since * static_cast<double>(rest.step_s);
                    fine = std::max(fine, distance(got, wanted, scale));
                }
            }
        }
        EXPECT_LE(fine, 1e-7);
        EXPECT_GT(rough, 1e-4) << "float32 alone would do";
    }
}

TEST(EllipsoidView, CompactKernelsStayInFloat32) {
    // The polynomial of four slabs has exponents up to k log2(e) times (3/2 + 3/2 step)^2, and slopes of three times
    // that over the way: 2^115 at most.
    int compact = 0, plain = 0;
    for (const double falloff : {1.0, 8.0, 30.0}) {
        for (const double spacing : {0.01, 0.05, 0.3}) {
            const auto scattered = random_field(13, 80, 20.0);
            EllipsoidFieldOptions options;
            options.falloff = falloff;
            const auto field = field_of(scattered->arrays(), options);
            const Look look(field, orthographic(), {50, 50}, spacing);
            const Look deep(field, perspective(), {50, 50}, spacing);
            for (std::size_t i = 0; i < field->size(); ++i) {
                EXPECT_EQ(deep.view.group(i, deep.view.depths(i), 0.0, never), SectionGroup::plain);
                const double step = glm::length(glm::inverse(look.in_eye(i)) * Vec3(0.0, 0.0, 1.0)) * spacing;
                const double far = 1.5 * (1.0 + step), exponent = 1.4426950408889634 * falloff;
                const bool fits = step <= 1.0 && exponent * far * std::max(far, 3.0 * step) < 115.0;
                EXPECT_EQ(look.view.group(i, look.view.depths(i), 0.0, never),
                          fits ? SectionGroup::compact : SectionGroup::plain)
                    << step;
                ++(fits ? compact : plain);
            }
        }
    }
    EXPECT_GT(compact, 50);
    EXPECT_GT(plain, 50);
}

TEST(EllipsoidView, ScalesValuesAndWeights) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0)};
    arrays.radii = {0.5, 0.5};
    arrays.values = {3.0, -2.0};
    arrays.weights = {2.0, 0.0};
    const Camera camera = orthographic();
    const auto field = field_of(arrays);
    const Look look(field, camera, {8, 8}, 0.1);
    const double gain = field->kernel().gain();
    const EllipsoidView view(*field, camera, look.frame, Sampling::point, Filter::none, 0.25, 5.0);
    EXPECT_NEAR(view.weight_scale(), gain / 5.0, 1e-15);
    EXPECT_NEAR(view.value_scale(), gain / 5.0 / 0.25, 1e-14);
    const SectionRecord first = view.record(0, view.kernel(0), 0);
    EXPECT_NEAR(first.value, 6.0 * gain / 5.0 / 0.25, 1e-5);
    EXPECT_NEAR(first.weight, 2.0 * gain / 5.0, 1e-6);
    const SectionRecord second = view.record(1, view.kernel(1), 0);
    EXPECT_EQ(second.value, 0.0F);
    EXPECT_GT(second.weight, 0.0F) << "a weight of 0 still reaches";
    EXPECT_LT(second.weight, 1e-20F);

    EllipsoidFieldOptions options;
    options.normalization = Normalization::lattice;
    options.cell_volume = 0.3;
    const auto lattice = field_of(arrays, options);
    const EllipsoidView divided(*lattice, camera, look.frame, Sampling::point, Filter::none, 0.25, 5.0);
    EXPECT_NEAR(divided.value_scale(), view.value_scale() / lattice->lattice_constant(), 1e-12);
    EXPECT_NEAR(divided.weight_scale(), view.weight_scale(), 1e-15);
}

TEST(EllipsoidFacts, CountWhatAPlanAsksFor) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-1.0, -1.0, -1.0), Vec3(1.0, 1.0, 1.0), Vec3(0.0), Vec3(0.5, 0.0, 0.0)};
    arrays.scales = {Vec3(0.5), Vec3(0.5, 0.25, 0.125), Vec3(0.01, 0.5, 0.5), Vec3(0.04, 0.05, 0.04)};
    arrays.values = {1.0, 1.0, 1.0, 1.0};
    const auto field = field_of(std::move(arrays));
    const Camera camera = Camera::orthographic(Vec3(0.0, 0.0, 5.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 4.0);
    const Look look(field, camera, {80, 80}, 0.1); // pixels of 0.05
    const auto survey = [](const EllipsoidField& of, const Camera& seen_by, const Frame& frame) {
        return survey_ellipsoids(of, survey_kernels(of), seen_by, frame);
    };
    const EllipsoidFacts facts = survey(*field, camera, look.frame);
    EXPECT_NEAR(facts.largest_aspect, 50.0, 1e-12);
    EXPECT_EQ(facts.unresolved, 2U) << "the disc is thinner than a pixel, the last one than a slice distance";
    EXPECT_NEAR(facts.largest_change, 100.0, 1e-9);
    EXPECT_NEAR(facts.smallest_px, 0.2, 1e-12);
    const Box box = field->supports_world();
    const Vec3 edge = box.extent();
    const double volume = 4.0 / 3.0 * pi * (0.125 + 0.015625 + 0.0025 + 0.00008);
    EXPECT_NEAR(facts.mean_overlap, volume / (edge.x * edge.y * edge.z), 1e-12);
    // In perspective a pixel grows with depth.
    const Camera deep = Camera::perspective(Vec3(0.0, 0.0, 50.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 10.0);
    const Look far(field, deep, {80, 80}, 0.001);
    const EllipsoidFacts seen_deep = survey(*field, deep, far.frame);
    EXPECT_EQ(seen_deep.unresolved, 2U) << "pixels of 0.11: the disc and the last one";
    EXPECT_NEAR(seen_deep.smallest_px, 0.01 / (50.0 * far.frame.pixel), 1e-12) << "the disc's own depth";
    // Where bounds tell, no kernel is looked at: a picture in which all are resolved, and one in which none is.
    const Look close(field, camera, {8000, 8000}, 0.001);
    EXPECT_EQ(survey(*field, camera, close.frame).unresolved, 0U);
    const Look coarse(field, camera, {2, 2}, 0.001);
    EXPECT_EQ(survey(*field, camera, coarse.frame).unresolved, 4U);
    const auto empty = field_of(EllipsoidArrays{});
    const EllipsoidFacts nothing = survey(*empty, camera, look.frame);
    EXPECT_EQ(nothing.unresolved, 0U);
    EXPECT_EQ(nothing.mean_overlap, 0.0);
}

} // namespace
} // namespace sheetsplat

// Cross-sections of ellipsoids: the analytic slicing that [NM06] leaves out against the factored form, and the bounds
// that decide which pixels are looked at.
#include "support/quadric_slice.hpp"

#include <gtest/gtest.h>

#include "reference/kernels.hpp"
#include "reference/support.hpp"

namespace sheetsplat::reference::testing {

namespace {

using test::ConicSlice;
using test::Quadric;

Mat3 matrix_of(const glm::dquat& rotation) { return glm::mat3_cast(rotation); }

Mat3 times(const Mat3& axes, const Vec3& s) { return Mat3(axes[0] * s.x, axes[1] * s.y, axes[2] * s.z); }

/// The ellipse from the factored form (DESIGN's method 1): centre s B n, conjugate half-diameters rho B u and rho B v.
struct FactoredSlice {
    bool exists = false;
    glm::dvec2 centre{0.0}, u{0.0}, v{0.0};
    double height = 0.0; // s
};

FactoredSlice factored(const Vec3& centre, const Mat3& b, double z) {
    const Vec3 row = glm::transpose(b)[2];
    const double half_depth = glm::length(row);
    const Vec3 n = row / half_depth;
    const Vec3 any = std::abs(n.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
    const Vec3 u = glm::normalize(glm::cross(n, any)), v = glm::cross(n, u);
    const double s = (z - centre.z) / half_depth;
    if (std::abs(s) >= 1.0) {
        return {};
    }
    const double rho = std::sqrt(1.0 - s * s);
    const Vec3 middle = centre + b * (s * n), bu = rho * (b * u), bv = rho * (b * v);
    return {true, {middle.x, middle.y}, {bu.x, bu.y}, {bv.x, bv.y}, s};
}

/// How far the points of one ellipse, seen as c + u cos + v sin, are off the other, as r^2 of the other.
double off_the_quadric(const FactoredSlice& slice, const Quadric& quadric, double z) {
    double worst = 0.0;
    for (int step = 0; step < 12; ++step) {
        const double angle = 2.0 * pi * step / 12.0;
        const glm::dvec2 p = slice.centre + std::cos(angle) * slice.u + std::sin(angle) * slice.v;
        worst = std::max(worst, std::abs(quadric.r_squared(Vec3(p.x, p.y, z)) - 1.0));
    }
    return worst;
}

} // namespace

TEST(QuadricSlice, SphereByHand) {
    const Quadric sphere(Vec3(1.0, 2.0, 3.0), Mat3(2.0));
    const ConicSlice slice = sphere.slice(4.2);
    ASSERT_TRUE(slice.exists);
    EXPECT_NEAR(slice.centre.x, 1.0, 1e-15);
    EXPECT_NEAR(slice.centre.y, 2.0, 1e-15);
    EXPECT_NEAR(glm::length(slice.semi_axes[0]), 1.6, 1e-15);
    EXPECT_NEAR(glm::length(slice.semi_axes[1]), 1.6, 1e-15);
    EXPECT_NEAR(slice.least_r_squared, 0.36, 1e-15);
    EXPECT_NEAR(sphere.r_squared(Vec3(1.0, 3.0, 3.0)), 0.25, 1e-15);
    EXPECT_FALSE(sphere.slice(5.01).exists);
    EXPECT_FALSE(sphere.slice(0.99).exists);
    EXPECT_TRUE(sphere.slice(4.99).exists);
}

TEST(QuadricSlice, LeaningEllipsoidByHand) {
    // Semi-axes 5 along (0.6, 0, 0.8), 1 along y, 2 along (-0.8, 0, 0.6): z^2 reaches 16 + 1.44.
    const Mat3 b(5.0 * Vec3(0.6, 0.0, 0.8), Vec3(0.0, 1.0, 0.0), 2.0 * Vec3(-0.8, 0.0, 0.6));
    const Quadric quadric(Vec3(0.0), b);
    EXPECT_TRUE(quadric.slice(std::sqrt(17.44) - 1e-9).exists);
    EXPECT_FALSE(quadric.slice(std::sqrt(17.44) + 1e-9).exists);
    // In the plane z = 0: x^2 (0.36 / 25 + 0.64 / 4) = 1.
    const ConicSlice middle = quadric.slice(0.0);
    EXPECT_NEAR(middle.extent.x, 1.0 / std::sqrt(0.1744), 1e-14);
    EXPECT_NEAR(middle.extent.y, 1.0, 1e-15);
    // The centres move along B n: by (b_x . b_z) / |b_z|^2 for one of z.
    EXPECT_NEAR(quadric.slice(1.0).centre.x, (12.0 - 1.92) / 17.44, 1e-15);
}

TEST(QuadricSlice, AgreesWithTheFactoredForm) {
    std::mt19937_64 generator(7);
    int cut = 0;
    for (int n = 0; n < 300; ++n) {
        const Mat3 axes = matrix_of(random_rotation(generator));
        const Vec3 s(std::exp(random_real(generator, -3.0, 3.0)), std::exp(random_real(generator, -3.0, 3.0)),
                     std::exp(random_real(generator, -3.0, 3.0)));
        const Mat3 b = times(axes, s);
        const Vec3 centre(random_real(generator, -2.0, 2.0), random_real(generator, -2.0, 2.0),
                          random_real(generator, -2.0, 2.0));
        const KernelShape shape(axes, s);
        const double share = random_real(generator, -1.2, 1.2), z = centre.z + share * shape.half_depth();
        const Quadric quadric(centre, b);
        const ConicSlice conic = quadric.slice(z);
        const FactoredSlice slice = factored(centre, b, z);
        ASSERT_EQ(conic.exists, slice.exists);
        ASSERT_EQ(conic.exists, std::abs(share) < 1.0);
        // The least r^2 of a plane is its share of the half-depth, squared.
        EXPECT_NEAR(conic.least_r_squared, share * share, 1e-11);
        if (!slice.exists) {
            continue;
        }
        ++cut;
        const double size = std::max({s.x, s.y, s.z});
        EXPECT_NEAR(glm::length(conic.centre - slice.centre), 0.0, 1e-11 * size);
        EXPECT_LE(off_the_quadric(slice, quadric, z), 1e-10);
        // Axes: perpendicular, on the ellipse, with the area and the sum of squares of any conjugate pair.
        const glm::dvec2 a0 = conic.semi_axes[0], a1 = conic.semi_axes[1];
        EXPECT_NEAR(glm::dot(a0, a1), 0.0, 1e-12 * size * size);
        EXPECT_GE(glm::length(a0), glm::length(a1) * (1.0 - 1e-12));
        EXPECT_NEAR(glm::length(a0) * glm::length(a1), std::abs(slice.u.x * slice.v.y - slice.u.y * slice.v.x),
                    1e-11 * size * size);
        EXPECT_NEAR(glm::dot(a0, a0) + glm::dot(a1, a1), glm::dot(slice.u, slice.u) + glm::dot(slice.v, slice.v),
                    1e-11 * size * size);
        for (const glm::dvec2& axis : {a0, a1}) {
            EXPECT_NEAR(quadric.r_squared(Vec3(conic.centre + axis, z)), 1.0, 1e-10);
        }
        // What the renderer's pixels are chosen by: the centre and the extents along x and y.
        const Interval x = shape.bounds_x(centre.z - z, centre.z - z), y = shape.bounds_y(centre.z - z, centre.z - z);
        EXPECT_NEAR(0.5 * (x.lower + x.upper) + centre.x, conic.centre.x, 1e-11 * size);
        EXPECT_NEAR(0.5 * (y.lower + y.upper) + centre.y, conic.centre.y, 1e-11 * size);
        EXPECT_NEAR(0.5 * (x.upper - x.lower), conic.extent.x, 1e-11 * size / std::sqrt(1.0 - share * share));
        EXPECT_NEAR(0.5 * (y.upper - y.lower), conic.extent.y, 1e-11 * size / std::sqrt(1.0 - share * share));
        // And the values, anywhere in the plane.
        for (int point = 0; point < 4; ++point) {
            const glm::dvec2 p = slice.centre + random_real(generator, -1.0, 1.0) * slice.u +
                                 random_real(generator, -1.0, 1.0) * slice.v;
            const Vec3 q = shape.to_unit(Vec3(p.x, p.y, z) - centre);
            EXPECT_NEAR(glm::dot(q, q), quadric.r_squared(Vec3(p.x, p.y, z)), 1e-10);
        }
        // A hair away it is another ellipse.
        const FactoredSlice other = factored(centre, b, z + 1e-7 * shape.half_depth());
        EXPECT_TRUE(!other.exists || off_the_quadric(other, quadric, z) > 1e-9 || std::abs(share) < 1e-2);
    }
    EXPECT_GT(cut, 200);
}

TEST(QuadricSlice, HoldsForNeedles) {
    std::mt19937_64 generator(8);
    for (int n = 0; n < 100; ++n) {
        const Mat3 axes = matrix_of(random_rotation(generator));
        const Vec3 s = n % 2 == 0 ? Vec3(1e3, 1.0, 1.5) : Vec3(1e3, 0.8e3, 1.0);
        const Mat3 b = times(axes, s);
        const KernelShape shape(axes, s);
        const double z = random_real(generator, -0.95, 0.95) * shape.half_depth();
        const Quadric quadric(Vec3(0.0), b);
        const FactoredSlice slice = factored(Vec3(0.0), b, z);
        EXPECT_LE(off_the_quadric(slice, quadric, z), 1e-8);
        EXPECT_NEAR(quadric.slice(z).least_r_squared, slice.height * slice.height, 1e-8);
        const FactoredSlice other = factored(Vec3(0.0), b, z + 1e-6 * shape.half_depth());
        EXPECT_GT(off_the_quadric(other, quadric, z) +
                      std::abs(other.height * other.height - slice.height * slice.height),
                  1e-8);
    }
}

TEST(QuadricSlice, IsWhatASliceOfAPictureShows) {
    // One slice of one leaning kernel, seen along -z: every pixel has g of the conic's r^2.
    std::mt19937_64 generator(21);
    for (int n = 0; n < 8; ++n) {
        const glm::dquat rotation = random_rotation(generator);
        const Vec3 s(0.4, 1.1, 2.3), at(0.3, -0.2, 0.1);
        Scene scene = make_scene(make_ellipsoids(one_ellipsoid(at, s, rotation), plain_ellipsoids()));
        scene.mode = Mode::mip;
        // Slices next to the middle only: a quarter of the half-depth before it and a quarter behind it reach the ball,
        // the others do not.
        const double half_depth = KernelShape(matrix_of(rotation), s).half_depth();
        scene.slice_spacing = 1.5 * half_depth;
        const Camera camera = Camera::orthographic(at + Vec3(0.0, 0.0, 9.0), at, Vec3(0.0, 1.0, 0.0), 5.0);
        const Picture picture = render(scene, camera, Size{31, 31});
        const auto shown = [&](const Quadric& quadric) {
            std::vector<double> values;
            for (int j = 0; j < 31; ++j) {
                for (int i = 0; i < 31; ++i) {
                    const double x = at.x + 2.5 * (2.0 * (i + 0.5) / 31.0 - 1.0);
                    const double y = at.y + 2.5 * (1.0 - 2.0 * (j + 0.5) / 31.0);
                    double most = 0.0;
                    for (const double side : {-0.75, 0.75}) {
                        const double z = at.z + side * half_depth;
                        const ConicSlice conic = quadric.slice(z);
                        EXPECT_TRUE(conic.exists);
                        // r^2 from the ellipse alone: 1 on it, least in its centre, quadratic between.
                        const glm::dvec2 d = glm::dvec2(x, y) - conic.centre;
                        const double a =
                            glm::dot(d, conic.semi_axes[0]) / glm::dot(conic.semi_axes[0], conic.semi_axes[0]);
                        const double b =
                            glm::dot(d, conic.semi_axes[1]) / glm::dot(conic.semi_axes[1], conic.semi_axes[1]);
                        const double r_squared =
                            conic.least_r_squared + (1.0 - conic.least_r_squared) * (a * a + b * b);
                        most = std::max(most, kernel_value(std::sqrt(r_squared), 8.0));
                    }
                    values.push_back(most > 0.0 ? most : no_number);
                }
            }
            return values;
        };
        const Mat3 m = times(matrix_of(rotation), s);
        EXPECT_GT(largest_of(picture.scalar), 0.005);
        EXPECT_LE(largest_difference(picture.scalar, shown(Quadric(at, m))), 1e-14);
        const Mat3 wrong = times(matrix_of(glm::normalize(rotation + glm::dquat(0.0, 1e-9, 2e-9, -1e-9))), s);
        EXPECT_GT(largest_difference(picture.scalar, shown(Quadric(at, wrong))), 1e-13);
    }
}

TEST(Bounds, HoldEveryPointAndAreTight) {
    std::mt19937_64 generator(3);
    for (const double longest : {1.0, 30.0, 1e5}) {
        double loosest_x = 0.0, loosest_y = 0.0;
        for (int n = 0; n < 60; ++n) {
            const Mat3 axes = matrix_of(random_rotation(generator));
            const Vec3 s(longest, random_real(generator, 0.5, 2.0), random_real(generator, 0.5, 2.0));
            const bool filtered = n % 2 == 1;
            const KernelShape shape = filtered ? KernelShape::filtered(axes, s, 0.7, 0.4) : KernelShape(axes, s);
            const double from = random_real(generator, -1.1, 1.0);
            const double front = from * shape.half_depth(),
                         back = (n % 3 == 0 ? from : random_real(generator, from, 1.1)) * shape.half_depth();
            const Interval x = shape.bounds_x(front, back), y = shape.bounds_y(front, back);
            const double slope_y = random_real(generator, -0.4, 0.4);
            double seen_x = 0.0, seen_y = 0.0;
            // Points on the sphere, at depths in the range: s along n, the rest beside it.
            Vec3 row(0.0);
            const Mat3 b = times(axes, s);
            for (int point = 0; point < 400 && !filtered; ++point) {
                row = glm::transpose(b)[2] / shape.half_depth();
                const double depth = random_real(generator, front, back), share = -depth / shape.half_depth();
                if (std::abs(share) >= 1.0) {
                    continue;
                }
                const Vec3 any = std::abs(row.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
                const Vec3 u = glm::normalize(glm::cross(row, any)), v = glm::cross(row, u);
                const double angle = random_real(generator, 0.0, 2.0 * pi);
                const Vec3 at =
                    b * (share * row + std::sqrt(1.0 - share * share) * (std::cos(angle) * u + std::sin(angle) * v));
                EXPECT_GE(at.x, x.lower);
                EXPECT_LE(at.x, x.upper);
                EXPECT_GE(at.y, y.lower);
                EXPECT_LE(at.y, y.upper);
                const double middle_x = 0.5 * (x.lower + x.upper), middle_y = 0.5 * (y.lower + y.upper);
                seen_x = std::max(seen_x, std::abs(at.x - middle_x) / (0.5 * (x.upper - x.lower)));
                seen_y = std::max(seen_y, std::abs(at.y - middle_y) / (0.5 * (y.upper - y.lower)));
                // The row that this point is in holds it, and is no wider than all.
                const Interval in_row = shape.bounds_in_row(at.y - slope_y * depth, slope_y, front, back);
                EXPECT_GE(at.x, in_row.lower);
                EXPECT_LE(at.x, in_row.upper);
            }
            if (!filtered && std::abs(from) < 0.8) {
                loosest_x = std::max(loosest_x, 1.0 - seen_x);
                loosest_y = std::max(loosest_y, 1.0 - seen_y);
            }
            if (filtered) {
                // Of the filtered shape only r is known: no point inside may be out of bounds.
                for (int point = 0; point < 400; ++point) {
                    const double depth = random_real(generator, front, back);
                    const Vec3 at(random_real(generator, 1.2 * x.lower, 1.2 * x.upper),
                                  random_real(generator, 1.2 * y.lower, 1.2 * y.upper), -depth);
                    const Vec3 q = shape.to_unit(at);
                    if (glm::dot(q, q) < 1.0) {
                        EXPECT_TRUE(at.x >= x.lower && at.x <= x.upper && at.y >= y.lower && at.y <= y.upper);
                        const Interval in_row = shape.bounds_in_row(at.y - slope_y * depth, slope_y, front, back);
                        EXPECT_TRUE(at.x >= in_row.lower && at.x <= in_row.upper);
                    }
                }
            }
        }
        // 400 random points come near the ends.
        EXPECT_LT(loosest_x, 0.1) << longest;
        EXPECT_LT(loosest_y, 0.1) << longest;
    }
}

TEST(Bounds, RowsEndWhereTheEllipseEnds) {
    // The ends of a row of a slice: r = 1 there, within the bounds' own slack.
    std::mt19937_64 generator(5);
    for (int n = 0; n < 100; ++n) {
        const Mat3 axes = matrix_of(random_rotation(generator));
        const KernelShape shape(axes, Vec3(random_real(generator, 1.0, 20.0), 1.0, 0.3));
        const double depth = random_real(generator, -0.9, 0.9) * shape.half_depth();
        const Interval y = shape.bounds_y(depth, depth);
        const double row = y.lower + random_real(generator, 0.05, 0.95) * (y.upper - y.lower);
        const double slope = random_real(generator, -0.5, 0.5);
        const Interval x = shape.bounds_in_row(row - slope * depth, slope, depth, depth);
        ASSERT_FALSE(x.empty());
        for (const double end : {x.lower, x.upper}) {
            const Vec3 q = shape.to_unit(Vec3(end, row, -depth));
            EXPECT_NEAR(glm::length(q), 1.0, 1e-9);
        }
        // A row beside the ellipse has none.
        const double beside = y.upper + 1e-3 * (y.upper - y.lower);
        EXPECT_TRUE(shape.bounds_in_row(beside - slope * depth, slope, depth, depth).empty());
    }
}

} // namespace sheetsplat::reference::testing

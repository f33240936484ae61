// The EWA filter of conventions, section 10.
#include <gtest/gtest.h>

#include "reference/kernels.hpp"
#include "reference/support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

using Wide = glm::mat<3, 3, long double, glm::defaultp>;
using WideVec = glm::vec<3, long double, glm::defaultp>;

/// B B^T + diag(across^2, across^2, along^2), multiplied out in long double.
Wide widened(const Mat3& axes, const Vec3& s, double across, double along) {
    Wide sum(0.0L);
    for (int own = 0; own < 3; ++own) {
        const WideVec b = WideVec(axes[own]) * static_cast<long double>(s[own]);
        sum += glm::outerProduct(b, b);
    }
    const long double p = across, d = along;
    sum[0][0] += p * p, sum[1][1] += p * p, sum[2][2] += d * d;
    return sum;
}

/// Cholesky's factor of a covariance: r^2 = |L^-1 d|^2.
template <class Real>
struct Factor {
    Real l00, l10, l11, l20, l21, l22;

    explicit Factor(const Wide& sum) {
        const auto at = [&](int row, int column) { return static_cast<Real>(sum[column][row]); };
        l00 = std::sqrt(at(0, 0));
        l10 = at(1, 0) / l00, l20 = at(2, 0) / l00;
        l11 = std::sqrt(at(1, 1) - l10 * l10);
        l21 = (at(2, 1) - l20 * l10) / l11;
        l22 = std::sqrt(at(2, 2) - l20 * l20 - l21 * l21);
    }
    double r_squared(const Vec3& d) const {
        const Real x = d.x / l00, y = (d.y - l10 * x) / l11, z = (d.z - l20 * x - l21 * y) / l22;
        return static_cast<double>(x * x + y * y + z * z);
    }
};

double area_of_pixel(const Camera& camera, Size size) {
    const double width = 2.0 * camera.half_height() / size.height;
    return width * width;
}

/// The x-ray's sum over the whole picture, times a pixel's area: the mass.
double mass(const Scene& scene, const Camera& camera, Size size) {
    double sum = 0.0;
    for (const double value : render(scene, camera, size).scalar) {
        sum += value;
    }
    return sum * area_of_pixel(camera, size);
}

Scene xray(std::shared_ptr<const Field> field, Filter filter, double spacing, Sampling sampling = Sampling::slab) {
    Scene scene = make_scene(std::move(field));
    scene.mode = Mode::xray;
    scene.sampling = sampling;
    scene.filter = filter;
    scene.slice_spacing = spacing;
    return scene;
}

// What the filter adds to a radius of falloff 8, in pixels and slice distances: half a standard deviation's.
const double widening = 0.5 * std::sqrt(2.0 * 8.0);

} // namespace

TEST(EwaFilter, IsTheWidenedCovariance) {
    std::mt19937_64 generator(31);
    double worst = 0.0, worst_unfiltered = 0.0;
    for (int n = 0; n < 200; ++n) {
        const Mat3 axes = glm::mat3_cast(random_rotation(generator));
        const Vec3 s(std::exp(random_real(generator, -3.0, 3.0)), std::exp(random_real(generator, -3.0, 3.0)),
                     std::exp(random_real(generator, -3.0, 3.0)));
        const double across = random_real(generator, 0.05, 3.0), along = random_real(generator, 0.05, 3.0);
        const KernelShape shape = KernelShape::filtered(axes, s, across, along);
        const Wide sum = widened(axes, s, across, along), form = glm::inverse(sum);
        EXPECT_NEAR(shape.half_depth() / std::sqrt(static_cast<double>(sum[2][2])), 1.0, 1e-14);
        const long double old = static_cast<long double>(s.x) * s.y * s.z;
        EXPECT_NEAR(shape.amplitude() / static_cast<double>(old / std::sqrt(glm::determinant(sum))), 1.0, 1e-12);
        EXPECT_LT(shape.amplitude(), 1.0);
        const Interval x = shape.bounds_x(-shape.half_depth(), shape.half_depth());
        EXPECT_NEAR(x.upper / std::sqrt(static_cast<double>(sum[0][0])), 1.0, 1e-11);
        const Interval y = shape.bounds_y(-shape.half_depth(), shape.half_depth());
        EXPECT_NEAR(-y.lower / std::sqrt(static_cast<double>(sum[1][1])), 1.0, 1e-11);
        for (int point = 0; point < 10; ++point) {
            const Vec3 d(random_real(generator, x.lower, x.upper), random_real(generator, y.lower, y.upper),
                         random_real(generator, -1.0, 1.0) * shape.half_depth());
            const double r_squared = static_cast<double>(glm::dot(WideVec(d), form * WideVec(d)));
            const Vec3 q = shape.to_unit(d), plain = KernelShape(axes, s).to_unit(d);
            worst = std::max(worst, std::abs(glm::dot(q, q) - r_squared) / (1.0 + r_squared));
            worst_unfiltered = std::max(worst_unfiltered, std::abs(glm::dot(plain, plain) - r_squared));
        }
    }
    EXPECT_LE(worst, 1e-11);
    EXPECT_GT(worst_unfiltered, 0.1);
}

TEST(EwaFilter, KeepsNeedlesAccurate) {
    // 1e5 long and far thinner than the filter, at any slant: r inside the support against long double, and what the
    // same product makes of it in float64.
    std::mt19937_64 generator(32);
    double worst = 0.0, by_product = 0.0, amplitude = 0.0;
    for (int n = 0; n < 100; ++n) {
        const Mat3 axes = glm::mat3_cast(random_rotation(generator));
        const Vec3 s(1e5, random_real(generator, 0.01, 2.0), random_real(generator, 0.01, 2.0));
        const KernelShape shape = KernelShape::filtered(axes, s, 1.0, 0.5);
        const Wide sum = widened(axes, s, 1.0, 0.5);
        const Factor<long double> exact(sum);
        const Factor<double> rough(sum);
        amplitude =
            std::max(amplitude, std::abs(static_cast<double>(
                                    shape.amplitude() * exact.l00 * exact.l11 * exact.l22 / s.x / s.y / s.z - 1.0L)));
        for (int point = 0; point < 20; ++point) {
            const Vec3 d = axes * (Vec3(random_real(generator, -0.7, 0.7) * s.x, random_real(generator, -0.5, 0.5),
                                        random_real(generator, -0.5, 0.5)));
            const Vec3 q = shape.to_unit(d);
            worst = std::max(worst, std::abs(glm::dot(q, q) - exact.r_squared(d)));
            by_product = std::max(by_product, std::abs(rough.r_squared(d) - exact.r_squared(d)));
        }
    }
    std::printf("filtered needles of 1:1e5: r^2 off by %.1e, amplitude by %.1e; by the product %.1e\n", worst,
                amplitude, by_product);
    EXPECT_LE(worst, 1e-8);
    EXPECT_LE(amplitude, 1e-8);
    EXPECT_GT(by_product, 1e-7);
}

TEST(EwaFilter, ExtremeSizesKeepTheirAmplitude) {
    // Products of the semi-axes that float64 does not hold.
    const Mat3 axes = glm::mat3_cast(glm::normalize(glm::dquat(0.3, 0.5, -0.2, 0.7)));
    const double plain = KernelShape::filtered(axes, Vec3(1.0, 2.0, 3.0), 0.5, 0.7).amplitude();
    for (const double scale : {1e120, 1e-120}) {
        EXPECT_NEAR(KernelShape::filtered(axes, scale * Vec3(1.0, 2.0, 3.0), 0.5 * scale, 0.7 * scale).amplitude(),
                    plain, 1e-13);
    }
    EXPECT_NEAR(KernelShape::filtered(axes, Vec3(1e110), 1.0, 1.0).amplitude(), 1.0, 1e-13);
    EXPECT_EQ(KernelShape(axes, Vec3(1.0, 2.0, 3.0)).amplitude(), 1.0);
    EXPECT_LT(plain, 0.99);
}

TEST(EwaFilter, KeepsTheMassOfAKernel) {
    const Vec3 s(0.9, 0.35, 0.6), at(0.11, -0.07, 0.3);
    const glm::dquat rotation = glm::normalize(glm::dquat(0.7, 0.2, -0.5, 0.4));
    const auto field = make_ellipsoids(one_ellipsoid(at, s, rotation), plain_ellipsoids());
    // Beside the closed form of a ball's mass.
    const double expected = field->kernel().unit_mass() * s.x * s.y * s.z;
    for (const Sampling sampling : {Sampling::slab, Sampling::point}) {
        for (const double spacing : {0.1, 0.25}) {
            const Size size{80, 80};
            const Camera camera = front_camera(4.0);
            const double plain = mass(xray(field, Filter::none, spacing, sampling), camera, size);
            const double filtered = mass(xray(field, Filter::ewa, spacing, sampling), camera, size);
            EXPECT_NEAR(plain / expected, 1.0, sampling == Sampling::slab ? 1e-5 : 1e-2);
            EXPECT_NEAR(filtered / expected, 1.0, sampling == Sampling::slab ? 1e-5 : 1e-2);
        }
    }
    // The amplitude makes it: without it there would be this much more.
    const KernelShape shape = KernelShape::filtered(glm::mat3_cast(rotation), s, widening * 0.05, widening * 0.25);
    EXPECT_LT(shape.amplitude(), 0.95);
    // And in perspective the pixel's width is that at the centre's depth, on whichever side of the target.
    for (const double z : {-6.0, 6.0}) {
        const auto there = make_ellipsoids(one_ellipsoid(Vec3(0.0, 0.0, z), s, rotation), plain_ellipsoids());
        const Camera camera = Camera::perspective(Vec3(0.0, 0.0, 20.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 12.0);
        const Size size{60, 60};
        const double pixel = (20.0 - z) * 2.0 * std::tan(6.0 * pi / 180.0) / 60.0;
        const double deepest = 0.2;
        Scene scene = xray(there, Filter::ewa, deepest);
        const double centre = render(scene, camera, Size{60, 60}).scalar[30 * 60 + 30];
        // The line integral through (nearly) the centre, by the covariance.
        const Wide form = glm::inverse(widened(glm::mat3_cast(rotation), s, widening * pixel, widening * deepest));
        const double x = 0.5 * pixel, y = -0.5 * pixel;
        const Vec3 ray = glm::normalize(Vec3(x, y, -(20.0 - z))), start(x, y, 0.0);
        const auto product = [&](const Vec3& a, const Vec3& b) {
            return static_cast<double>(glm::dot(WideVec(a), form * WideVec(b)));
        };
        const double vv = product(ray, ray), xv = product(start, ray), xx = product(start, start);
        const double amplitude = s.x * s.y * s.z * std::sqrt(static_cast<double>(glm::determinant(form)));
        const double expected_centre = amplitude * chord_integral(std::sqrt(xx - xv * xv / vv), 8.0) / std::sqrt(vv);
        EXPECT_NEAR(centre / expected_centre, 1.0, 1e-12);
        scene.filter = Filter::none;
        EXPECT_GT(std::abs(render(scene, camera, size).scalar[30 * 60 + 30] / expected_centre - 1.0), 1e-2);
    }
}

TEST(EwaFilter, TinyKernelsDoNotVanish) {
    // A kernel of a hundredth of a pixel and of a slice, moved over a pixel and a slab: without the filter most places
    // show nothing; with it all do, and the mean over all places is its mass.
    constexpr int steps = 6;
    const Size size{7, 7};
    const Camera camera = front_camera(7.0);
    const double radius = 0.01;
    // A second kernel far outside of the picture holds the anchor.
    const auto total = [&](double x, double y, double z, Filter filter, Sampling sampling) {
        EllipsoidArrays arrays;
        arrays.centers = {Vec3(x, y, z), Vec3(1000.0 - x, -y, -z)};
        arrays.radii = {radius, radius};
        arrays.values = {1.0, 1.0};
        return mass(xray(make_ellipsoids(arrays, plain_ellipsoids()), filter, 1.0, sampling), camera, size);
    };
    const double expected = Kernel{8.0}.unit_mass() * radius * radius * radius;
    for (const Sampling sampling : {Sampling::slab, Sampling::point}) {
        double sum = 0.0, least = std::numeric_limits<double>::infinity(), most = 0.0;
        int unfiltered_seen = 0;
        for (int a = 0; a < steps; ++a) {
            for (int b = 0; b < steps; ++b) {
                for (int c = 0; c < steps; ++c) {
                    const double x = (a + 0.5) / steps, y = (b + 0.5) / steps, z = (c + 0.5) / steps;
                    const double seen = total(x, y, z, Filter::ewa, sampling);
                    sum += seen;
                    least = std::min(least, seen);
                    most = std::max(most, seen);
                    unfiltered_seen += total(x, y, z, Filter::none, sampling) > 0.0 ? 1 : 0;
                }
            }
        }
        std::printf("a kernel of 0.01 pixels, by %s: %.2f to %.2f of its mass, %.5f on average\n",
                    sampling == Sampling::slab ? "slabs" : "points", least / expected, most / expected,
                    sum / (steps * steps * steps) / expected);
        EXPECT_GT(least, 0.0);
        EXPECT_NEAR(sum / (steps * steps * steps) / expected, 1.0, 2e-3);
        EXPECT_LT(unfiltered_seen, steps * steps * steps / 100);
    }
}

TEST(EwaFilter, HugeKernelsBarelyChange) {
    // Semi-axes of hundreds of pixels and slices: the square of their ratio.
    EllipsoidArrays arrays = scattered(10, 33);
    for (Vec3& scale : arrays.scales) {
        scale = 2.0 + scale;
    }
    Scene scene = make_scene(make_ellipsoids(arrays));
    scene.reference_length = 1.0;
    const auto difference = [&](double pixel) {
        scene.slice_spacing = pixel;
        scene.filter = Filter::none;
        const Camera camera = Camera::orthographic(Vec3(3.0, 2.0, 9.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 12.0 * pixel);
        const auto plain = render(scene, camera, Size{12, 12}).rgba;
        scene.filter = Filter::ewa;
        EXPECT_GT(largest_of(plain), 0.2);
        return largest_difference(plain, render(scene, camera, Size{12, 12}).rgba);
    };
    const std::vector<double> pixels{0.04, 0.02, 0.01, 0.005};
    std::vector<double> differences;
    for (const double pixel : pixels) {
        differences.push_back(difference(pixel));
    }
    std::printf("the filter on huge kernels: order %.2f, least %.1e\n", fitted_order(pixels, differences),
                differences.back());
    EXPECT_LE(differences.back(), 2e-4);
    EXPECT_GT(differences.back(), 1e-9);
    EXPECT_NEAR(fitted_order(pixels, differences), 2.0, 0.2);
}

TEST(EwaFilter, ItsSupportDecidesWhichSlicesThereAre) {
    // A disc of half-depth 0.01 that faces the camera, slices 1 apart: two slabs touch it, and six once it is filtered
    // (its half-depth is sqrt(0.0001 + 4)).
    const auto field = make_ellipsoids(one_ellipsoid(Vec3(0.0), Vec3(2.0, 2.0, 0.01), glm::dquat(1.0, 0.0, 0.0, 0.0)),
                                       plain_ellipsoids());
    for (const Sampling sampling : {Sampling::slab, Sampling::point}) {
        const Picture plain = render(xray(field, Filter::none, 1.0, sampling), front_camera(4.0), Size{9, 9});
        const Picture filtered = render(xray(field, Filter::ewa, 1.0, sampling), front_camera(4.0), Size{9, 9});
        EXPECT_EQ(plain.first_slice, -1);
        EXPECT_EQ(plain.slices, 2);
        EXPECT_EQ(filtered.first_slice, -3);
        EXPECT_EQ(filtered.slices, 6);
        // Between slices the disc is not there for points; filtered it is.
        EXPECT_EQ(largest_of(plain.scalar) > 0.0, sampling == Sampling::slab);
        EXPECT_GT(largest_of(filtered.scalar), 1e-3);
    }
    // It reaches more pixels as well: at opacity above 0, as many as its own pixel's width says.
    Scene scene =
        make_scene(make_ellipsoids(one_ellipsoid(Vec3(0.0), Vec3(0.1, 0.1, 0.1), glm::dquat(1.0, 0.0, 0.0, 0.0))),
                   TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
    scene.slice_spacing = 0.01;
    const auto seen = [&](Filter filter) {
        scene.filter = filter;
        const Picture picture = render(scene, front_camera(5.0), Size{5, 5});
        int count = 0;
        for (std::size_t n = 0; n < 25; ++n) {
            count += picture.rgba[4 * n + 3] > 0.0 ? 1 : 0;
        }
        return count;
    };
    EXPECT_EQ(seen(Filter::none), 1);
    // Those whose distance is below sqrt(0.01 + 4): at 0, 1, sqrt(2) and 2.
    EXPECT_EQ(seen(Filter::ewa), 13);
}

TEST(EwaFilter, GoesForLatticesToo) {
    // A volume finer than the pixels: filtered, its constant stays its constant inside.
    RegularFieldOptions options = test::zero_boundary();
    options.origin = Vec3(-6.0);
    options.spacing = Vec3(0.5);
    const auto field = make_field(sampled({25, 25, 25}, [](int, int, int) { return 0.7; }), {25, 25, 25}, options);
    for (const bool perspective : {false, true}) {
        Scene scene = make_scene(field);
        scene.mode = Mode::mip;
        scene.slice_spacing = 1.0;
        scene.filter = Filter::ewa;
        const Camera camera = perspective
                                  ? Camera::perspective(Vec3(1.0, 2.0, 30.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 10.0)
                                  : Camera::orthographic(Vec3(1.0, 2.0, 30.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 5.0);
        for (const double value : render(scene, camera, Size{5, 5}).scalar) {
            EXPECT_NEAR(value, 0.7, 0.7 * 0.008);
        }
        // C is the mass before the filter: were the amplitude not lowered, the sum would be far above it.
        const double lattice_widening = 0.5 * std::sqrt(2.0 * field->kernel().falloff);
        const KernelShape shape = KernelShape::filtered(Mat3(1.0), Vec3(1.0), lattice_widening, lattice_widening);
        EXPECT_LT(shape.amplitude(), 0.36);
    }
}

TEST(EwaFilter, MeasuresPixelsNoNearerThanTheNearPlane) {
    // A kernel around the eye, and behind it: its widths are those of a pixel at `near`.
    const double near = 1.5, spacing = 0.5, pixel_at_1 = 2.0 * std::tan(6.0 * pi / 180.0) / 9.0;
    const Camera camera = Camera::perspective(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0), 12.0, near);
    for (const double depth : {-3.0, -0.2, 0.7, 1.5, 4.0}) {
        const auto field =
            make_ellipsoids(one_ellipsoid(Vec3(0.0, 0.0, -depth), Vec3(0.1), glm::dquat(1.0, 0.0, 0.0, 0.0)));
        const Scene scene = xray(field, Filter::ewa, spacing);
        const Screen screen(camera, Size{9, 9});
        const EyeKernel kernel = EyeKernels(*field, scene, camera, screen, 1.0).at(0);
        const double across = widening * pixel_at_1 * std::max(depth, near);
        EXPECT_NEAR(kernel.shape.bounds_x(-1.0, 1.0).upper, std::hypot(0.1, across), 1e-9) << depth;
        EXPECT_NEAR(kernel.shape.half_depth(), std::hypot(0.1, widening * spacing), 1e-12) << depth;
    }
}

} // namespace sheetsplat::reference::testing

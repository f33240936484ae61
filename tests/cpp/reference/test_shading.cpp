// Gradients, light and isosurfaces against closed forms.
#include "reference/shade.hpp"

#include <gtest/gtest.h>

#include "support.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr double radius = 2.0, falloff = 5.0, iso = 0.3;

/// Radius at which one kernel has the iso value.
double iso_radius() {
    const double edge = std::exp(-falloff);
    return radius * std::sqrt(-std::log(iso * (1.0 - edge) + edge) / falloff);
}

/// White light from right, top and front, one a channel: a fully diffuse surface shows the positive part of its normal.
std::vector<Light> lights_along_axes() {
    return {{Vec3(1.0, 0.0, 0.0), Vec3(1.0, 0.0, 0.0), LightSpace::eye},
            {Vec3(0.0, 2.0, 0.0), Vec3(0.0, 1.0, 0.0), LightSpace::eye},
            {Vec3(0.0, 0.0, 0.5), Vec3(0.0, 0.0, 1.0), LightSpace::eye}};
}

Scene iso_ball(double spacing) {
    Scene scene =
        make_scene(one_kernel(radius, falloff), TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 0.0}}));
    scene.mode = Mode::isosurface;
    scene.iso_values = {iso};
    scene.slice_spacing = spacing;
    scene.lights = lights_along_axes();
    scene.material = {0.0, 1.0, 0.0, 1.0, false};
    return scene;
}

/// A scene that is never drawn, for its lights and material.
Scene lit(const std::vector<Light>& lights, const Material& material) {
    Scene scene = make_scene(one_kernel(), TransferFunction({{0.0, Vec3(0.0), 0.0}, {1.0, Vec3(1.0), 1.0}}));
    scene.reference_length = 1.0;
    scene.lights = lights;
    scene.material = material;
    return scene;
}

Vec3 lit_color(const std::vector<Light>& lights, const Material& material, const Vec3& color, const Vec3& gradient,
               const Vec3& viewer = Vec3(0.0, 0.0, 1.0)) {
    return Shader(CountedScene(lit(lights, material)), front_camera(2.0)).shade(color, gradient, {viewer});
}

void expect_color(const Vec3& actual, const Vec3& expected) {
    for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(actual[c], expected[c], 1e-15);
    }
}

} // namespace

TEST(Phong, ValuesByHand) {
    const Vec3 color(0.5, 0.25, 1.0);
    const Material material{0.1, 0.8, 0.5, 2.0, false};
    // No light: the colour itself.
    expect_color(lit_color({}, material, color, Vec3(0.0, 0.0, -3.0)), color);
    // N = (0, 0, 1), L the same: R.V = 1.
    const Light head{Vec3(0.0, 0.0, 7.0), Vec3(1.0, 2.0, 0.5), LightSpace::eye};
    expect_color(lit_color({head}, material, color, Vec3(0.0, 0.0, -3.0)),
                 Vec3(0.05 + 0.4 + 0.5, 0.025 + 2.0 * (0.2 + 0.5), 0.1 + 0.5 * (0.8 + 0.5)));
    // L = (0.6, 0, 0.8): N.L = 0.8, R = (-0.6, 0, 0.8), (R.V)^2 = 0.64, the highlight times N.L as well.
    const Light side{Vec3(3.0, 0.0, 4.0), Vec3(1.0), LightSpace::eye};
    const double highlight = 0.8 * 0.5 * 0.64;
    expect_color(lit_color({side}, material, color, Vec3(0.0, 0.0, -3.0)),
                 Vec3(0.05 + 0.8 * 0.4 + highlight, 0.025 + 0.8 * 0.2 + highlight, 0.1 + 0.8 * 0.8 + highlight));
    // Perspective: V along the ray.
    const double towards = 0.5 * 0.8 * std::pow(-0.6 * 0.28 + 0.8 * 0.96, 2.0);
    expect_color(lit_color({side}, material, color, Vec3(0.0, 0.0, -3.0), Vec3(0.28, 0.0, 0.96)),
                 Vec3(0.05 + 0.8 * 0.4 + towards, 0.025 + 0.8 * 0.2 + towards, 0.1 + 0.8 * 0.8 + towards));
    // Two lights add; ambient counts once.
    const Vec3 both = lit_color({head, side}, material, color, Vec3(0.0, 0.0, -3.0));
    expect_color(both, lit_color({head}, material, color, Vec3(0.0, 0.0, -3.0)) +
                           lit_color({side}, material, color, Vec3(0.0, 0.0, -3.0)) - 0.1 * color);
}

TEST(Phong, TwoSidedTurnsTheNormalForEachLight) {
    const Vec3 color(0.5, 0.25, 1.0), away(0.0, 0.0, 2.0);
    Material material{0.1, 0.8, 0.5, 2.0, false};
    const Light front{Vec3(0.0, 0.0, 1.0), Vec3(1.0), LightSpace::eye},
        behind{Vec3(0.0, 0.6, -0.8), Vec3(1.0), LightSpace::eye};
    expect_color(lit_color({front}, material, color, away), 0.1 * color);
    const Vec3 from_behind = lit_color({behind}, material, color, away);
    EXPECT_GT(from_behind.x, 0.1 * color.x);
    material.two_sided = true;
    expect_color(lit_color({front}, material, color, away), 0.9 * color + Vec3(0.5));
    // The light that N faces already sees no difference.
    expect_color(lit_color({behind}, material, color, away), from_behind);
    expect_color(lit_color({front, behind}, material, color, away), 0.8 * color + Vec3(0.5) + from_behind);
}

TEST(Phong, WeakGradientsFade) {
    const Material material{0.0, 1.0, 0.0, 1.0, false};
    const Light head{};
    // g_0 is 10^-3 here.
    expect_color(lit_color({head}, material, Vec3(1.0), Vec3(0.0, 0.0, -1e-3)), Vec3(1.0));
    expect_color(lit_color({head}, material, Vec3(1.0), Vec3(0.0, 0.0, -2.5e-4)), Vec3(0.25));
    expect_color(lit_color({head}, material, Vec3(1.0), Vec3(0.0)), Vec3(0.0));
    Scene scene = lit({head}, material);
    scene.reference_length = 0.1;
    const Vec3 per_length = *scene.reference_length * Vec3(0.0, 0.0, -1e-3);
    expect_color(Shader(CountedScene(scene), front_camera(2.0)).shade(Vec3(1.0), per_length, {Vec3(0.0, 0.0, 1.0)}),
                 Vec3(0.1));
}

TEST(Phong, WorldLightsTurnWithTheWorld) {
    const Material material{0.0, 1.0, 0.0, 1.0, false};
    const Camera camera = Camera::orthographic(Vec3(5.0, 0.0, 0.0), Vec3(0.0), Vec3(0.0, 0.0, 1.0), 2.0);
    // Seen from +x with z up: the world's x is towards the viewer, y to the right, z up.
    const Scene scene = lit({{Vec3(0.6, 0.8, 0.0), Vec3(1.0), LightSpace::world}}, material);
    const Shader shader(CountedScene(scene), camera);
    EXPECT_NEAR(shader.shade(Vec3(1.0), Vec3(0.0, 0.0, -1.0), {Vec3(0.0, 0.0, 1.0)}).x, 0.6, 1e-15);
    EXPECT_NEAR(shader.shade(Vec3(1.0), Vec3(-1.0, 0.0, 0.0), {Vec3(0.0, 0.0, 1.0)}).x, 0.8, 1e-15);
}

TEST(Isosurface, DepthOfABall) {
    Request request;
    request.depth = true;
    for (const bool perspective : {false, true}) {
        const Camera camera = perspective
                                  ? Camera::perspective(Vec3(0.0, 0.0, 6.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 10.0)
                                  : front_camera(1.1, 6.0);
        std::vector<double> steps, errors, wrong;
        for (double spacing = 0.2; spacing > 0.01; spacing /= 2.0) {
            const Picture picture = render(iso_ball(spacing), camera, Size{11, 11}, request);
            std::vector<double> expected;
            for (int j = 0; j < 11; ++j) {
                for (int i = 0; i < 11; ++i) {
                    const double x = 2.0 * (i + 0.5) / 11.0 - 1.0, y = 1.0 - 2.0 * (j + 0.5) / 11.0;
                    const double h = perspective ? std::tan(5.0 * pi / 180.0) : 0.55, r = iso_radius();
                    if (perspective) {
                        // |t (X, Y, -1) + (0, 0, 6)| = r
                        const double a = 1.0 + h * h * (x * x + y * y);
                        expected.push_back((6.0 - std::sqrt(36.0 - a * (36.0 - r * r))) / a);
                    } else {
                        expected.push_back(6.0 - std::sqrt(r * r - h * h * (x * x + y * y)));
                    }
                }
            }
            steps.push_back(spacing);
            errors.push_back(root_mean_square(picture.depth, expected));
            std::vector<double> late = picture.depth;
            for (double& depth : late) {
                depth += 0.05 * spacing;
            }
            wrong.push_back(root_mean_square(late, expected));
            for (std::size_t n = 0; n < expected.size(); ++n) {
                EXPECT_EQ(picture.rgba[4 * n + 3], 1.0);
            }
        }
        std::printf("isosurface depth: order %.2f, finest error %.1e; a share of the step late: order %.2f\n",
                    fitted_order(steps, errors), errors.back(), fitted_order(steps, wrong));
        EXPECT_GE(fitted_order(steps, errors), 1.7);
        EXPECT_LT(errors.back(), 1e-3);
        EXPECT_LT(fitted_order(steps, wrong), 1.7);
    }
}

TEST(Isosurface, NormalOfABall) {
    for (const bool perspective : {false, true}) {
        std::vector<double> steps, errors;
        for (int pixels = 16; pixels <= 128; pixels *= 2) {
            const double spacing = 1.6 / pixels;
            const Camera camera = perspective
                                      ? Camera::perspective(Vec3(0.0, 0.0, 3.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 17.0)
                                      : front_camera(0.9, 3.0);
            Request request;
            request.depth = true;
            const Picture picture = render(iso_ball(spacing), camera, Size{pixels, pixels}, request);
            double sum = 0.0, sum_forgetful = 0.0;
            int count = 0;
            // The quadrant in which all parts of the normal are positive.
            for (int j = 0; j < pixels / 2; ++j) {
                for (int i = pixels / 2; i < pixels; ++i) {
                    const std::size_t n = static_cast<std::size_t>(j * pixels + i);
                    const double x = 2.0 * (i + 0.5) / pixels - 1.0, y = 1.0 - 2.0 * (j + 0.5) / pixels;
                    const double t = picture.depth[n];
                    const double h = perspective ? std::tan(8.5 * pi / 180.0) * t : 0.45;
                    const Vec3 normal = glm::normalize(Vec3(x * h, y * h, 3.0 - t));
                    const Vec3 shown(picture.rgba[4 * n], picture.rgba[4 * n + 1], picture.rgba[4 * n + 2]);
                    sum += glm::dot(shown - normal, shown - normal);
                    // As if the difference between slices ran along the view axis and not along the pixel's ray.
                    const double along = perspective ? (x * normal.x + y * normal.y) * std::tan(8.5 * pi / 180.0) : 0.0;
                    const Vec3 forgetful = glm::normalize(Vec3(normal.x, normal.y, normal.z - along));
                    sum_forgetful += glm::dot(shown - forgetful, shown - forgetful);
                    ++count;
                }
            }
            steps.push_back(spacing);
            errors.push_back(std::sqrt(sum / count));
            EXPECT_TRUE(!perspective || std::sqrt(sum_forgetful / count) > 1e-2);
        }
        std::printf("isosurface normal: order %.2f, finest error %.1e\n", fitted_order(steps, errors), errors.back());
        EXPECT_GE(fitted_order(steps, errors), 1.7);
        EXPECT_LT(errors.back(), 1e-3);
    }
}

TEST(Isosurface, EitherWayRound) {
    // From outside, 0, down to a value below the iso value.
    Scene scene = iso_ball(0.01);
    scene.fields = {make_field({-1.0}, {1, 1, 1}, plain_options(radius, falloff))};
    scene.iso_values = {-iso};
    scene.material.two_sided = true;
    Request request;
    request.depth = true;
    const Picture picture = render(scene, front_camera(0.2, 6.0), Size{1, 1}, request);
    EXPECT_NEAR(picture.depth[0], 6.0 - iso_radius(), 1e-4);
    EXPECT_EQ(picture.rgba[3], 1.0);
    EXPECT_NEAR(picture.rgba[2], 1.0, 1e-3);
    scene.iso_values = {-1.5};
    const Picture nothing = render(scene, front_camera(0.2, 6.0), Size{1, 1}, request);
    EXPECT_EQ(nothing.rgba[3], 0.0);
    EXPECT_EQ(nothing.depth[0], std::numeric_limits<double>::infinity());
}

TEST(Isosurface, IsCutOpenByTheNearPlane) {
    // A wide slab: the first slice is above the iso value already, so the crossing is that to the slice behind it.
    Scene scene = iso_ball(1.0);
    Request request;
    request.depth = true;
    const auto seen = [&](double near) {
        const Camera camera = Camera::perspective(Vec3(0.0, 0.0, 0.6), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 10.0, near);
        return render(scene, camera, Size{1, 1}, request);
    };
    // Slices at 0.6 + n + 1/2; that at 0.1 is in front of near, so 1.1 is the first.
    const Picture picture = seen(0.5);
    EXPECT_EQ(picture.first_slice, 0);
    const double first = kernel_value(0.5 / radius, falloff), second = kernel_value(1.5 / radius, falloff);
    ASSERT_GT(first, iso);
    ASSERT_LT(second, iso);
    EXPECT_NEAR(picture.depth[0], 1.1 + (first - iso) / (first - second), 1e-14);
    EXPECT_EQ(picture.rgba[3], 1.0);
    // The surface is seen from inside: its normal points away.
    EXPECT_EQ(picture.rgba[2], 0.0);
    // With the slice at 0.1 nothing but that slice changes.
    EXPECT_NEAR(seen(0.05).depth[0], picture.depth[0], 1e-14);
    EXPECT_EQ(seen(0.05).first_slice, -1);
}

} // namespace sheetsplat::reference::testing

// Scattered ellipsoids on the GL backend against the float64 reference.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {
namespace {

bool gl_available() {
    for (const DeviceReport& report : devices()) {
        if (report.backend == "gl" && report.available) {
            return true;
        }
    }
    return false;
}

glm::dquat random_rotation(std::mt19937& random) {
    std::normal_distribution<double> normal;
    glm::dquat q(normal(random), normal(random), normal(random), normal(random));
    return glm::normalize(q);
}

/// Kernels in the unit cube whose volumes are those of balls of `radius`; aspect: longest over shortest semi-axis.
std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, double aspect, unsigned seed = 5,
                                            EllipsoidFieldOptions options = {}, bool weights = false) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3 at(uniform(random), uniform(random), uniform(random));
        arrays.centers.push_back(at);
        arrays.values.push_back(0.2 + 0.8 * std::exp(-8.0 * glm::dot(at - 0.5, at - 0.5)));
        if (aspect == 1.0) {
            arrays.radii.push_back(radius * (0.6 + 0.8 * uniform(random)));
        } else {
            const double own = std::pow(aspect, uniform(random));
            Vec3 axes = uniform(random) < 0.5 ? Vec3(own, 1.0, 1.0) : Vec3(own, own, 1.0);
            axes *= radius / std::cbrt(axes.x * axes.y * axes.z);
            arrays.scales.push_back(axes);
            arrays.rotations.push_back(random_rotation(random));
        }
        if (weights) {
            arrays.weights.push_back(std::pow(10.0, 2.0 * uniform(random) - 1.0));
        }
    }
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

Scene scene_of(const std::shared_ptr<const Field>& field) {
    Scene scene{{field},
                TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.08}, {1.0, {1.0, 0.8, 0.2}, 0.4}})};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    return scene;
}

Camera askew(const Field& field, Projection projection, double margin = 1.0) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, margin, 40.0);
}

Difference against_reference(const Scene& scene, const Camera& camera, Size size, RendererOptions options,
                             const std::string& name, const Outputs& outputs = {}) {
    options.backend = Backend::gl;
    Renderer gl(options);
    RendererOptions exact;
    exact.backend = Backend::reference;
    Renderer reference(exact);
    const Image picture = gl.render(scene, camera, size, outputs);
    const Image judge = reference.render(scene, camera, size, outputs);
    const bool scalar = !judge.scalar.empty();
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    Difference difference = scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    if (scalar && largest > 1.0) {
        difference.rmse /= largest;
        difference.p99_9 /= largest;
        difference.maximum /= largest;
    }
    std::printf("%-60s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9,
                difference.maximum, largest);
    EXPECT_GT(largest, 0.01) << name;
    if (outputs.coverage) {
        double most = 1.0;
        for (float value : judge.coverage) {
            most = std::max(most, double(value));
        }
        EXPECT_LT(compare(picture.coverage, judge.coverage, 1).rmse / most, 2e-5) << name << " coverage";
    }
    return difference;
}

class Ellipsoids : public ::testing::TestWithParam<std::tuple<double, Mode, Sampling, Projection, Packing>> {};

TEST_P(Ellipsoids, AreTheReferencesPicture) {
    if (!gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const auto [aspect, mode, sampling, projection, packing] = GetParam();
    const auto field = cloud(120, 0.14, aspect);
    Scene scene = scene_of(field);
    scene.mode = mode;
    scene.sampling = sampling;
    scene.iso_value = 0.4;
    scene.slice_spacing = 0.03;
    RendererOptions options;
    options.packing = packing;
    const std::string name = "aspect " + std::to_string(static_cast<int>(aspect)) +
                             (mode == Mode::composite ? " composite" : mode == Mode::isosurface ? " iso" : " xray") +
                             (sampling == Sampling::slab ? " slab" : " point") +
                             (projection == Projection::perspective ? " persp " : " ortho ") + to_string(packing);
    const Difference difference = against_reference(scene, askew(*field, projection, 0.8), {56, 48}, options, name);
    const bool jumps = mode == Mode::isosurface;
    EXPECT_LT(difference.rmse, jumps ? 1e-4 : 2e-5);
    EXPECT_LT(difference.p99_9, jumps ? 1e-3 : 2e-4);
}

INSTANTIATE_TEST_SUITE_P(All, Ellipsoids,
                         ::testing::Combine(::testing::Values(1.0, 5.0, 1000.0),
                                            ::testing::Values(Mode::composite, Mode::isosurface, Mode::xray),
                                            ::testing::Values(Sampling::point, Sampling::slab),
                                            ::testing::Values(Projection::orthographic, Projection::perspective),
                                            ::testing::Values(Packing::wide, Packing::paper)));

} // namespace
} // namespace sheetsplat

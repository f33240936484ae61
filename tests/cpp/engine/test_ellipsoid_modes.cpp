// The two ways of drawing ellipsoids that are kept for comparison, the 2006 paper's step by step and gathering by
// pixels, against the float64 reference.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {
namespace {

const bool gl_available = [] {
    const auto reports = devices();
    return std::any_of(reports.begin(), reports.end(), [](const DeviceReport& report) {
        return report.backend == "gl" && report.available;
    });
}();

/// Kernels in the unit cube whose volumes are those of balls of `radius`; aspect: longest over shortest semi-axis.
std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, double aspect, unsigned seed = 5,
                                            EllipsoidFieldOptions options = {}, bool weights = false) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
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
            const glm::dquat q(normal(random), normal(random), normal(random), normal(random));
            arrays.rotations.push_back(glm::normalize(q));
        }
        if (weights) {
            arrays.weights.push_back(std::pow(10.0, 2.0 * uniform(random) - 1.0));
        }
    }
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

Scene scene_of(const std::shared_ptr<const Field>& field) {
    Scene scene{
        {field},
        TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.08}, {1.0, {1.0, 0.8, 0.2}, 0.4}})};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    scene.slice_spacing = 0.03;
    return scene;
}

Camera askew(double height = 1.6) {
    const Vec3 middle(0.5);
    return Camera::orthographic(middle + Vec3(1.5, 1.05, 2.4), middle, Vec3(0, 1, 0), height);
}

RendererOptions with(const std::string& mode, std::map<std::string, bool> effects = {}) {
    RendererOptions options;
    options.backend = Backend::gl;
    options.effects = std::move(effects);
    options.effects[mode] = true;
    return options;
}

Difference between(const Image& picture, const Image& judge, const std::string& name) {
    const bool scalar = !judge.scalar.empty();
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    EXPECT_GT(largest, 0.01) << name;
    Difference difference = scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    if (scalar && largest > 1.0) {
        difference.rmse /= largest;
        difference.p99_9 /= largest;
        difference.maximum /= largest;
    }
    std::printf("%-60s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9,
                difference.maximum, largest);
    return difference;
}

Image by_reference(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {}) {
    RendererOptions exact;
    exact.backend = Backend::reference;
    return Renderer(exact).render(scene, camera, size, outputs);
}

const std::vector<std::string> modes{"paper_slicing", "gather"};

struct Trial {
    const char* name;
    std::size_t kernels;
    double radius, aspect;
    double slice_spacing = 0.03;
    Size size{56, 48};
};
std::ostream& operator<<(std::ostream& out, const Trial& trial) { return out << trial.name; }

class RandomFields : public ::testing::TestWithParam<Trial> {};

TEST_P(RandomFields, AreTheReferencesPicture) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const Trial& trial = GetParam();
    Scene scene = scene_of(cloud(trial.kernels, trial.radius, trial.aspect));
    scene.slice_spacing = trial.slice_spacing;
    const Image judge = by_reference(scene, askew(), trial.size);
    for (const std::string& mode : modes) {
        Renderer renderer(with(mode));
        const Image picture = renderer.render(scene, askew(), trial.size);
        const Difference difference = between(picture, judge, mode + " " + trial.name);
        EXPECT_LT(difference.rmse, 2e-5);
        EXPECT_LT(difference.p99_9, 2e-4);
        EXPECT_TRUE(picture.plan->has(mode));
    }
}

INSTANTIATE_TEST_SUITE_P(All, RandomFields,
                         ::testing::Values(Trial{"1 sphere", 1, 0.4, 1.0, 0.1}, Trial{"1 of 1:1,000", 1, 0.3, 1000.0},
                                           Trial{"100 spheres", 100, 0.14, 1.0}, Trial{"120 of 1:5", 120, 0.14, 5.0},
                                           Trial{"300 of 1:50", 300, 0.14, 50.0},
                                           Trial{"300 of 1:1,000", 300, 0.14, 1000.0},
                                           Trial{"10,000 of 1:20", 10000, 0.045, 20.0, 0.05, {40, 36}},
                                           Trial{"10,000 of 1:1,000", 10000, 0.045, 1000.0, 0.05, {40, 36}}));

} // namespace
} // namespace sheetsplat

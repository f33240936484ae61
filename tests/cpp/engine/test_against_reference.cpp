// The GL backend against the float64 reference, over everything that a regular field can be asked for.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {
namespace {

/// A soft random volume: a few blobs, some noise.
std::shared_ptr<const RegularField> blobs(RegularFieldOptions options, std::size_t n = 14, unsigned seed = 3) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<float> samples(n * n * n);
    std::vector<std::array<double, 5>> centres;
    for (int b = 0; b < 5; ++b) {
        centres.push_back({uniform(random) * double(n), uniform(random) * double(n), uniform(random) * double(n), 1.5 + 2.0 * uniform(random), 0.4 + 0.6 * uniform(random)});
    }
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                double value = 0.0;
                for (const auto& c : centres) {
                    const double d2 = std::pow(double(i) - c[0], 2) + std::pow(double(j) - c[1], 2) + std::pow(double(k) - c[2], 2);
                    value += c[4] * std::exp(-d2 / (2 * c[3] * c[3]));
                }
                samples[(k * n + j) * n + i] = static_cast<float>(value + 0.02 * uniform(random));
            }
        }
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n}, options);
}

TransferFunction ramp() {
    return TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.15}, {1.1, {1.0, 0.8, 0.2}, 0.6}});
}

Scene scene_of(const std::shared_ptr<const RegularField>& field) {
    Scene scene{{field}, ramp()};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    return scene;
}

Camera askew(const RegularField& field, Projection projection) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, 1.0, 40.0);
}

Difference against_reference(const Scene& scene, const Camera& camera, Size size, RendererOptions options, const Outputs& outputs, const std::string& name) {
    options.backend = Backend::gl;
    Renderer gl(options);
    RendererOptions exact;
    exact.backend = Backend::reference;
    Renderer reference(exact);
    const Image picture = gl.render(scene, camera, size, outputs);
    const Image judge = reference.render(scene, camera, size, outputs);
    const bool scalar = !judge.scalar.empty();
    const Difference difference = scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    std::printf("%-70s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9, difference.maximum, largest);
    EXPECT_GT(largest, 0.05) << name;
    if (outputs.coverage) {
        EXPECT_LT(compare(picture.coverage, judge.coverage, 1).rmse, 2e-5) << name << " coverage";
    }
    return difference;
}

bool gl_available() {
    for (const DeviceReport& report : devices()) {
        if (report.backend == "gl" && report.available) {
            return true;
        }
    }
    return false;
}

struct Case {
    Mode mode;
    Sampling sampling;
    Projection projection;
    Lattice lattice;
    Normalization normalization;
    Packing packing;
};

class Matrix : public ::testing::TestWithParam<std::tuple<Mode, Sampling, Projection, Lattice, Normalization, Packing>> {};

TEST_P(Matrix, IsTheReferencesPicture) {
    if (!gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const auto [mode, sampling, projection, lattice, normalization, packing] = GetParam();
    RegularFieldOptions field_options;
    field_options.lattice = lattice;
    field_options.normalization = normalization;
    field_options.spacing = lattice == Lattice::bcc ? Vec3(1.2) : Vec3(1.0, 1.0, 1.0);
    auto field = blobs(field_options);
    Scene scene = scene_of(field);
    scene.mode = mode;
    scene.sampling = sampling;
    scene.iso_value = 0.45;
    if (normalization == Normalization::none) {
        const double c = field->lattice_constant();
        scene.transfer_function = TransferFunction({{0.1 * c, {0.1, 0.2, 0.9}, 0.0}, {0.5 * c, {0.2, 0.9, 0.3}, 0.15}, {1.1 * c, {1.0, 0.8, 0.2}, 0.6}});
        scene.iso_value = 0.45 * c;
    }
    RendererOptions options;
    options.packing = packing;
    const std::string name = std::string(mode == Mode::composite ? "composite" : mode == Mode::isosurface ? "iso" : mode == Mode::xray ? "xray" : "mip") +
                             (sampling == Sampling::slab ? " slab" : " point") + (projection == Projection::perspective ? " persp" : " ortho") +
                             (lattice == Lattice::bcc ? " bcc" : " cart") + (normalization == Normalization::none ? " none" : normalization == Normalization::lattice ? " lattice" : " threshold") +
                             " " + to_string(packing);
    const Difference difference = against_reference(scene, askew(*field, projection), {48, 40}, options, {}, name);
    if (mode == Mode::isosurface) {
        EXPECT_LT(difference.p99_9, 1e-3);
    } else {
        EXPECT_LT(difference.rmse, 2e-5);
        EXPECT_LT(difference.p99_9, 2e-4);
    }
}

INSTANTIATE_TEST_SUITE_P(All, Matrix,
                         ::testing::Combine(::testing::Values(Mode::composite, Mode::isosurface, Mode::xray, Mode::mip),
                                            ::testing::Values(Sampling::point, Sampling::slab),
                                            ::testing::Values(Projection::orthographic, Projection::perspective),
                                            ::testing::Values(Lattice::cartesian, Lattice::bcc),
                                            ::testing::Values(Normalization::none, Normalization::lattice, Normalization::threshold),
                                            ::testing::Values(Packing::wide, Packing::paper)));

} // namespace
} // namespace sheetsplat

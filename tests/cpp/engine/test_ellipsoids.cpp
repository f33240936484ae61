// Scattered ellipsoids on the GL backend against the float64 reference.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
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
    Scene scene{
        {field},
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
    Renderer renderer(options);
    RendererOptions exact;
    exact.backend = Backend::reference;
    Renderer reference(exact);
    const Image picture = renderer.render(scene, camera, size, outputs);
    EXPECT_EQ(picture.plan->backend, options.backend) << name;
    const Image judge = reference.render(scene, camera, size, outputs);
    const bool scalar = !judge.scalar.empty();
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    const Difference difference =
        scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    std::printf("%-60s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9,
                difference.maximum, largest);
    EXPECT_GT(largest, 0.01) << name;
    if (outputs.coverage) {
        EXPECT_LT(compare(picture.coverage, judge.coverage, 1).rmse, 2e-5) << name << " coverage";
    }
    return difference;
}

/// What draws: a backend, and on gl how slices lie in its buffers.
enum class Way { wide, paper, cpu };
const char* to_string(Way way) { return way == Way::wide ? "wide" : way == Way::paper ? "paper" : "cpu"; }

RendererOptions options_of(Way way) {
    RendererOptions options;
    options.backend = way == Way::cpu ? Backend::cpu : Backend::gl;
    options.packing = way == Way::paper ? Packing::paper : way == Way::wide ? Packing::wide : Packing::automatic;
    return options;
}

class Ellipsoids : public ::testing::TestWithParam<std::tuple<double, Mode, Sampling, Projection, Way>> {};

TEST_P(Ellipsoids, AreTheReferencesPicture) {
    const auto [aspect, mode, sampling, projection, way] = GetParam();
    if (way != Way::cpu && !gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const auto field = cloud(120, 0.14, aspect);
    Scene scene = scene_of(field);
    scene.mode = mode;
    scene.sampling = sampling;
    scene.iso_values = {0.4};
    scene.slice_spacing = 0.03;
    const RendererOptions options = options_of(way);
    const std::string name = "aspect " + std::to_string(static_cast<int>(aspect)) +
                             (mode == Mode::composite    ? " composite"
                              : mode == Mode::isosurface ? " iso"
                                                         : " xray") +
                             (sampling == Sampling::slab ? " slab" : " point") +
                             (projection == Projection::perspective ? " persp " : " ortho ") + to_string(way);
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
                                            ::testing::Values(Way::wide, Way::paper, Way::cpu)));

struct Draw {
    const char* name;
    Packing packing = Packing::wide;
    Tagging tagging = Tagging::automatic;
    std::map<std::string, bool> effects{};
    int tile_size = 0;
    int tags_per_clear = 0;
    Backend backend = Backend::gl;
    Precision precision = Precision::automatic;
    int threads = 0;
};

std::ostream& operator<<(std::ostream& out, const Draw& draw) { return out << draw.name; }

class EllipsoidDrawing : public ::testing::TestWithParam<Draw> {};

/// Saturates, so that everything that looks for opaque pixels has something to find.
Scene dense(const std::shared_ptr<const Field>& field) {
    Scene scene = scene_of(field);
    scene.transfer_function =
        TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 0.5}, {1.0, {1.0, 0.8, 0.2}, 0.9}});
    return scene;
}

TEST_P(EllipsoidDrawing, IsTheReferencesPicture) {
    const Draw& draw = GetParam();
    if (draw.backend == Backend::gl && !gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    RendererOptions options;
    options.backend = draw.backend;
    options.precision = draw.precision;
    options.threads = draw.threads;
    options.packing = draw.packing;
    options.tagging = draw.tagging;
    options.effects = draw.effects;
    options.tile_size = draw.tile_size;
    options.tags_per_clear = draw.tags_per_clear;
    for (const double aspect : {1.0, 20.0}) {
        for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
            const auto field = cloud(300, 0.16, aspect);
            Scene scene = dense(field);
            scene.slice_spacing = 0.02;
            Difference difference;
            try {
                difference = against_reference(scene, askew(*field, projection, 0.7), {61, 47}, options,
                                               std::string(draw.name) + " aspect " + std::to_string(aspect));
            } catch (const Unsupported& error) {
                if (draw.tagging == Tagging::depth_bounds) {
                    GTEST_SKIP() << error.what();
                }
                throw;
            }
            EXPECT_LT(difference.rmse, 2e-5);
            EXPECT_LT(difference.p99_9, 2e-4);
        }
    }
}

Draw on_cpu(const char* name, int tile_size = 0, Precision precision = Precision::automatic, int threads = 0,
            std::map<std::string, bool> effects = {}) {
    return {name,   Packing::automatic, Tagging::automatic, std::move(effects), tile_size, 0, Backend::cpu, precision,
            threads};
}

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidDrawing,
    ::testing::Values(
        Draw{"wide tiles", Packing::wide, Tagging::tiles}, Draw{"wide off", Packing::wide, Tagging::off},
        Draw{"wide equal", Packing::wide, Tagging::depth_equal},
        Draw{"wide depth_bounds", Packing::wide, Tagging::depth_bounds},
        Draw{"paper equal", Packing::paper, Tagging::depth_equal}, Draw{"paper off", Packing::paper, Tagging::off},
        Draw{"wide elimination", Packing::wide, Tagging::tiles, {{"elimination", true}}},
        Draw{"no elimination", Packing::wide, Tagging::tiles, {{"elimination", false}}},
        Draw{"paper elimination", Packing::paper, Tagging::depth_equal, {{"elimination", true}}},
        Draw{"restarted tags", Packing::wide, Tagging::depth_equal, {}, 0, 3},
        Draw{"small tiles", Packing::wide, Tagging::tiles, {}, 17},
        Draw{"small tiles of paper", Packing::paper, Tagging::tiles, {}, 17},
        Draw{"resident", Packing::wide, Tagging::tiles, {{"resident_sections", true}}},
        Draw{"resident in paper", Packing::paper, Tagging::depth_equal, {{"resident_sections", true}}},
        Draw{"resident in small tiles", Packing::wide, Tagging::tiles, {{"resident_sections", true}}, 17},
        Draw{
            "resident and fine", Packing::wide, Tagging::tiles, {{"resident_sections", true}, {"fine_gradient", true}}},
        Draw{"opacity buffer", Packing::wide, Tagging::tiles, {{"opacity_buffer", true}}},
        Draw{"no culling", Packing::wide, Tagging::tiles, {{"culling", false}}},
        Draw{"fine", Packing::wide, Tagging::tiles, {{"fine_gradient", true}}, 0, 0},
        Draw{"everything",
             Packing::wide,
             Tagging::depth_equal,
             {{"empty_test", true},
              {"weight", true},
              {"specular", true},
              {"opacity_correction", true},
              {"opacity_stop", true},
              {"compensation", true}}},
        on_cpu("cpu"), on_cpu("cpu in small tiles", 17), on_cpu("cpu in tiny tiles", 8),
        on_cpu("cpu float64", 0, Precision::float64), on_cpu("cpu float64 in small tiles", 17, Precision::float64),
        on_cpu("cpu one thread", 0, Precision::automatic, 1), on_cpu("cpu five threads", 17, Precision::automatic, 5),
        on_cpu("cpu no culling", 0, Precision::automatic, 0, {{"culling", false}}),
        on_cpu("cpu everything", 0, Precision::automatic, 0,
               {{"empty_test", true},
                {"weight", true},
                {"specular", true},
                {"opacity_correction", true},
                {"opacity_stop", true}})));

struct Case {
    const char* name;
    std::function<std::pair<Scene, Camera>()> make;
    double rmse = 2e-5, p99_9 = 2e-4;
};
std::ostream& operator<<(std::ostream& out, const Case& one) { return out << one.name; }

class EllipsoidCase : public ::testing::TestWithParam<Case> {};

TEST_P(EllipsoidCase, IsTheReferencesPicture) {
    const auto [scene, camera] = GetParam().make();
    for (const Way way : {Way::wide, Way::paper, Way::cpu}) {
        if (way != Way::cpu && !gl_available()) {
            continue;
        }
        Outputs outputs;
        outputs.coverage = way != Way::paper && scene.fields.size() == 1;
        const Difference difference = against_reference(scene, camera, {50, 44}, options_of(way),
                                                        std::string(GetParam().name) + " " + to_string(way), outputs);
        EXPECT_LT(difference.rmse, GetParam().rmse);
        EXPECT_LT(difference.p99_9, GetParam().p99_9);
    }
}

std::shared_ptr<const RegularField> lattice(Lattice lattice, Normalization normalization) {
    std::vector<float> samples(8 * 8 * 8);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        samples[i] = static_cast<float>(0.3 + 0.2 * std::sin(0.7 * double(i)));
    }
    RegularFieldOptions options;
    options.lattice = lattice;
    options.normalization = normalization;
    options.spacing = Vec3(0.11);
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{8, 8, 8}, options);
}

std::pair<Scene, Camera> seen(const std::shared_ptr<const Field>& field, Projection projection,
                              const std::function<void(Scene&)>& change = {}) {
    Scene scene = scene_of(field);
    scene.slice_spacing = 0.03;
    if (change) {
        change(scene);
    }
    return {scene, askew(*field, projection, 0.8)};
}

constexpr Projection ortho = Projection::orthographic;
constexpr Projection persp = Projection::perspective;

EllipsoidFieldOptions normalized(Normalization normalization, double w0 = 1.0) {
    EllipsoidFieldOptions options;
    options.normalization = normalization;
    options.w0 = w0;
    return options;
}

std::shared_ptr<const EllipsoidField> moved(double scale, const Vec3& by, double aspect) {
    const auto field = cloud(200, 0.14, aspect);
    EllipsoidArrays arrays = field->arrays();
    for (Vec3& center : arrays.centers) {
        center = center * scale + by;
    }
    for (double& radius : arrays.radii) {
        radius *= scale;
    }
    for (Vec3& axes : arrays.scales) {
        axes *= scale;
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidCase,
    ::testing::Values(
        Case{"weights", [] { return seen(cloud(200, 0.14, 5.0, 7, {}, true), ortho); }},
        Case{"small w0",
             [] { return seen(cloud(200, 0.14, 5.0, 7, normalized(Normalization::threshold, 0.05)), persp); }},
        Case{"none", [] { return seen(cloud(200, 0.1, 5.0, 7, normalized(Normalization::none)), ortho); }},
        Case{"opaque at 0",
             [] {
                 return seen(cloud(60, 0.14, 3.0), ortho, [](Scene& scene) {
                     scene.transfer_function =
                         TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.05}, {1.0, {1.0, 0.8, 0.2}, 0.4}});
                 });
             },
             1e-4, 1e-3},
        Case{"preintegrated",
             [] { return seen(cloud(100, 0.14, 3.0), persp, [](Scene& s) { s.preintegration = true; }); }},
        Case{"ewa",
             [] {
                 return seen(cloud(200, 0.02, 10.0), ortho, [](Scene& s) {
                     s.filter = Filter::ewa;
                     s.transfer_function = TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.0}, {0.3, {1.0, 0.8, 0.2}, 0.4}});
                 });
             }},
        Case{"ewa slab",
             [] {
                 return seen(cloud(200, 0.02, 10.0), persp, [](Scene& s) {
                     s.filter = Filter::ewa;
                     s.sampling = Sampling::slab;
                     s.transfer_function = TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.0}, {0.3, {1.0, 0.8, 0.2}, 0.4}});
                 });
             }},
        Case{"ewa of a lattice",
             [] {
                 return seen(lattice(Lattice::bcc, Normalization::lattice), persp,
                             [](Scene& s) { s.filter = Filter::ewa; });
             }},
        Case{"two quotients",
             [] {
                 return seen(cloud(100, 0.14, 5.0, 7), ortho,
                             [](Scene& s) { s.fields.push_back(cloud(100, 0.1, 2.0, 8)); });
             }},
        Case{"cartesian, bcc and ellipsoids",
             [] {
                 return seen(cloud(100, 0.14, 5.0, 7), persp, [](Scene& s) {
                     s.fields.push_back(lattice(Lattice::cartesian, Normalization::lattice));
                     s.fields.push_back(lattice(Lattice::bcc, Normalization::threshold));
                     s.sampling = Sampling::slab;
                 });
             }},
        Case{
            "three fields, opaque at 0",
            [] {
                return seen(cloud(40, 0.14, 5.0, 7), ortho, [](Scene& s) {
                    s.fields.push_back(lattice(Lattice::cartesian, Normalization::lattice));
                    s.fields.push_back(cloud(40, 0.1, 2.0, 8));
                    s.transfer_function = TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.05}, {1.0, {1.0, 0.8, 0.2}, 0.4}});
                });
            },
            1e-4, 1e-3},
        Case{"far away", [] { return seen(moved(1.0, Vec3(1e9, -2e9, 0.5e9), 5.0), ortho); }, 1e-4, 1e-3},
        Case{"tiny world",
             [] { return seen(moved(1e-6, Vec3(0.0), 5.0), persp, [](Scene& s) { s.slice_spacing = 0.03e-6; }); }},
        Case{"huge world",
             [] { return seen(moved(1e6, Vec3(0.0), 5.0), ortho, [](Scene& s) { s.slice_spacing = 0.03e6; }); }},
        Case{"close-up",
             [] {
                 auto [scene, camera] = seen(cloud(200, 0.14, 5.0), ortho);
                 return std::pair<Scene, Camera>{
                     scene, Camera::orthographic({0.5, 0.5, 3.0}, {0.5, 0.5, 0.0}, {0, 1, 0}, 1e-3)};
             }},
        Case{"close-up of slabs",
             [] {
                 auto [scene, camera] =
                     seen(cloud(200, 0.14, 5.0), persp, [](Scene& s) { s.sampling = Sampling::slab; });
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 3.0}, {0.5, 0.5, 0.0}, {0, 1, 0}, 0.02)};
             }},
        Case{"thin slices",
             [] {
                 return seen(cloud(30, 0.14, 5.0), persp, [](Scene& s) {
                     s.slice_spacing = 0.002;
                     s.reference_length = 0.03;
                 });
             }},
        Case{"inside",
             [] {
                 auto [scene, camera] = seen(cloud(200, 0.2, 5.0), persp);
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 0.5}, {0.5, 0.6, 0.0}, {0, 1, 0}, 80.0)};
             },
             1e-4, 1e-3},
        Case{"inside, slabs",
             [] {
                 auto [scene, camera] =
                     seen(cloud(200, 0.2, 5.0), persp, [](Scene& s) { s.sampling = Sampling::slab; });
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 0.5}, {0.5, 0.6, 0.0}, {0, 1, 0}, 80.0)};
             },
             1e-4, 1e-3},
        Case{"needles of 1:100,000",
             [] {
                 const auto needles = cloud(3000, 0.05, 1e5, 5, normalized(Normalization::none));
                 auto [scene, camera] = seen(needles, persp, [](Scene& s) {
                     s.transfer_function = TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.0}, {0.3, {1.0, 0.8, 0.2}, 0.4}});
                 });
                 return std::pair<Scene, Camera>{scene, Camera::fit(Box{Vec3(0.0), Vec3(1.0)}, Vec3(-0.5, -0.35, -0.8),
                                                                    Vec3(0, 1, 0), persp, 1.0, 40.0)};
             },
             1e-4, 1e-3}));

} // namespace
} // namespace sheetsplat

// Pictures in stages, what a renderer re-uses between pictures, and the choice of a backend.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "gl/context.hpp"
#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"
#include "support/draws.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

RendererOptions on(Backend backend) {
    RendererOptions options;
    options.backend = backend;
    return options;
}

std::shared_ptr<const RegularField> waves(std::size_t n = 24) {
    std::vector<float> samples(n * n * n);
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const Vec3 at = 2.0 * Vec3(double(i), double(j), double(k)) / double(n - 1) - 1.0;
                const double r = std::sqrt(at.x * at.x + at.y * at.y + at.z * at.z);
                const double bumps = 0.2 * std::sin(7.0 * at.x) * std::cos(6.0 * at.y + 1.0) * std::sin(5.0 * at.z);
                samples[(k * n + j) * n + i] = static_cast<float>(std::clamp(1.1 - 1.2 * r + bumps, 0.0, 1.0));
            }
        }
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n},
                                          test::zero_boundary());
}

std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, bool spheres) {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        arrays.centers.push_back(test::three([&] { return uniform(random); }));
        arrays.values.push_back(0.2 + 0.8 * uniform(random));
        if (spheres) {
            arrays.radii.push_back(radius * (0.7 + 0.6 * uniform(random)));
        } else {
            arrays.scales.push_back(radius * Vec3(1.5, 0.8, 0.8));
            arrays.rotations.push_back(test::rotation([&] { return normal(random); }));
        }
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

Scene scene_of(const std::shared_ptr<const Field>& field, bool lit = true) {
    Scene scene{
        {field},
        TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.15}, {1.0, {1.0, 0.8, 0.2}, 0.5}})};
    if (lit) {
        scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    }
    scene.iso_values = {0.45};
    return scene;
}

Camera askew(const Field& field, Projection projection = Projection::orthographic) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, 0.9, 40.0);
}

const std::vector<float>& pixels(const Image& image) { return image.rgba.empty() ? image.scalar : image.rgba; }

double rmse(const Image& a, const Image& b) {
    return compare(pixels(a), pixels(b), a.rgba.empty() ? 1 : 4, Gaps::left_out).rmse;
}

/// Small enough that no picture is done at once.
constexpr double at_once = 1e-6;

TEST(Stages, LastIsRendersPicture) {
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        const Scene scene = scene_of(waves());
        const Camera camera = askew(*scene.fields[0], projection);
        Renderer renderer(on(Backend::cpu));
        const Image plain = renderer.render(scene, camera, {90, 70}, {true, true});
        Stages stages(renderer, scene, camera, {90, 70}, {true, true}, at_once);
        double number = 0.0;
        Image image;
        while (!stages.done()) {
            image = stages.next();
            EXPECT_EQ(image.size.width, 90);
            EXPECT_EQ(image.rgba.size(), plain.rgba.size());
            EXPECT_EQ(image.coverage.size(), plain.coverage.size());
            EXPECT_EQ(image.depth.size(), plain.depth.size());
            EXPECT_EQ(image.stats.at("stage"), ++number);
            EXPECT_NE(stages.done(), image.stats.at("stage") < image.stats.at("stages"));
        }
        EXPECT_GT(number, 1.0);
        EXPECT_EQ(image.rgba, plain.rgba);
        EXPECT_EQ(image.coverage, plain.coverage);
        EXPECT_EQ(image.depth, plain.depth);
        EXPECT_LT(image.stats.at("estimated_rmse"), 2e-5);
        EXPECT_THROW(static_cast<void>(stages.next()), InvalidInput);
    }
}

struct Case {
    const char* name;
    std::function<Scene()> make;
    Projection projection = Projection::orthographic;
};

TEST(Stages, EstimatesAreWithinAFactorOfThree) {
    const auto change = [](Scene scene, const std::function<void(Scene&)>& how) {
        how(scene);
        return scene;
    };
    const std::vector<Case> cases{
        {"waves", [] { return scene_of(waves()); }},
        {"waves unlit", [] { return scene_of(waves(), false); }},
        {"waves in perspective", [] { return scene_of(waves()); }, Projection::perspective},
        {"waves, isosurface", [&] { return change(scene_of(waves()), [](Scene& s) { s.mode = Mode::isosurface; }); }},
        {"waves, x-ray", [&] { return change(scene_of(waves()), [](Scene& s) { s.mode = Mode::xray; }); }},
        {"waves of blocks", [] { return scene_of(waves(160)); }},
        {"waves of blocks, unlit", [] { return scene_of(waves(160), false); }, Projection::perspective},
        {"waves, closer slices", [&] { return change(scene_of(waves()), [](Scene& s) { s.slice_spacing = 0.5; }); }},
        {"spheres", [] { return scene_of(cloud(600, 0.1, true)); }},
        {"spheres unlit", [] { return scene_of(cloud(600, 0.1, true), false); }, Projection::perspective},
        {"ellipsoids", [] { return scene_of(cloud(600, 0.1, false)); }},
        {"ellipsoids, slabs",
         [&] { return change(scene_of(cloud(600, 0.1, false)), [](Scene& s) { s.sampling = Sampling::slab; }); }},
        {"ellipsoids, mip",
         [&] { return change(scene_of(cloud(600, 0.1, false)), [](Scene& s) { s.mode = Mode::mip; }); }},
        {"spheres on white",
         [&] { return change(scene_of(cloud(600, 0.1, true)), [](Scene& s) { s.background = Vec3(1.0); }); }},
    };
    Renderer renderer(on(Backend::cpu));
    double smallest = 1.0, largest = 0.0;
    for (const Case& one : cases) {
        const Scene scene = one.make();
        const Camera camera = askew(*scene.fields[0], one.projection);
        const Size size{128, 112};
        const Image last = renderer.render(scene, camera, size);
        Stages stages(renderer, scene, camera, size, {}, at_once);
        std::printf("%-24s", one.name);
        while (!stages.done()) {
            const Image image = stages.next();
            if (stages.done()) {
                break;
            }
            const double error = rmse(image, last), estimate = image.stats.at("estimated_rmse");
            std::printf("  %.1e (estimated %.1e)", error, estimate);
            EXPECT_LT(estimate, 3.0 * error) << one.name << ", stage " << image.stats.at("stage");
            EXPECT_GT(estimate, error / 3.0) << one.name << ", stage " << image.stats.at("stage");
            smallest = std::min(smallest, error);
            largest = std::max(largest, error);
        }
        std::printf("\n");
    }
    EXPECT_GT(largest, 12.0 * smallest) << "one number for all would be as good";
}

// Where pixels of a stage are wider than the distance of samples, it draws kernels of blocks.
TEST(Stages, CoarseOnesDrawFewerKernels) {
    const Scene scene = scene_of(waves(96));
    const Camera camera = askew(*scene.fields[0]);
    Renderer renderer(on(Backend::cpu));
    Stages stages(renderer, scene, camera, {96, 96}, {}, at_once);
    std::vector<double> kernels;
    Image image;
    while (!stages.done()) {
        image = stages.next();
        kernels.push_back(image.stats.at("kernels_visible"));
    }
    ASSERT_GT(kernels.size(), 2U);
    EXPECT_LT(kernels.front(), kernels.back() / 32.0);
    EXPECT_TRUE(std::is_sorted(kernels.begin(), kernels.end()));
    EXPECT_EQ(image.rgba, Renderer(on(Backend::cpu)).render(scene, camera, {96, 96}).rgba);
    // Another picture of the same renderer finds all levels as they were.
    Stages again(renderer, scene, camera, {96, 96}, {}, at_once);
    EXPECT_EQ(again.next().stats.at("kernels_visible"), kernels.front());
}

TEST(Stages, AreOneWherePicturesAreFast) {
    const Scene scene = scene_of(waves(8));
    const Camera camera = askew(*scene.fields[0]);
    Renderer renderer(on(Backend::cpu));
    static_cast<void>(renderer.render(scene, camera, {16, 16}));
    Stages stages(renderer, scene, camera, {16, 16}, {}, 10.0);
    EXPECT_EQ(stages.next().stats.at("stages"), 1.0);
    EXPECT_TRUE(stages.done());
    EXPECT_THROW(Stages(renderer, scene, camera, {16, 16}, {}, 0.0), InvalidInput);
    EXPECT_THROW(Stages(renderer, scene, camera, {16, 16}, {}, std::nan("")), InvalidInput);
    EXPECT_THROW(Stages(renderer, scene, camera, {0, 16}), InvalidInput);
}

// Also while errors of light are measured, which is after the picture is drawn.
TEST(Reuse, ARendererIsWholeAfterACancelAnywhere) {
    Scene scene = scene_of(waves(16));
    scene.shadows = true;
    const Camera camera = askew(*scene.fields[0]);
    const Size size{40, 40};
    const Image plain = Renderer(on(Backend::cpu)).render(scene, camera, size);
    int cancelled = 0;
    for (int last = 1;; last += 1 + last / 16) {
        Renderer renderer(on(Backend::cpu));
        int calls = 0;
        try {
            static_cast<void>(renderer.render(scene, camera, size, {}, [&](double) { return ++calls < last; }));
            EXPECT_LT(calls, last);
            break;
        } catch (const Cancelled&) {
            ++cancelled;
        }
        const Image again = renderer.render(scene, camera, size);
        ASSERT_EQ(again.rgba, plain.rgba) << "cancelled at call " << last;
        ASSERT_EQ(again.plan->expected_error(), plain.plan->expected_error()) << "cancelled at call " << last;
    }
    EXPECT_GT(cancelled, 10);
}

TEST(Stages, CanBeEndedBetweenAndWithin) {
    const Scene scene = scene_of(waves(48));
    const Camera camera = askew(*scene.fields[0]);
    const Size size{400, 400};
    Renderer renderer(on(Backend::cpu));
    const Image plain = renderer.render(scene, camera, size);
    Stages stages(renderer, scene, camera, size, {}, at_once);
    static_cast<void>(stages.next());
    EXPECT_THROW(static_cast<void>(stages.next([](double) { return false; })), Cancelled);
    EXPECT_FALSE(stages.done());
    // The stage that was ended is made anew, and the renderer draws as before.
    Image image;
    while (!stages.done()) {
        image = stages.next();
    }
    EXPECT_EQ(image.rgba, plain.rgba);

    int seen = 0;
    const auto whole = [&](const Image&, bool last) {
        ++seen;
        return !last;
    };
    EXPECT_TRUE(renderer.render_progressive(scene, camera, size, {}, whole));
    EXPECT_GE(seen, 1);
    RendererOptions slow = on(Backend::cpu);
    slow.threads = 1;
    slow.precision = Precision::float64;
    Renderer other(slow);
    seen = 0;
    const bool done = other.render_progressive(scene, camera, {1200, 1200}, {}, [&](const Image&, bool) {
        ++seen;
        return false;
    });
    EXPECT_EQ(seen, 1);
    EXPECT_FALSE(done) << "the first of several";
}

TEST(Renderer, ReusesWhatAChangeLeavesAsItIs) {
    for (const bool scattered : {false, true}) {
        const std::shared_ptr<const Field> field =
            scattered ? std::shared_ptr<const Field>(cloud(2000, 0.1, false)) : waves();
        Scene scene = scene_of(field);
        const Camera camera = askew(*field);
        Renderer renderer(on(Backend::cpu));
        const auto draw = [&](const Scene& what, const Camera& from) { return renderer.render(what, from, {64, 64}); };
        EXPECT_EQ(draw(scene, camera).stats.at("buckets_reused"), 0.0);
        scene.lights[0].direction = Vec3(-1.0, 0.2, 0.5);
        EXPECT_EQ(draw(scene, camera).stats.at("buckets_reused"), 1.0) << "another light";
        scene.transfer_function =
            TransferFunction({{0.1, {0.9, 0.2, 0.1}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.3}, {1.0, {0.1, 0.8, 0.9}, 0.2}});
        const Image recoloured = draw(scene, camera);
        EXPECT_EQ(recoloured.stats.at("buckets_reused"), 1.0) << "another transfer function";
        Renderer fresh(on(Backend::cpu));
        EXPECT_EQ(fresh.render(scene, camera, {64, 64}).rgba, recoloured.rgba) << "nothing is left of the former one";
        const Camera turned =
            Camera::fit(field->supports_world(), Vec3(-0.4, -0.35, -0.8), Vec3(0, 1, 0), camera.projection(), 0.9);
        const Image other = draw(scene, turned);
        EXPECT_EQ(other.stats.at("buckets_reused"), 0.0) << "another camera";
        EXPECT_EQ(other.rgba, Renderer(on(Backend::cpu)).render(scene, turned, {64, 64}).rgba);
        EXPECT_LT(other.stats.at("seconds_index"), 0.002) << "the index does not know the camera";
    }
}

TEST(Renderer, ThreadsAreChecked) {
    RendererOptions options = on(Backend::cpu);
    for (const int threads : {-1, 1025}) {
        options.threads = threads;
        EXPECT_THROW(Renderer{options}, InvalidInput) << threads;
    }
    const Scene scene = scene_of(waves());
    const Camera camera = askew(*scene.fields[0]);
    std::vector<float> first;
    for (const int threads : {1, 2, 3, 7}) {
        options.threads = threads;
        Renderer renderer(options);
        const Image image = renderer.render(scene, camera, {70, 50});
        EXPECT_NE(image.plan->device.find(std::to_string(threads) + " thread"), std::string::npos)
            << image.plan->device;
        first = first.empty() ? image.rgba : first;
        EXPECT_EQ(image.rgba, first) << threads << " threads";
    }
}

TEST(Renderer, TakesTheOtherBackendWhereOneDoesNotSupportAScene) {
    bool with_gl = false, hardware = false;
    for (const gl::Attempt& attempt : gl::Context::survey()) {
        with_gl = with_gl || attempt.succeeded;
        hardware = hardware || (attempt.succeeded && !attempt.capabilities.software);
    }
    if (std::getenv("SHEETSPLAT_BACKEND") != nullptr) {
        GTEST_SKIP() << "SHEETSPLAT_BACKEND is set";
    }
    const Scene scene = scene_of(waves());
    const Camera camera = askew(*scene.fields[0]);
    RendererOptions options;
    if (!hardware) {
        EXPECT_EQ(Renderer(options).plan(scene, camera, {32, 32}).backend, Backend::cpu);
    }
    options.packing = Packing::paper;
    if (with_gl) {
        EXPECT_EQ(Renderer(options).render(scene, camera, {32, 32}).plan->backend, Backend::gl);
        options.backend = Backend::cpu;
        EXPECT_THROW(static_cast<void>(Renderer(options).plan(scene, camera, {32, 32})), Unsupported);
    }
    options.backend = Backend::automatic;
    options.precision = Precision::float64;
    try {
        static_cast<void>(Renderer(options).plan(scene, camera, {32, 32}));
        FAIL() << "no backend packs as the paper did in float64";
    } catch (const Unsupported& error) {
        EXPECT_NE(std::string(error.what()).find("backend cpu"), std::string::npos) << error.what();
        EXPECT_NE(std::string(error.what()).find(with_gl ? "backend gl" : "no OpenGL"), std::string::npos)
            << error.what();
    }
}

TEST(Devices, TellOfTheProcessor) {
    const std::vector<DeviceReport> found = devices();
    const auto cpu = std::find_if(found.begin(), found.end(), [](const DeviceReport& r) { return r.backend == "cpu"; });
    ASSERT_NE(cpu, found.end());
    EXPECT_TRUE(cpu->available);
    EXPECT_NE(cpu->description.find("thread"), std::string::npos) << cpu->description;
    EXPECT_FALSE(cpu->extensions.empty());
}

} // namespace
} // namespace sheetsplat

// Estimates of a picture's error without a reference, held against converged pictures.
#include "error_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"
#include "support/bumps.hpp"
#include "support/draws.hpp"

namespace sheetsplat {
namespace {

using test::bumps;

std::shared_ptr<const EllipsoidField> cloud() {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < 120; ++i) {
        arrays.centers.push_back(12.0 * test::three([&] { return uniform(random); }));
        arrays.values.push_back(uniform(random));
        arrays.scales.push_back(2.5 * Vec3(1.5, 0.8, 0.6));
        arrays.rotations.push_back(test::rotation([&] { return normal(random); }));
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

Camera camera_of(const Field& field) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.4, -0.8), Vec3(0.0, 1.0, 0.0));
}

RendererOptions on_cpu(Precision precision = Precision::automatic) {
    RendererOptions options;
    options.backend = Backend::cpu;
    options.precision = precision;
    return options;
}

const Size size{64, 56};

double true_error(const Image& image, Scene scene, const Camera& camera) {
    scene.reference_length = scene.reference_distance();
    scene.slice_spacing = scene.slice_distance() / 16.0;
    scene.opacity_stop = 1.0;
    const Image converged = Renderer(on_cpu(Precision::float64)).render(scene, camera, size);
    return image.rgba.empty() ? compare(image.scalar, converged.scalar, 1, Gaps::left_out).rmse
                              : compare(image.rgba, converged.rgba, 4).rmse;
}

void expect_sum(const ErrorEstimate& estimate) {
    double causes = 0.0, pixels = 0.0;
    for (const ErrorShare& share : estimate.budget) {
        EXPECT_GE(share.rmse, 0.0);
        causes += share.rmse * share.rmse;
    }
    for (const float value : estimate.map) {
        pixels += static_cast<double>(value) * static_cast<double>(value);
    }
    ASSERT_EQ(estimate.map.size(), static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height));
    EXPECT_NEAR(std::sqrt(causes), estimate.rmse, 1e-6 * estimate.rmse);
    EXPECT_NEAR(std::sqrt(pixels / double(estimate.map.size())), estimate.rmse, 1e-5 * estimate.rmse);
}

struct Kind {
    const char* name;
    bool ellipsoids;
    void (*change)(Scene&);
};

class Estimates : public testing::TestWithParam<Kind> {};

TEST_P(Estimates, LieWithinAFactorOfTwo) {
    std::shared_ptr<const Field> field;
    if (GetParam().ellipsoids) {
        field = cloud();
    } else {
        field = bumps();
    }
    Scene scene{
        {field},
        TransferFunction({{0.1, Vec3(0.1, 0.2, 0.6), 0.0}, {0.6, Vec3(0.9, 0.6, 0.2), 0.5}, {1.0, Vec3(1.0), 0.8}})};
    GetParam().change(scene);
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    const Image image = renderer.render(scene, camera, size);
    const ErrorEstimate estimate = renderer.estimate_error(image, scene, camera);
    const double found = true_error(image, scene, camera);
    RecordProperty("true_over_estimate", std::to_string(found / estimate.rmse));
    EXPECT_GT(found, 1e-6);
    EXPECT_LE(estimate.rmse, 2.0 * found);
    EXPECT_GE(estimate.rmse, 0.5 * found);
    expect_sum(estimate);
    EXPECT_EQ(estimate.budget.front().cause, "slice distance");
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, Estimates,
    testing::Values(
        Kind{"flat", false, [](Scene&) {}}, Kind{"ellipsoids", true, [](Scene&) {}},
        Kind{"lit", false, [](Scene& scene) { scene.lights.push_back({}); }},
        Kind{"slab", true, [](Scene& scene) { scene.sampling = Sampling::slab; }},
        Kind{"preintegrated", false, [](Scene& scene) { scene.preintegration = true; }},
        Kind{"stopped", false, [](Scene& scene) { scene.opacity_stop = 0.6; }},
        Kind{"coarse", true, [](Scene& scene) { scene.slice_spacing = 2.0 * scene.default_slice_spacing(); }},
        Kind{"step", false,
             [](Scene& scene) {
                 scene.transfer_function = TransferFunction({{0.3, Vec3(1.0), 0.0}, {0.3, Vec3(1.0, 0.5, 0.2), 0.4}});
             }},
        Kind{"surface", false,
             [](Scene& scene) {
                 scene.mode = Mode::isosurface;
                 scene.iso_values = {0.4};
                 scene.lights.push_back({});
             }},
        Kind{"mip", true, [](Scene& scene) { scene.mode = Mode::mip; }},
        Kind{"xray", true, [](Scene& scene) { scene.mode = Mode::xray; }}),
    [](const testing::TestParamInfo<Kind>& one) { return std::string(one.param.name); });

TEST(ErrorEstimate, SplitsCauses) {
    const auto field = bumps();
    Scene scene{{field}, TransferFunction({{0.1, Vec3(1.0, 0.5, 0.2), 0.0}, {0.6, Vec3(1.0), 0.9}})};
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    const auto share = [&](const Image& image, const std::string& cause) {
        const ErrorEstimate estimate = renderer.estimate_error(image, scene, camera);
        for (const ErrorShare& one : estimate.budget) {
            if (one.cause == cause) {
                return one.rmse;
            }
        }
        return 0.0;
    };
    scene.opacity_stop = 0.6;
    const Image early = renderer.render(scene, camera, size);
    const double stopped = share(early, "opacity stop"), slices = share(early, "slice distance");
    EXPECT_GT(stopped, 3.0 * slices);
    scene.opacity_stop = 1.0;
    const Image never = renderer.render(scene, camera, size);
    EXPECT_EQ(share(never, "opacity stop"), 0.0);
    EXPECT_NEAR(share(never, "slice distance"), slices, 1e-9);
    EXPECT_LT(share(never, "sums in float32"), 1e-5);
    // A picture that numbers have spoiled: nothing but arithmetic can have done it.
    Image spoiled = never;
    for (std::size_t i = 0; i < spoiled.rgba.size(); ++i) {
        spoiled.rgba[i] += i % 2 == 0 ? 0.01F : -0.01F;
    }
    EXPECT_NEAR(share(spoiled, "slice distance"), slices, 1e-9);
    const ErrorEstimate estimate = renderer.estimate_error(spoiled, scene, camera);
    EXPECT_NEAR(estimate.rmse, std::hypot(0.01, slices), 1e-4);
}

TEST(ErrorEstimate, ShadowsFromVolumesCountAsThePlanHasThem) {
    const auto field = bumps();
    Scene scene{{field}, TransferFunction({{0.1, Vec3(1.0, 0.5, 0.2), 0.0}, {0.6, Vec3(1.0), 0.5}})};
    scene.lights.push_back({Vec3(0.4, 0.6, 1.0), Vec3(1.0), LightSpace::eye});
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    const auto share = [](const std::vector<ErrorShare>& budget, const std::string& effect) {
        double sum = 0.0;
        for (const ErrorShare& one : budget) {
            sum += one.effect == effect ? one.rmse : 0.0;
        }
        return sum;
    };
    EXPECT_EQ(share(renderer.estimate_error(renderer.render(scene, camera, size), scene, camera).budget, "shadows"), 0);
    scene.shadows = true;
    const Image image = renderer.render(scene, camera, size);
    const ErrorEstimate estimate = renderer.estimate_error(image, scene, camera);
    expect_sum(estimate);
    EXPECT_NEAR(share(estimate.budget, "shadows"), share(image.plan->error_budget, "shadows"), 1e-9);
    EXPECT_LT(share(estimate.budget, "sums"), 1e-5);
    EXPECT_EQ(estimate.map.front(), 0.0F);

    RendererOptions options;
    options.backend = Backend::reference;
    Renderer slow(options);
    const Image exact = slow.render(scene, camera, size);
    const double found = compare(image.rgba, exact.rgba, 4).rmse;
    EXPECT_GT(found, 1e-5);
    EXPECT_GE(share(estimate.budget, "shadows"), found);
    // Without volumes there is nothing of the kind, nor is it taken for arithmetic.
    const Size few{20, 18};
    const ErrorEstimate own = slow.estimate_error(slow.render(scene, camera, few), scene, camera);
    for (std::size_t i = 1; i < own.budget.size(); ++i) {
        EXPECT_TRUE(own.budget[i].cause == "opacity stop" || own.budget[i].rmse < 1e-6) << own.budget[i].cause;
    }
}

TEST(ErrorEstimate, FindsWhereTheErrorIs) {
    const auto field = bumps();
    const Scene scene{{field}, TransferFunction({{0.1, Vec3(1.0, 0.5, 0.2), 0.0}, {0.6, Vec3(1.0), 0.9}})};
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    const Image image = renderer.render(scene, camera, size);
    const ErrorEstimate estimate = renderer.estimate_error(image, scene, camera);
    // Nothing is in the corner; most of the error is where the picture is.
    EXPECT_EQ(estimate.map.front(), 0.0F);
    EXPECT_GT(*std::max_element(estimate.map.begin(), estimate.map.end()), 2.0F * static_cast<float>(estimate.rmse));
}

TEST(ErrorEstimate, PicturesWithoutOneAreRefused) {
    const auto field = bumps();
    const Scene scene{{field}, TransferFunction({{0.1, Vec3(1.0), 0.0}, {0.6, Vec3(1.0), 0.9}})};
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    Image image = renderer.render(scene, camera, size);
    Image loaded = image;
    loaded.plan.reset();
    EXPECT_THROW((void)renderer.estimate_error(loaded, scene, camera), InvalidInput);
    Image stage = image;
    stage.stats["stage"] = 1.0;
    stage.stats["stages"] = 2.0;
    EXPECT_THROW((void)renderer.estimate_error(stage, scene, camera), InvalidInput);
    stage.stats["stage"] = 2.0;
    EXPECT_NO_THROW((void)renderer.estimate_error(stage, scene, camera));
    Scene other = scene;
    other.slice_spacing = 0.123;
    EXPECT_THROW((void)renderer.estimate_error(image, other, camera), InvalidInput);
    other = scene;
    other.mode = Mode::xray;
    EXPECT_THROW((void)renderer.estimate_error(image, other, camera), InvalidInput);
    EXPECT_THROW((void)renderer.estimate_error(image, scene, camera, [](double) { return false; }), Cancelled);
}

TEST(ErrorEstimate, ChangesNothing) {
    const auto field = bumps();
    const Scene scene{{field}, TransferFunction({{0.1, Vec3(1.0), 0.0}, {0.6, Vec3(1.0), 0.9}})};
    const Camera camera = camera_of(*field);
    Renderer renderer(on_cpu());
    const Image before = renderer.render(scene, camera, size);
    (void)renderer.estimate_error(before, scene, camera);
    const Image after = renderer.render(scene, camera, size);
    EXPECT_EQ(before.rgba, after.rgba);
    EXPECT_EQ(before.plan->precision, after.plan->precision);
}

} // namespace
} // namespace sheetsplat

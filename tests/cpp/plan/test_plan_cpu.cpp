// What the plan of backend cpu holds, when it takes float64, and what it refuses.
#include <algorithm>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> small_field(Normalization normalization = Normalization::lattice,
                                                float offset = 0.0F, double falloff = 5.0) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = normalization;
    options.falloff = falloff;
    std::vector<float> samples{0.0F, 1.0F, 0.5F, 0.2F, 0.1F, 0.9F, 0.3F, 0.4F};
    for (float& sample : samples) {
        sample += offset;
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{2, 2, 2}, options);
}

Scene lit_scene(Normalization normalization = Normalization::lattice) {
    Scene scene{{small_field(normalization)}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.01}})};
    scene.lights = {Light{}};
    return scene;
}

ViewFacts facts() {
    ViewFacts view;
    view.frame.size = {64, 64};
    view.frame.slices = 6;
    view.kernels.all = 8;
    view.screen_px.smallest = 2.0;
    view.shapes.smallest_falloff = 5.0;
    return view;
}

DrawPlan plan_of(const Scene& scene, const ViewFacts& view = facts(), const RendererOptions& options = {},
                 const Outputs& outputs = {}, Projection projection = Projection::orthographic) {
    return make_plan(scene, test::surveyed(scene, view), options, outputs, projection, Backend::cpu, nullptr);
}

std::string refusal(const Scene& scene, const ViewFacts& view, const RendererOptions& options = {}) {
    try {
        plan_of(scene, view, options);
    } catch (const Unsupported& error) {
        return error.what();
    }
    return "";
}

TEST(PlanOfCpu, HasNoWaysOfDrawingOnGl) {
    const DrawPlan plan = plan_of(lit_scene());
    EXPECT_EQ(plan.summary.backend, Backend::cpu);
    EXPECT_EQ(plan.summary.precision, Precision::float32);
    EXPECT_FALSE(plan.fine_gradient || plan.points || plan.compensated || plan.elimination || plan.resident_sections);
    EXPECT_FALSE(plan.summary.error_budget.empty());
}

TEST(PlanOfCpu, CountsItsMemory) {
    EXPECT_EQ(plan_of(lit_scene()).summary.memory, 64U * 64U * 16U + 8U * 24U) << "pixels, and 24 bytes a kernel";
    EXPECT_EQ(plan_of(lit_scene(), facts(), {}, {true, true}).summary.memory, 64U * 64U * 24U + 8U * 24U);
}

TEST(PlanOfCpu, CountsTheMemoryOfLight) {
    // A thousand slices along each axis: every grid is as large as it may become.
    ViewFacts view = facts();
    view.frame.slice_spacing = view.frame.smallest_pixel = 1e-3;
    const std::uint64_t others = plan_of(lit_scene(), view).summary.memory;
    Scene scene = lit_scene();
    scene.shadows = true;
    const auto light = [&] { return plan_of(scene, view).summary.memory - others; };
    EXPECT_EQ(light(), 96U << 20) << "one light";
    scene.lights.resize(3);
    EXPECT_EQ(light(), 256U << 20) << "all grids";
    scene.shadows = false;
    scene.ambient_occlusion = AmbientOcclusion{};
    EXPECT_EQ(light(), 16U << 20) << "ambient occlusion";
}

TEST(PlanOfCpu, FollowsTheSceneAsOnGl) {
    Scene scene = lit_scene(Normalization::threshold);
    scene.fields.push_back(small_field());
    const DrawPlan plan = plan_of(scene);
    EXPECT_EQ(plan.own_sheets, (std::vector<int>{0, -1}));
    EXPECT_FALSE(plan.threshold);
    EXPECT_FALSE(plan.weight);
    EXPECT_TRUE(plan_of(scene, facts(), {}, {true, false}).weight) << "coverage";
    EXPECT_TRUE(plan_of(lit_scene(Normalization::threshold)).weight);
}

TEST(PlanOfCpu, LooksAtTheTransferFunctionOfEveryGroup) {
    Scene scene = lit_scene(Normalization::threshold);
    scene.fields = {small_field(), small_field(Normalization::lattice, 1000.0F)};
    scene.later_groups = {{1, TransferFunction({{900.0, {1, 1, 1}, 0.0}, {1100.0, {1, 1, 1}, 0.01}})}};
    EXPECT_EQ(plan_of(scene).precision, Precision::float32);
    EXPECT_TRUE(plan_of(scene).own_sheets.empty());
    // Only the second group's window is narrow beside its values.
    scene.later_groups = {{1, TransferFunction({{1000.0, {1, 1, 1}, 0.0}, {1000.001, {1, 1, 1}, 0.01}})}};
    EXPECT_EQ(plan_of(scene).precision, Precision::float64);
    scene.later_groups = {{1, TransferFunction({{1000.0, {1, 1, 1}, 0.0}, {1000.0000000000001, {1, 1, 1}, 0.01}})}};
    EXPECT_NE(refusal(scene, facts()).find("values up to 1001"), std::string::npos);
    // Opacity at 0, of the second one alone.
    scene.later_groups = {{1, TransferFunction({{0.0, {1, 1, 1}, 0.1}, {1100.0, {1, 1, 1}, 0.01}})}};
    EXPECT_TRUE(plan_of(scene).empty_test);
}

TEST(PlanOfCpu, WhereKernelsEndShowsWhereSlicesCountByTheirWeights) {
    Scene scene = lit_scene();
    scene.fields = {small_field(Normalization::lattice, 0.0F, 25.0)};
    EXPECT_EQ(plan_of(scene).precision, Precision::float32);
    RendererOptions weighing;
    weighing.effects = {{"weight", true}};
    for (const Mode mode : {Mode::minimum, Mode::average}) {
        scene.mode = mode;
        EXPECT_EQ(plan_of(scene, facts(), weighing).precision, Precision::float64);
        EXPECT_TRUE(plan_of(scene, facts(), weighing).weight);
        // Where samples are says which slices count.
        EXPECT_EQ(plan_of(scene).precision, Precision::float32);
        EXPECT_FALSE(plan_of(scene).weight);
    }
    scene.fields = {small_field(Normalization::lattice, 0.0F, 700.0)};
    EXPECT_NE(refusal(scene, facts(), weighing).find("at most 600"), std::string::npos);
    EXPECT_EQ(refusal(scene, facts()), "");
}

const Effect& ray_extremes(const DrawPlan& plan) {
    return *std::find_if(plan.summary.effects.begin(), plan.summary.effects.end(),
                         [](const Effect& effect) { return effect.name == "ray_extremes"; });
}

TEST(PlanOfCpu, ExtremesAreLookedUpWhereThatTakesLess) {
    Scene scene = lit_scene();
    scene.mode = Mode::mip;
    ViewFacts view = facts();
    view.frame.smallest_pixel = view.frame.largest_pixel = 0.3;
    view.extremes = ExtremeFacts{0.02, 1.0, 1.0};
    DrawPlan plan = plan_of(scene, view);
    EXPECT_TRUE(plan.ray_extremes);
    EXPECT_NE(ray_extremes(plan).reason.find("leave 2 % of"), std::string::npos) << ray_extremes(plan).reason;
    view.extremes->left = 0.97;
    plan = plan_of(scene, view);
    EXPECT_FALSE(plan.ray_extremes);
    EXPECT_NE(ray_extremes(plan).reason.find("summing sheets takes less"), std::string::npos)
        << ray_extremes(plan).reason;
    // Sections that lean take longer.
    view.extremes->left = 0.35;
    EXPECT_FALSE(plan_of(scene, view).ray_extremes);
    view.shapes.sheared = true;
    EXPECT_TRUE(plan_of(scene, view).ray_extremes);
    view.shapes.sheared = false;
    view.extremes->left = 0.97;
    // More samples a pixel: more to be splatted for each point.
    view.frame.smallest_pixel = view.frame.largest_pixel = 8.0;
    EXPECT_TRUE(plan_of(scene, view).ray_extremes);
    // Of few samples, little is splatted, and rays pass by most blocks.
    view.frame.smallest_pixel = view.frame.largest_pixel = 0.3;
    view.extremes = ExtremeFacts{0.2, 1.0, 0.01};
    plan = plan_of(scene, view);
    EXPECT_FALSE(plan.ray_extremes);
    EXPECT_NE(ray_extremes(plan).reason.find("1 % of the samples"), std::string::npos) << ray_extremes(plan).reason;
    // ... but for minima, which end rays early, while every point of sheets counts.
    scene.mode = Mode::minimum;
    view.extremes = ExtremeFacts{0.0, 0.05, 0.01};
    EXPECT_TRUE(plan_of(scene, view).ray_extremes);
    // Pixels of a part of a whole that no slice counts for are no number.
    const double everywhere = std::numeric_limits<double>::infinity();
    scene.part = Part{Box{Vec3(-everywhere), Vec3(everywhere)}};
    EXPECT_TRUE(plan_of(scene, view).ray_extremes);
    scene.mode = Mode::mip;
    EXPECT_TRUE(plan_of(scene, view).ray_extremes);
    scene.part.reset();
    view.extremes = ExtremeFacts{0.02, 1.0, 1.0};
    RendererOptions options;
    options.effects = {{"ray_extremes", false}};
    plan = plan_of(scene, view, options);
    EXPECT_FALSE(plan.ray_extremes);
    EXPECT_TRUE(ray_extremes(plan).forced);
    // Whatever is forced, not where sheets hold what is asked for.
    options.effects = {{"ray_extremes", true}};
    EXPECT_TRUE(plan_of(scene, view, options).ray_extremes);
    EXPECT_FALSE(plan_of(scene, view, options, {true, false}).ray_extremes) << "coverage";
    scene.sampling = Sampling::slab;
    EXPECT_FALSE(plan_of(scene, view, options).ray_extremes);
    scene.sampling = Sampling::point;
    scene.mode = Mode::xray;
    EXPECT_FALSE(plan_of(scene, view, options).ray_extremes);
}

TEST(PlanOfCpu, RefusesWaysOfDrawingOnGl) {
    for (const Tagging tagging : {Tagging::depth_bounds, Tagging::depth_equal, Tagging::off}) {
        RendererOptions options;
        options.tagging = tagging;
        EXPECT_NE(refusal(lit_scene(), facts(), options).find(to_string(tagging)), std::string::npos);
    }
    RendererOptions options;
    options.tagging = Tagging::tiles;
    options.packing = Packing::wide;
    EXPECT_EQ(refusal(lit_scene(), facts(), options), "");
    options.packing = Packing::paper;
    EXPECT_NE(refusal(lit_scene(), facts(), options), "");
    for (const Precision precision : {Precision::float16, Precision::uint8}) {
        RendererOptions coarse;
        coarse.precision = precision;
        coarse.allow_inexact = true;
        EXPECT_NE(refusal(lit_scene(), facts(), coarse).find(to_string(precision)), std::string::npos);
    }
    RendererOptions strange;
    strange.effects = {{"no_such_thing", true}};
    EXPECT_THROW(plan_of(lit_scene(), facts(), strange), InvalidInput);
}

TEST(PlanOfCpu, RefusesToLeaveOutWhatTheSceneCallsFor) {
    RendererOptions options;
    options.effects = {{"gradient", false}};
    EXPECT_NE(refusal(lit_scene(), facts(), options).find("gradient"), std::string::npos);
    options.allow_inexact = true;
    EXPECT_EQ(refusal(lit_scene(), facts(), options), "");
}

TEST(PlanOfCpu, StaysInFloat32WhereAllIsMild) {
    EXPECT_EQ(plan_of(lit_scene(Normalization::threshold)).precision, Precision::float32);
    ViewFacts view = facts();
    view.frame.smallest_pixel = view.frame.slice_spacing = 0.13;
    view.frame.slices = 1 << 14;
    view.shapes.largest_aspect = 512.0;
    view.screen_px.smallest = 0.051;
    view.screen_px.largest_lattice = view.screen_px.largest_ellipsoid = 0.9e6;
    view.slabs.thickest = 99.0;
    view.shapes.smallest_falloff = 0.51;
    view.overlap.typical = view.overlap.densest = 999.0;
    Scene scene = lit_scene();
    scene.sampling = Sampling::slab;
    EXPECT_EQ(plan_of(scene, view).precision, Precision::float32);
    scene.lights.clear();
    view.frame.smallest_pixel = 1e-3;
    EXPECT_EQ(plan_of(scene, view).precision, Precision::float32) << "unlit: no gradient to lose";
    RendererOptions options;
    options.precision = Precision::float64;
    EXPECT_EQ(plan_of(lit_scene(), facts(), options).precision, Precision::float64) << "asked for";
}

TEST(PlanOfCpu, RefusesWhatFloat64WouldNotDo) {
    Scene scene = lit_scene();
    scene.lights.clear();
    EXPECT_EQ(refusal(scene, facts()), "");
    ViewFacts view = facts();
    view.screen_px.largest_lattice = 1.1e12;
    EXPECT_NE(refusal(scene, view).find("1.1e+12"), std::string::npos);
    view = facts();
    view.shapes.smallest_falloff = 1e-9;
    EXPECT_NE(refusal(scene, view).find("falloff"), std::string::npos);
    scene.fields = {std::make_shared<RegularField>(std::vector<double>(8, 1e15), std::array<std::size_t, 3>{2, 2, 2},
                                                   test::zero_boundary())};
    EXPECT_NE(refusal(scene, facts()).find("1e+15"), std::string::npos);
    RendererOptions options;
    options.allow_inexact = true;
    EXPECT_EQ(refusal(scene, facts(), options), "");
    scene.fields = {std::make_shared<RegularField>(std::vector<double>(8, 1e7), std::array<std::size_t, 3>{2, 2, 2},
                                                   test::zero_boundary())};
    EXPECT_EQ(plan_of(scene).precision, Precision::float64) << "what float32 could not do";
}

TEST(PlanOfCpu, ErrorsExpectedFollowThePrecision) {
    RendererOptions options;
    options.precision = Precision::float64;
    const double coarse = plan_of(lit_scene()).summary.error_budget.front().rmse;
    const double fine = plan_of(lit_scene(), facts(), options).summary.error_budget.front().rmse;
    EXPECT_GT(coarse, 1e6 * fine);
    EXPECT_GT(fine, 0.0);
    EXPECT_LT(coarse, 1e-4);
}

TEST(PlanOfCpu, ErrorsExpectedOfScatteredKernels) {
    ViewFacts view = facts();
    view.kernels.ellipsoids = true;
    const auto& budget = plan_of(lit_scene(), view).summary.error_budget;
    const auto found = std::find_if(budget.begin(), budget.end(),
                                    [](const ErrorShare& share) { return share.effect == "scattered_kernels"; });
    ASSERT_NE(found, budget.end());
    EXPECT_NEAR(found->rmse, 2e-7, 1e-9) << "values reach what is resolved, colours do not bend";
}

TEST(PlanOfCpu, ErrorsExpectedFollowTheWeights) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0)};
    arrays.radii = {1.0, 1.0};
    arrays.values = {2.0, -3.0};
    arrays.weights = {0.5, 4.0};
    const auto field = std::make_shared<const EllipsoidField>(std::move(arrays));
    Scene scene = lit_scene();
    scene.fields = {field};
    const double usual = plan_of(scene).summary.error_budget.front().rmse;
    ViewFacts view = test::surveyed(scene, facts());
    view.weights.at(field.get()).alone = 1e-6;
    EXPECT_NE(plan_of(scene, view).summary.error_budget.front().rmse, usual);
}

TEST(PlanOfCpu, BoundIsThatOfGentleScenesUpToTheirSteepnessAndMagnification) {
    Scene scene = lit_scene();
    ViewFacts view = facts();
    view.frame.slice_spacing = view.frame.reference_length;
    view.frame.largest_slant = 1.0;
    const auto bound = [&](double steepness, double pixels) {
        scene.transfer_function =
            TransferFunction({{0.0, {1, 1, 1}, 0.0}, {0.5 / steepness, {1, 1, 1}, 0.5}, {1.0, {1, 1, 1}, 0.5}});
        view.frame.smallest_pixel = view.frame.largest_pixel = view.frame.reference_length / pixels;
        return plan_of(scene, view).bound;
    };
    EXPECT_EQ(bound(9.9, 99.0), 2e-5);
    EXPECT_EQ(bound(10.1, 99.0), 1e-4);
    EXPECT_EQ(bound(9.9, 101.0), 1e-4);
}

} // namespace
} // namespace sheetsplat

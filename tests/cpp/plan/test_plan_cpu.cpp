// What the plan of backend cpu holds, when it takes float64, and what it refuses.
#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> small_field(Normalization normalization = Normalization::lattice,
                                                float offset = 0.0F, double falloff = 5.0) {
    RegularFieldOptions options;
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
    view.size = {64, 64};
    view.slices = 6;
    view.kernels = 8;
    view.smallest_radius_px = 2.0;
    view.smallest_falloff = 5.0;
    return view;
}

DrawPlan plan_of(const Scene& scene, const ViewFacts& view = facts(), const RendererOptions& options = {},
                 const Outputs& outputs = {}, Projection projection = Projection::orthographic) {
    return make_plan(scene, view, options, outputs, projection, Backend::cpu, nullptr);
}

std::string refusal(const Scene& scene, const ViewFacts& view, const RendererOptions& options = {}) {
    try {
        plan_of(scene, view, options);
    } catch (const Unsupported& error) {
        return error.what();
    }
    return "";
}

const std::vector<const char*> of_gl{"fine_gradient",  "resident_sections", "precise_sections", "paper_slicing",
                                     "opacity_buffer", "elimination",       "compensation"};

TEST(PlanOfCpu, ListsEffectsOfThePictureAlone) {
    const DrawPlan plan = plan_of(lit_scene());
    EXPECT_EQ(plan.summary.backend, Backend::cpu);
    EXPECT_EQ(plan.summary.precision, Precision::float32);
    EXPECT_TRUE(plan.summary.has("gradient"));
    EXPECT_TRUE(plan.summary.has("culling"));
    EXPECT_FALSE(plan.summary.has("float64"));
    EXPECT_FALSE(plan.fine_gradient || plan.points || plan.compensated || plan.elimination || plan.resident_sections);
    std::vector<std::string> names;
    for (const Effect& effect : plan.summary.effects) {
        EXPECT_GT(effect.reason.size(), 10U) << effect.name;
        names.push_back(effect.name);
        // Of these two it says how it does without them.
        const bool told = effect.name == "elimination" || effect.name == "opacity_buffer";
        for (const char* name : of_gl) {
            EXPECT_TRUE(told || effect.name != name) << name << " is a way of drawing on GL";
        }
    }
    for (const char* name : {"classification",
                             "empty_test",
                             "weight",
                             "ewa_filter",
                             "scattered_kernels",
                             "slab_sampling",
                             "perspective",
                             "general_sections",
                             "gradient",
                             "specular",
                             "two_sided",
                             "world_lights",
                             "opacity_correction",
                             "preintegration",
                             "opacity_stop",
                             "separate_normalization",
                             "culling",
                             "background",
                             "coverage",
                             "depth",
                             "float64"}) {
        EXPECT_EQ(std::count(names.begin(), names.end(), name), 1) << name;
    }
    EXPECT_FALSE(plan.summary.error_budget.empty());
    EXPECT_GT(plan.summary.memory, 64U * 64U * 16U - 1U);
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

TEST(PlanOfCpu, RefusesWaysOfDrawingOnGl) {
    for (const char* name : of_gl) {
        RendererOptions options;
        options.effects = {{name, true}};
        const std::string text = refusal(lit_scene(), facts(), options);
        EXPECT_NE(text.find(name), std::string::npos) << name << ": " << text;
        EXPECT_NE(text.find("backend = gl"), std::string::npos) << text;
        options.effects = {{name, false}};
        EXPECT_EQ(refusal(lit_scene(), facts(), options), "") << name << " off says nothing";
    }
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

struct Hard {
    const char* name;
    std::function<void(Scene&, ViewFacts&)> make;
};

/// Each of them just beyond what float32 keeps; `mild` says how the same scene looks just below.
const std::vector<Hard> hard{
    {"small pixels", [](Scene&, ViewFacts& view) { view.smallest_pixel = 0.12; }},
    {"close slices", [](Scene&, ViewFacts& view) { view.slice_spacing = 0.12; }},
    {"many slices", [](Scene&, ViewFacts& view) { view.slices = (1 << 14) + 1; }},
    {"needles", [](Scene&, ViewFacts& view) { view.largest_aspect = 513.0; }},
    {"tiny kernels", [](Scene&, ViewFacts& view) { view.smallest_radius_px = 0.049; }},
    {"huge kernels", [](Scene&, ViewFacts& view) { view.largest_splat_px = 1.1e6; }},
    {"huge ellipsoids", [](Scene&, ViewFacts& view) { view.largest_radius_px = 1.1e6; }},
    {"thick slabs",
     [](Scene& scene, ViewFacts& view) {
         scene.sampling = Sampling::slab;
         view.thickest_slab = 101.0;
     }},
    {"flat kernels", [](Scene&, ViewFacts& view) { view.smallest_falloff = 0.049; }},
    {"narrow window far from 0",
     [](Scene& scene, ViewFacts&) {
         scene.fields = {small_field(Normalization::lattice, 3000.0F)};
         scene.transfer_function = TransferFunction({{3000.0, {1, 1, 1}, 0.0}, {3001.0, {1, 1, 1}, 0.01}});
     }},
    {"lit quotients far from 0",
     [](Scene& scene, ViewFacts&) {
         scene.fields = {small_field(Normalization::threshold, 45.0F)};
         scene.transfer_function = TransferFunction({{45.0, {1, 1, 1}, 0.0}, {46.0, {1, 1, 1}, 0.01}});
     }},
    {"lit quotients of many",
     [](Scene& scene, ViewFacts& view) {
         scene = lit_scene(Normalization::threshold);
         view.largest_overlap = 1001.0;
     }},
    {"lit quotients of a crowd",
     [](Scene& scene, ViewFacts& view) {
         scene = lit_scene(Normalization::threshold);
         view.densest_overlap = 1001.0;
     }},
};

TEST(PlanOfCpu, TakesFloat64WhereFloat32WouldNotDo) {
    for (const Hard& one : hard) {
        Scene scene = lit_scene();
        ViewFacts view = facts();
        one.make(scene, view);
        const DrawPlan plan = plan_of(scene, view);
        EXPECT_EQ(plan.precision, Precision::float64) << one.name;
        EXPECT_EQ(plan.summary.precision, Precision::float64) << one.name;
        EXPECT_TRUE(plan.summary.has("float64")) << one.name;
        RendererOptions options;
        options.precision = Precision::float32;
        EXPECT_NE(refusal(scene, view, options), "") << one.name;
        options.allow_inexact = true;
        EXPECT_EQ(plan_of(scene, view, options).precision, Precision::float32) << one.name;
    }
    // And nothing of this without its cause.
    EXPECT_EQ(plan_of(lit_scene(Normalization::threshold)).precision, Precision::float32);
    ViewFacts view = facts();
    view.smallest_pixel = view.slice_spacing = 0.13;
    view.slices = 1 << 14;
    view.largest_aspect = 512.0;
    view.smallest_radius_px = 0.051;
    view.largest_splat_px = view.largest_radius_px = 0.9e6;
    view.thickest_slab = 99.0;
    view.smallest_falloff = 0.51;
    view.largest_overlap = view.densest_overlap = 999.0;
    Scene scene = lit_scene();
    scene.sampling = Sampling::slab;
    EXPECT_EQ(plan_of(scene, view).precision, Precision::float32);
    scene.lights.clear();
    view.smallest_pixel = 1e-3;
    EXPECT_EQ(plan_of(scene, view).precision, Precision::float32) << "unlit: no gradient to lose";
    RendererOptions options;
    options.precision = Precision::float64;
    EXPECT_EQ(plan_of(lit_scene(), facts(), options).precision, Precision::float64) << "asked for";
}

TEST(PlanOfCpu, TakesFloat64ForTheMiddlesOfLitEllipsoidsThatHardlyOverlap) {
    ViewFacts view = facts();
    view.largest_aspect = 3.0;
    view.smallest_px = view.smallest_radius_px = 2.0;
    view.largest_overlap = view.densest_overlap = 1.0;
    EXPECT_EQ(plan_of(lit_scene(), view).precision, Precision::float64);
    Scene unlit = lit_scene();
    unlit.lights.clear();
    EXPECT_EQ(plan_of(unlit, view).precision, Precision::float32);
    ViewFacts crowded = view;
    crowded.largest_overlap = 20.0;
    EXPECT_EQ(plan_of(lit_scene(), crowded).precision, Precision::float32);
    ViewFacts round = view;
    round.largest_aspect = 1.0;
    EXPECT_EQ(plan_of(lit_scene(), round).precision, Precision::float32);
    ViewFacts large = view;
    large.smallest_px = large.smallest_radius_px = 20.0;
    EXPECT_EQ(plan_of(lit_scene(), large).precision, Precision::float32);
}

TEST(PlanOfCpu, RefusesWhatFloat64WouldNotDo) {
    Scene scene = lit_scene();
    scene.lights.clear();
    EXPECT_EQ(refusal(scene, facts()), "");
    ViewFacts view = facts();
    view.largest_splat_px = 1.1e12;
    EXPECT_NE(refusal(scene, view).find("1.1e+12"), std::string::npos);
    view = facts();
    view.smallest_falloff = 1e-9;
    EXPECT_NE(refusal(scene, view).find("falloff"), std::string::npos);
    scene.fields = {std::make_shared<RegularField>(std::vector<double>(8, 1e15), std::array<std::size_t, 3>{2, 2, 2})};
    EXPECT_NE(refusal(scene, facts()).find("1e+15"), std::string::npos);
    RendererOptions options;
    options.allow_inexact = true;
    EXPECT_EQ(refusal(scene, facts(), options), "");
    scene.fields = {std::make_shared<RegularField>(std::vector<double>(8, 1e7), std::array<std::size_t, 3>{2, 2, 2})};
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

TEST(WeightFacts, AreTheSameWhetherKnownOrLookedFor) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0), Vec3(2.0)};
    arrays.radii = {1.0, 1.0, 1.0};
    arrays.values = {2.0, -3.0, 5.0};
    arrays.weights = {0.5, 4.0, 0.0};
    const auto field = std::make_shared<const EllipsoidField>(std::move(arrays));
    const WeightFacts weights = survey_weights(*field);
    EXPECT_EQ(weights.low, -12.0);
    EXPECT_EQ(weights.high, 1.0);
    EXPECT_EQ(weights.most, 4.0);
    EXPECT_EQ(weights.least, 0.5);
    EXPECT_EQ(weights.alone, 3.0);
    Scene scene = lit_scene();
    scene.fields = {field};
    ViewFacts view = facts();
    const double looked_for = plan_of(scene, view).summary.error_budget.front().rmse;
    view.weights.emplace(field.get(), weights);
    EXPECT_EQ(plan_of(scene, view).summary.error_budget.front().rmse, looked_for);
    view.weights.at(field.get()).alone = 1e-6;
    EXPECT_NE(plan_of(scene, view).summary.error_budget.front().rmse, looked_for) << "what is known is used";
}

} // namespace
} // namespace sheetsplat

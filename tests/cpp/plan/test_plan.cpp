// What a scene calls for, and why.
#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> small_field(Normalization normalization = Normalization::lattice) {
    RegularFieldOptions options;
    options.normalization = normalization;
    return std::make_shared<RegularField>(std::vector<float>{0.0F, 1.0F, 0.5F, 0.2F, 0.1F, 0.9F, 0.3F, 0.4F},
                                          std::array<std::size_t, 3>{2, 2, 2}, options);
}

Scene plain_scene(Normalization normalization = Normalization::lattice) {
    return Scene{{small_field(normalization)}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.01}})};
}

ViewFacts facts() {
    ViewFacts view;
    view.size = {64, 64};
    view.slices = 6;
    return view;
}

Capabilities software() {
    Capabilities capabilities;
    capabilities.renderer = "a rasteriser in software";
    capabilities.software = true;
    capabilities.max_point_size = 255.0F;
    capabilities.texture_barrier = true;
    return capabilities;
}

DrawPlan plan_of(const Scene& scene, const RendererOptions& options = {}, const Outputs& outputs = {},
                 ViewFacts view = facts(), Capabilities capabilities = software(),
                 Projection projection = Projection::orthographic) {
    return make_plan(scene, view, options, outputs, projection, Backend::gl, &capabilities);
}

TEST(Plan, LeavesOutWhatTheSceneDoesNotCallFor) {
    const DrawPlan plan = plan_of(plain_scene());
    for (const char* name : {"weight", "gradient", "specular", "two_sided", "opacity_correction", "opacity_stop",
                             "elimination", "opacity_buffer", "perspective", "slab_sampling", "preintegration",
                             "coverage", "depth", "background", "world_lights", "preshaded"}) {
        EXPECT_FALSE(plan.summary.has(name)) << name;
    }
    EXPECT_TRUE(plan.summary.has("classification"));
    EXPECT_TRUE(plan.summary.has("points"));
    EXPECT_FALSE(plan.read_image);
    for (const Effect& effect : plan.summary.effects) {
        EXPECT_GT(effect.reason.size(), 10U) << effect.name;
        EXPECT_FALSE(effect.forced) << effect.name;
    }
}

TEST(Plan, FollowsTheScene) {
    Scene scene = plain_scene();
    scene.lights = {Light{}};
    EXPECT_TRUE(plan_of(scene).gradient);
    EXPECT_FALSE(plan_of(scene).specular);
    scene.material.specular = 0.3;
    scene.material.two_sided = true;
    EXPECT_TRUE(plan_of(scene).specular);
    EXPECT_TRUE(plan_of(scene).two_sided);
    scene.mode = Mode::xray;
    EXPECT_FALSE(plan_of(scene).gradient);
    EXPECT_FALSE(plan_of(scene).summary.has("classification"));

    EXPECT_TRUE(plan_of(plain_scene(Normalization::threshold)).weight);
    scene = plain_scene();
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.2}, {1.0, {1, 1, 1}, 0.3}});
    EXPECT_TRUE(plan_of(scene).weight) << "opacity at 0 is above 0";
    EXPECT_TRUE(plan_of(plain_scene(), {}, {true, false}).weight) << "coverage";

    scene = plain_scene();
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.9}});
    EXPECT_TRUE(plan_of(scene).stop);
    scene.opacity_stop = 1.0;
    EXPECT_FALSE(plan_of(scene).stop);

    ViewFacts view = facts();
    view.slice_spacing = 0.5;
    EXPECT_TRUE(plan_of(plain_scene(), {}, {}, view).opacity_correction);
    view = facts();
    view.largest_splat_px = 200.0;
    EXPECT_FALSE(plan_of(plain_scene(), {}, {}, view).points) << "larger than the largest point";
}

TEST(Plan, EliminatesOnHardwareWhereSomethingSaturates) {
    Scene scene = plain_scene();
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.9}});
    Capabilities hardware = software();
    hardware.software = false;
    hardware.depth_bounds = true;
    EXPECT_TRUE(plan_of(scene, {}, {}, facts(), hardware).elimination);
    EXPECT_EQ(plan_of(scene, {}, {}, facts(), hardware).tagging, Tagging::depth_bounds);
    EXPECT_TRUE(plan_of(scene).elimination) << "opaque within a few slices pays in software too";
    EXPECT_EQ(plan_of(scene).tagging, Tagging::tiles);
    Scene slow = plain_scene();
    slow.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.1}});
    ViewFacts deep = facts();
    deep.slices = 100;
    EXPECT_FALSE(plan_of(slow, {}, {}, deep).elimination);
    EXPECT_TRUE(plan_of(slow, {}, {}, deep, hardware).elimination);
    EXPECT_FALSE(plan_of(scene, {}, {true, false}, facts(), hardware).elimination)
        << "coverage looks behind opaque pixels";
    EXPECT_FALSE(plan_of(plain_scene(), {}, {}, facts(), hardware).elimination) << "nothing saturates";
}

TEST(Plan, RefusesWhatWouldMakeAWrongPicture) {
    RendererOptions options;
    options.effects = {{"no_such_thing", true}};
    EXPECT_THROW(plan_of(plain_scene(), options), InvalidInput);
    Scene lit = plain_scene();
    lit.lights = {Light{}};
    options.effects = {{"gradient", false}};
    EXPECT_THROW(plan_of(lit, options), Unsupported);
    options.allow_inexact = true;
    EXPECT_FALSE(plan_of(lit, options).gradient);
    options = {};
    options.tagging = Tagging::depth_bounds;
    EXPECT_THROW(plan_of(plain_scene(), options), Unsupported);
    options = {};
    options.precision = Precision::uint8;
    EXPECT_THROW(plan_of(plain_scene(), options), Unsupported);
    options.precision = Precision::float16;
    EXPECT_THROW(plan_of(plain_scene(), options), Unsupported) << "stores that cut off drift";
    options.allow_inexact = true;
    EXPECT_EQ(plan_of(plain_scene(), options).precision, Precision::float16);
    options = {};
    options.precision = Precision::float64;
    EXPECT_THROW(plan_of(plain_scene(), options), Unsupported);
}

TEST(Plan, RefusesWindowsThatFloat32CannotResolve) {
    auto offset = std::make_shared<RegularField>(std::vector<double>(8, 1e9), std::array<std::size_t, 3>{2, 2, 2});
    const Scene scene{{offset}, TransferFunction({{1e9, {1, 1, 1}, 0.0}, {1e9 + 1.0, {1, 1, 1}, 0.5}})};
    EXPECT_THROW(plan_of(scene), Unsupported);
    RendererOptions options;
    options.allow_inexact = true;
    EXPECT_EQ(plan_of(scene, options).precision, Precision::float32);
}

TEST(Plan, ForcedEffectsSayWhatTheSceneWanted) {
    RendererOptions options;
    options.effects = {{"elimination", false}, {"points", false}};
    const DrawPlan plan = plan_of(plain_scene(), options);
    int forced = 0;
    for (const Effect& effect : plan.summary.effects) {
        if (effect.forced) {
            ++forced;
            EXPECT_NE(effect.reason.find("the scene says"), std::string::npos);
        }
    }
    EXPECT_EQ(forced, 2);
    EXPECT_FALSE(plan.points);
}

} // namespace
} // namespace sheetsplat

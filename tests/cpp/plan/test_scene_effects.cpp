// Effects that every backend shares: what calls for them, what of a scene's values makes them idle, and what each owes.
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "plan/effect_table.hpp"
#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

/// Values from 0 to 1 at (0..1)^3 with supports of 2 round each: the box from -2 to 3.
std::shared_ptr<const RegularField> volume(Normalization normalization = Normalization::lattice) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = normalization;
    return std::make_shared<RegularField>(std::vector<float>{0.0F, 1.0F, 0.5F, 0.2F, 0.1F, 0.9F, 0.3F, 0.4F},
                                          std::array<std::size_t, 3>{2, 2, 2}, options);
}

Scene lit_scene() {
    Scene scene{{volume()}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
    scene.lights = {Light{}};
    return scene;
}

DrawPlan plan_of(const Scene& scene, Backend backend = Backend::reference, const RendererOptions& options = {},
                 double farthest = 10.0) {
    ViewFacts view;
    view.frame.size = {64, 64};
    view.frame.slices = 6;
    view.kernels.all = 8;
    view.screen_px.smallest = 10.0;
    view.frame.farthest_depth = farthest;
    Capabilities capabilities;
    capabilities.renderer = "a device";
    capabilities.version = "4.5";
    capabilities.version_major = 4;
    capabilities.version_minor = 5;
    capabilities.software = true;
    capabilities.max_point_size = 255.0F;
    return make_plan(scene, test::surveyed(scene, view), options, {}, Projection::orthographic, backend,
                     backend == Backend::gl ? &capabilities : nullptr);
}

const Effect& row(const DrawPlan& plan, const std::string& name) {
    const auto& all = plan.summary.effects;
    const auto found = std::find_if(all.begin(), all.end(), [&](const Effect& one) { return one.name == name; });
    EXPECT_NE(found, all.end()) << name;
    static const Effect none;
    return found != all.end() ? *found : none;
}

RendererOptions forcing(const std::string& name, bool on) {
    RendererOptions options;
    options.effects = {{name, on}};
    return options;
}

constexpr std::array<Backend, 3> backends{Backend::gl, Backend::cpu, Backend::reference};

TEST(EffectTable, IsWhatPlansList) {
    for (const Backend backend : backends) {
        std::multiset<std::string> listed, known;
        for (const Effect& effect : plan_of(lit_scene(), backend).summary.effects) {
            EXPECT_GT(effect.reason.size(), 10U) << effect.name;
            listed.insert(effect.name);
        }
        for (const EffectEntry& entry : effect_table) {
            if (control_of(entry, backend) != Control::absent) {
                known.insert(entry.name);
            }
        }
        EXPECT_EQ(listed, known) << to_string(backend);
    }
}

TEST(EffectTable, IsInOrderAndComplete) {
    for (std::size_t n = 0; n < effect_table.size(); ++n) {
        const EffectEntry& entry = effect_table[n];
        EXPECT_EQ(static_cast<std::size_t>(entry.id), n) << entry.name;
        EXPECT_EQ(entry.decided_by == nullptr,
                  std::count(entry.controls.begin(), entry.controls.end(), Control::forcible) > 0)
            << entry.name;
        EXPECT_NE(control_of(entry, Backend::reference), Control::forcible) << entry.name;
    }
    EXPECT_EQ(known_effects().size(), effect_table.size());
    EXPECT_EQ(known_effects().back().name, effect_table.back().name);
}

TEST(EffectTable, SaysWhatCanBeForced) {
    for (const Backend backend : {Backend::gl, Backend::cpu}) {
        for (const EffectEntry& entry : effect_table) {
            const auto force = [&](bool on) { (void)plan_of(lit_scene(), backend, forcing(entry.name, on)); };
            if (entry.decided_by != nullptr) {
                expect_parts(message_of<InvalidInput>([&] { force(true); }), {entry.name, entry.decided_by});
            } else if (control_of(entry, backend) == Control::forcible) {
                RendererOptions options = forcing(entry.name, false);
                options.allow_inexact = true;
                const DrawPlan plan = plan_of(lit_scene(), backend, options);
                EXPECT_FALSE(row(plan, entry.name).on) << entry.name;
                EXPECT_TRUE(row(plan, entry.name).forced) << entry.name;
            } else {
                expect_parts(message_of<Unsupported>([&] { force(true); }), {entry.name, to_string(backend)});
                EXPECT_NO_THROW(force(false)) << entry.name << " off is what this backend does anyway";
            }
        }
    }
}

TEST(SceneEffects, FollowTheScene) {
    const DrawPlan plain = plan_of(lit_scene());
    EXPECT_TRUE(plain.lit && plain.gradient);
    EXPECT_FALSE(plain.clip || plain.analytic_gradient || plain.gradient_opacity || plain.depth_cue ||
                 plain.second_order || plain.shadows || plain.ambient_occlusion || plain.ambient_only || plain.blank);
    Scene scene = lit_scene();
    scene.clip.planes = {{{1, 0, 0}, 0.5}};
    scene.gradient = Gradient::analytic;
    scene.gradient_opacity = 0.1;
    scene.depth_cue = DepthCue{};
    scene.preintegration = scene.second_order = true;
    const DrawPlan plan = plan_of(scene);
    EXPECT_TRUE(plan.clip && plan.analytic_gradient && plan.gradient_opacity && plan.depth_cue && plan.second_order);
    EXPECT_FALSE(plan.blank);
    for (const char* name : {"clip", "analytic_gradient", "gradient_opacity", "depth_cue", "second_order"}) {
        EXPECT_TRUE(row(plan, name).on) << name;
    }
    scene = lit_scene();
    scene.shadows = true;
    scene.ambient_occlusion = AmbientOcclusion{};
    EXPECT_TRUE(plan_of(scene).shadows && plan_of(scene).ambient_occlusion);
}

TEST(SceneEffects, FacesAreOfCutsInLitComposites) {
    Scene scene = lit_scene();
    scene.cut_faces = true;
    EXPECT_FALSE(plan_of(scene).cut_faces);
    expect_parts(row(plan_of(scene), "cut_faces").reason, {"nothing is cut off"});
    scene.clip.planes = {{{1, 0, 0}, 0.5}};
    for (const Backend backend : backends) {
        EXPECT_TRUE(plan_of(scene, backend).cut_faces) << to_string(backend);
        expect_parts(row(plan_of(scene, backend), "cut_faces").reason, {"normals are those of the cut"});
    }
    EXPECT_TRUE(plan_of(scene, Backend::gl).read_image) << "what is in front counts";
    scene.cut_faces = false;
    EXPECT_FALSE(plan_of(scene).cut_faces);
    scene.cut_faces = true;
    scene.mode = Mode::mip;
    EXPECT_FALSE(plan_of(scene).cut_faces);
    scene.mode = Mode::composite;
    scene.lights.clear();
    EXPECT_FALSE(plan_of(scene).cut_faces);
    expect_parts(row(plan_of(scene), "cut_faces").reason, {"there are no lights"});
}

TEST(SceneEffects, GradientsAreForLightsOrForOpacity) {
    Scene scene = lit_scene();
    scene.lights.clear();
    EXPECT_FALSE(plan_of(scene).gradient);
    scene.gradient = Gradient::analytic;
    EXPECT_FALSE(plan_of(scene).analytic_gradient) << "nothing calls for gradients";
    expect_parts(row(plan_of(scene), "analytic_gradient").reason, {"there are no lights"});
    scene.gradient_opacity = 0.1;
    const DrawPlan plan = plan_of(scene);
    EXPECT_TRUE(plan.gradient && plan.gradient_opacity && plan.analytic_gradient);
    EXPECT_FALSE(plan.lit || plan.specular || plan.two_sided || plan.shadows);
    expect_parts(row(plan, "gradient").reason, {"opacity follows the gradient"});
}

TEST(SceneEffects, LightThatNothingGivesBackCallsForNothing) {
    for (const int kind : {0, 1}) {
        Scene scene = lit_scene();
        scene.shadows = true;
        scene.material.two_sided = true;
        if (kind == 0) {
            scene.material.specular = 0.5;
            scene.lights[0].color = Vec3(0.0);
        } else {
            scene.material.diffuse = 0.0;
        }
        const DrawPlan plan = plan_of(scene);
        EXPECT_TRUE(plan.ambient_only);
        EXPECT_FALSE(plan.gradient || plan.lit || plan.specular || plan.two_sided || plan.shadows);
        EXPECT_FALSE(row(plan, "eye_lights").on);
        scene.ambient_occlusion = AmbientOcclusion{};
        EXPECT_TRUE(plan_of(scene).ambient_occlusion && plan_of(scene).ambient_only);
        EXPECT_FALSE(plan_of(scene).gradient) << "ambient light has no direction";
        scene.ambient_occlusion->strength = 0.0;
        EXPECT_FALSE(plan_of(scene).ambient_occlusion);
        scene.ambient_occlusion->strength = 1.0;
        scene.material.ambient = 0.0;
        EXPECT_FALSE(plan_of(scene).ambient_occlusion);
        scene.lights.clear();
        EXPECT_TRUE(plan_of(scene).ambient_occlusion) << "without lights all colours are ambient";
        EXPECT_FALSE(plan_of(scene).gradient || plan_of(scene).ambient_only);
    }
    Scene scene = lit_scene();
    scene.material.diffuse = 0.0;
    scene.material.specular = 0.2;
    EXPECT_TRUE(plan_of(scene).lit && plan_of(scene).specular);
    scene.lights.push_back({{0, 0, 1}, {0, 0, 0}, LightSpace::world});
    EXPECT_TRUE(row(plan_of(scene), "eye_lights").on);
    expect_parts(row(plan_of(scene), "world_lights").reason, {"1 light of the world"});
}

TEST(SceneEffects, ValuesThatDoNotOccurCallForNothing) {
    Scene scene = lit_scene();
    scene.material.specular = 0.5;
    scene.gradient_opacity = 0.1;
    scene.depth_cue = DepthCue{};
    // The ripple carries 1 to some 1.006 at most.
    for (const double from : {1.05, 0.99}) {
        scene.transfer_function = TransferFunction({{from, {1, 1, 1}, 0.0}, {2.0, {1, 1, 1}, 1.0}});
        const DrawPlan plan = plan_of(scene);
        const bool occurs = from < 1.04;
        EXPECT_EQ(plan.gradient, occurs);
        EXPECT_EQ(plan.lit, occurs);
        EXPECT_EQ(plan.specular, occurs);
        EXPECT_EQ(plan.gradient_opacity, occurs);
        EXPECT_EQ(plan.depth_cue, occurs);
        EXPECT_FALSE(plan.stop) << "opacity 1 does not occur";
        if (!occurs) {
            expect_parts(row(plan, "gradient").reason, {"opacity is 0 over all values that can occur"});
        }
    }
    scene.transfer_function = TransferFunction({{-1.0, {1, 1, 1}, 1.0}, {-0.01, {1, 1, 1}, 0.0}});
    EXPECT_FALSE(plan_of(scene).gradient) << "no value is below 0";
    // Unnormalised sums of lattices are larger; those of scattered kernels have no bound.
    scene.transfer_function = TransferFunction({{1.05, {1, 1, 1}, 0.0}, {2.0, {1, 1, 1}, 1.0}});
    scene.fields = {volume(Normalization::none)};
    EXPECT_TRUE(plan_of(scene).gradient);
    EllipsoidArrays arrays;
    arrays.centers = {{0, 0, 0}};
    arrays.radii = {1.0};
    arrays.values = {1.0};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::none;
    scene.fields = {std::make_shared<EllipsoidField>(arrays, options)};
    EXPECT_TRUE(plan_of(scene).gradient);
    scene.transfer_function = TransferFunction({{-1.0, {1, 1, 1}, 1.0}, {-0.01, {1, 1, 1}, 0.0}});
    EXPECT_FALSE(plan_of(scene).gradient) << "none is below 0, however many overlap";
    options.normalization = Normalization::threshold;
    scene.fields = {std::make_shared<EllipsoidField>(arrays, options)};
    scene.transfer_function = TransferFunction({{1.05, {1, 1, 1}, 0.0}, {2.0, {1, 1, 1}, 1.0}});
    EXPECT_FALSE(plan_of(scene).gradient) << "a mean is no larger than the largest value";
    // The cubic of second order leaves the range of the values by an eighth of the spread.
    scene.preintegration = scene.second_order = true;
    EXPECT_TRUE(plan_of(scene).gradient);
}

TEST(SceneEffects, IsovaluesThatDoNotOccurCallForNothing) {
    Scene scene = lit_scene();
    scene.mode = Mode::isosurface;
    for (const auto& [iso, crossed] : std::vector<std::pair<double, bool>>{{0.5, true}, {1.2, false}, {-0.1, false}}) {
        scene.iso_values = {iso};
        EXPECT_EQ(plan_of(scene).gradient, crossed) << iso;
        EXPECT_EQ(row(plan_of(scene), "gradient").reason.find("no value crosses") == std::string::npos, crossed);
    }
}

TEST(SceneEffects, SurfacesCastShadowsByTheirOwnOpacity) {
    Scene scene = lit_scene();
    scene.mode = Mode::isosurface;
    scene.iso_values = {{0.5, 0.3}};
    scene.shadows = true;
    scene.ambient_occlusion = AmbientOcclusion{};
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.5, {1, 1, 1}, 0.0}, {2.0, {1, 1, 1}, 1.0}});
    EXPECT_TRUE(plan_of(scene).shadows && plan_of(scene).ambient_occlusion && plan_of(scene).lit);
    for (const std::vector<IsoValue>& unseen : {std::vector<IsoValue>{{0.5, 0.0}}, {1.4, -0.1}}) {
        scene.iso_values = unseen;
        EXPECT_FALSE(plan_of(scene).shadows || plan_of(scene).ambient_occlusion || plan_of(scene).lit);
        expect_parts(row(plan_of(scene), "shadows").reason, {"no value crosses an iso value"});
    }
    scene.iso_values = {0.5};
    EXPECT_TRUE(plan_of(scene, Backend::cpu).shadows && plan_of(scene, Backend::cpu).ambient_occlusion);
}

TEST(SceneEffects, EveryBackendHasGroupsSeveralSurfacesAndWeightedSlices) {
    Scene groups = lit_scene();
    groups.fields.push_back(volume());
    groups.later_groups = {{1, groups.transfer_function}};
    Scene surfaces = lit_scene();
    surfaces.mode = Mode::isosurface;
    for (const Backend backend : backends) {
        EXPECT_TRUE(row(plan_of(groups, backend), "own_transfer_functions").on);
        // Each field is a group: nothing adds up.
        EXPECT_FALSE(row(plan_of(groups, backend), "several_fields").on);
        expect_parts(row(plan_of(groups, backend), "several_fields").reason, {"2 fields", "own transfer function"});
        Scene pair = groups;
        pair.fields.push_back(volume());
        EXPECT_TRUE(row(plan_of(pair, backend), "several_fields").on);
        expect_parts(row(plan_of(pair, backend), "several_fields").reason, {"3 fields in 2 groups"});
        surfaces.iso_values = {0.5, 0.6};
        EXPECT_FALSE(plan_of(surfaces, backend).stop);
        surfaces.iso_values = {{0.5, 0.99}};
        EXPECT_TRUE(plan_of(surfaces, backend).stop);
        for (const Mode mode : {Mode::minimum, Mode::average}) {
            Scene scalar = lit_scene();
            scalar.mode = mode;
            EXPECT_EQ(plan_of(scalar, backend).weight, backend != Backend::cpu);
            scalar.sampling = Sampling::slab;
            EXPECT_TRUE(plan_of(scalar, backend).weight);
            // Where each field is divided by its own weights, the sum of all weights still counts.
            scalar.fields = {volume(Normalization::threshold), volume(Normalization::threshold)};
            EXPECT_TRUE(plan_of(scalar, backend).weight);
        }
        // In scalar modes all fields add up.
        Scene xray = groups;
        xray.mode = Mode::xray;
        EXPECT_FALSE(row(plan_of(xray, backend), "own_transfer_functions").on);
        EXPECT_TRUE(row(plan_of(xray, backend), "several_fields").on);
        EXPECT_TRUE(plan_of(xray, backend).field_units.empty());
    }
}

TEST(SceneEffects, PackingPaperHasSheetsOfOneGroup) {
    Scene groups = lit_scene();
    groups.fields.push_back(volume());
    groups.later_groups = {{1, groups.transfer_function}};
    RendererOptions paper;
    paper.packing = Packing::paper;
    expect_parts(message_of<Unsupported>([&] { (void)plan_of(groups, Backend::gl, paper); }),
                 {"packing paper for 2 transfer functions", "packing = wide"});
    EXPECT_EQ(plan_of(groups, Backend::gl).packing, Packing::wide);
    groups.mode = Mode::mip;
    EXPECT_EQ(plan_of(groups, Backend::gl, paper).packing, Packing::paper);
    // Each group's fields are divided before they are shaded, since each has a w0 of its own.
    Scene quotients = lit_scene();
    quotients.fields = {volume(Normalization::threshold), volume()};
    quotients.later_groups = {{1, quotients.transfer_function}};
    EXPECT_EQ(plan_of(quotients, Backend::gl).own_sheets, (std::vector<int>{0, -1}));
}

TEST(SceneEffects, EachGroupHasTheUnitOfItsWindow) {
    Scene scene = lit_scene();
    scene.fields = {volume(), volume(), volume()};
    scene.later_groups = {{2, TransferFunction({{10.0, {1, 1, 1}, 0.0}, {40.0, {1, 1, 1}, 0.5}})}};
    const DrawPlan plan = plan_of(scene, Backend::cpu);
    EXPECT_EQ(plan.field_units, (std::vector<double>{1.0, 1.0, 30.0}));
    EXPECT_EQ(plan.unit_of(1), 1.0);
    EXPECT_EQ(plan.unit_of(2), 30.0);
    EXPECT_EQ(plan_of(lit_scene(), Backend::cpu).unit_of(0), 1.0);
    // Of surfaces the values decide.
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.5};
    EXPECT_EQ(plan_of(scene, Backend::cpu).field_units, (std::vector<double>{1.0, 1.0, 1.0}));
}

TEST(SceneEffects, TheStopCountsWhereSurfacesAreTranslucent) {
    Scene scene = lit_scene();
    scene.mode = Mode::isosurface;
    scene.opacity_stop = 0.9;
    scene.iso_values = {0.5};
    EXPECT_FALSE(plan_of(scene).stop);
    scene.iso_values = {0.5, {0.4, 0.5}};
    EXPECT_TRUE(plan_of(scene).stop);
    scene.opacity_stop = 1.0;
    EXPECT_FALSE(plan_of(scene).stop);
}

// Six slices, a reference length apart, of an opacity of 0.5: together 1 - 0.5^6 = 0.984.
TEST(SceneEffects, TheStopCountsWhereOpacityCanReachIt) {
    Scene scene = lit_scene();
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.5}, {1.0, {1, 1, 1}, 0.5}});
    scene.opacity_stop = 0.98;
    EXPECT_TRUE(plan_of(scene).stop);
    scene.opacity_stop = 0.99;
    EXPECT_FALSE(plan_of(scene).stop);
    // Seven intervals: 0.992.
    scene.preintegration = true;
    EXPECT_TRUE(plan_of(scene).stop);
    // 1 - (1 - 4/3 0.5)^7 = 0.9995.
    scene.opacity_stop = 0.999;
    EXPECT_FALSE(plan_of(scene).stop);
    scene.second_order = true;
    EXPECT_TRUE(plan_of(scene).stop);
}

TEST(SceneEffects, TheStopCountsWhatGroupsAbsorbTogether) {
    Scene scene = lit_scene();
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.5}, {1.0, {1, 1, 1}, 0.5}});
    scene.fields = {volume(), volume()};
    scene.later_groups = {{1, scene.transfer_function}};
    // 1 - 0.25^6 = 0.99976
    scene.opacity_stop = 0.9995;
    EXPECT_TRUE(plan_of(scene).stop);
    scene.opacity_stop = 0.9999;
    EXPECT_FALSE(plan_of(scene).stop);
}

TEST(SceneEffects, ScalarModesHaveNoneButClip) {
    for (const Mode mode : {Mode::xray, Mode::mip}) {
        Scene scene = lit_scene();
        scene.mode = mode;
        scene.clip.box = Box{{0, 0, 0}, {1, 1, 1}};
        scene.gradient = Gradient::analytic;
        scene.depth_cue = DepthCue{};
        scene.shadows = true;
        scene.ambient_occlusion = AmbientOcclusion{};
        const DrawPlan plan = plan_of(scene);
        EXPECT_TRUE(plan.clip);
        EXPECT_FALSE(plan.gradient || plan.lit || plan.analytic_gradient || plan.depth_cue || plan.shadows ||
                     plan.ambient_occlusion || plan.ambient_only || plan.second_order);
    }
}

TEST(SceneEffects, DepthLimitsAreOnWhereTheyCutSomething) {
    struct Case {
        double nearest, farthest;
        bool on, blank;
    };
    constexpr double infinity = std::numeric_limits<double>::infinity();
    // Slices lie at depths from 0 on; crossings and intervals end at 10.
    for (const Case& one : {Case{11.1, infinity, false, false}, Case{9.9, infinity, true, false},
                            Case{0.1, 0.2, true, false}, Case{-1.0, 0.0, true, true}}) {
        Scene scene = lit_scene();
        scene.depth_limit = DepthLimit({1, 2}, {one.nearest, one.farthest});
        for (const Backend backend : backends) {
            const DrawPlan plan = plan_of(scene, backend);
            EXPECT_EQ(plan.depth_limit, one.on) << one.nearest;
            EXPECT_EQ(plan.blank, one.blank) << one.nearest;
            EXPECT_EQ(plan.cuts(), one.on) << one.nearest;
            EXPECT_EQ(row(plan, "depth_limit").on, one.on) << one.nearest;
        }
        scene.preintegration = true;
        EXPECT_EQ(plan_of(scene, Backend::cpu).empty_test, one.on) << "an interval may have one end that is cut off";
    }
    EXPECT_FALSE(plan_of(lit_scene()).cuts());
    expect_parts(row(plan_of(lit_scene()), "depth_limit").reason, {"no depths"});
}

TEST(SceneEffects, ClipsThatKeepAllAreOffAndThoseThatKeepNothingDrawNothing) {
    struct Case {
        Vec3 normal;
        double offset;
        bool on, blank;
    };
    // Supports reach from -2 to 3 along each axis.
    for (const Case& one :
         {Case{{1, 0, 0}, -2.0, false, false}, Case{{1, 0, 0}, -1.99, true, false},
          Case{{-2, 0, 0}, -6.0, false, false}, Case{{-2, 0, 0}, -5.9, true, false}, Case{{0, 0, 1}, 3.01, true, true},
          Case{{0, 0, 1}, 2.99, true, false}, Case{{1, 1, 1}, -6.0, false, false}, Case{{1, 1, 1}, 9.01, true, true}}) {
        Scene scene = lit_scene();
        scene.clip.planes = {{one.normal, one.offset}};
        const DrawPlan plan = plan_of(scene);
        EXPECT_EQ(plan.clip, one.on) << one.offset;
        EXPECT_EQ(plan.blank, one.blank) << one.offset;
    }
    Scene scene = lit_scene();
    scene.clip.box = Box{{-2, -2, -2}, {3, 3, 3}};
    EXPECT_FALSE(plan_of(scene).clip);
    expect_parts(row(plan_of(scene), "clip").reason, {"keeps all that kernels reach"});
    // A crossing has an end beyond the supports, and a slab reaches beyond its middle.
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.5};
    EXPECT_TRUE(plan_of(scene).clip);
    scene.mode = Mode::composite;
    scene.sampling = Sampling::slab;
    EXPECT_TRUE(plan_of(scene).clip);
    scene.clip.box = Box{{-3, -3, -3}, {4, 4, 4}};
    EXPECT_FALSE(plan_of(scene).clip);
    scene.clip.box = Box{{10, 10, 10}, {11, 11, 11}};
    EXPECT_TRUE(plan_of(scene).blank);
}

TEST(SceneEffects, DepthCuesThatChangeNothingAreOff) {
    Scene scene = lit_scene();
    scene.depth_cue = DepthCue{1.0, 2.0, {0, 0, 0}, 0.0};
    EXPECT_FALSE(plan_of(scene).depth_cue);
    expect_parts(row(plan_of(scene), "depth_cue").reason, {"strength of 0"});
    scene.depth_cue = DepthCue{11.0, 12.0, {0, 0, 0}, 1.0};
    EXPECT_FALSE(plan_of(scene).depth_cue);
    expect_parts(row(plan_of(scene), "depth_cue").reason, {"behind the last slice"});
    EXPECT_TRUE(plan_of(scene, Backend::reference, {}, 11.5).depth_cue);
}

TEST(SceneEffects, WhatHasNoNumbersCannotBeForcedOn) {
    for (const char* name : {"clip", "gradient_opacity", "cut_faces", "depth_cue", "second_order", "shadows",
                             "ambient_occlusion", "analytic_gradient"}) {
        const DrawPlan plan = plan_of(lit_scene(), Backend::cpu, forcing(name, true));
        EXPECT_FALSE(row(plan, name).on) << name;
        EXPECT_TRUE(row(plan, name).forced) << name;
        expect_parts(row(plan, name).reason, {"forced on, but there is nothing to do"});
    }
    Scene clipped = lit_scene();
    clipped.clip.planes = {{{1, 0, 0}, -100.0}};
    EXPECT_FALSE(plan_of(clipped, Backend::gl).clip);
    EXPECT_TRUE(plan_of(clipped, Backend::gl, forcing("clip", true)).clip);
    clipped.clip.planes = {{{1, 0, 0}, 0.5}};
    EXPECT_THROW(plan_of(clipped, Backend::gl, forcing("clip", false)), Unsupported);
    RendererOptions inexact = forcing("clip", false);
    inexact.allow_inexact = true;
    EXPECT_FALSE(plan_of(clipped, Backend::gl, inexact).clip);
}

TEST(SceneEffects, ComplaintsNameWhatTheBackendHas) {
    const auto complaint = [](Backend backend, const char* name) {
        return message_of<InvalidInput>([&] { (void)plan_of(lit_scene(), backend, forcing(name, true)); });
    };
    const std::string of_cpu = complaint(Backend::cpu, "no_such_thing");
    expect_parts(of_cpu, {"no_such_thing", "of backend cpu", "culling", "depth_cue"});
    EXPECT_EQ(of_cpu.find("opacity_buffer"), std::string::npos);
    expect_parts(complaint(Backend::gl, "no_such_thing"), {"of backend gl", "opacity_buffer", "depth_cue"});
    expect_parts(complaint(Backend::reference, "no_such_thing"), {"backend reference draws what the scene says"});
    for (const Backend backend : backends) {
        expect_parts(complaint(backend, "float64"), {"float64", "precision"});
        // Whatever a plan lists can be forced, or the complaint says what decides it.
        for (const Effect& effect : plan_of(lit_scene(), backend).summary.effects) {
            try {
                (void)plan_of(lit_scene(), backend, forcing(effect.name, true));
            } catch (const InvalidInput& error) {
                expect_parts(error.what(), {effect.name.c_str(), "follows from"});
            } catch (const Unsupported&) {
                // It is known, but not for this scene or this backend.
            }
        }
    }
}

TEST(SceneEffects, TheReferenceDrawsWhatTheSceneSays) {
    for (const Effect& effect : plan_of(lit_scene(), Backend::reference, forcing("gradient", false)).summary.effects) {
        EXPECT_FALSE(effect.forced);
        EXPECT_TRUE(effect.name != "gradient" || effect.on);
    }
}

TEST(SceneEffects, WhatTheyOweAddsUpToTheBudget) {
    Scene scene = lit_scene();
    scene.material.specular = 0.5;
    for (const Backend backend : backends) {
        const RenderPlan plan = plan_of(scene, backend).summary;
        double squares = 0.0;
        for (const Effect& effect : plan.effects) {
            EXPECT_GE(effect.error, 0.0);
            squares += effect.error * effect.error;
        }
        EXPECT_NEAR(std::sqrt(squares), plan.expected_error(), 1e-12 * plan.expected_error()) << to_string(backend);
        EXPECT_EQ(plan.expected_error() > 0.0, backend != Backend::reference);
        for (const ErrorShare& share : plan.error_budget) {
            EXPECT_TRUE(plan.has(share.effect)) << share.cause << " is owed by " << share.effect;
        }
    }
}

} // namespace
} // namespace sheetsplat

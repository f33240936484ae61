// What a scene calls for, and why.
#include <cmath>
#include <sstream>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> small_field(Normalization normalization = Normalization::lattice) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = normalization;
    return std::make_shared<RegularField>(std::vector<float>{0.0F, 1.0F, 0.5F, 0.2F, 0.1F, 0.9F, 0.3F, 0.4F},
                                          std::array<std::size_t, 3>{2, 2, 2}, options);
}

Scene plain_scene(Normalization normalization = Normalization::lattice) {
    return Scene{{small_field(normalization)}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.01}})};
}

ViewFacts facts() {
    ViewFacts view;
    view.frame.size = {64, 64};
    view.frame.slices = 6;
    view.kernels.all = 8;
    return view;
}

Capabilities software() {
    Capabilities capabilities;
    capabilities.renderer = "a rasteriser in software";
    capabilities.software = true;
    capabilities.float16_blend_rounds = false;
    capabilities.max_point_size = 255.0F;
    capabilities.texture_barrier = true;
    return capabilities;
}

DrawPlan plan_of(const Scene& scene, const RendererOptions& options = {}, const Outputs& outputs = {},
                 ViewFacts view = facts(), Capabilities capabilities = software(),
                 Projection projection = Projection::orthographic) {
    return make_plan(scene, test::surveyed(scene, std::move(view)), options, outputs, projection, Backend::gl,
                     &capabilities);
}

TEST(Plan, RefusesFloat32SheetsThatTheDeviceCannotBlend) {
    Capabilities capabilities = software();
    capabilities.float32_blend = false;
    test::expect_parts(test::message_of<Unsupported>(
                           [&] { static_cast<void>(plan_of(plain_scene(), {}, {}, facts(), capabilities)); }),
                       {"float32 sheets", "a rasteriser in software", "cannot blend 32-bit floats"});
}

TEST(Plan, LeavesOutWhatTheSceneDoesNotCallFor) {
    const DrawPlan plan = plan_of(plain_scene());
    for (const char* name : {"weight", "gradient", "specular", "two_sided", "opacity_correction", "opacity_stop",
                             "elimination", "opacity_buffer", "perspective", "slab_sampling", "preintegration",
                             "coverage", "depth", "background", "world_lights"}) {
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
    view.frame.slice_spacing = 0.5;
    EXPECT_TRUE(plan_of(plain_scene(), {}, {}, view).opacity_correction);
    view = facts();
    view.screen_px.largest_lattice = 200.0;
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
    deep.frame.slices = 100;
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
    auto offset = std::make_shared<RegularField>(std::vector<double>(8, 1e9), std::array<std::size_t, 3>{2, 2, 2},
                                                 test::zero_boundary());
    const Scene scene{{offset}, TransferFunction({{1e9, {1, 1, 1}, 0.0}, {1e9 + 1.0, {1, 1, 1}, 0.5}})};
    EXPECT_THROW(plan_of(scene), Unsupported);
    RendererOptions options;
    options.allow_inexact = true;
    EXPECT_EQ(plan_of(scene, options).precision, Precision::float32);
}

TEST(Plan, ForcedEffectsSayWhatTheSceneWanted) {
    RendererOptions options;
    options.effects = {{"elimination", false}, {"culling", false}};
    const DrawPlan plan = plan_of(plain_scene(), options);
    int forced = 0;
    for (const Effect& effect : plan.summary.effects) {
        if (effect.forced) {
            ++forced;
            EXPECT_NE(effect.reason.find("the scene says"), std::string::npos);
        }
    }
    EXPECT_EQ(forced, 2);
    EXPECT_FALSE(plan.culling);
}

// ---- ellipsoids

std::shared_ptr<const EllipsoidField> scattered(const std::vector<double>& values = {0.2, 1.0},
                                                const std::vector<double>& weights = {},
                                                Normalization normalization = Normalization::threshold, double w0 = 1.0,
                                                bool round = false) {
    EllipsoidArrays arrays;
    for (const double value : values) {
        arrays.centers.emplace_back(static_cast<double>(arrays.centers.size()), 0.0, 0.0);
        if (round) {
            arrays.radii.push_back(1.0);
        } else {
            arrays.scales.emplace_back(1.0, 0.5, 2.0);
        }
        arrays.values.push_back(value);
    }
    arrays.weights = weights;
    EllipsoidFieldOptions options;
    options.normalization = normalization;
    options.w0 = w0;
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

Scene scene_of(std::vector<std::shared_ptr<const Field>> fields) {
    Scene scene = plain_scene();
    scene.fields = std::move(fields);
    return scene;
}

ViewFacts ellipsoid_facts() {
    ViewFacts view = facts();
    view.kernels.ellipsoids = true;
    view.kernels.most_ellipsoids = 2;
    view.shapes.largest_aspect = 4.0;
    view.screen_px.largest_lattice = 0.0;
    view.overlap.typical = 5.0;
    return view;
}

Capabilities hardware() {
    Capabilities capabilities = software();
    capabilities.software = false;
    capabilities.float16_blend_rounds = true;
    capabilities.renderer = "a device";
    capabilities.version = "4.6";
    capabilities.version_major = 4;
    capabilities.version_minor = 6;
    return capabilities;
}

std::string reason_of(const DrawPlan& plan, const std::string& name) {
    std::string reason;
    int found = 0;
    for (const Effect& effect : plan.summary.effects) {
        if (effect.name == name) {
            reason = effect.reason;
            ++found;
        }
    }
    EXPECT_EQ(found, 1) << name;
    return reason;
}

RendererOptions forcing(const std::string& name, bool on, bool allow_inexact = false) {
    RendererOptions options;
    options.effects = {{name, on}};
    options.allow_inexact = allow_inexact;
    return options;
}

using test::expect_parts;
using test::message_of;

TEST(PlanOfEllipsoids, SaysWhatTheFilterIsFor) {
    Scene scene = scene_of({scattered()});
    ViewFacts view = ellipsoid_facts();
    DrawPlan plan = plan_of(scene, {}, {}, view);
    EXPECT_FALSE(plan.filter);
    EXPECT_FALSE(plan.summary.has("ewa_filter"));
    expect_parts(reason_of(plan, "ewa_filter"), {"no filter", "no kernel is smaller than a pixel"});

    view.kernels.unresolved = 123456;
    view.shapes.largest_filtering = 4.0;
    plan = plan_of(scene, {}, {}, view);
    EXPECT_FALSE(plan.filter) << "only where it is asked for";
    expect_parts(reason_of(plan, "ewa_filter"), {"no filter, though 123456 kernels are smaller", "the filter ewa"});
    view.kernels.unresolved = 1;
    expect_parts(reason_of(plan_of(scene, {}, {}, view), "ewa_filter"), {"1 kernel is smaller"});

    scene.filter = Filter::ewa;
    plan = plan_of(scene, {}, {}, view);
    EXPECT_TRUE(plan.filter);
    EXPECT_TRUE(plan.summary.has("ewa_filter"));
    expect_parts(reason_of(plan, "ewa_filter"), {"has the filter ewa, and 1 kernel is smaller"});
    view.kernels.unresolved = 0;
    view.shapes.largest_filtering = 1e-3;
    plan = plan_of(scene, {}, {}, view);
    EXPECT_TRUE(plan.filter);
    expect_parts(reason_of(plan, "ewa_filter"),
                 {"has the filter ewa: it widens kernels by a pixel and a slice distance"});
    view.shapes.largest_filtering = 1e-7;
    plan = plan_of(scene, {}, {}, view);
    EXPECT_FALSE(plan.filter);
    expect_parts(reason_of(plan, "ewa_filter"), {"every kernel is so large that it would change nothing"});
}

TEST(PlanOfEllipsoids, TellsLatticesFromScatteredKernels) {
    ViewFacts lattice = facts();
    lattice.shapes.largest_filtering = 1.0;
    EXPECT_FALSE(plan_of(plain_scene(), {}, {}, lattice).summary.has("scattered_kernels"));
    EXPECT_EQ(reason_of(plan_of(plain_scene(), {}, {}, lattice), "scattered_kernels"), "all fields are lattices");
    Scene filtered = plain_scene();
    filtered.filter = Filter::ewa;
    EXPECT_TRUE(plan_of(filtered, {}, {}, lattice).summary.has("scattered_kernels"));
    expect_parts(reason_of(plan_of(filtered, {}, {}, lattice), "scattered_kernels"), {"lattices into ellipsoids"});
    EXPECT_TRUE(plan_of(scene_of({scattered()}), {}, {}, ellipsoid_facts()).summary.has("scattered_kernels"));

    // Sections of lattices are told from those of ellipsoids, which need no choice.
    const auto general = [](const Scene& scene, ViewFacts view, Projection projection) {
        return plan_of(scene, {}, {}, std::move(view), software(), projection);
    };
    ViewFacts sheared = facts();
    sheared.shapes.sheared = true;
    EXPECT_TRUE(general(plain_scene(), facts(), Projection::perspective).general);
    EXPECT_TRUE(general(plain_scene(), sheared, Projection::orthographic).general);
    EXPECT_FALSE(general(plain_scene(), facts(), Projection::orthographic).general);
    expect_parts(reason_of(general(plain_scene(), facts(), Projection::orthographic), "general_sections"), {"lattice"});
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        const DrawPlan plan = general(scene_of({scattered()}), ellipsoid_facts(), projection);
        EXPECT_FALSE(plan.general);
        expect_parts(reason_of(plan, "general_sections"), {"no lattice is drawn", "every ellipsoid"});
    }
    EXPECT_TRUE(general(scene_of({small_field(), scattered()}), ellipsoid_facts(), Projection::perspective).general);
    EXPECT_FALSE(general(filtered, lattice, Projection::perspective).general) << "no lattice is left";
}

TEST(PlanOfEllipsoids, DrawsSmallSpheresAsPoints) {
    const auto round = scattered({0.2, 1.0}, {}, Normalization::threshold, 1.0, true);
    const ViewFacts view = ellipsoid_facts();
    EXPECT_TRUE(plan_of(scene_of({round}), {}, {}, view).points);
    expect_parts(reason_of(plan_of(scene_of({round}), {}, {}, view), "points"), {"spheres that are small enough"});
    EXPECT_FALSE(plan_of(scene_of({scattered()}), {}, {}, view).points);
    expect_parts(reason_of(plan_of(scene_of({scattered()}), {}, {}, view), "points"), {"rectangles"});
    EXPECT_TRUE(plan_of(scene_of({scattered(), round}), {}, {}, view).points);
    EXPECT_TRUE(plan_of(scene_of({scattered(), small_field()}), {}, {}, view).points) << "those of the lattice";
    Scene slabs = scene_of({round});
    slabs.sampling = Sampling::slab;
    EXPECT_FALSE(plan_of(slabs, {}, {}, view).points);
    Scene wide = scene_of({round});
    wide.filter = Filter::ewa;
    ViewFacts small = view;
    small.shapes.largest_filtering = 1.0;
    EXPECT_FALSE(plan_of(wide, {}, {}, small).points);
    const DrawPlan deep = plan_of(scene_of({round}), {}, {}, view, software(), Projection::perspective);
    EXPECT_FALSE(deep.points);
    expect_parts(reason_of(deep, "points"), {"differ in size"});
}

TEST(PlanOfEllipsoids, DividesFieldsByTheirOwnWeights) {
    const auto none = scattered({0.2, 1.0}, {}, Normalization::none);
    const ViewFacts view = ellipsoid_facts();
    DrawPlan plan = plan_of(scene_of({scattered()}), {}, {}, view);
    EXPECT_TRUE(plan.own_sheets.empty());
    EXPECT_TRUE(plan.threshold);
    EXPECT_TRUE(plan.weight);
    EXPECT_FALSE(plan.summary.has("separate_normalization"));
    EXPECT_TRUE(plan_of(scene_of({none, small_field()}), {}, {}, view).own_sheets.empty()) << "all of them add up";

    plan = plan_of(scene_of({scattered(), none, small_field(), scattered()}), {}, {}, view);
    EXPECT_EQ(plan.own_sheets, (std::vector<int>{0, -1, -1, 1}));
    EXPECT_TRUE(plan.summary.has("separate_normalization"));
    expect_parts(reason_of(plan, "separate_normalization"), {"their own weight sums before they are added"});
    EXPECT_FALSE(plan.threshold) << "the sum of all is divided no more";
    EXPECT_FALSE(plan.weight);
    const std::uint64_t all = plan.summary.memory;
    const std::uint64_t one = plan_of(scene_of({none, none, small_field(), scattered()}), {}, {}, view).summary.memory;
    // Values and weights in three targets of 16 bytes a pixel.
    EXPECT_EQ(all - one, 66U * 66U * 16U * 6U);
    EXPECT_TRUE(plan_of(scene_of({scattered(), none}), {}, {true, false}, view).weight) << "coverage is of all";

    Scene close = scene_of({scattered(), none});
    close.lights = {Light{}};
    ViewFacts near = view;
    near.frame.smallest_pixel = 0.01;
    EXPECT_THROW(plan_of(close, {}, {}, near), Unsupported);
    EXPECT_TRUE(plan_of(close, {}, {}, view).gradient);
}

TEST(PlanOfEllipsoids, SlicesOnTheDeviceWhereThatIsExactAndPays) {
    const Scene scene = scene_of({scattered()});
    const ViewFacts view = ellipsoid_facts();
    DrawPlan plan = plan_of(scene, {}, {}, view, hardware());
    EXPECT_TRUE(plan.resident_sections);
    expect_parts(reason_of(plan, "resident_sections"), {"one pass on the device"});
    plan = plan_of(scene, {}, {}, view);
    EXPECT_FALSE(plan.resident_sections);

    const auto refused = [&](const Scene& asked, const ViewFacts& facts_of_it, const Capabilities& capabilities,
                             const std::string& why) {
        const DrawPlan left = plan_of(asked, {}, {}, facts_of_it, capabilities);
        EXPECT_FALSE(left.resident_sections) << why;
        expect_parts(reason_of(left, "resident_sections"), {why});
        expect_parts(message_of<Unsupported>([&] {
                         static_cast<void>(
                             plan_of(asked, forcing("resident_sections", true), {}, facts_of_it, capabilities));
                     }),
                     {"resident_sections forced on", why});
    };
    refused(plain_scene(), facts(), hardware(), "no field holds ellipsoids");
    ViewFacts slender = view;
    slender.shapes.largest_aspect = 2000.0;
    refused(scene, slender, hardware(), "1:2000 are sliced for each batch");
    ViewFacts many = view;
    many.kernels.most_ellipsoids = 12345678;
    refused(scene, many, hardware(), "12345678 kernels are sliced batch by batch");
    Capabilities old = hardware();
    old.version = "4.0 of old";
    old.version_minor = 0;
    refused(scene, view, old, "OpenGL 4.0 of old has no float64 vertex programs");
    Scene filtered = scene;
    filtered.filter = Filter::ewa;
    ViewFacts small = view;
    small.shapes.largest_filtering = 1.0;
    refused(filtered, small, hardware(), "filtered kernels are sliced by the processor");

    // A device in software can, but does not gain by it.
    Capabilities new_software = hardware();
    new_software.software = true;
    plan = plan_of(scene, {}, {}, view, new_software);
    EXPECT_FALSE(plan.resident_sections);
    expect_parts(reason_of(plan, "resident_sections"), {"a device in software"});
    EXPECT_TRUE(plan_of(scene, forcing("resident_sections", true), {}, view, new_software).resident_sections);
    EXPECT_FALSE(plan_of(scene, forcing("resident_sections", false), {}, view, hardware()).resident_sections);
}

TEST(PlanOfEllipsoids, PlacesNeedlesInFloat64) {
    const Scene scene = scene_of({scattered()});
    ViewFacts view = ellipsoid_facts();
    EXPECT_EQ(plan_of(scene, {}, {}, view, hardware()).precise_aspect, std::numeric_limits<double>::infinity());
    view.shapes.largest_aspect = 1e5;
    DrawPlan plan = plan_of(scene, {}, {}, view, hardware());
    EXPECT_TRUE(plan.summary.has("precise_sections"));
    EXPECT_LT(plan.precise_aspect, 1e4);
    EXPECT_GT(plan.precise_aspect, 1e3);
    EXPECT_THROW(plan_of(scene, forcing("precise_sections", false), {}, view, hardware()), Unsupported);
    // Without float64 they are refused, unless the caller allows it.
    Capabilities old = hardware();
    old.version_major = 3;
    EXPECT_THROW(plan_of(scene, {}, {}, view, old), Unsupported);
    RendererOptions inexact;
    inexact.allow_inexact = true;
    plan = plan_of(scene, inexact, {}, view, old);
    EXPECT_EQ(plan.precise_aspect, std::numeric_limits<double>::infinity());
    view.shapes.largest_aspect = 1e4;
    EXPECT_NO_THROW(plan_of(scene, {}, {}, view, old));
}

TEST(Plan, TakesSixteenBitsOnlyWhereTheyKeepTheirBound) {
    const auto chosen = [](const Scene& scene, const Capabilities& device, const Outputs& outputs = {}) {
        const DrawPlan plan = plan_of(scene, {}, outputs, facts(), device);
        EXPECT_EQ(plan.summary.has("float16"), plan.precision == Precision::float16);
        EXPECT_EQ(plan.summary.precision, plan.precision);
        return plan.precision;
    };
    const Scene plain = plain_scene();
    EXPECT_EQ(chosen(plain, hardware()), Precision::float16);
    EXPECT_LE(plan_of(plain, {}, {}, facts(), hardware()).summary.expected_error(), 1.0 / 510.0);
    expect_parts(reason_of(plan_of(plain, {}, {}, facts(), hardware()), "float16"), {"whole picture"});
    EXPECT_EQ(chosen(plain, software()), Precision::float32) << "no gain";
    Capabilities cutting = hardware();
    cutting.float16_blend_rounds = false;
    EXPECT_EQ(chosen(plain, cutting), Precision::float32) << "long sums come out dark";
    EXPECT_EQ(chosen(plain, hardware(), {true, false}), Precision::float32) << "coverage is a number";
    Scene scene = plain;
    scene.lights = {Light{}};
    EXPECT_EQ(chosen(scene, hardware()), Precision::float32) << "differences of sums";
    scene = plain;
    scene.mode = Mode::xray;
    EXPECT_EQ(chosen(scene, hardware()), Precision::float32) << "numbers";
    scene = plain;
    scene.transfer_function = TransferFunction({{0.0, {0, 0, 0}, 0.0}, {0.1, {1, 1, 1}, 0.01}, {1.0, {0, 0, 0}, 0.01}});
    EXPECT_EQ(chosen(scene, hardware()), Precision::float32) << "steep";
    expect_parts(reason_of(plan_of(scene, {}, {}, facts(), hardware()), "float16"), {"33.5", "kernels at a point"});
    // Wider kernels overlap more, whatever the view says.
    RegularFieldOptions wide = test::zero_boundary();
    wide.radius = 3.0;
    wide.falloff = 8.0;
    scene = plain;
    scene.fields = {
        std::make_shared<RegularField>(std::vector<float>(8, 1.0F), std::array<std::size_t, 3>{2, 2, 2}, wide)};
    EXPECT_EQ(chosen(scene, hardware()), Precision::float32);
    expect_parts(reason_of(plan_of(scene, {}, {}, facts(), hardware()), "float16"), {"113.1"});
    scene = plain;
    scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {0.01, {1, 1, 1}, 0.01}});
    EXPECT_EQ(chosen(scene, hardware()), Precision::float32) << "values a hundred times the window";

    // Forced beyond, the error tells what was expected.
    RendererOptions half;
    half.precision = Precision::float16;
    EXPECT_NO_THROW(static_cast<void>(plan_of(plain, half, {}, facts(), hardware())));
    const std::string message =
        message_of<Unsupported>([&] { static_cast<void>(plan_of(scene, half, {}, facts(), hardware())); });
    half.allow_inexact = true;
    const double expected = plan_of(scene, half, {}, facts(), hardware()).summary.expected_error();
    EXPECT_GT(expected, 1.0 / 510.0);
    std::ostringstream figure;
    figure.precision(4);
    figure << expected;
    expect_parts(message, {"float16", "an expected error of " + figure.str(), "0.001961", "allow_inexact"});
}

TEST(PlanOfEllipsoids, BudgetGrowsWithTheOverlap) {
    const Scene scene = scene_of({scattered()});
    const auto noise = [&](double overlap, Precision precision) {
        ViewFacts view = ellipsoid_facts();
        view.overlap.typical = overlap;
        RendererOptions options;
        options.precision = precision;
        options.allow_inexact = true;
        return plan_of(scene, options, {}, view).summary.error_budget.front().rmse;
    };
    EXPECT_EQ(noise(1.0, Precision::uint8), 1.0) << "sums of weights end at 1";
    for (const Precision precision : {Precision::float32, Precision::float16}) {
        EXPECT_GT(noise(20.0, precision), 1.5 * noise(5.0, precision)) << to_string(precision);
        EXPECT_GT(noise(1000.0, precision), 1.5 * noise(100.0, precision)) << to_string(precision);
    }
    EXPECT_NEAR(noise(400.0, Precision::float32), 0.6 * 20.0 * 6e-8, 1e-12);
    // Stores that cut off drift with the number of sums, rounding ones with its root.
    EXPECT_NEAR(noise(4000.0, Precision::float16) / noise(400.0, Precision::float16), 10.0, 1e-9);
    ViewFacts crowded = ellipsoid_facts();
    crowded.overlap.typical = 400.0;
    RendererOptions half;
    half.precision = Precision::float16;
    EXPECT_THROW(plan_of(scene, half, {}, crowded, hardware()), Unsupported);
    EXPECT_NO_THROW(plan_of(scene, half, {}, ellipsoid_facts(), hardware()));
}

TEST(PlanOfEllipsoids, BoundsValuesByWhatWeightsLeaveOfThem) {
    const ViewFacts view = ellipsoid_facts();
    const auto ratio_of = [&](const std::vector<double>& values, const std::vector<double>& weights,
                              Normalization normalization, double w0) {
        RendererOptions options;
        options.allow_inexact = true;
        const Scene scene = scene_of({scattered(values, weights, normalization, w0)});
        return plan_of(scene, options, {}, view).summary.error_budget.front().rmse / (0.6 * 6e-8 * std::sqrt(5.0));
    };
    // Window 1: the bound on |rho| itself.
    EXPECT_NEAR(ratio_of({0.5, 7.0}, {}, Normalization::threshold, 1.0), 7.0, 1e-9);
    EXPECT_NEAR(ratio_of({0.5, 7.0}, {100.0, 100.0}, Normalization::threshold, 1.0), 7.0, 1e-9) << "a mean";
    EXPECT_NEAR(ratio_of({0.5, 7.0}, {100.0, 100.0}, Normalization::none, 1.0), 700.0, 1e-6) << "a sum";
    EXPECT_NEAR(ratio_of({0.5, -7.0}, {1.0, 0.01}, Normalization::none, 1.0), 0.5, 1e-9);
    EXPECT_NEAR(ratio_of({0.5, 1e9}, {1.0, 1e-9}, Normalization::threshold, 1.0), 33.5, 1e-6)
        << "an outlier that weighs next to nothing";
    EXPECT_NEAR(ratio_of({0.5, 1e9}, {1.0, 0.0}, Normalization::threshold, 1.0), 0.5 * 33.5, 1e-6);
    EXPECT_NEAR(ratio_of({0.5, 7.0}, {}, Normalization::threshold, 1e3), 7.0 * 33.5 / 1e3, 1e-9)
        << "w0 divides more than kernels weigh";
    EXPECT_NEAR(ratio_of({0.5, 7.0}, {2.0, 1.0}, Normalization::threshold, 1e3), 7.0 * 33.5 / 1e3, 1e-9);

    // What that decides: the same numbers can be drawn with weights that tame them, and not without.
    const auto draw = [&](const std::vector<double>& weights, Normalization normalization) {
        static_cast<void>(plan_of(scene_of({scattered({0.5, 1e9}, weights, normalization)}), {}, {}, view));
    };
    EXPECT_THROW(draw({}, Normalization::threshold), Unsupported);
    EXPECT_NO_THROW(draw({1.0, 1e-9}, Normalization::threshold));
    EXPECT_NO_THROW(draw({1.0, 1e-9}, Normalization::none));
    const auto heavy = scattered({0.5, 0.7}, {1e9, 1e9}, Normalization::none);
    EXPECT_THROW(plan_of(scene_of({heavy}), {}, {}, view), Unsupported);
    EXPECT_NO_THROW(plan_of(scene_of({scattered({0.5, 0.7}, {1e9, 1e9})}), {}, {}, view));

    // Scalar pictures and isosurfaces resolve what there is.
    Scene sum = scene_of({heavy});
    sum.mode = Mode::xray;
    EXPECT_NEAR(plan_of(sum, {}, {}, view).value_unit, 0.7e9, 1.0);
    Scene surface = sum;
    surface.mode = Mode::isosurface;
    surface.iso_values = {6e8};
    EXPECT_NO_THROW(plan_of(surface, {}, {}, view));
    Scene lit = scene_of({scattered({49.5, 50.0}), scattered({0.5, 0.6}, {}, Normalization::none)});
    lit.lights = {Light{}};
    EXPECT_NO_THROW(plan_of(lit, {}, {}, view)) << "in sheets of their own quotients count from their values' middle";
}

TEST(PlanOfEllipsoids, RefusesWeightsThatSheetsCannotHold) {
    const ViewFacts view = ellipsoid_facts();
    const auto draw = [&](double weight, double w0, Precision precision, bool allow = false) {
        RendererOptions options;
        options.precision = precision;
        options.allow_inexact = allow;
        const auto field = scattered({0.5, 0.7}, {weight, weight}, Normalization::threshold, w0);
        static_cast<void>(plan_of(scene_of({field}), options, {}, view, hardware()));
    };
    EXPECT_NO_THROW(draw(1e30, 1.0, Precision::automatic));
    expect_parts(message_of<Unsupported>([&] { draw(1e36, 1.0, Precision::automatic); }),
                 {"sums of weights", "1e+36", "scale the values or the weights"});
    EXPECT_NO_THROW(draw(1e36, 1.0, Precision::automatic, true));
    EXPECT_NO_THROW(draw(100.0, 1.0, Precision::float16));
    expect_parts(message_of<Unsupported>([&] { draw(1e4, 1.0, Precision::float16); }), {"float16", "6e+04"});
    // Weights of 1e-30 cannot be told from those of 0, unless w0 drowns both.
    EXPECT_NO_THROW(draw(1e-28, 1.0, Precision::automatic));
    EXPECT_NO_THROW(draw(1e-20, 1e-28, Precision::automatic));
    expect_parts(message_of<Unsupported>([&] { draw(1e-28, 1e-28, Precision::automatic); }), {"w0", "1e-22"});
}

} // namespace
} // namespace sheetsplat

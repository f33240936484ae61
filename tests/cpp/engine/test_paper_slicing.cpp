// The 2006 paper's slicing step by step (effect paper_slicing) against the float64 reference.
#include <string>
#include <vector>

#include "support/ellipsoid_scenes.hpp"

namespace sheetsplat {
namespace {

using namespace testing;

RendererOptions with_paper_slicing(RendererOptions options = {}) {
    options.backend = Backend::gl;
    options.effects["paper_slicing"] = true;
    return options;
}

Image draw(const RendererOptions& options, const Scene& scene, const Camera& camera, Size size,
           const Outputs& outputs) {
    return Renderer(with_paper_slicing(options)).render(scene, camera, size, outputs);
}

class RandomFields : public ::testing::TestWithParam<Trial> {};

TEST_P(RandomFields, AreTheReferencesPicture) {
    const Trial& trial = GetParam();
    Scene scene = scene_of(cloud(trial.kernels, trial.radius, trial.aspect));
    scene.slice_spacing = trial.slice_spacing;
    const Image judge = by_reference(scene, askew(), trial.size);
    RendererOptions cpu;
    cpu.backend = Backend::cpu;
    for (const RendererOptions& options : {cpu, with_paper_slicing()}) {
        if (options.backend == Backend::gl && !gl_available()) {
            continue;
        }
        Image picture;
        try {
            picture = Renderer(options).render(scene, askew(), trial.size);
        } catch (const Unsupported& error) {
            // OpenGL before 4.0 slices in float32.
            EXPECT_NE(std::string(error.what()).find("1:512 at most"), std::string::npos) << error.what();
            EXPECT_GE(trial.aspect, 1000.0);
            continue;
        }
        const Difference difference =
            between(picture, judge, std::string(to_string(options.backend)) + " " + trial.name);
        EXPECT_LT(difference.rmse, 2e-5);
        EXPECT_LT(difference.p99_9, 2e-4);
        EXPECT_EQ(picture.plan->has("paper_slicing"), options.backend == Backend::gl);
    }
}

INSTANTIATE_TEST_SUITE_P(All, RandomFields, ::testing::ValuesIn(trials()));

class PaperSlicing : public ::testing::TestWithParam<Case> {};

TEST_P(PaperSlicing, DrawsTheReferencesPicture) { expect_the_references_picture(GetParam(), draw, true); }

INSTANTIATE_TEST_SUITE_P(Ellipsoids, PaperSlicing, ::testing::ValuesIn(cases()));

INSTANTIATE_TEST_SUITE_P(
    All, PaperSlicing,
    ::testing::Values(
        Case{"depth tags", [](Scene&) {}, {}, [](RendererOptions& o) { o.tagging = Tagging::depth_equal; }},
        Case{"restarted depth tags",
             [](Scene&) {},
             {},
             [](RendererOptions& o) {
                 o.tagging = Tagging::depth_equal;
                 o.tags_per_clear = 3;
             }},
        Case{"two quotients",
             [](Scene& s) {
                 s.fields.push_back(cloud(100, 0.1, 2.0, 8, normalized(Normalization::threshold, 1.0, 5.0)));
             }},
        Case{"a lattice among them", [](Scene& s) { s.fields.push_back(lattice(Normalization::lattice)); }},
        Case{"nobody in sight", // the kernels' own scene, then one whose kernels all lie beside the picture
             [](Scene& s) { s.fields.push_back(moved(1.0, Vec3(30.0, 0.0, 0.0))); }}));

class PaperSlicingControls : public WithGl {};

TEST_F(PaperSlicingControls, WrongPicturesFail) { expect_spoilt_pictures_to_fail(draw); }

TEST_F(PaperSlicingControls, IsListedAndOffUnlessAskedFor) {
    const Scene scene = scene_of(cloud(50, 0.2, 5.0));
    RendererOptions options;
    options.backend = Backend::gl;
    const RenderPlan plan = Renderer(options).plan(scene, askew(), {40, 40});
    const Image plain = Renderer(options).render(scene, askew(), {40, 40});
    const auto found = std::find_if(plan.effects.begin(), plan.effects.end(),
                                    [](const Effect& effect) { return effect.name == "paper_slicing"; });
    ASSERT_NE(found, plan.effects.end());
    EXPECT_FALSE(found->on);
    EXPECT_NE(found->reason.find("not asked for"), std::string::npos) << found->reason;
    const RenderPlan forced = Renderer(with_paper_slicing()).plan(scene, askew(), {40, 40});
    EXPECT_TRUE(forced.has("paper_slicing"));
    EXPECT_EQ(forced.packing, Packing::paper);
    options.effects = {{"paper_slicing", false}};
    const Image off = Renderer(options).render(scene, askew(), {40, 40});
    EXPECT_EQ(off.rgba, plain.rgba);
    EXPECT_EQ(off.stats.at("bytes_device"), plain.stats.at("bytes_device"));
}

TEST_F(PaperSlicingControls, AnotherViewOrFieldLeavesNothingBehind) {
    const Camera turned = Camera::orthographic({-2.0, 0.9, 1.0}, {0.5, 0.5, 0.5}, {0, 1, 0}, 1.4);
    Renderer kept(with_paper_slicing());
    for (const unsigned seed : {3U, 4U}) {
        const Scene scene = scene_of(cloud(60 + 1500 * (seed - 3), 0.12, 5.0, seed));
        static_cast<void>(kept.render(scene, askew(), {40, 36}));
        EXPECT_EQ(kept.render(scene, turned, {40, 36}).rgba,
                  Renderer(with_paper_slicing()).render(scene, turned, {40, 36}).rgba);
    }
}

class PaperSlicingRefusals : public WithGl, public ::testing::WithParamInterface<Refusal> {};

TEST_P(PaperSlicingRefusals, SayWhy) {
    expect_refusal(GetParam(), "effect paper_slicing",
                   [](const RendererOptions& options, const Scene& scene, const Camera& camera) {
                       static_cast<void>(Renderer(with_paper_slicing(options)).plan(scene, camera, {40, 40}));
                   });
}

INSTANTIATE_TEST_SUITE_P(Common, PaperSlicingRefusals, ::testing::ValuesIn(common_refusals()));

INSTANTIATE_TEST_SUITE_P(
    All, PaperSlicingRefusals,
    ::testing::Values(
        Refusal{"fine gradient", as_it_is, "fine_gradient",
                [](RendererOptions& o) {
                    o.effects = {{"fine_gradient", true}};
                }},
        Refusal{"resident sections", as_it_is, "resident_sections",
                [](RendererOptions& o) {
                    o.effects = {{"resident_sections", true}};
                }},
        Refusal{"wide packing", as_it_is, "packing wide", [](RendererOptions& o) { o.packing = Packing::wide; }},
        Refusal{"falloff",
                [](Scene& s) { s.fields = {cloud(20, 0.2, 5.0, 5, normalized(Normalization::none, 1.0, 33.0))}; },
                "a falloff of 33"},
        Refusal{"needles", [](Scene& s) { s.fields = {cloud(20, 0.2, 1e4)}; }, "ellipsoids of 1:"},
        Refusal{"small kernels",
                [](Scene& s) {
                    s.fields = {cloud(20, 2e-4, 1.0)};
                    s.slice_spacing = 1e-4;
                    s.lights.clear();
                },
                "a semi-axis of"}));

} // namespace
} // namespace sheetsplat

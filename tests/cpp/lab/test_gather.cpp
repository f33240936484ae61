// Comparator gather, where pixels look for the ellipsoids that reach them, against the float64 reference.
#include <string>

#include "lab/comparators.hpp"
#include "support/ellipsoid_scenes.hpp"

namespace sheetsplat::lab {
namespace {

using namespace sheetsplat::testing;

Comparators gather() { return comparators_of({"gather"}); }

Image draw(const RendererOptions& options, const Scene& scene, const Camera& camera, Size size,
           const Outputs& outputs) {
    Renderer renderer(options);
    return render(renderer, gather(), scene, camera, size, outputs);
}

RendererOptions on_gl() {
    RendererOptions options;
    options.backend = Backend::gl;
    return options;
}

class Gather : public WithGl {};
class GatherFields : public Gather, public ::testing::WithParamInterface<Trial> {};
class GatherCases : public Gather, public ::testing::WithParamInterface<Case> {};

TEST_P(GatherFields, AreTheReferencesPicture) {
    const Trial& trial = GetParam();
    Scene scene = scene_of(cloud(trial.kernels, trial.radius, trial.aspect));
    scene.slice_spacing = trial.slice_spacing;
    const Image judge = by_reference(scene, askew(), trial.size);
    const Difference difference = between(draw(on_gl(), scene, askew(), trial.size, {}), judge, trial.name);
    EXPECT_LT(difference.rmse, 2e-5);
    EXPECT_LT(difference.p99_9, 2e-4);
}

INSTANTIATE_TEST_SUITE_P(All, GatherFields, ::testing::ValuesIn(trials()));

TEST_P(GatherCases, AreTheReferencesPicture) { expect_the_references_picture(GetParam(), draw); }

INSTANTIATE_TEST_SUITE_P(All, GatherCases, ::testing::ValuesIn(cases()));

INSTANTIATE_TEST_SUITE_P(One, GatherCases,
                         ::testing::Values(Case{"all in one cell", [](Scene& s) { s.fields = {cloud(3, 0.3, 2.0)}; }}));

TEST_F(Gather, WrongPicturesFail) { expect_spoilt_pictures_to_fail(draw); }

TEST_F(Gather, AnotherViewOrFieldLeavesNothingBehind) {
    const Camera turned = Camera::orthographic({-2.0, 0.9, 1.0}, {0.5, 0.5, 0.5}, {0, 1, 0}, 1.4);
    Renderer kept(on_gl());
    for (const unsigned seed : {3U, 4U}) {
        const Scene scene = scene_of(cloud(60 + 1500 * (seed - 3), 0.12, 5.0, seed));
        const Image plain = kept.render(scene, askew(), {40, 36});
        static_cast<void>(render(kept, gather(), scene, askew(), {40, 36}));
        EXPECT_EQ(render(kept, gather(), scene, turned, {40, 36}).rgba,
                  draw(on_gl(), scene, turned, {40, 36}, {}).rgba);
        EXPECT_EQ(kept.render(scene, askew(), {40, 36}).rgba, plain.rgba) << "without comparators";
    }
}

class GatherRefusals : public Gather, public ::testing::WithParamInterface<Refusal> {};

TEST_P(GatherRefusals, SayWhy) {
    expect_refusal(GetParam(), "comparator gather",
                   [](const RendererOptions& options, const Scene& scene, const Camera& camera) {
                       static_cast<void>(draw(options, scene, camera, {40, 40}, {}));
                   });
}

INSTANTIATE_TEST_SUITE_P(Common, GatherRefusals, ::testing::ValuesIn(common_refusals()));

INSTANTIATE_TEST_SUITE_P(
    All, GatherRefusals,
    ::testing::Values(
        Refusal{"fine gradient", as_it_is, "differences",
                [](RendererOptions& o) {
                    o.effects = {{"fine_gradient", true}};
                }},
        Refusal{"needles", [](Scene& s) { s.fields = {cloud(20, 0.2, 2e4)}; }, "an ellipsoid of more than 1:16384"},
        Refusal{"several fields", [](Scene& s) { s.fields.push_back(cloud(5, 0.2, 1.0)); }, "several fields"},
        Refusal{"paper packing", as_it_is, "packing paper", [](RendererOptions& o) { o.packing = Packing::paper; }}));

} // namespace
} // namespace sheetsplat::lab
